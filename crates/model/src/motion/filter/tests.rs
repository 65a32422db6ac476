use super::*;

/// Deterministic noise: the sum of twelve uniform numbers from a small generator is near enough to Gaussian.
struct Noise(u64);
impl Noise {
    fn next(&mut self) -> f64 {
        (0..12)
            .map(|_| {
                self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
                (self.0 >> 11) as f64 / (1u64 << 53) as f64
            })
            .sum::<f64>()
            - 6.0
    }
}

fn exactly(at_ns: i64) -> Sampled {
    Sampled { at_ns, ..Sampled::default() }
}

#[test]
fn follows_a_swing_with_honest_uncertainty() {
    let (sigma, mut noise) = (20e-6, Noise(5));
    let mut filter = MotionFilter::new(sigma);
    let (mut error2, mut normalised, mut n) = (0.0, 0.0, 0.0);
    for k in 0..4000i64 {
        let (t, w) = (k as f64 * 0.008, 9.0);
        filter.measure(exactly(k * 8_000_000), 0.0, 0.2 * (w * t).sin() + sigma * noise.next());
        if k > 200 {
            let m = filter.motion(exactly(k * 8_000_000)).unwrap();
            let e = m.acceleration_rad_s2 + 0.2 * w * w * (w * t).sin();
            error2 += e * e;
            normalised += e * e / m.covariance[(2, 2)];
            n += 1.0;
        }
    }
    let (rms, nees) = ((error2 / n).sqrt(), normalised / n);
    assert!(rms < 0.5, "acceleration error {rms} rad/s^2 of a 16 rad/s^2 swing");
    assert!((0.3..1.5).contains(&nees), "normalised error {nees}");
}

#[test]
fn a_held_joint_has_next_to_no_acceleration() {
    let (sigma, mut noise) = (20e-6, Noise(9));
    let mut filter = MotionFilter::new(sigma);
    for k in 0..1000i64 {
        filter.measure(exactly(k * 8_000_000), 0.0, 1.0 + sigma * noise.next());
    }
    let m = filter.motion(exactly(999 * 8_000_000)).unwrap();
    assert!(m.acceleration_rad_s2.abs() < 0.02 && m.covariance[(2, 2)].sqrt() < 0.02, "{m:?}");
}

#[test]
fn starts_anew_after_silence_and_when_the_clock_is_set_back() {
    let mut filter = MotionFilter::new(1e-5);
    assert!(filter.motion(exactly(0)).is_none());
    let settle = |filter: &mut MotionFilter, from_ns: i64, at_rad: f64| {
        for k in 0..i64::from(NEEDED) {
            let now = from_ns + k * 8_000_000;
            assert!(filter.motion(exactly(now)).is_none(), "too few readings");
            filter.measure(exactly(now), 0.0, at_rad);
            filter.measure(exactly(now - 4_000_000), 0.0, 5.0); // older than the last: ignored
        }
        let now = from_ns + i64::from(NEEDED - 1) * 8_000_000;
        assert!((filter.motion(exactly(now)).unwrap().position_rad - at_rad).abs() < 1e-4);
    };
    settle(&mut filter, 0, 1.0);
    // The first reading after silence starts anew; that it came is not known before it is measured.
    filter.measure(exactly(2_000_000_000), 0.0, -3.0);
    filter.measure(exactly(-9_000_000_000), 0.0, 2.0);
    assert!(filter.motion(exactly(-9_000_000_000)).is_none());
    for k in 1..i64::from(NEEDED) {
        filter.measure(exactly(-9_000_000_000 + k * 8_000_000), 0.0, 2.0);
    }
    assert!((filter.motion(exactly(-8_968_000_000)).unwrap().position_rad - 2.0).abs() < 1e-4);
}

/// A held joint with `extra` on its reading; the motion after each reading.
fn held_with(extra: impl Fn(i64) -> f64) -> Vec<Option<JointMotion>> {
    let (sigma, mut noise) = (20e-6, Noise(3));
    let mut filter = MotionFilter::new(sigma);
    let reading = |k: i64| {
        filter.measure(exactly(k * 8_000_000), 0.0, 1.0 + extra(k) + sigma * noise.next());
        filter.motion(exactly(k * 8_000_000))
    };
    (0..300).map(reading).collect()
}

#[test]
fn a_glitch_is_passed_over() {
    let motions = held_with(|k| if k == 200 { 0.5 } else { 0.0 });
    for motion in &motions[20..] {
        let motion = motion.unwrap();
        assert!(
            (motion.position_rad - 1.0).abs() < 1e-4 && motion.acceleration_rad_s2.abs() < 0.1,
            "{motion:?}"
        );
        assert!(motion.covariance[(0, 0)].sqrt() < 1e-4);
    }
}

#[test]
fn after_a_jump_the_position_is_uncertain_by_it_until_it_jumps_back() {
    let motions = held_with(|k| if (100..200).contains(&k) { -0.03 } else { 0.0 });
    let sigma = |k: usize| motions[k].map(|motion| motion.covariance[(0, 0)].sqrt());
    assert!(sigma(99).unwrap() < 1e-4 && sigma(100).unwrap() < 1e-3, "the first may be a glitch");
    assert_eq!((sigma(101), sigma(111)), (None, None), "nothing is known of its motion");
    assert!((sigma(150).unwrap() / 0.03 - 1.0).abs() < 0.01, "{:?}", sigma(150));
    assert!(sigma(250).unwrap() < 1e-4);
}

#[test]
fn two_glitches_in_a_row_are_no_jump() {
    let motions = held_with(|k| if (200..202).contains(&k) { 0.5 } else { 0.0 });
    let sigma = motions[250].unwrap().covariance[(0, 0)].sqrt();
    assert!(sigma < 1e-4, "{sigma}");
}

#[test]
fn no_joint_stops_dead() {
    // In full swing a reading is the one before again, as from a frame that was sent twice.
    let (sigma, mut noise) = (20e-6, Noise(4));
    let mut filter = MotionFilter::new(sigma);
    let mut last = 0.0;
    for k in 0..400i64 {
        let reading = if k == 300 { last } else { 0.9e-3 * k as f64 + sigma * noise.next() };
        filter.measure(exactly(k * 1_000_000), 0.0, reading);
        last = reading;
        if k > 100 {
            let motion = filter.motion(exactly(k * 1_000_000)).unwrap();
            assert!((motion.velocity_rad_s - 0.9).abs() < 0.05, "{k}: {motion:?}");
        }
    }
}

#[test]
fn an_unlikely_reading_leaves_the_motion_in_doubt_until_the_next() {
    let (sigma, mut noise, w) = (20e-6, Noise(6), 3.0);
    let mut filter = MotionFilter::new(sigma);
    for k in 0..400i64 {
        let t = k as f64 * 0.008;
        let wrong = if k == 300 { 1.5e-3 } else { 0.0 };
        filter.measure(exactly(k * 8_000_000), 0.0, 0.3 * (w * t).sin() + sigma * noise.next() + wrong);
        if k > 200 {
            let motion = filter.motion(exactly(k * 8_000_000)).unwrap();
            let error = motion.acceleration_rad_s2 + 0.3 * w * w * (w * t).sin();
            assert!(error.abs() < 5.0 * motion.covariance[(2, 2)].sqrt(), "{k}: {error} {motion:?}");
        }
    }
}

/// A joint at a speed (rad/s) with `extra` on its readings, every 8 ms. The motion after each, and the largest error of velocity and
/// acceleration after it was first known, in standard deviations.
fn moving_with(velocity: f64, extra: impl Fn(i64) -> f64) -> (Vec<Option<JointMotion>>, f64) {
    let (sigma, mut noise) = (20e-6, Noise(8));
    let mut filter = MotionFilter::new(sigma);
    let mut motions = Vec::new();
    for k in 0..300i64 {
        let place_rad = 0.008 * velocity * k as f64;
        filter.measure(exactly(k * 8_000_000), 0.0, place_rad + extra(k) + sigma * noise.next());
        motions.push(filter.motion(exactly(k * 8_000_000)));
    }
    let off = |m: &JointMotion| {
        let velocity = (m.velocity_rad_s - velocity).abs() / m.covariance[(1, 1)].sqrt();
        velocity.max(m.acceleration_rad_s2.abs() / m.covariance[(2, 2)].sqrt())
    };
    let worst = motions.iter().skip(100).flatten().map(off).fold(0.0, f64::max);
    (motions, worst)
}

#[test]
fn a_wrong_reading_between_moving_on_and_rest_is_not_believed_on_its_word() {
    // Bits that turned; had the joint stopped it would be 1.8 mm, or 0.9 mm, behind.
    for (velocity, wrong_rad) in [(0.22, -512e-6), (0.22, 512e-6), (0.11, -512e-6), (0.58, 1024e-6)] {
        for at in 150..170 {
            let (_, worst) = moving_with(velocity, |k| if k == at { wrong_rad } else { 0.0 });
            assert!(worst < 5.0, "{velocity} rad/s, {wrong_rad} at {at}: {worst} sigma");
        }
    }
}

#[test]
fn a_moving_joint_is_not_at_rest_on_the_word_of_one_reading() {
    // The wrong reading is about the one before.
    let (velocity, step_rad) = (0.11, 0.11 * 0.008);
    for short_rad in [1.0, 1.05, 1.1, 1.15].map(|share| -share * step_rad) {
        for at in 150..170 {
            let (_, worst) = moving_with(velocity, |k| if k == at { short_rad } else { 0.0 });
            assert!(worst < 5.0, "{short_rad} at {at}: {worst} sigma");
        }
    }
}

#[test]
fn a_wrong_first_reading_leaves_no_doubt_behind() {
    let (sigma, mut noise) = (20e-6, Noise(2));
    let mut filter = MotionFilter::new(sigma);
    for k in 0..100i64 {
        // A host that catches up: steps are uncertain by half a round.
        let at = Sampled { at_ns: k * 8_000_000, walked_s2: 16e-6 * k as f64, scatter_s: 4e-3 };
        let wrong_rad = if k == 0 { 33.55 } else { 0.0 };
        filter.measure(at, 0.0, 0.8 - 0.0036 * k as f64 + wrong_rad + sigma * noise.next());
        assert!(filter.doubt_rad() < 1e-9, "{k}: {} rad", filter.doubt_rad());
        assert!(k < 6 || filter.motion(at).is_some(), "{k}");
    }
}

#[test]
fn a_wrong_reading_after_a_jump_is_doubted_before_the_motion_is_told() {
    let jump = |k: i64| if k >= 150 { 0.5 } else { 0.0 };
    for at in 157..164 {
        let (_, worst) = moving_with(0.5, |k| jump(k) + if k == at { 1024e-6 } else { 0.0 });
        assert!(worst < 5.0, "{at}: {worst} sigma");
    }
}

#[test]
fn a_round_that_may_be_late_does_not_make_a_wrong_reading_right() {
    // The boards may have paused for 5 ms: that is for all joints to tell, not for one.
    let (sigma, mut noise, velocity) = (20e-6, Noise(7), -0.45);
    let mut filter = MotionFilter::new(sigma);
    for k in 0..200i64 {
        let unsure_s2 = if k >= 100 { 25e-6 } else { 0.0 };
        let at = Sampled { at_ns: k * 8_000_000, walked_s2: unsure_s2, scatter_s: 0.0 };
        let wrong_rad = if k == 100 { -2048e-6 } else { 0.0 };
        filter.measure(at, 0.0, velocity * 0.008 * k as f64 + wrong_rad + sigma * noise.next());
        if k > 50 {
            let m = filter.motion(at).unwrap();
            let off = m.acceleration_rad_s2.abs() / m.covariance[(2, 2)].sqrt();
            assert!(off < 5.0, "{k}: {off} sigma, {m:?}");
        }
    }
}

#[test]
fn uncertainty_grows_while_nothing_comes() {
    let mut filter = MotionFilter::new(1e-5);
    for k in 0..100i64 {
        filter.measure(exactly(k * 1_000_000), 0.0, 0.5);
    }
    let now = filter.motion(exactly(99_000_000)).unwrap().covariance[(0, 0)];
    let later = filter.motion(exactly(119_000_000)).unwrap().covariance[(0, 0)];
    assert!(later > now);
}
