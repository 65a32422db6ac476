//! Faults that nothing but the other gauges tells of.
//!
//! What can be told apart is computed here by another way than the product's: the projector onto what six unknowns leave, from an SVD.

use nalgebra::{DMatrix, DVector};
use rig::Rig;
use rig::Status;
use rig::config::PublishMode;
use rig::cycle::{Cycle, Estimate, GaugeState, Refusal};
use sim::{Options, Scenario, Simulator, Trajectory};

use crate::common::{model, rig, truth};
use crate::gauge::change;

/// Rate of these simulations, Hz, and the instants that 50 ms hold at it.
const RATE_HZ: f64 = 125.0;
const INSTANTS: f64 = 6.25;

/// When faults begin, s.
const FAULT_S: f64 = 0.4;

/// A held pose under a weight, and what a fault in it comes to.
struct Pose {
    rig: Rig,
    simulator: Box<dyn Fn() -> Simulator>,
}

fn pose(seed: u64, seconds: f64) -> Pose {
    let rig = rig(PublishMode::Event);
    let scenario = sim::Preset::Holds.scenario(&rig.chain, seed).unwrap();
    let start: Vec<f64> = scenario.trajectory.last_pose().to_vec();
    let mut trajectory = Trajectory::from_pose(start);
    trajectory.hold(seconds);
    let scenario = Scenario::of_motion(trajectory).with_load(0.4, [0.01, 0.0, 0.05]).unwrap();
    let options = Options { rate_hz: Some(RATE_HZ), seed, ..Options::default() };
    let (of, truth) = (rig.clone(), truth(&rig));
    let simulator = move || Simulator::new(&of, truth.clone(), &scenario, options).unwrap();
    Pose { rig, simulator: Box::new(simulator) }
}

/// What became of a fault.
#[derive(Debug, Default)]
struct Outcome {
    /// Gauges that were isolated at any time.
    isolated: Vec<usize>,
    /// From the fault to the first flag, to the isolation, and to the last instant of it, s.
    flagged_s: Option<f64>,
    isolated_s: Option<f64>,
    isolated_until_s: f64,
    /// Instants, and those with a wrench farther from the truth than it may be.
    instants: usize,
    wrong: usize,
    last: Option<Estimate>,
    suspects: Vec<usize>,
}

impl Pose {
    fn cycle(&self) -> Cycle {
        Cycle::new(&self.rig, &model(&self.rig, &truth(&self.rig))).unwrap()
    }

    /// Runs the cycle over frames in which `fault` (s since the fault's beginning, gauge, counts) changes readings.
    fn run(&self, mut fault: impl FnMut(f64, usize, f64) -> f64) -> Outcome {
        let (mut cycle, mut world) = (self.cycle(), (self.simulator)());
        let mut outcome = Outcome::default();
        for mut frame in (self.simulator)() {
            let since_s = (frame.stamp_ns - sim::START_NS) as f64 * 1e-9 - FAULT_S;
            if since_s >= 0.0 {
                (0..8).for_each(|gauge| change(&mut frame, gauge, |counts| fault(since_s, gauge, counts)));
            }
            let mut last = None;
            cycle.push(&frame, |estimate| last = Some(estimate.clone()));
            let Some(estimate) = last else { continue };
            let since_s = (estimate.instant_ns - sim::START_NS) as f64 * 1e-9 - FAULT_S;
            outcome.instants += 1;
            if estimate.status.has(Status::PARITY) {
                outcome.flagged_s.get_or_insert(since_s);
            }
            for gauge in 0..8 {
                if cycle.stage().gauge_states()[gauge] == GaugeState::Isolated {
                    outcome.isolated_s.get_or_insert(since_s);
                    outcome.isolated_until_s = since_s;
                    if !outcome.isolated.contains(&gauge) {
                        outcome.isolated.push(gauge);
                    }
                }
            }
            outcome.suspects = (0..8).filter(|gauge| cycle.stage().is_suspect(*gauge)).collect();
            outcome.wrong += usize::from(is_wrong(&estimate, &mut world));
            outcome.last = Some(estimate);
        }
        outcome
    }

    /// What one count in each gauge shows to the spare ones, in standard deviations of a mean over so many instants.
    fn signatures(&self, instants: f64) -> Vec<DVector<f64>> {
        let (mut cycle, truth) = (self.cycle(), truth(&self.rig));
        (self.simulator)().take(2000).for_each(|frame| cycle.push(&frame, |_| {}));
        let estimator = cycle.stage().estimator();
        let sigma: Vec<f64> = truth
            .gauges
            .iter()
            .map(|g| {
                let slow = g.noise.slow_share;
                g.noise.sigma_counts * (slow + (1.0 - slow) / instants).sqrt()
            })
            .collect();
        let a = DMatrix::from_fn(8, 6, |i, k| {
            estimator.dynamics().row_to_tip(i, &truth.gauges[i].compliance.vector())[k] / sigma[i]
                * if k < 3 { 1.0 } else { 10.0 }
        });
        let u = a.svd(true, false).u.unwrap();
        let projector = DMatrix::identity(8, 8) - &u * u.transpose();
        let one = |i: usize| DVector::from_fn(8, |k, _| if k == i { 1.0 / sigma[i] } else { 0.0 });
        (0..8).map(|i| &projector * one(i)).collect()
    }

    /// Lengths in standard deviations of what one count in a gauge shows over 50 ms: whole, and beside the nearest other gauge's line.
    fn shows(&self) -> Vec<(f64, f64)> {
        let signatures = self.signatures(INSTANTS);
        let of = |(i, own): (usize, &DVector<f64>)| {
            let beside = |other: &DVector<f64>| (own - other * share(own, other)).norm();
            let others = signatures.iter().enumerate().filter(|(j, _)| *j != i);
            (own.norm(), others.map(|(_, other)| beside(other)).fold(f64::INFINITY, f64::min))
        };
        signatures.iter().enumerate().map(of).collect()
    }
}

/// How much of another a vector holds.
fn share(own: &DVector<f64>, other: &DVector<f64>) -> f64 {
    own.dot(other) / other.norm_squared()
}

/// Both gauges of a frame whose bits turned can hide each other from the spare ones, and move the wrench far beyond what one gauge could.
#[test]
fn a_frame_that_is_wrong_in_both_its_gauges_is_doubted_where_they_hide_each_other() {
    /// What the spare gauges may see of it without a word, standard deviations.
    const SEEN_SIGMA: f64 = 4.0;
    for seed in 1..7 {
        let pose = pose(seed, 0.7);
        let signatures = pose.signatures(1.0);
        for first in [0, 2, 4, 6] {
            let (own, other) = (&signatures[first], &signatures[first + 1]);
            let by = share(own, other);
            // As far as 24 bits and the gauges' ranges go.
            let counts = (SEEN_SIGMA / (own - other * by).norm()).min(5e5 / by.abs().max(1.0));
            let outcome = pose.run(|since_s, gauge, reading| match gauge {
                _ if since_s > 0.9 / RATE_HZ => reading,
                gauge if gauge == first => reading + counts,
                gauge if gauge == first + 1 => reading - by * counts,
                _ => reading,
            });
            assert_eq!(outcome.wrong, 0, "pose {seed}, gauges {first} and next: {outcome:?}");
            assert!(outcome.last.is_some_and(|last| last.status == Status::GOOD), "pose {seed}, {first}");
        }
    }
}

/// Whether an estimate is farther from the truth than five of its deviations and what one faulty gauge can hide.
pub(crate) fn is_wrong(estimate: &Estimate, world: &mut Simulator) -> bool {
    let Ok(solution) = &estimate.outcome else { return false };
    let error = solution.wrench.to_vector() - world.truth_at_ns(estimate.instant_ns).to_vector();
    (0..6).any(|k| error[k].abs() > 5.0 * solution.covariance[(k, k)].sqrt() + solution.protection[k])
}

/// Wherever in a block of the window that is: it may still have the first one for its suspect when the second goes astray.
#[test]
fn two_gauges_astray_one_right_after_the_other_are_several() {
    for first in 25..30 {
        let begin_s = (f64::from(first) - 0.1) / RATE_HZ;
        // It ends with the second.
        let pose = pose(3, FAULT_S + f64::from(first + 1) / RATE_HZ);
        let outcome = pose.run(|since_s, gauge, counts| match (gauge, since_s - begin_s) {
            (6, 0.0..0.008) => counts + 1e6,
            (5, 0.008..) => counts - 1e5,
            _ => counts,
        });
        let last = outcome.last.unwrap();
        assert_eq!(last.outcome.as_ref().err(), Some(&Refusal::SeveralAstray), "{first}: {last:?}");
    }
}

#[test]
fn a_fault_that_no_other_gauge_could_cause_is_isolated_and_no_other_ever_is() {
    let (mut separable, mut hidden, mut between) = (0, 0, 0);
    for seed in 1..=6 {
        let pose = pose(seed, 0.7);
        for (gauge, (whole, beside)) in pose.shows().into_iter().enumerate() {
            for size_counts in [1e3, -6e3, 3e4, -2e5, 1.5e6] {
                let outcome = pose.run(|_, k, counts| counts + if k == gauge { size_counts } else { 0.0 });
                let (whole, beside) = (whole * f64::abs(size_counts), beside * f64::abs(size_counts));
                let what = format!(
                    "pose {seed} gauge {gauge} {size_counts} counts: {whole:.1} sigma, {beside:.1} from others: {outcome:?}"
                );
                assert_eq!(outcome.wrong, 0, "{what}");
                assert!(outcome.isolated.iter().all(|isolated| *isolated == gauge), "{what}");
                if whole >= 14.0 && beside >= 11.0 {
                    separable += 1;
                    assert!(outcome.isolated_s.is_some_and(|s| s <= 0.06), "{what}");
                } else if whole < 3.0 {
                    hidden += 1;
                    assert!(outcome.isolated.is_empty() && outcome.flagged_s.is_none(), "{what}");
                } else if whole >= 14.0 && beside < 2.0 {
                    between += 1;
                    assert!(outcome.isolated.is_empty() && outcome.suspects.contains(&gauge), "{what}");
                    assert!(outcome.suspects.len() > 1, "{what}");
                    let status = outcome.last.unwrap().status;
                    assert!(status.has(Status::PARITY) && status.has(Status::UNCERTAIN), "{what}");
                }
            }
        }
    }
    assert!(separable > 60 && hidden > 15 && between > 1, "{separable} {hidden} {between}");
}

/// A gauge of this pose whose fault is far from what any other could cause.
fn clearest(pose: &Pose) -> usize {
    let shows = pose.shows();
    (0..8).max_by(|a, b| shows[*a].1.total_cmp(&shows[*b].1)).unwrap()
}

#[test]
fn a_gauge_is_taken_back_when_it_has_proved_itself_and_not_before() {
    let pose = pose(2, 5.0);
    let culprit = clearest(&pose);
    let fault = |since_s: f64, gauge: usize, counts: f64| {
        counts + if gauge == culprit && since_s < 2.0 { 1e5 } else { 0.0 }
    };
    let outcome = pose.run(fault);
    assert_eq!((&outcome.isolated, outcome.wrong), (&vec![culprit], 0), "{outcome:?}");
    assert!((2.9..3.2).contains(&outcome.isolated_until_s), "a second of agreement: {outcome:?}");
    assert_eq!(outcome.last.unwrap().status, Status::GOOD);
    // Whoever fails again must prove itself for two seconds.
    let fault = |since_s: f64, gauge: usize, counts: f64| {
        let fails = since_s < 0.2 || (1.5..1.7).contains(&since_s);
        counts + if gauge == culprit && fails { 1e5 } else { 0.0 }
    };
    let outcome = pose.run(fault);
    assert_eq!((&outcome.isolated, outcome.wrong), (&vec![culprit], 0), "{outcome:?}");
    assert!((3.6..3.9).contains(&outcome.isolated_until_s), "{outcome:?}");
}

#[test]
fn a_gauge_that_says_anything_is_isolated_whatever_its_mean() {
    let pose = pose(3, 1.0);
    let culprit = clearest(&pose);
    for size_counts in [1e5, 2e6] {
        let mut turn = 0.0;
        let outcome = pose.run(|_, gauge, counts| {
            turn += 1.7;
            counts + if gauge == culprit { size_counts * f64::sin(turn * turn) } else { 0.0 }
        });
        assert_eq!((&outcome.isolated, outcome.wrong), (&vec![culprit], 0), "{outcome:?}");
        assert!(outcome.isolated_s.is_some_and(|s| s <= 0.15), "{outcome:?}");
    }
}

#[test]
fn one_wrong_reading_isolates_nobody_and_is_never_published_as_good() {
    let pose = pose(4, 1.0);
    let culprit = clearest(&pose);
    let mut done = false;
    let outcome = pose.run(|_, gauge, counts| {
        let hit = gauge == culprit && !done;
        done |= hit;
        counts + if hit { 3e6 } else { 0.0 }
    });
    assert!(outcome.isolated.is_empty() && outcome.wrong == 0, "{outcome:?}");
    assert!(outcome.flagged_s.is_some_and(|s| s < 0.01), "{outcome:?}");
    assert_eq!(outcome.last.unwrap().status, Status::GOOD);
}
