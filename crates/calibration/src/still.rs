//! Which instants of a recording are still.

/// A joint slower than this is still, rad/s.
pub const STILL_RAD_S: f64 = 5e-3;

/// Speed is the central difference over this time, s.
const OVER_NS: i64 = 160_000_000;

/// An instant this near to one that is not still is not still either, ns.
const MARGIN_NS: i64 = 60_000_000;

/// What a hold loses at each end where the arm moves fast up to it, s.
pub const LOST_S: f64 = (OVER_NS / 2 + MARGIN_NS) as f64 * 1e-9;

/// For every instant, whether all joints are slower than 5 mrad/s (central difference over 0.16 s) then and within
/// 60 ms of it. `positions_rad[j][k]` is joint j at instant k; instants rise.
pub fn still_instants(at_ns: &[i64], positions_rad: &[Vec<f64>]) -> Vec<bool> {
    let n = at_ns.len();
    let mut still = vec![true; n];
    let (mut before, mut after) = (0, 0);
    let mut moving = Vec::new();
    for k in 0..n {
        // The nearest instants that are half the time away, or the recording's ends.
        while before + 1 < k && at_ns[before + 1] <= at_ns[k] - OVER_NS / 2 {
            before += 1;
        }
        while after + 1 < n && at_ns[after] < at_ns[k] + OVER_NS / 2 {
            after += 1;
        }
        let span_s = (at_ns[after] - at_ns[before]) as f64 * 1e-9;
        let moves = |q: &Vec<f64>| (q[after] - q[before]).abs() >= STILL_RAD_S * span_s;
        if span_s <= 0.0 || positions_rad.iter().any(moves) {
            moving.push(k);
        }
    }
    for k in moving {
        let near = |i: &usize| (at_ns[*i] - at_ns[k]).abs() <= MARGIN_NS;
        (0..=k).rev().take_while(near).for_each(|i| still[i] = false);
        (k..n).take_while(near).for_each(|i| still[i] = false);
    }
    still
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_move_and_its_surroundings_are_not_still() {
        let at: Vec<i64> = (0..500).map(|k| k * 10_000_000).collect();
        // Still for 2 s, 1 rad/s for 1 s, still again.
        let q: Vec<f64> = at.iter().map(|t| (*t as f64 * 1e-9 - 2.0).clamp(0.0, 1.0)).collect();
        let still = still_instants(&at, &[vec![0.3; 500], q]);
        let moving: Vec<usize> = (0..500).filter(|k| !still[*k]).collect();
        let (first, last) = (moving[0], moving[moving.len() - 1]);
        // 80 ms of the difference and 60 ms of margin, to a sample.
        assert!((185..=188).contains(&first) && (312..=315).contains(&last), "{first} {last}");
        assert_eq!(moving.len(), last - first + 1);
    }

    #[test]
    fn slower_than_the_limit_is_still() {
        let at: Vec<i64> = (0..300).map(|k| k * 8_000_000).collect();
        let slow: Vec<f64> = at.iter().map(|t| *t as f64 * 1e-9 * 4e-3).collect();
        assert!(still_instants(&at, &[slow]).iter().all(|s| *s));
        assert!(still_instants(&[], &[]).is_empty());
    }
}
