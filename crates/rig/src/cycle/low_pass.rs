//! `[filter] cutoff_hz`: a low-pass of the wrench.
//!
//! Two equal first-order stages, so that a step is followed without overshoot. All their weights are positive and add up to one: the
//! same mean over variances and protection levels bounds those of the filtered wrench, however errors go together in time, and the
//! same mean over the instants is the instant that the filtered wrench refers to.

use std::f64::consts::TAU;

use model::estimator::Solution;
use nalgebra::{Matrix6, Vector6};

use super::Estimate;
use crate::status::Status;

/// Two equal stages fall by 3 dB where one has fallen by 1.5 dB: sqrt(sqrt(2) - 1) of the corner of one.
const CORNER: f64 = 0.643_594_252_905_582_6;

/// Instants count until together they have less than this share, and that is after so many time constants.
const LEAST_SHARE: f64 = 0.04;
const FORGOTTEN: f64 = 5.0;

/// After a longer gap the filter starts anew, ns.
const GAP_NS: i64 = 500_000_000;

/// Flags that stay for as long as their instants count.
const REMEMBERED: [Status; 2] = [Status::UNCERTAIN, Status::PARITY];

/// What is averaged.
#[derive(Clone, Copy, Debug)]
struct Mean {
    /// How long ago, ns.
    ago_ns: f64,
    wrench: Vector6<f64>,
    covariance: Matrix6<f64>,
    protection: [f64; 6],
    /// Share of the instants in which nothing bounds a hidden fault.
    unbounded: [f64; 6],
    /// Variances of the singular directions, N^2.
    variances_n2: [f64; 6],
}

impl Mean {
    fn of(solution: &Solution) -> Self {
        Self {
            ago_ns: 0.0,
            wrench: solution.wrench.to_vector(),
            covariance: solution.covariance,
            protection: solution.protection.map(|level| if level.is_finite() { level } else { 0.0 }),
            unbounded: solution.protection.map(|level| f64::from(u8::from(!level.is_finite()))),
            variances_n2: solution.singular_values_per_n.map(|value| 1.0 / (value * value)),
        }
    }

    fn protection(&self) -> [f64; 6] {
        let bounded = |k: usize| self.unbounded[k] < LEAST_SHARE;
        std::array::from_fn(|k| if bounded(k) { self.protection[k] } else { f64::INFINITY })
    }

    /// Moves towards another by a share.
    fn approach(&mut self, other: &Self, share: f64) {
        let mixed = |own: f64, other: f64| own + share * (other - own);
        self.ago_ns = mixed(self.ago_ns, other.ago_ns);
        self.wrench += (other.wrench - self.wrench) * share;
        self.covariance += (other.covariance - self.covariance) * share;
        for k in 0..6 {
            self.protection[k] = mixed(self.protection[k], other.protection[k]);
            self.unbounded[k] = mixed(self.unbounded[k], other.unbounded[k]);
            self.variances_n2[k] = mixed(self.variances_n2[k], other.variances_n2[k]);
        }
    }
}

/// The filter of one cycle.
#[derive(Clone, Debug)]
pub(super) struct LowPass {
    time_constant_s: f64,
    /// Both stages, and the last instant, ns.
    last: Option<([Mean; 2], i64)>,
    /// When each flag was last seen, ns.
    seen_ns: [Option<i64>; REMEMBERED.len()],
}

impl LowPass {
    /// With its -3 dB point at this frequency, Hz.
    pub(super) fn new(cutoff_hz: f64) -> Self {
        Self { time_constant_s: CORNER / (TAU * cutoff_hz), last: None, seen_ns: [None; REMEMBERED.len()] }
    }

    /// Filters the next estimate. One without a wrench stays so, and the filter starts anew after it.
    pub(super) fn apply(&mut self, estimate: &mut Estimate) {
        let now_ns = estimate.instant_ns;
        estimate.status = self.remember(now_ns, estimate.status);
        let Ok(solution) = &mut estimate.outcome else {
            self.last = None;
            return;
        };
        let next = Mean::of(solution);
        let [mut first, mut second] = match self.last {
            Some((stages, last_ns)) if (0..GAP_NS).contains(&(now_ns - last_ns)) => {
                let step_ns = (now_ns - last_ns) as f64;
                stages.map(|stage| Mean { ago_ns: stage.ago_ns + step_ns, ..stage })
            }
            _ => [next; 2],
        };
        if let Some((_, last_ns)) = self.last {
            let share = 1.0 - (-((now_ns - last_ns).max(0) as f64) * 1e-9 / self.time_constant_s).exp();
            first.approach(&next, share);
            second.approach(&first, share);
        }
        self.last = Some(([first, second], now_ns));
        solution.wrench = second.wrench.into();
        solution.covariance = second.covariance;
        solution.protection = second.protection();
        solution.singular_values_per_n = second.variances_n2.map(|variance_n2| 1.0 / variance_n2.sqrt());
        let ago_ns = second.ago_ns.round() as i64;
        estimate.instant_ns -= ago_ns;
        estimate.delay_ns += ago_ns;
    }

    /// The flags of this instant and of those that still count.
    fn remember(&mut self, now_ns: i64, status: Status) -> Status {
        let memory_ns = (FORGOTTEN * self.time_constant_s * 1e9) as i64;
        let mut all = status;
        for (flag, seen_ns) in REMEMBERED.into_iter().zip(&mut self.seen_ns) {
            if status.has(flag) {
                *seen_ns = Some(now_ns);
            }
            if seen_ns.is_some_and(|seen_ns| (0..=memory_ns).contains(&(now_ns - seen_ns))) {
                all = all.with(flag);
            }
        }
        all
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cycle::Refusal;
    use model::spatial::Wrench;

    const CUTOFF_HZ: f64 = 10.0;

    /// A wrench with this force along x, at this time, with the variance and the protection level that it is said to have.
    fn estimate(at_s: f64, fx_n: f64, variance: f64, protection: f64) -> Estimate {
        let solution = Solution {
            wrench: Wrench::from_vector(&Vector6::new(fx_n, 0.0, 0.0, 0.0, 0.0, 0.0)),
            covariance: Matrix6::identity() * variance,
            singular_values_per_n: [1.0 / variance.sqrt(); 6],
            parity_chi2: 0.0,
            parity_dof: 2,
            protection: [protection; 6],
        };
        let instant_ns = (at_s * 1e9).round() as i64;
        Estimate {
            instant_ns,
            delay_ns: 0,
            last_stamp_ns: instant_ns,
            round: 0,
            outcome: Ok(solution),
            status: Status::GOOD,
        }
    }

    fn filtered(filter: &mut LowPass, mut estimate: Estimate) -> Estimate {
        filter.apply(&mut estimate);
        estimate
    }

    fn fx(estimate: &Estimate) -> f64 {
        estimate.outcome.unwrap().wrench.force_n.x
    }

    /// The largest force that comes out of a unit swing of this frequency.
    fn amplitude(frequency_hz: f64) -> f64 {
        let mut filter = LowPass::new(CUTOFF_HZ);
        let out = (0..4000).map(|k| {
            let t = f64::from(k) * 5e-4;
            fx(&filtered(&mut filter, estimate(t, (TAU * frequency_hz * t).sin(), 1.0, 1.0)))
        });
        out.skip(2000).fold(0.0, |most, force: f64| most.max(force.abs()))
    }

    #[test]
    fn it_falls_by_three_decibel_at_its_cut_off() {
        assert!((amplitude(CUTOFF_HZ) - 0.5f64.sqrt()).abs() < 0.02, "{}", amplitude(CUTOFF_HZ));
        assert!(amplitude(0.1 * CUTOFF_HZ) > 0.98 && amplitude(10.0 * CUTOFF_HZ) < 0.05);
    }

    #[test]
    fn a_step_is_followed_without_overshoot_and_a_ramp_is_right_at_its_instant() {
        let mut filter = LowPass::new(CUTOFF_HZ);
        let mut before = 0.0;
        for k in 0..300 {
            let force =
                fx(&filtered(&mut filter, estimate(f64::from(k) * 1e-3, f64::from(k.min(1)), 1.0, 1.0)));
            assert!((before..=1.0).contains(&force), "{k}");
            before = force;
        }
        let mut filter = LowPass::new(CUTOFF_HZ);
        for k in 0..300 {
            // One round in seven is lost.
            let at_s = f64::from(k + k / 6) * 1e-3;
            let out = filtered(&mut filter, estimate(at_s, 3.0 * at_s, 1.0, 1.0));
            assert!((fx(&out) - 3.0 * out.instant_ns as f64 * 1e-9).abs() < 1e-6, "{k}");
            assert_eq!(out.instant_ns + out.delay_ns, (at_s * 1e9).round() as i64);
        }
    }

    #[test]
    fn what_is_uncertain_stays_so_while_it_counts() {
        let mut filter = LowPass::new(CUTOFF_HZ);
        let _ = filtered(&mut filter, estimate(0.0, 0.0, 1.0, 1.0));
        let mut poor = estimate(0.001, 5.0, 100.0, f64::INFINITY);
        poor.status = Status::UNCERTAIN;
        let _ = filtered(&mut filter, poor);
        let soon = filtered(&mut filter, estimate(0.002, 0.0, 1.0, 1.0));
        assert!(soon.status.has(Status::UNCERTAIN));
        let solution = soon.outcome.unwrap();
        assert!(solution.covariance[(0, 0)] > 1.0 && solution.singular_values_per_n[5] < 1.0);
        let later =
            (3..200).map(|k| filtered(&mut filter, estimate(f64::from(k) * 1e-3, 0.0, 1.0, 1.0))).last();
        let later = later.unwrap();
        assert_eq!(later.status, Status::GOOD);
        assert!((later.outcome.unwrap().protection[0] - 1.0).abs() < 0.01);
    }

    #[test]
    fn without_a_wrench_it_starts_anew() {
        let mut filter = LowPass::new(CUTOFF_HZ);
        let _ = filtered(&mut filter, estimate(0.0, 7.0, 1.0, 1.0));
        let mut none = estimate(0.001, 0.0, 1.0, 1.0);
        none.outcome = Err(Refusal::Fault);
        let none = filtered(&mut filter, none);
        assert_eq!((none.outcome, none.instant_ns), (Err(Refusal::Fault), 1_000_000));
        let anew = filtered(&mut filter, estimate(0.002, 1.0, 1.0, 1.0));
        assert_eq!((fx(&anew), anew.delay_ns), (1.0, 0));
    }
}
