//! Tare and payload: what they do to the wrench in every pose, when they are refused, and how they are undone.

use model::estimator::Solution;
use model::spatial::RigidBody;
use nalgebra::{Matrix3, Vector3};
use rig::config::{PublishMode, Tool};
use rig::tare::TareRefusal;
use rig::{Rig, Status};
use sim::motion::{MotionLimits, Trajectory};
use sim::{Options, Scenario, Simulator, Truth};
use wrenchd::command::{Command, Done, Order, Report};
use wrenchd::engine::{Engine, Now, Told};
use wrenchd::published::Published;

use crate::common::{model, rig, truth};

const POSES: [[f64; 6]; 3] =
    [[0.2, -0.9, 0.8, 0.3, -0.7, 0.4], [-0.6, -0.4, 1.2, -0.8, 0.9, -1.0], [0.9, -1.3, 0.3, 1.4, 0.5, 2.0]];

/// Drifted zeros: another wrench in every pose, and gauges that contradict each other.
const DRIFT_COUNTS: [f64; 8] = [60e3, -45e3, 70e3, 30e3, -55e3, 40e3, -35e3, 50e3];

/// A simulated arm that holds each pose for two seconds, and the daemon's engine on its frames.
struct World {
    arm: std::iter::Peekable<Simulator>,
    engine: Engine,
    time_ns: i64,
}

impl World {
    fn new(drifted: &dyn Fn(&mut Truth), load_kg: f64) -> Self {
        let rig = rig(PublishMode::Event);
        let mut drifting = truth(&rig);
        drifted(&mut drifting);
        let limits = MotionLimits::of(&rig.chain).unwrap();
        let mut trajectory = Trajectory::from_pose(POSES[0].to_vec());
        trajectory.hold(2.0);
        for pose in &POSES[1..] {
            trajectory.move_to(pose.to_vec(), &limits, 0.5);
            trajectory.hold(2.0);
        }
        let scenario = Scenario::of_motion(trajectory).with_load(load_kg, COM_M).unwrap();
        let options = Options { rate_hz: Some(500.0), ..Options::default() };
        let arm = Simulator::new(&rig, drifting, &scenario, options).unwrap();
        let engine = engine(&rig);
        Self { arm: arm.peekable(), engine, time_ns: sim::START_NS }
    }

    /// What is published in the next seconds.
    fn run(&mut self, seconds: f64) -> Vec<Published> {
        let end_ns = self.time_ns + (seconds * 1e9) as i64;
        let mut records = Vec::new();
        while let Some(frame) = self.arm.next_if(|frame| frame.stamp_ns < end_ns) {
            let now = Now::simulated(frame.stamp_ns + 50_000);
            self.engine.push(&frame, &mut Told::new(now, |record| records.push(*record)));
            self.engine.tick(now, &mut Told::new(now, |record| records.push(*record)));
        }
        self.time_ns = end_ns;
        self.engine.tick(
            Now::simulated(end_ns),
            &mut Told::new(Now::simulated(end_ns), |record| records.push(*record)),
        );
        records
    }

    fn order(&mut self, order: Order) -> Option<Report> {
        self.engine.command(Command { number: 7, order }, Now::simulated(self.time_ns));
        self.engine.take_report()
    }

    /// To the end, what was published while the arm held its second and its third pose.
    fn other_poses(&mut self) -> Vec<Published> {
        let records = self.run(60.0);
        let n = records.len() - 1;
        // The last two seconds, and a stretch as long in the middle: both found by their small covariance.
        let held = records[..n].iter().filter(|r| r.outcome.is_ok_and(|s| trace_n2(&s) < 0.05));
        held.copied().collect()
    }
}

const COM_M: [f64; 3] = [0.01, -0.02, 0.06];

fn engine(rig: &Rig) -> Engine {
    Engine::new(rig, &model(rig, &truth(rig))).unwrap()
}

/// For an arm whose load is its tool.
fn tooled_engine() -> Engine {
    let mut config = rig(PublishMode::Event).config;
    config.tool = Some(Tool { mass_kg: 0.4, com_m: COM_M, inertia: None });
    let tooled = Rig::load(config).unwrap();
    Engine::new(&tooled, &model(&tooled, &truth(&tooled))).unwrap()
}

fn trace_n2(solution: &Solution) -> f64 {
    (0..3).map(|k| solution.covariance[(k, k)]).sum()
}

fn force_n(records: &[Published]) -> f64 {
    let forces: Vec<Vector3<f64>> =
        records.iter().filter_map(|r| Some(r.outcome.ok()?.wrench.force_n)).collect();
    assert!(forces.len() > 100, "{} of {} are valid", forces.len(), records.len());
    (forces.iter().map(|f| f.norm_squared()).sum::<f64>() / forces.len() as f64).sqrt()
}

/// Mean over instants and axes of squared error over reported variance, the true wrench being zero.
fn nees(records: &[Published]) -> f64 {
    let solutions: Vec<Solution> = records.iter().filter_map(|r| r.outcome.ok()).collect();
    let square = |s: &Solution, k: usize| s.wrench.to_vector()[k].powi(2) / s.covariance[(k, k)];
    solutions.iter().map(|s| (0..6).map(|k| square(s, k)).sum::<f64>() / 6.0).sum::<f64>()
        / solutions.len() as f64
}

fn drift(truth: &mut Truth) {
    truth.gauges.iter_mut().zip(DRIFT_COUNTS).for_each(|(gauge, drift)| gauge.bias_counts += drift);
}

#[test]
fn a_tare_takes_drifted_zeros_away_in_every_pose_and_is_undone() {
    let mut world = World::new(&drift, 0.0);
    let before = world.run(0.5);
    assert!(before[10..].iter().all(|r| !r.is_valid() || r.status.has(Status::PARITY)), "never as good");
    assert!(before[10..].iter().any(|r| !r.is_valid()));
    assert_eq!(world.order(Order::Tare), None, "it takes its time");
    let during = world.run(0.45);
    assert!(world.engine.take_report().is_none() && during.iter().all(|r| !r.status.has(Status::TARED)));
    world.run(0.1);
    let report = world.engine.take_report().unwrap();
    let Ok(Done::Tared(tared)) = report.outcome else { panic!("{report:?}") };
    assert!(report.number == 7 && tared.left_out == 0 && (248..=252).contains(&tared.instants), "{report:?}");
    assert!(world.engine.board().tared().is_some());
    let shifts: Vec<f64> = world.engine.board().gauges().map(|gauge| gauge.zero_shift_counts).collect();
    for (shift, drift) in shifts.iter().zip(DRIFT_COUNTS) {
        assert!((shift - drift).abs() < 1500.0, "{shifts:?}");
    }
    let here = world.run(0.4);
    let elsewhere = world.other_poses();
    for records in [&here, &elsewhere] {
        assert!(records.iter().all(|r| r.status.has(Status::TARED)));
        let (after, nees) = (force_n(records), nees(records));
        assert!(after < 0.1, "{after} N after");
        assert!((0.4..1.6).contains(&nees), "nees {nees}");
    }
    // The same again, undone.
    let mut world = World::new(&drift, 0.0);
    world.run(0.1);
    world.order(Order::Tare);
    world.run(0.6);
    assert!(force_n(&world.run(0.3)) < 0.1);
    assert_eq!(world.order(Order::Untare).unwrap().outcome, Ok(Done::Obeyed));
    let undone = world.run(0.4);
    let mut never_tared = World::new(&drift, 0.0);
    never_tared.run(1.0);
    let expected = never_tared.run(0.4);
    assert_eq!(undone.len(), expected.len());
    for (undone, expected) in undone[1..].iter().zip(&expected[1..]) {
        assert!(!undone.is_valid() || undone.status.has(Status::PARITY), "{undone:?}");
        if let (Ok(a), Ok(b)) = (undone.outcome, expected.outcome) {
            assert!((a.wrench.to_vector() - b.wrench.to_vector()).amax() < 1e-9, "{a:?} {b:?}");
        }
    }
    assert!(undone[1..].iter().all(|r| !r.status.has(Status::TARED)));
    assert!(world.engine.board().tared().is_none());
    assert!(world.engine.board().gauges().all(|gauge| gauge.zero_shift_counts == 0.0));
}

#[test]
fn a_tare_is_refused_in_motion_without_a_wrench_and_without_snapshots() {
    let refused = |world: &mut World| world.engine.take_report().unwrap().outcome.unwrap_err();
    let mut world = World::new(&drift, 0.0);
    world.run(1.8);
    world.order(Order::Tare);
    world.run(0.6);
    assert!(matches!(refused(&mut world), TareRefusal::Moving(_)));
    assert!(world.run(0.1).iter().all(|r| !r.status.has(Status::TARED)));

    let mut world = World::new(&drift, 0.0);
    world.order(Order::Tare);
    world.run(0.1);
    assert!(matches!(refused(&mut world), TareRefusal::NoWrench(_)), "the motion is not known at the start");

    let mut world = World::new(&drift, 0.0);
    world.run(0.3);
    world.order(Order::Tare);
    world.time_ns += 2_100_000_000;
    world.engine.tick(Now::simulated(world.time_ns), &mut Told::new(Now::simulated(world.time_ns), |_| {}));
    assert_eq!(refused(&mut world), TareRefusal::Silent);
}

#[test]
fn a_payload_is_subtracted_still_and_moving_until_it_is_taken_off() {
    let mut world = World::new(&|_| (), 0.4);
    let weight_n = 0.4 * 9.80665;
    assert!((force_n(&world.run(0.5)[50..]) / weight_n - 1.0).abs() < 0.03);
    let body = RigidBody::from_com(0.4, Vector3::from(COM_M), Matrix3::zeros());
    assert_eq!(world.order(Order::Payload(body)).unwrap().outcome, Ok(Done::Obeyed));
    assert_eq!(world.engine.board().payload(), body);
    assert!(force_n(&world.run(0.5)[1..]) < 0.1);
    // From here on, moving too, it is as if the body had been configured as a tool.
    let mut tooled = World::new(&|_| (), 0.4);
    tooled.engine = tooled_engine();
    tooled.run(1.0);
    let (payload, tool) = (world.run(4.0), tooled.run(4.0));
    assert!(payload.len() == tool.len() && payload.len() > 1900);
    for (payload, tool) in payload.iter().zip(&tool) {
        let (Ok(a), Ok(b)) = (payload.outcome, tool.outcome) else { panic!("{payload:?} {tool:?}") };
        let scale = 1.0 + a.covariance.amax();
        assert!((a.wrench.to_vector() - b.wrench.to_vector()).amax() < 1e-8 * scale);
        assert!((a.covariance - b.covariance).amax() < 1e-8 * scale);
    }
    let mut world = World::new(&|_| (), 0.4);
    world.order(Order::Payload(body));
    world.run(0.5);
    world.order(Order::Payload(RigidBody::zero()));
    assert!((force_n(&world.run(0.5)[1..]) / weight_n - 1.0).abs() < 0.03);
}

#[test]
fn a_reload_keeps_the_payload_and_keeps_the_tare_of_the_same_gauges_only() {
    let rig = rig(PublishMode::Event);
    let mut world = World::new(&drift, 0.0);
    let body = RigidBody::from_com(0.1, Vector3::from(COM_M), Matrix3::zeros());
    world.run(0.3);
    world.order(Order::Payload(body));
    world.order(Order::Tare);
    world.run(0.6);
    let old = std::mem::replace(&mut world.engine, engine(&rig));
    world.engine.continue_from(&old);
    let shifts = |engine: &Engine| engine.board().gauges().map(|g| g.zero_shift_counts).collect::<Vec<_>>();
    assert_eq!(shifts(&world.engine), shifts(&old));
    assert_eq!((world.engine.board().payload(), world.engine.board().tared().is_some()), (body, true));
    assert!(force_n(&world.run(0.4)[20..]) < 0.1);
    let mut other = truth(&rig);
    other.gauges[3].bias_counts += 1.0;
    let mut recalibrated = Engine::new(&rig, &model(&rig, &other)).unwrap();
    // An average that runs is interrupted, and says so.
    world.order(Order::Tare);
    recalibrated.continue_from(&world.engine);
    let report = Report { number: 7, outcome: Err(TareRefusal::Interrupted) };
    assert_eq!(recalibrated.take_report(), Some(report));
    assert_eq!((recalibrated.board().payload(), recalibrated.board().tared()), (body, None));
}
