//! Names beside points so that no two lie on each other.

use crate::svg::text_width;

/// Height of a line of text, px.
const LINE_PX: f64 = 15.0;

/// Where a text begins (its left end and baseline, px).
pub(crate) type Place = (f64, f64);

/// Places for texts near their points within a drawing: nearest first, on circles about the point, never over a text that
/// was placed before; in a drawing that is too full, over the least of them.
///
/// `lines` are to be left free too, as far as there is room.
pub(crate) fn place(
    wanted: &[((f64, f64), String)],
    lines: &[Vec<(f64, f64)>],
    width: f64,
    height: f64,
) -> Vec<Place> {
    let drawn: Vec<[f64; 4]> = lines.iter().flat_map(|line| line.windows(2)).flat_map(along).collect();
    let mut taken: Vec<[f64; 4]> =
        wanted.iter().map(|(p, _)| [p.0 - 3.0, p.1 - 3.0, p.0 + 3.0, p.1 + 3.0]).collect();
    let mut out = Vec::with_capacity(wanted.len());
    for (point, text) in wanted {
        let wide = text_width(text);
        let candidates = (1..=8).flat_map(|ring| {
            (0..12).map(move |turn| {
                (5.0 + 9.0 * f64::from(ring), f64::from(turn) * std::f64::consts::TAU / 12.0)
            })
        });
        let boxed = |(far, turn): (f64, f64)| {
            let (x, y) = (point.0 + far * turn.cos(), point.1 + far * turn.sin());
            // To the left of the point the text ends there.
            let x0 = if turn.cos() < -0.2 {
                x - wide
            } else if turn.cos() > 0.2 {
                x
            } else {
                x - wide / 2.0
            };
            [x0, y - LINE_PX / 2.0, x0 + wide, y + LINE_PX / 2.0]
        };
        let covered = |b: &[f64; 4]| {
            let outside = b[0] < 0.0 || b[1] < 0.0 || b[2] > width || b[3] > height;
            drawn.iter().map(|t| overlap(b, t)).sum::<f64>()
                + 1e3 * taken.iter().map(|t| overlap(b, t)).sum::<f64>()
                + if outside { 1e9 } else { 0.0 }
        };
        let best = candidates.map(boxed).min_by(|a, b| covered(a).total_cmp(&covered(b)));
        let best = best.unwrap_or([point.0, point.1, point.0 + wide, point.1 + LINE_PX]);
        taken.push(best);
        out.push((best[0], best[3] - 3.5));
    }
    out
}

/// Small boxes along a straight piece, px.
fn along(piece: &[(f64, f64)]) -> impl Iterator<Item = [f64; 4]> + use<> {
    const APART_PX: f64 = 4.0;
    let (a, b) = (piece[0], piece[1]);
    let steps = ((b.0 - a.0).hypot(b.1 - a.1) / APART_PX).clamp(1.0, 1000.0) as usize;
    (0..=steps).map(move |k| {
        let share = k as f64 / steps as f64;
        let (x, y) = (a.0 + share * (b.0 - a.0), a.1 + share * (b.1 - a.1));
        [x - 1.5, y - 1.5, x + 1.5, y + 1.5]
    })
}

fn overlap(a: &[f64; 4], b: &[f64; 4]) -> f64 {
    let side = |k: usize| (a[k + 2].min(b[k + 2]) - a[k].max(b[k])).max(0.0);
    side(0) * side(1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn names_never_lie_on_each_other(points in prop::collection::vec((120.0..380.0f64, 120.0..280.0f64), 1..10)) {
            let wanted: Vec<_> = points.iter().enumerate().map(|(k, p)| (*p, format!("s{k}"))).collect();
            let placed = place(&wanted, &[vec![(0.0, 200.0), (500.0, 200.0)]], 500.0, 400.0);
            let boxes: Vec<[f64; 4]> = placed.iter().zip(&wanted)
                .map(|(p, (_, text))| [p.0, p.1 - 11.5, p.0 + text_width(text), p.1 + 3.5]).collect();
            for (k, a) in boxes.iter().enumerate() {
                for b in &boxes[..k] {
                    prop_assert!(overlap(a, b) < 1e-9, "{a:?} {b:?}");
                }
                prop_assert!(a[0] >= 0.0 && a[2] <= 500.0);
            }
        }
    }
}
