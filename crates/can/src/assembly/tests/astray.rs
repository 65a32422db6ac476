//! Frames that were held back by themselves, and counters whose bits turned: neither mixes cycles, nor shifts those that follow

use super::*;
use crate::fault::{Faults, broken};

const AT: i64 = 20;

/// No snapshot holds values of two cycles, and the last ones are whole again
fn assert_no_cycle_is_mixed(all: &[Snapshot], what: &str) {
    for snapshot in all {
        let mut told = cycles_of(snapshot).into_iter().flatten();
        let first = told.next();
        assert!(told.all(|cycle| Some(cycle) == first), "{what}: {:?}", cycles_of(snapshot));
    }
    let (last, second) = (&all[all.len() - 1], &all[all.len() - 2]);
    assert!(last.complete && second.complete, "{what}: {:?}", cycles_of(last));
}

#[test]
fn a_joint_frame_that_comes_late_is_of_no_other_cycle() {
    for (number, late_ms) in (0..2).flat_map(|number| (1..40).map(move |late_ms| (number, late_ms))) {
        let mut frames: Vec<Stamped> = (0..2 * AT).flat_map(cycle).collect();
        frames[(4 * AT) as usize + number].stamp_ns += late_ms * MS;
        frames.sort_by_key(|frame| frame.stamp_ns);
        let (all, _) = run(frames);
        assert_no_cycle_is_mixed(&all, &format!("joint {number}, {late_ms} ms late"));
    }
}

#[test]
fn a_joint_frame_that_comes_last_and_early_in_the_next_round_is_not_of_it() {
    // In the boards' order J2 comes last; held back by itself it comes between the next round's frames.
    let late = |frame: &mut Stamped| frame.stamp_ns += MS;
    for late_us in (7000..7900).step_by(50) {
        let mut frames: Vec<Stamped> = (0..2 * AT).flat_map(cycle).collect();
        frames.iter_mut().filter(|frame| frame.frame.id().number() == 0x202).for_each(late);
        frames[(4 * AT) as usize + 1].stamp_ns += late_us * MS / 1000;
        frames.sort_by_key(|frame| frame.stamp_ns);
        let (all, _) = run(frames);
        assert_no_cycle_is_mixed(&all, &format!("{late_us} us late"));
    }
}

#[test]
fn a_counter_whose_bits_turned_moves_no_frame_to_another_cycle() {
    for (number, bit) in (2..4).flat_map(|number| (0..8).map(move |bit| (number, bit))) {
        let mut frames: Vec<Stamped> = (0..3 * AT).flat_map(cycle).collect();
        frames[(4 * AT) as usize + number].frame.data_mut()[6] ^= 1 << bit;
        let (all, _) = run(frames);
        assert_no_cycle_is_mixed(&all, &format!("frame {number}, bit {bit}"));
    }
}

/// Frames in the boards' order, each of which comes up to 7 ms late: the stamps say nothing of cycles
fn scattered(frames: impl IntoIterator<Item = Stamped>) -> Vec<Stamped> {
    let (mut seed, mut free_ns) = (5u64, 0);
    let late = |mut frame: Stamped| {
        seed = seed.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        frame.stamp_ns = (frame.stamp_ns + (seed >> 40) as i64 * 7 * MS / (1 << 24)).max(free_ns);
        free_ns = frame.stamp_ns + MS / 100;
        frame
    };
    frames.into_iter().map(late).collect()
}

#[test]
fn a_counted_frame_that_is_overtaken_is_of_its_cycle_although_another_was_lost() {
    for lost in 1..5 {
        let mut frames: Vec<Stamped> = (0..3 * AT).flat_map(cycle).collect();
        // G1 of one cycle comes between the first frames of the next; the one of a cycle shortly before never came.
        let overtaken = frames.remove((4 * AT) as usize + 2);
        frames.insert((4 * AT) as usize + 4, overtaken);
        frames.remove((4 * (AT - lost)) as usize + 2);
        let (all, _) = run(scattered(frames));
        assert_no_cycle_is_mixed(&all, &format!("lost {lost} cycles before"));
    }
}

#[test]
fn a_reading_without_a_counter_may_be_older_where_one_was_lost_and_stamps_do_not_tell() {
    let unsure = |snapshot: &Snapshot| snapshot.joints[0].position.map_or(0, |reading| reading.unsure_ns);
    let mut frames: Vec<Stamped> = (0..2 * AT).flat_map(cycle).collect();
    frames.remove((4 * AT) as usize);
    let (steady, _) = run(frames.clone());
    assert!(steady.iter().all(|snapshot| unsure(snapshot) == 0), "in its time it is of its own cycle");
    let (all, _) = run(scattered(frames));
    let at = all.iter().position(|snapshot| snapshot.joints[0].position.is_err()).unwrap();
    assert!(all[..at].iter().all(|snapshot| unsure(snapshot) == 0));
    assert!((unsure(&all[at + 1]) - 8 * MS).abs() < 2 * MS, "{:?}", all[at + 1].joints[0]);
    assert_eq!(all[at + 1].joints[1].position.map(|reading| reading.unsure_ns), Ok(0), "it came every time");
}

/// Cycles of a bus that never pauses: rounds may begin anywhere
fn without_a_pause(cycles: std::ops::Range<i64>) -> Vec<Stamped> {
    let placed = |k: i64| {
        let stamp_ns = move |i: usize| START + 8 * MS * k + 2 * MS * i as i64;
        cycle(k).into_iter().enumerate().map(move |(i, frame)| Stamped { stamp_ns: stamp_ns(i), ..frame })
    };
    cycles.flat_map(placed).collect()
}

#[test]
fn one_lost_frame_mixes_no_cycles_on_a_bus_that_never_pauses() {
    for lost in 0..4 {
        let mut frames = without_a_pause(0..3 * AT);
        frames.remove((4 * AT) as usize + lost);
        let (all, _) = run(frames);
        assert_no_cycle_is_mixed(&all, &format!("lost {lost}"));
    }
}

#[test]
fn a_frame_that_is_handed_on_late_with_a_stamp_of_its_own_begins_no_round() {
    let overtaken = Faults { reorder: 0.1, reorder_frames: 5, ..Faults::default() };
    for seed in 0..20 {
        let mut frames = without_a_pause(0..2 * AT);
        frames.extend(broken(without_a_pause(2 * AT..10 * AT), overtaken, seed));
        let (all, _) = run(frames);
        let back = all.windows(2).find(|pair| pair[1].instant_ns <= pair[0].instant_ns);
        assert!(back.is_none(), "seed {seed}: {back:?}");
    }
}
