use super::*;
use crate::scenario::Preset;
use crate::simulator::{Options, Simulator};

fn rig() -> Rig {
    Rig::load_file(concat!(env!("CARGO_MANIFEST_DIR"), "/../../config/arm.toml").as_ref()).unwrap()
}

fn short(rig: &Rig) -> Scenario {
    let limits = crate::motion::MotionLimits::of(&rig.chain).unwrap();
    let mut trajectory = crate::Trajectory::from_pose(limits.middle());
    for (k, share) in [0.7, 0.5, 0.7].into_iter().enumerate() {
        let mut pose = limits.middle();
        pose.iter_mut().enumerate().for_each(|(j, q)| *q += 0.5 * ((j + 2 * k) as f64).sin());
        trajectory.move_to(pose, &limits, share);
    }
    Scenario::of_motion(trajectory).with_load(0.5, [0.0, 0.02, 0.05]).unwrap()
}

#[test]
fn every_effect_shows_at_the_size_that_was_asked_for() {
    let rig = rig();
    let truth = Truth::draw(&rig, 3, 0.0);
    let scenario = short(&rig);
    let clean = |effects: Effects| {
        let truth = Truth { effects, ..truth.clone().without_noise() };
        Simulator::new(&rig, truth, &scenario, Options::default()).unwrap().clean_counts()
    };
    let nominal = clean(Effects::default());
    for kind in Kind::ALL {
        if matches!(kind, Kind::Spikes | Kind::RandomWalk | Kind::ZeroJumps | Kind::GainWalk) {
            continue;
        }
        let spec = Spec::sized(*kind, None, 3.0);
        let effects = Effects::new(&rig, &truth, &scenario, &[spec], 5).unwrap();
        let changed = clean(effects);
        let rms = |gauge: usize| {
            let squares = nominal.iter().zip(&changed).map(|(a, b)| (b[gauge] - a[gauge]).powi(2));
            (squares.sum::<f64>() / nominal.len() as f64).sqrt() / truth.gauges[gauge].noise.sigma_counts
        };
        let size = (0..truth.gauges.len()).map(rms).fold(0.0, f64::max);
        assert!((1.0..9.0).contains(&size), "{}: {size}", kind.id());
    }
}

#[test]
fn what_cannot_be_is_refused_with_what_could() {
    let words = |text: &str| text.parse::<Spec>().unwrap_err().to_string();
    assert!(words("frictoin@joint_1").contains("friction"));
    assert!(words("gain@s1,relativ=0.1").contains("relative and size"));
    assert!(words("gain@s1,relative=much").contains("is not a number"));
    assert!(words("gain@s1,relative=0.1,size=3").contains("give one"));
    let rig = rig();
    let truth = Truth::draw(&rig, 3, 0.0);
    let scenario = Preset::Holds.scenario(&rig.chain, 1).unwrap();
    let spec: Spec = "gain@nowhere".parse().unwrap();
    let error = Effects::new(&rig, &truth, &scenario, &[spec], 1).unwrap_err().to_string();
    assert!(error.contains("no place for it"), "{error}");
}
