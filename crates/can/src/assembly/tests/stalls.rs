//! Senders and hosts that stop within rounds
use super::*;

/// Numbers from 0 to 1
fn uniform(mut seed: u64) -> impl FnMut() -> f64 {
    move || {
        seed = seed.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (seed >> 11) as f64 / (1u64 << 53) as f64
    }
}

/// Cycles over a host that stops for up to 60 ms anywhere, after which what waited comes in a burst; a share of the frames is lost
fn stopping_host(cycles: i64, lost: f64) -> Vec<Stamped> {
    let mut uniform = uniform(7);
    let mut free_ns = 0;
    let mut frames = Vec::new();
    for mut frame in (0..cycles).flat_map(cycle) {
        if uniform() < 0.005 {
            free_ns = free_ns.max(frame.stamp_ns + (uniform() * 60e6) as i64);
        }
        frame.stamp_ns = (frame.stamp_ns + (uniform() * 3e5) as i64).max(free_ns);
        free_ns = frame.stamp_ns + 20_000;
        if uniform() >= lost {
            frames.push(frame);
        }
    }
    frames
}

#[test]
fn a_host_that_stops_tears_no_cycle_apart() {
    let (all, assembler) = run(stopping_host(4000, 0.0));
    assert_eq!(all.len(), 4000, "{:?}", assembler.counts());
    for (k, snapshot) in all.iter().enumerate() {
        assert_eq!(cycles_of(snapshot), [Some(k as i64); 4]);
        assert_eq!(snapshot.cycles, (k > 0).then_some(1));
    }
}

#[test]
fn a_host_that_stops_and_frames_that_are_lost_mix_no_cycles() {
    let (all, _) = run(stopping_host(20_000, 0.01));
    let (mut mixed, mut complete) = (Vec::new(), 0);
    for snapshot in &all {
        let seen: Vec<_> = cycles_of(snapshot).into_iter().flatten().collect();
        complete += usize::from(snapshot.complete);
        if seen.iter().any(|k| *k != seen[0]) {
            mixed.push(cycles_of(snapshot));
        }
    }
    // One lost frame in a hundred costs each cycle that it hits, and no other.
    assert!(complete > 19_000, "{complete} of {}", all.len());
    assert!(mixed.is_empty(), "{} of {}: {:?}", mixed.len(), all.len(), &mixed[..mixed.len().min(20)]);
}

/// Cycles of a sender that puts out each as a burst and cannot keep up: after a while a burst is a frame more than a cycle, its last
/// frames a little late, and pauses of about a cycle wander through the rounds
fn breathless_sender(cycles: i64) -> Vec<Stamped> {
    let mut uniform = uniform(11);
    let mut now_ns = START;
    let mut left = 0;
    let mut frames: Vec<Stamped> = (0..cycles).flat_map(cycle).collect();
    for (number, frame) in frames.iter_mut().enumerate() {
        let due_ns = START + 8 * MS * (number as i64 / 4);
        left = if left == 0 { 4 } else { left - 1 };
        let gap_ns = match left {
            _ if number < 400 => 16_000,
            4 => (8e6 + uniform() * 4e6) as i64,
            0 | 1 if uniform() < 0.7 => (0.7e6 + uniform() * 0.6e6) as i64,
            _ => 20_000,
        };
        now_ns = (now_ns + gap_ns).max(due_ns);
        frame.stamp_ns = now_ns;
    }
    frames
}

#[test]
fn a_sender_that_pauses_in_every_round_tears_none_apart() {
    let (all, assembler) = run(breathless_sender(8000));
    assert_eq!(all.len(), 8000, "{:?}", assembler.counts());
    for (k, snapshot) in all.iter().enumerate() {
        assert_eq!(cycles_of(snapshot), [Some(k as i64); 4]);
    }
}
