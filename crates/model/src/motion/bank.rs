//! The bank of Kalman filters of one joint, all worked on at once: at rest, and moving with each strength of snap.

mod belief;

use nalgebra::{Matrix4, Vector4};
use wide::f64x8;

use super::kalman::{
    CREEP, SHIVER, State, UNIT_S, inner_density, inner_step, inner_variance, stopping, unit_process,
};
use super::{DWELL_S, REST_S, SNAP_DENSITIES, Sampled};

/// At rest, and moving with each strength of snap: one filter a lane.
pub(super) const MODELS: usize = 1 + SNAP_DENSITIES.len();

/// Place of an element among those of the upper triangle of a covariance, row by row.
const PLACE: [[usize; 4]; 4] = [[0, 1, 2, 3], [1, 4, 5, 6], [2, 5, 7, 8], [3, 6, 8, 9]];

/// Rows and columns of these elements.
const ELEMENTS: [(usize, usize); 10] =
    [(0, 0), (0, 1), (0, 2), (0, 3), (1, 1), (1, 2), (1, 3), (2, 2), (2, 3), (3, 3)];

/// Kalman filters side by side, and how much each is believed.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bank {
    states: States,
    weights: f64x8,
}

/// Means and covariances (upper triangles) of position, velocity, acceleration and jerk, as [`State`] has them.
#[derive(Clone, Copy, Debug)]
struct States {
    mean: [f64x8; 4],
    covariance: [f64x8; 10],
}

impl Bank {
    /// At a position (rad), and nothing known of the motion.
    pub(super) fn at(position_rad: f64, variance_rad2: f64) -> Self {
        let state = State::from_position(position_rad, variance_rad2);
        let covariance = ELEMENTS.map(|element| f64x8::splat(state.covariance[element]));
        let mean = std::array::from_fn(|k| f64x8::splat(state.mean[k]));
        Self { states: States { mean, covariance }, weights: f64x8::splat(1.0 / MODELS as f64) }
    }

    /// What the filters together say.
    pub(super) fn mixture(&self) -> State {
        let weigh = |values: f64x8| (values * self.weights).reduce_add();
        let means = self.states.mean.map(weigh);
        let apart: [f64x8; 4] = std::array::from_fn(|k| self.states.mean[k] - f64x8::splat(means[k]));
        let elements: [f64; 10] = std::array::from_fn(|at| {
            let (i, k) = ELEMENTS[at];
            weigh(self.states.covariance[at] + apart[i] * apart[k])
        });
        State { mean: Vector4::from(means), covariance: Matrix4::from_fn(|i, k| elements[PLACE[i][k]]) }
    }

    /// Strength of snap that the filters together expect, rad^2/s^7.
    pub(super) fn density(&self) -> f64 {
        self.weights.as_array()[1..]
            .iter()
            .zip(&SNAP_DENSITIES)
            .map(|(weight, density)| weight * density)
            .sum()
    }

    /// How far a position is from where the filters for moving joints expect it, rad, the nearest of them.
    pub(super) fn nearest_rad(&self, position_rad: f64) -> Option<f64> {
        let off_rad = |mean_rad: &f64| position_rad - mean_rad;
        let means_rad = &self.states.mean[0].as_array()[1..];
        means_rad.iter().map(off_rad).min_by(|a, b| a.abs().total_cmp(&b.abs()))
    }

    /// Variance of a position (rad^2) that the filter for the strongest snap expects, read at a time that is uncertain by `jitter_s`.
    pub(super) fn boldest_variance(&self, variance_rad2: f64, jitter_s: f64) -> f64 {
        let of = |values: &f64x8| values.as_array()[MODELS - 1];
        of(&(self.states.covariance[0] + self.smear_rad2((jitter_s / UNIT_S).powi(2)))) + variance_rad2
    }

    /// Variance of a position (rad^2), each filter's, by the time at which it was read, of this variance (inner units): as far as
    /// velocity and, where a joint reverses, acceleration carry it.
    fn smear_rad2(&self, time2: f64) -> f64x8 {
        let [_, velocity, acceleration, _] = self.states.mean;
        velocity * velocity * time2 + acceleration * acceleration * (0.5 * time2 * time2.max(0.0))
    }

    /// Lets each filter take in a position (rad) whose own sampling instant is uncertain by `jitter_s`: at speed it counts for less.
    pub(super) fn measure_position(&mut self, position_rad: f64, variance_rad2: f64, jitter_s: f64) {
        let smear_rad2 = self.smear_rad2((jitter_s / UNIT_S).powi(2));
        self.measure::<0>(position_rad, smear_rad2 + variance_rad2);
    }

    /// Lets each filter take in a velocity, rad/s.
    pub(super) fn measure_velocity(&mut self, velocity_rad_s: f64, sigma_rad_s: f64) {
        self.measure::<1>(velocity_rad_s * UNIT_S, f64x8::splat((sigma_rad_s * UNIT_S).powi(2)));
    }

    /// Lets each filter take in a measurement of one state, and believes it as well as it had predicted that.
    fn measure<const STATE: usize>(&mut self, value: f64, variance: f64x8) {
        let States { mean, covariance } = &mut self.states;
        let column: [f64x8; 4] = std::array::from_fn(|i| covariance[PLACE[i][STATE]]);
        let innovation_variance = column[STATE] + variance;
        let innovation = f64x8::splat(value) - mean[STATE];
        let gain = column.map(|element| element / innovation_variance);
        (0..4).for_each(|i| mean[i] += gain[i] * innovation);
        for (element, (i, k)) in covariance.iter_mut().zip(ELEMENTS) {
            *element -= gain[i] * column[k];
        }
        let spread_ln = f64x8::new(innovation_variance.to_array().map(f64::ln));
        self.reweigh((innovation * innovation / innovation_variance + spread_ln) * -0.5);
    }

    /// Weighs the filters by the log-likelihood of what they just measured. A floor keeps each motion reachable; rest is, from any that may stop.
    fn reweigh(&mut self, fit: f64x8) {
        const FLOOR: f64x8 = f64x8::new([0.0, 1e-12, 1e-12, 1e-12, 1e-12, 1e-12, 1e-12, 1e-12]);
        let best = fit.as_array().iter().copied().fold(f64::NEG_INFINITY, f64::max);
        if !best.is_finite() {
            return;
        }
        let likelihood = f64x8::new((fit - f64x8::splat(best)).to_array().map(f64::exp));
        let weights = (self.weights * likelihood).max(FLOOR);
        self.weights = weights / f64x8::splat(weights.reduce_add());
    }

    /// Mixes the filters by the chance that what the joint does has changed, then predicts each over the step.
    pub(super) fn advance(&mut self, last: &Sampled, at: &Sampled) {
        let step = inner_step(last, at);
        let chances = Chances::over(step * UNIT_S);
        // From a strength of snap to one of those beside it, or to rest.
        let change = self.weights * chances.change;
        let parts = Parts {
            rest: self.weights.as_array()[0] * chances.wake,
            below: shifted_up(change),
            same: self.weights * f64x8::splat(chances.stay),
            above: shifted_down(change),
        };
        let mut to_rest = change;
        to_rest.as_mut_array()[0] = self.weights.as_array()[0] * chances.sleep;
        let stops = self.states.may_stop(step);
        let mut expected = parts.total();
        expected.as_mut_array()[0] = (to_rest * stops).reduce_add();
        let resting = self.states.resting(&to_rest, step);
        self.states = self.states.mixed(&parts);
        self.states.predict(step);
        self.states.smear(inner_variance(last, at));
        self.states.put(0, &resting);
        self.weights = expected / f64x8::splat(expected.reduce_add());
    }
}

/// What the joint may have come from, for every strength of snap: unnormalised shares.
struct Parts {
    rest: f64,
    below: f64x8,
    same: f64x8,
    above: f64x8,
}

impl Parts {
    fn total(&self) -> f64x8 {
        self.below + self.same + self.above + f64x8::splat(self.rest)
    }
}

/// Chances that a joint does something else after a step. From rest it goes to any strength of snap alike; from one strength to those beside
/// it or to rest.
struct Chances {
    /// From rest to rest, and to each strength.
    sleep: f64,
    wake: f64,
    /// From a strength to itself, and to each of those that it may go to.
    stay: f64,
    change: f64x8,
}

impl Chances {
    fn over(step_s: f64) -> Self {
        const BESIDE: f64x8 =
            f64x8::new([0.0, 0.5, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 3.0, 0.5]);
        let wake = 1.0 - (-step_s / REST_S).exp();
        let change = 1.0 - (-step_s / DWELL_S).exp();
        Self {
            sleep: 1.0 - wake,
            wake: wake / (MODELS - 1) as f64,
            stay: 1.0 - change,
            change: BESIDE * f64x8::splat(change),
        }
    }
}

/// Each moving filter's place taken by the one for weaker snap.
fn shifted_up(values: f64x8) -> f64x8 {
    let [_, b, c, d, e, f, g, _] = values.to_array();
    f64x8::new([0.0, 0.0, b, c, d, e, f, g])
}

/// Each moving filter's place taken by the one for stronger snap.
fn shifted_down(values: f64x8) -> f64x8 {
    let [_, _, c, d, e, f, g, h] = values.to_array();
    f64x8::new([0.0, c, d, e, f, g, h, 0.0])
}

impl States {
    /// How likely it is, against a joint that stands, that each comes to rest within `step` inner time units: none stops dead. One at rest: 1.
    fn may_stop(&self, step: f64) -> f64x8 {
        let lost = stopping(step);
        let [rate, variance] = [self.mean[1], self.covariance[PLACE[1][1]]];
        let exponent = rate * rate / (variance + f64x8::splat(lost * lost)) * -0.5;
        let mut stops = exponent.to_array().map(f64::exp);
        stops[0] = 1.0;
        f64x8::new(stops)
    }

    /// The filter for rest `step` inner time units later, if its parts have these shares: it stays where they are, but for what a held joint creeps.
    fn resting(&self, shares: &f64x8, step: f64) -> State {
        let shares = *shares / f64x8::splat(shares.reduce_add());
        let mean = (self.mean[0] * shares).reduce_add();
        let apart = self.mean[0] - f64x8::splat(mean);
        let variance = ((self.covariance[0] + apart * apart) * shares).reduce_add();
        let variances =
            Vector4::new(variance + (CREEP * step).powi(2), CREEP.powi(2), SHIVER.powi(2), SHIVER.powi(2));
        State { mean: Vector4::new(mean, 0.0, 0.0, 0.0), covariance: Matrix4::from_diagonal(&variances) }
    }

    /// Mixtures of rest, the filters for weaker, the same and stronger snap.
    fn mixed(&self, parts: &Parts) -> Self {
        let per_total = f64x8::ONE / parts.total();
        let [below, same, above] = [parts.below, parts.same, parts.above].map(|part| part * per_total);
        let rest = per_total * f64x8::splat(parts.rest);
        let of_rest = |values: &f64x8| f64x8::splat(values.as_array()[0]);
        let mean: [f64x8; 4] = std::array::from_fn(|k| {
            let own = self.mean[k];
            of_rest(&own) * rest + shifted_up(own) * below + own * same + shifted_down(own) * above
        });
        let apart: [[f64x8; 4]; 4] = std::array::from_fn(|k| {
            let own = self.mean[k];
            [of_rest(&own), shifted_up(own), own, shifted_down(own)].map(|value| value - mean[k])
        });
        let covariance = std::array::from_fn(|at| {
            let (i, k) = ELEMENTS[at];
            let own = self.covariance[at];
            (of_rest(&own) + apart[i][0] * apart[k][0]) * rest
                + (shifted_up(own) + apart[i][1] * apart[k][1]) * below
                + (own + apart[i][2] * apart[k][2]) * same
                + (shifted_down(own) + apart[i][3] * apart[k][3]) * above
        });
        Self { mean, covariance }
    }

    /// Carries all on by `step` inner time units, each driven by its strength of snap.
    fn predict(&mut self, step: f64) {
        let process = unit_process(step);
        let densities = f64x8::new(std::array::from_fn(|k| match k.checked_sub(1) {
            None => 0.0,
            Some(k) => inner_density(SNAP_DENSITIES[k]),
        }));
        let powers = [1.0, step, step * step / 2.0, step * step * step / 6.0].map(f64x8::splat);
        let carried = |of: &dyn Fn(usize) -> f64x8, from: usize| {
            (1..4 - from).fold(of(from), |sum, n| sum + of(from + n) * powers[n])
        };
        self.mean = std::array::from_fn(|i| carried(&|k| self.mean[k], i));
        let half: [f64x8; 10] = std::array::from_fn(|at| {
            let (i, k) = ELEMENTS[at];
            carried(&|row| self.covariance[PLACE[row][k]], i)
        });
        self.covariance = std::array::from_fn(|at| {
            let (i, k) = ELEMENTS[at];
            carried(&|column| half[PLACE[i][column]], k) + densities * process[(i, k)]
        });
    }

    /// As [`State::smeared`]: the instant that all refer to is unsure by this variance (inner units).
    fn smear(&mut self, variance: f64) {
        let [_, b, c, d] = self.mean;
        let (first, second) = (f64x8::splat(variance), f64x8::splat(0.5 * variance));
        let twice = second * f64x8::splat(variance);
        self.mean[0] += c * second;
        self.mean[1] += d * second;
        self.covariance[0] += b * b * first + c * c * twice;
        self.covariance[1] += b * c * first + c * d * twice;
        self.covariance[2] += b * d * first;
        self.covariance[4] += c * c * first + d * d * twice;
        self.covariance[5] += c * d * first;
        self.covariance[7] += d * d * first;
    }

    /// Puts a state into the place of a filter.
    fn put(&mut self, filter: usize, state: &State) {
        (0..4).for_each(|k| self.mean[k].as_mut_array()[filter] = state.mean[k]);
        for (element, place) in self.covariance.iter_mut().zip(ELEMENTS) {
            element.as_mut_array()[filter] = state.covariance[place];
        }
    }
}
