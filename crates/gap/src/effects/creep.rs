//! A signal that goes on changing under a constant load: a lag of the signal added to it, 0.02..1 %.
//!
//! One first-order lag, or many with times over two decades, as strong each: what polymers and glues do goes with a small power of
//! time, nearly with its logarithm, and has no time of its own. What was calibrated is either what is there at once (then the lag is
//! added), or what is there in the end (then the lag less the signal is), or something between, when a scale comes along with it; which of
//! all these is part of the shape. W. Findley, J. Lai,
//! K. Onaran, Creep and Relaxation of Nonlinear Viscoelastic Materials, 1976, ch. 5.

use super::*;

/// What is there at once was calibrated.
const AT_ONCE: f64 = 0.0;
/// What is there in the end was.
const IN_THE_END: f64 = 1.0;
/// Something between was: a scale comes with it.
const BETWEEN: f64 = 2.0;
/// One lag, or many.
const ONE: f64 = 0.0;
const MANY: f64 = 1.0;
/// Their times against the middle one. Where what is there at once was calibrated only the slow half: a lag that is shorter than the
/// load's changes is a wrong scale, not creep.
const TIMES: [f64; 5] = [0.1, 0.316, 1.0, 3.16, 10.0];
const SLOW: std::ops::Range<usize> = 2..5;

/// A signal that goes on changing under a constant load: a lag of the signal added to it, 0.02..1 %.
pub(super) struct Creep;

impl Effect for Creep {
    fn id(&self) -> &'static str {
        "creep"
    }

    fn words(&self) -> &'static str {
        "creep of the sensor"
    }

    fn remedy(&self) -> &'static str {
        "wait before reading, or compensate by the load's history"
    }

    fn missing(&self, session: &Session) -> Option<String> {
        without_time_or_signal(session)
    }

    fn places(&self, session: &Session) -> Vec<Place> {
        moving_channels(session)
    }

    fn shape_parameters(&self) -> &'static [(&'static str, &'static str)] {
        &[("tau_s", "s")]
    }

    fn shapes(&self, session: &Session, _place: Place) -> Vec<Shape> {
        let (Some(step_s), Some(longest_s)) = (session.step_s(), session.longest_s()) else {
            return Vec::new();
        };
        let times = geometric((20.0 * step_s).max(1.0), longest_s.max(40.0 * step_s).max(2.0), 7);
        let kinds = [IN_THE_END, AT_ONCE, BETWEEN];
        let one = kinds.iter().flat_map(|kind| times.iter().map(|tau| vec![tau[0], *kind, ONE]));
        // So broad that every other will do.
        let every_other = || times.iter().skip(1).step_by(2);
        let many = kinds.iter().flat_map(|kind| every_other().map(|tau| vec![tau[0], *kind, MANY]));
        one.chain(many).collect()
    }

    fn is_continuous(&self) -> bool {
        true
    }

    fn columns(&self, session: &Session, place: Place, shape: &[f64]) -> Vec<Column> {
        let Place::Channel(channel) = place else { return Vec::new() };
        let own = &session.channels[channel];
        let (kind, signal) = (shape[1], &own.simulated);
        let is_many = shape[2] == MANY;
        let values =
            if is_many { broad(session, signal, shape[0], kind) } else { lagged(session, signal, shape[0]) };
        let share = if kind == IN_THE_END { 1.0 } else { 0.0 };
        let values = values.iter().zip(&own.simulated).map(|(slow, signal)| slow - share * signal).collect();
        let slow = Column::value("relative", "1", 0.1, channel, values);
        if kind != BETWEEN {
            return vec![slow];
        }
        let scale = Column::value("", "1", 0.1, channel, own.simulated.clone()).role(Role::Nuisance);
        vec![slow, scale]
    }

    fn experiment(&self) -> &'static str {
        "a load put on at once and left for ten minutes"
    }
}

/// Mean of the lags about a time (s).
fn broad(session: &Session, values: &[f64], tau_s: f64, kind: f64) -> Vec<f64> {
    let times = if kind == IN_THE_END { &TIMES[..] } else { &TIMES[SLOW] };
    let mut sum = vec![0.0; values.len()];
    for factor in times {
        let slow = lagged(session, values, factor * tau_s);
        sum.iter_mut().zip(slow).for_each(|(sum, slow)| *sum += slow / times.len() as f64);
    }
    sum
}
