//! Many dots as few: one for each place on the drawing that any of them would have covered.

use std::collections::HashSet;
use std::fmt::Write;

use crate::scale::Scale;

/// Side of a place, px, from well below a dot's own width up to it: larger ones where there are too many dots.
const PLACES_PX: [f64; 3] = [1.5, 2.2, 3.2];

/// More dots than this are too many for a page of many charts.
const MANY: usize = 3000;

/// The dots that would be seen of `points` on a drawing of this size (px): the first of each place, so that no place that had a
/// dot is left empty.
#[must_use]
pub fn thinned(points: &[(f64, f64)], width_px: f64, height_px: f64) -> Vec<(f64, f64)> {
    let x = crate::scale::extent(points.iter().map(|p| p.0));
    let y = crate::scale::extent(points.iter().map(|p| p.1));
    let mut few = Vec::new();
    for place_px in PLACES_PX {
        let place = |value: f64, (low, high): (f64, f64), px: f64| {
            let share = if high > low { (value - low) / (high - low) } else { 0.0 };
            (share * px / place_px) as i64
        };
        let mut taken = HashSet::new();
        let finite = points.iter().filter(|p| p.0.is_finite() && p.1.is_finite());
        let mut is_new = |p: &&(f64, f64)| taken.insert((place(p.0, x, width_px), place(p.1, y, height_px)));
        few = finite.filter(|p| is_new(p)).copied().collect();
        if few.len() <= MANY {
            break;
        }
    }
    few
}

/// Dots as one path of lines without length, which round ends make dots.
pub(crate) fn path(points: &[(f64, f64)], x: &Scale, y: &Scale) -> String {
    let mut d = String::new();
    for (a, b) in points.iter().filter(|p| p.0.is_finite() && p.1.is_finite()) {
        let _ = write!(d, "M{:.1} {:.1}h0", x.at(*a), y.at(*b));
    }
    d
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_place_that_had_a_dot_keeps_one() {
        let fraction = |k: u32, step: f64| (f64::from(k) * step).fract();
        let points: Vec<(f64, f64)> =
            (0..100_000).map(|k| (fraction(k, 2f64.sqrt()), fraction(k, 3f64.sqrt()))).collect();
        let few = thinned(&points, 60.0, 30.0);
        assert!(few.len() <= 41 * 21 && few.len() >= 40 * 20, "{}", few.len());
        let near =
            |p: &(f64, f64)| few.iter().any(|f| (f.0 - p.0).abs() <= 0.0251 && (f.1 - p.1).abs() <= 0.0501);
        assert!(points.iter().step_by(97).all(near));
        assert_eq!(thinned(&[(1.0, 2.0), (f64::NAN, 0.0)], 10.0, 10.0), [(1.0, 2.0)]);
    }
}
