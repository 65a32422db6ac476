//! Sensitivity to loads that the channel should not see: the sensing axis is not where it was meant to be.
//!
//! The compliance vector of a section is `r [l x R, R]` (Y.-L. Kim, J.-J. Park, J.-B. Song, J. Mech. Sci. Technol. 24(8), 2010); a
//! small turn or shift adds multiples of the other load components. Of a gauge whose section's load is known, the columns are
//! the derivatives of that vector by the axis' four numbers, half way to where the axis went: then they make up the whole change to
//! third order. Tried as well: with the scale alongside, and the whole vector for an axis that is far off. A gauge whose model has no
//! crosstalk at all was never calibrated for any: the zero that came with such a model has taken up the mean of what crosstalk added,
//! so zeros are fitted alongside the whole vector.
//! With nothing but load columns given each is a column here.

use model::sensing::{ActualFrame, Compliance};
use nalgebra::Vector6;

use super::zero_offset::zeros;
use super::*;
use crate::session::Gauge;

/// Crosstalk of loads.
pub(super) struct SensingAxis;

/// The axis turned and shifted; what follows are the four numbers by which it did, where the columns are to hold for so much.
const TURNED: f64 = 2.0;
/// Turns, shifts, and the scale.
const MOVED: f64 = 0.0;
/// Any compliance.
const WHOLE: f64 = 1.0;
/// Share of a change by which columns may miss it.
const STRAIGHT_ENOUGH: f64 = 0.01;
/// How far an axis may be off: rad, rad, m, m.
const PLAUSIBLE: [f64; 4] = [0.2, 0.2, 0.02, 0.02];

impl Effect for SensingAxis {
    fn id(&self) -> &'static str {
        "sensing_axis"
    }

    fn words(&self) -> &'static str {
        "crosstalk of other load components (a sensing axis off its place)"
    }

    fn remedy(&self) -> &'static str {
        "calibrate the full compliance of the sensor"
    }

    fn missing(&self, session: &Session) -> Option<String> {
        if session.loads.len() < 2 && session.channels.iter().all(|channel| channel.gauge.is_none()) {
            return Some("the other components of the load ([covariates] load = [columns])".to_owned());
        }
        None
    }

    fn places(&self, session: &Session) -> Vec<Place> {
        every_channel(session)
    }

    fn shapes(&self, session: &Session, place: Place) -> Vec<Shape> {
        let Place::Channel(channel) = place else { return Vec::new() };
        match &session.channels[channel].gauge {
            None => vec![Shape::new()],
            Some(gauge) if is_nominal(gauge) => vec![vec![WHOLE]],
            Some(_) => vec![vec![TURNED], vec![MOVED], vec![WHOLE]],
        }
    }

    fn is_exact(&self) -> bool {
        true
    }

    /// Which of the three kinds: where the axis went follows from what the columns are fitted to.
    fn searched(&self, _shape: &[f64]) -> usize {
        1
    }

    fn is_curved(&self) -> bool {
        true
    }

    fn straightened(&self, session: &Session, term: &Fitted<'_>) -> Option<Shape> {
        let Place::Channel(channel) = term.place else { return None };
        straightened(session.channels[channel].gauge.as_ref()?, term.shape, term.values)
    }

    fn columns(&self, session: &Session, place: Place, shape: &[f64]) -> Vec<Column> {
        let Place::Channel(channel) = place else { return Vec::new() };
        let Some(gauge) = &session.channels[channel].gauge else { return of_loads(session, channel) };
        let directions = directions(gauge, shape);
        let mut columns: Vec<Column> =
            directions.iter().map(|direction| direction.column(gauge, channel, shape[0] == WHOLE)).collect();
        if is_nominal(gauge) && !columns.is_empty() {
            columns.extend(zeros(session, channel).into_iter().map(|zero| zero.role(Role::Nuisance)));
        }
        columns
    }

    fn report(&self, session: &Session, term: &Fitted<'_>) -> Option<Vec<Reported>> {
        let Place::Channel(channel) = term.place else { return None };
        let gauge = session.channels[channel].gauge.as_ref()?;
        let directions = directions(gauge, term.shape);
        let compliance = gauge.compliance + changed_by(&directions, term.values);
        let before = Compliance::from_vector(&gauge.compliance).actual_frame()?;
        let after = Compliance::from_vector(&compliance).actual_frame()?;
        let are_numbers = term.shape[0] != WHOLE && directions.len() >= NAMES.len();
        let sigmas = are_numbers.then_some(term.sigmas);
        Some(reported(&before, &after, sigmas))
    }

    fn compensate(&self, session: &Session, term: &Fitted<'_>) -> Vec<Compensation> {
        let Place::Channel(channel) = term.place else { return Vec::new() };
        let Some(gauge) = &session.channels[channel].gauge else { return Vec::new() };
        let directions = directions(gauge, term.shape);
        let change = changed_by(&directions, term.values);
        let mut out = vec![Compensation::Compliance { gauge: channel, change }];
        // What follows the directions are zeros, one a session: the model has room for their mean.
        let zeros = term.values.get(directions.len()..).unwrap_or_default();
        if !zeros.is_empty() {
            let counts = zeros.iter().sum::<f64>() / zeros.len() as f64;
            out.push(Compensation::Bias { gauge: channel, counts });
        }
        out
    }

    fn experiment(&self) -> &'static str {
        "loads in other directions at other points"
    }
}

fn reported(before: &ActualFrame, after: &ActualFrame, sigmas: Option<&[f64]>) -> Vec<Reported> {
    let turned = |a: f64, b: f64| {
        (b - a + std::f64::consts::PI).rem_euclid(std::f64::consts::TAU) - std::f64::consts::PI
    };
    let values = [
        ("d_ax", turned(before.a_x_rad, after.a_x_rad), "rad"),
        ("d_ay", turned(before.a_y_rad, after.a_y_rad), "rad"),
        ("d_lx", after.l_x_m - before.l_x_m, "m"),
        ("d_ly", after.l_y_m - before.l_y_m, "m"),
    ];
    let of = |(k, (name, value, unit)): (usize, (&str, f64, &str))| {
        (name.to_owned(), value, sigmas.map(|sigmas| sigmas[k]), unit.to_owned())
    };
    values.into_iter().enumerate().map(of).collect()
}

/// A frame whose axis moved by this part of a_x, a_y (rad), l_x, l_y (m).
fn moved(mut frame: ActualFrame, numbers: &[f64; 4], part: f64) -> ActualFrame {
    frame.a_x_rad += part * numbers[0];
    frame.a_y_rad += part * numbers[1];
    frame.l_x_m += part * numbers[2];
    frame.l_y_m += part * numbers[3];
    frame
}

/// Change of the compliance by each of these four numbers, half way to them.
fn tangent(compliance: &Vector6<f64>, to: &[f64; 4]) -> Option<[Vector6<f64>; 4]> {
    let half = moved(Compliance::from_vector(compliance).actual_frame()?, to, 0.5);
    let of = |number: usize| {
        let step = 1e-6;
        let mut one = [0.0; 4];
        one[number] = 1.0;
        let at = |sign: f64| moved(half, &one, sign * step).compliance().vector();
        (at(1.0) - at(-1.0)) / (2.0 * step)
    };
    Some([0, 1, 2, 3].map(of))
}

/// Whether its model knows of no crosstalk: nothing but the moment about the nominal axis.
fn is_nominal(gauge: &Gauge) -> bool {
    (0..5).all(|k| gauge.compliance[k] == 0.0)
}

/// The shape whose columns make up the whole change by these numbers, where those of this one do not.
fn straightened(gauge: &Gauge, shape: &[f64], numbers: &[f64]) -> Option<Shape> {
    let to: &[f64; 4] = numbers.try_into().ok().filter(|_| shape.first() == Some(&TURNED))?;
    let before = Compliance::from_vector(&gauge.compliance).actual_frame()?;
    let change = moved(before, to, 1.0).compliance().vector() - gauge.compliance;
    let missed = change - changed_by(&directions(gauge, shape), numbers);
    let size = |change: Vector6<f64>| {
        let force = change.fixed_rows::<3>(0).norm() * model::sensing::CHARACTERISTIC_LENGTH_M;
        force.hypot(change.fixed_rows::<3>(3).norm())
    };
    (size(missed) > STRAIGHT_ENOUGH * size(change)).then(|| [&[TURNED][..], numbers].concat())
}

fn components() -> Vec<Vector6<f64>> {
    (0..6).map(|k| Vector6::ith(k, 1.0)).collect()
}

/// Counts that a change of the compliance makes of the section's load, per row.
pub(super) fn changed(gauge: &Gauge, change: &Vector6<f64>) -> Vec<f64> {
    gauge.loads.iter().map(|load| change.dot(load)).collect()
}

/// A way in which the compliance may change, that the data shows.
struct Direction {
    /// Which of the axis' numbers (the scale last), or which component.
    number: usize,
    change: Vector6<f64>,
}

const NAMES: [&str; 4] = ["d_ax", "d_ay", "d_lx", "d_ly"];
const UNITS: [&str; 4] = ["rad", "rad", "m", "m"];

impl Direction {
    fn column(&self, gauge: &Gauge, channel: usize, is_component: bool) -> Column {
        let values = changed(gauge, &self.change);
        if is_component {
            // A gauge whose axis points anywhere, up to two characteristic lengths away.
            let scale = 2.0 * gauge.compliance.fixed_rows::<3>(3).norm();
            let length_m = model::sensing::CHARACTERISTIC_LENGTH_M;
            let plausible = if self.number < 3 { scale * length_m } else { scale };
            return Column::value("", "counts/N or counts/Nm", plausible, channel, values);
        }
        match NAMES.get(self.number) {
            Some(name) => Column::value(name, UNITS[self.number], PLAUSIBLE[self.number], channel, values),
            None => Column::value("", "1", 0.05, channel, values).role(Role::Nuisance),
        }
    }
}

/// The ways of a shape, in the order of its columns.
fn directions(gauge: &Gauge, shape: &[f64]) -> Vec<Direction> {
    let to = shape.get(1..).and_then(|to| to.try_into().ok()).unwrap_or_default();
    let turns = || tangent(&gauge.compliance, &to).map(Vec::from).unwrap_or_default();
    let all = match shape[0] {
        TURNED => turns(),
        MOVED => turns().into_iter().chain([gauge.compliance]).collect(),
        _ => components(),
    };
    let of = |(number, change): (usize, Vector6<f64>)| {
        let is_loaded = gauge.loads.iter().any(|load| change.dot(load) != 0.0);
        is_loaded.then_some(Direction { number, change })
    };
    all.into_iter().enumerate().filter_map(of).collect()
}

fn changed_by(directions: &[Direction], values: &[f64]) -> Vector6<f64> {
    directions.iter().zip(values).map(|(direction, value)| direction.change * *value).sum()
}

/// One column a load that is given.
fn of_loads(session: &Session, channel: usize) -> Vec<Column> {
    let own = &session.channels[channel];
    let span = deviation(&own.simulated).max(own.rms_gap());
    let mut columns = Vec::new();
    for load in session.loads.iter().filter(|load| deviation(&load.values) > 0.0) {
        let plausible = span / deviation(&load.values);
        let column = Column::value(&format!("c_{}", load.name), "1", plausible, channel, load.values.clone());
        // An axis that turns loses some of its own load, and what hangs on a lever loads several components at once.
        let is_own = is_same(&load.values, &own.simulated);
        columns.push(if is_own { column.role(Role::Nuisance) } else { column });
    }
    columns
}

/// Whether one column repeats the other but for rounding.
fn is_same(a: &[f64], b: &[f64]) -> bool {
    let tolerance = 1e-9 * a.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
    a.iter().zip(b).all(|(a, b)| (a - b).abs() <= tolerance)
}

#[cfg(test)]
mod tests {
    use nalgebra::{SMatrix, Vector4};

    use super::*;

    #[test]
    fn an_axis_that_turned_far_is_found_by_its_four_numbers_alone() {
        let compliance = Vector6::new(20.0, -310.0, 0.0, 8e3, 1.6e4, 1.6e5);
        let frame = Compliance::from_vector(&compliance).actual_frame().unwrap();
        let compliance = frame.compliance().vector();
        let gauge = Gauge { compliance, bias_counts: 0.0, loads: components(), temperature_c: None };
        let put_in = [0.25, -0.15, 0.05, -0.08];
        let change = moved(frame, &put_in, 1.0).compliance().vector() - compliance;
        let mut shape = vec![TURNED];
        let mut misses = Vec::new();
        loop {
            let ways = directions(&gauge, &shape);
            let ways = SMatrix::<f64, 6, 4>::from_fn(|r, c| ways[c].change[r]);
            let numbers: Vector4<f64> = ways.svd(true, true).solve(&change, 0.0).unwrap_or_default();
            misses.push((change - ways * numbers).norm() / change.norm());
            let Some(next) = straightened(&gauge, &shape, numbers.as_slice()) else {
                assert!((numbers - Vector4::from(put_in)).amax() < 0.01, "{numbers}");
                break;
            };
            shape = next;
            assert!(misses.len() < 8, "{misses:?}");
        }
        assert!(misses[0] > 0.05 && misses.last().is_some_and(|miss| *miss < 0.005), "{misses:?}");
    }
}
