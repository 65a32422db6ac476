//! Frames that were held back by themselves, and counters whose bits turned: neither mixes cycles, nor shifts those that follow

use super::*;

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
