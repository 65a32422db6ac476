//! What a daemon says that starts in a world its model does not describe.

use can::frame::Stamped;
use rig::config::PublishMode;
use rig::cycle::{Cycle, Estimate, GaugeState, Refusal};
use sim::{Options, Scenario, Simulator, Trajectory};

use crate::common::{model, rig, truth};
use crate::gauge::{change, change_position};

/// A held pose, whose frames are changed from the first one on; a tare after a second where it is asked for.
fn start(change: impl Fn(&mut Stamped), tares: bool) -> (Vec<Estimate>, Cycle) {
    let rig = rig(PublishMode::Event);
    let mut trajectory = Trajectory::from_pose(vec![0.2, -0.9, 0.8, 0.3, -0.7, 0.4]);
    trajectory.hold(3.0);
    let scenario = Scenario::of_motion(trajectory);
    let options = Options { rate_hz: Some(125.0), ..Options::default() };
    let mut cycle = Cycle::new(&rig, &model(&rig, &truth(&rig))).unwrap();
    let mut estimates: Vec<Estimate> = Vec::new();
    for mut frame in Simulator::new(&rig, truth(&rig), &scenario, options).unwrap() {
        change(&mut frame);
        cycle.push(&frame, |estimate| estimates.push(estimate.clone()));
        if tares && estimates.len() == 125 {
            cycle.stage_mut().begin_tare();
        }
    }
    assert!(estimates.len() > 350);
    (estimates, cycle)
}

fn valid(estimates: &[Estimate]) -> usize {
    estimates.iter().filter(|estimate| estimate.outcome.is_ok()).count()
}

#[test]
fn it_starts_as_valid_where_pose_and_counts_are_the_model_s() {
    let (estimates, _) = start(|_| (), false);
    assert!(valid(&estimates) + 10 > estimates.len(), "{} of {}", valid(&estimates), estimates.len());
}

#[test]
fn a_joint_that_is_not_where_it_says_keeps_it_from_starting() {
    let (estimates, _) = start(|frame| change_position(frame, 1, |rad| rad + 0.3), false);
    assert_eq!(valid(&estimates), 0);
    let last = estimates.last().unwrap();
    assert_eq!(last.outcome, Err(Refusal::Unproven), "{last:?}");
}

#[test]
fn zeros_that_drifted_while_it_was_off_keep_it_from_starting_until_a_tare() {
    let drifted =
        |frame: &mut Stamped| (0..8).for_each(|k| change(frame, k, |counts| counts + [3e4, -5e4][k % 2]));
    let (estimates, _) = start(drifted, true);
    let (before, after) = estimates.split_at(125);
    assert_eq!(valid(before), 0);
    assert_eq!(before.last().unwrap().outcome, Err(Refusal::Unproven));
    // The tare takes half a second.
    assert!(valid(&after[80..]) == after.len() - 80, "{:?}", after.last());
}

#[test]
fn one_gauge_that_was_broken_before_the_start_is_a_suspect_until_a_tare() {
    // A pose that is not the arm's can look the same: nobody is left out before all have agreed once.
    let broken = |frame: &mut Stamped| change(frame, 2, |counts| counts + 1e6);
    let (estimates, cycle) = start(broken, false);
    assert_eq!(valid(&estimates), 0);
    assert!(cycle.stage().is_suspect(2));
    assert!(cycle.stage().gauge_states().iter().all(|state| *state == GaugeState::Used));
    let (estimates, _) = start(broken, true);
    assert_eq!(valid(&estimates[205..]), estimates.len() - 205);
}
