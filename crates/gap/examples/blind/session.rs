//! One session of four runs as a person would record it: a bare motion, the same with a weight and once more, and held poses with
//! another motion and the weight elsewhere.

use calibration::Recording;
use rig::Run;
use rig::run::{LoadInterval, Loads};
use sim::effects::{Effects, Kind, Spec};
use sim::motion::{MotionLimits, Sine, Sines};
use sim::scenario::Warming;
use sim::{Options, Scenario, Simulator, Trajectory, Truth};

use crate::Result;
use crate::arms::Arm;
use crate::random::Random;

/// From when to when each run lasts, s.
const RUNS_S: [(f64, f64); 4] = [(0.0, 35.0), (35.0, 65.0), (65.0, 95.0), (95.0, 130.0)];
/// Rest at the beginning, s.
const REST_S: f64 = 5.0;
const WEIGHT_KG: f64 = 0.5;

/// A recorded session with the truth of it.
pub(crate) struct Recorded {
    pub(crate) runs: Vec<Run>,
    pub(crate) recordings: Vec<Recording>,
    /// What was put in, where.
    pub(crate) effects: Effects,
}

/// Records a session of an arm with effects of these sizes (noise floors).
pub(crate) fn record(arm: &Arm, put_in: &[(Kind, f64)], seed: u64) -> Result<Recorded> {
    let mut random = Random::new(seed);
    let mut scenario = scenario(arm, &mut random)?;
    let is_warm = put_in.iter().any(|(kind, _)| is_of_temperature(*kind));
    let change_k = if is_warm { random.between(6.0, 12.0) } else { random.between(0.0, 4.0) };
    scenario.warming =
        Some(Warming { change_k: random.sign() * change_k, time_s: random.between(25.0, 90.0) });
    let specs: Vec<Spec> = put_in.iter().map(|(kind, size)| Spec::sized(*kind, None, *size)).collect();
    let effects = Effects::new(&arm.rig, &arm.truth, &scenario, &specs, random.next())?;
    let mut truth = Truth { effects: effects.clone(), ..arm.truth.clone() };
    for gauge in &mut truth.gauges {
        // Noise is coloured otherwise than when the arm was calibrated.
        gauge.noise.slow_share = random.between(0.05, 0.25);
        gauge.noise.slow_time_s = random.between(0.1, 1.0);
    }
    let options = Options { seed: random.next(), ..Options::default() };
    let simulator = Simulator::new(&arm.rig, truth, &scenario, options)?;
    let mut whole = Recording::from_frames(&arm.rig, "session", simulator)?;
    whole.session = "session".to_owned();
    whole.loads = Loads::new(scenario.loads.clone());
    let recordings = RUNS_S.iter().map(|(from_s, to_s)| part(&whole, *from_s, *to_s)).collect();
    let run = |index: usize| {
        let mut run = arm.run.clone();
        run.dir = format!("run_{}", index + 1).into();
        run.session = Some("session".to_owned());
        run.repeat_of = (index == 2).then(|| "run_2".to_owned());
        run.loads = whole.loads.clone();
        run.reference = None;
        run
    };
    Ok(Recorded { runs: (0..RUNS_S.len()).map(run).collect(), recordings, effects })
}

fn is_of_temperature(kind: Kind) -> bool {
    matches!(kind, Kind::TemperatureOffset | Kind::TemperatureGain)
}

/// A stretch of a recording, on the clock of the whole.
fn part(whole: &Recording, from_s: f64, to_s: f64) -> Recording {
    let kept: Vec<usize> = (0..whole.len()).filter(|k| (from_s..to_s).contains(&whole.time_s(*k))).collect();
    let rows = kept.first().copied().unwrap_or(0)..kept.last().map_or(0, |last| last + 1);
    let mut part = whole.clone();
    part.at_ns = whole.at_ns[rows.clone()].to_vec();
    part.sampled = whole.sampled[rows.clone()].to_vec();
    let cut = |columns: &mut Vec<Vec<f64>>| {
        columns
            .iter_mut()
            .filter(|column| !column.is_empty())
            .for_each(|column| *column = column[rows.clone()].to_vec());
    };
    cut(&mut part.positions_rad);
    cut(&mut part.velocities_rad_s);
    for column in part.counts.iter_mut().chain(&mut part.temperatures_c) {
        *column = column[rows.clone()].to_vec();
    }
    part
}

/// What happens in a session.
fn scenario(arm: &Arm, random: &mut Random) -> Result<Scenario> {
    let limits = MotionLimits::of(&arm.rig.chain)?;
    let is_swing = random.next() & 1 == 0;
    let centre = pose(&limits, random, 0.15);
    let mut trajectory = Trajectory::from_pose(centre.clone());
    trajectory.hold(REST_S);
    let (swing, goals) = (sines(&limits, random, &centre, 30.0), goals(&limits, random, 40));
    for (_, to_s) in &RUNS_S[..3] {
        if is_swing {
            trajectory.swing(swing.clone());
        } else {
            visit(&mut trajectory, &limits, &goals, *to_s);
        }
    }
    let held = self::goals(&limits, random, 6);
    visit(&mut trajectory, &limits, &held, RUNS_S[3].0 + 15.0);
    let last = trajectory.last_pose().to_vec();
    let rest_s = RUNS_S[3].1 - trajectory.duration_s();
    trajectory.swing(sines(&limits, random, &last, rest_s));
    let mut scenario = Scenario::of_motion(trajectory);
    for (from_s, to_s, com_m) in [(35.0, 95.0, [0.0, 0.08, 0.03]), (95.0, 131.0, [0.0, 0.0, 0.05])] {
        scenario.loads.push(LoadInterval { from_s, to_s, mass_kg: WEIGHT_KG, com_m });
    }
    Ok(scenario)
}

/// A pose within this share of the joints' ranges about their middle.
fn pose(limits: &MotionLimits, random: &mut Random, share: f64) -> Vec<f64> {
    let place = |joint: &sim::motion::JointLimits| {
        let half = share * (joint.upper_rad - joint.lower_rad) / 2.0;
        (joint.lower_rad + joint.upper_rad) / 2.0 + random.between(-half, half)
    };
    limits.joints.iter().map(place).collect()
}

fn goals(limits: &MotionLimits, random: &mut Random, count: usize) -> Vec<Vec<f64>> {
    (0..count).map(|_| pose(limits, random, 0.7)).collect()
}

/// Goes from goal to goal and back to where it began, until a time (s).
fn visit(trajectory: &mut Trajectory, limits: &MotionLimits, goals: &[Vec<f64>], until_s: f64) {
    let home = trajectory.last_pose().to_vec();
    let mut whole = trajectory.clone();
    for goal in goals {
        trajectory.move_to(goal.clone(), limits, 0.5);
        trajectory.hold(0.3);
        let mut back = trajectory.clone();
        back.move_to(home.clone(), limits, 0.5);
        if back.duration_s() > until_s {
            break;
        }
        whole = back;
    }
    let rest_s = until_s - whole.duration_s();
    whole.hold(rest_s);
    *trajectory = whole;
}

/// All joints swing at several frequencies.
fn sines(limits: &MotionLimits, random: &mut Random, centre: &[f64], seconds: f64) -> Sines {
    let mut terms = Vec::with_capacity(limits.joints.len());
    for joint in &limits.joints {
        let range_rad = (joint.upper_rad - joint.lower_rad) / 2.0;
        let sine = |random: &mut Random, low_hz: f64, high_hz: f64, share: f64| Sine {
            amplitude_rad: share * range_rad * random.between(0.5, 1.0),
            frequency_hz: random.between(low_hz, high_hz),
            phase_rad: random.between(0.0, std::f64::consts::TAU),
        };
        terms.push(vec![
            sine(random, 0.05, 0.12, 0.4),
            sine(random, 0.12, 0.3, 0.2),
            sine(random, 0.3, 0.8, 0.05),
        ]);
    }
    Sines::new(centre.to_vec(), terms, seconds, 2.0, limits, 0.6)
}
