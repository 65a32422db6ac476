use std::path::Path;

use super::*;

fn limits(joints: usize) -> MotionLimits {
    let joint = |index| JointLimits {
        name: format!("j{}", index + 1),
        lower_rad: -2.0,
        upper_rad: 2.0,
        velocity_rad_s: 1.0,
        acceleration_rad_s2: 5.0,
    };
    MotionLimits { joints: (0..joints).map(joint).collect() }
}

/// Velocity and acceleration are the derivatives of position and velocity, and nothing jumps.
fn is_consistent(trajectory: &Trajectory, from_s: f64, to_s: f64) {
    let state = |t_s: f64| {
        let mut state = JointState::at_rest(trajectory.coordinates());
        trajectory.at(t_s, &mut state);
        state
    };
    let (h, steps) = (1e-5, 2000);
    for step in 0..steps {
        // An irrational step, so that no piece's border is hit.
        let t_s = from_s + (to_s - from_s) * ((f64::from(step) * 0.618_033_988_75) % 1.0);
        let [before, now, after] = [t_s - h, t_s, t_s + h].map(state);
        for k in 0..trajectory.coordinates() {
            let velocity = (after.positions_rad[k] - before.positions_rad[k]) / (2.0 * h);
            let acceleration = (after.velocities_rad_s[k] - before.velocities_rad_s[k]) / (2.0 * h);
            assert!((velocity - now.velocities_rad_s[k]).abs() < 1e-6, "t {t_s}: {velocity}");
            let error = acceleration - now.accelerations_rad_s2[k];
            assert!(error.abs() < 1e-3, "t {t_s}: {acceleration} for {}", now.accelerations_rad_s2[k]);
        }
    }
}

fn lively() -> Trajectory {
    let limits = limits(2);
    let mut trajectory = Trajectory::from_pose(vec![0.3, -1.0]);
    trajectory.hold(0.5);
    trajectory.move_to(vec![-1.0, 1.2], &limits, 0.8);
    let sine = |amplitude_rad, frequency_hz, phase_rad| Sine { amplitude_rad, frequency_hz, phase_rad };
    let terms = vec![vec![sine(0.5, 0.4, 0.3), sine(0.2, 1.1, 1.0)], vec![sine(3.0, 0.2, -1.0)]];
    trajectory.swing(Sines::new(trajectory.last_pose().to_vec(), terms, 6.0, 1.0, &limits, 0.9));
    trajectory.move_to(vec![0.0, 0.0], &limits, 0.2);
    trajectory
}

#[test]
fn rates_are_derivatives() {
    let trajectory = lively();
    is_consistent(&trajectory, -0.5, trajectory.duration_s() + 0.5);
}

#[test]
fn limits_hold_and_are_used() {
    let trajectory = lively();
    let mut state = JointState::at_rest(2);
    let (mut fastest, mut hardest) = (0.0f64, 0.0f64);
    for step in 0..(trajectory.duration_s() * 1e3) as usize {
        trajectory.at(step as f64 * 1e-3, &mut state);
        for k in 0..2 {
            let (low, high) = trajectory.extent(k);
            assert!((low - 1e-12..=high + 1e-12).contains(&state.positions_rad[k]));
            assert!(low >= -2.0 && high <= 2.0);
            fastest = fastest.max(state.velocities_rad_s[k].abs());
            hardest = hardest.max(state.accelerations_rad_s2[k].abs());
        }
    }
    assert!(fastest <= 0.9 && fastest > 0.79, "{fastest}");
    assert!(hardest <= 5.0, "{hardest}");
}

#[test]
fn a_short_move_is_bounded_by_its_acceleration() {
    let quintic = Move::new(vec![0.0], vec![0.01], &limits(1), 1.0);
    let peak = (0..=1000).map(|k| quintic.at(0, quintic.duration_s() * f64::from(k) / 1000.0)[2].abs());
    let peak = peak.fold(0.0, f64::max);
    assert!((peak - 5.0).abs() < 1e-3, "{peak}");
    let none = Move::new(vec![0.5], vec![0.5], &limits(1), 1.0);
    assert_eq!((none.duration_s(), none.at(0, 0.0)), (0.0, [0.5, 0.0, 0.0]));
}

#[test]
fn the_spline_goes_through_its_rows_and_rests_at_its_ends() {
    let rows: Vec<(f64, Vec<f64>)> =
        [(1.0, 0.0), (1.5, 0.1), (2.5, 0.5), (4.0, -0.2), (5.0, 0.0)].map(|(t, q)| (t, vec![q])).to_vec();
    let spline = Spline::new(&rows).unwrap();
    for (t_s, row) in &rows {
        assert!((spline.at(0, t_s - 1.0)[0] - row[0]).abs() < 1e-14);
    }
    assert!(spline.at(0, 0.0)[1].abs() < 1e-14 && spline.at(0, 4.0)[1].abs() < 1e-14);
    is_consistent(&Trajectory::from_spline(spline), 0.001, 3.999);
    // A cubic that is at rest at both ends is its own spline: 3 s^2 - 2 s^3.
    let cubic = |s: f64| s * s * (3.0 - 2.0 * s);
    let rows: Vec<_> = (0..=7).map(|k| f64::from(k) / 7.0).map(|s| (s, vec![cubic(s)])).collect();
    let spline = Spline::new(&rows).unwrap();
    for s in [0.03, 0.4, 0.77, 0.99] {
        let [q, v, a] = spline.at(0, s);
        assert!((q - cubic(s)).abs() < 1e-13 && (v - 6.0 * s * (1.0 - s)).abs() < 1e-12);
        assert!((a - (6.0 - 12.0 * s)).abs() < 1e-11);
    }
    assert!((spline.fastest(0).0 - 1.5).abs() < 1e-12);
}

#[test]
fn a_file_becomes_a_motion() {
    let parse = |text: &str| Trajectory::parse_csv(Path::new("m.csv"), text, &limits(2));
    let trajectory = parse("# by hand\nt, j2, j1\n10, 0.5, -0.5\n12, 0.6, -0.4\n\n14,0.5,-0.5\n").unwrap();
    assert_eq!(trajectory.duration_s(), 4.0);
    let mut state = JointState::at_rest(2);
    trajectory.at(2.0, &mut state);
    assert_eq!(state.positions_rad, [-0.4, 0.6]);
    assert_eq!(parse("t,q1,q2\n0,0,0\n1,0,0\n").unwrap().duration_s(), 1.0);
    trajectory.at(9.0, &mut state);
    assert_eq!((state.positions_rad[0], state.velocities_rad_s[0]), (-0.5, 0.0));
}

#[test]
fn a_bad_file_is_refused_at_its_line() {
    let cases = [
        ("", "m.csv:1: the first column is \"\" instead of t"),
        ("time,j1,j2\n", "m.csv:1: the first column is \"time\""),
        ("t,j1,j3\n", "m.csv:1: the column \"j3\" is no movable joint of the arm; write t,j1,j2"),
        ("t,j1,q1\n", "m.csv:1: joint \"j1\" has two columns"),
        ("t,j1\n", "m.csv:1: joint \"j2\" has no column"),
        ("t,j1,q0\n", "\"q0\" is no movable joint"),
        ("t,j1,j2\n0,0,0\n", "m.csv:1: has 1 rows"),
        ("t,j1,j2\n0,0,0\n1,0\n", "m.csv:3: has 2 columns instead of 3"),
        ("t,j1,j2\n0,0,zero\n1,0,0\n", "m.csv:2: \"zero\" is not a finite number"),
        ("t,j1,j2\n0,0,nan\n1,0,0\n", "m.csv:2: \"nan\""),
        ("t,j1,j2\n\n1,0,0\n1,0,0\n", "m.csv:4: t = 1 is not after t = 1"),
        (
            "t,j1,j2\n0,0,0\n1,0,90\n",
            "m.csv:3: joint \"j2\" at 90 rad is outside its limits -2 .. 2 rad; are these degrees?",
        ),
        ("t,j1,j2\n0,0,0\n5,0,0\n6,0,1\n", "m.csv:3: joint \"j2\" would move at"),
        ("t,j1,j2\n0,0,1\n9,0,1.99\n20,0,1.99\n30,0,1\n", "m.csv:2: joint \"j2\" swings to"),
    ];
    for (text, expected) in cases {
        let message = Trajectory::parse_csv(Path::new("m.csv"), text, &limits(2)).unwrap_err().to_string();
        assert!(message.contains(expected), "{message:?} for {expected:?}");
    }
}
