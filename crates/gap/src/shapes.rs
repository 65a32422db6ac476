//! Which of an effect's shapes to look at, at one place.

use std::collections::BTreeMap;

use crate::library::{Library, TermId};
use crate::screen::Screen;

/// Candidates whose improvements differ by less than this share of the larger are equally good.
pub(crate) const EQUALLY_GOOD: f64 = 0.03;

/// What a place of an effect could add in its best shape, and in the best of those with fewer parameters.
pub(crate) struct Found {
    pub(crate) gain: f64,
    pub(crate) id: TermId,
    pub(crate) simpler: Vec<(f64, TermId)>,
}

/// A shape with fewer parameters that explains less than this share of what the best one does is not worth looking at.
const WORTH_A_LOOK: f64 = 0.5;

/// The shape that explains most; of those that are as good the one with the fewest parameters. What differs by more than is worth
/// finding is not as good, however small a share of a large gap it is. On the data that is fitted more parameters always explain more:
/// whether they do on what was left out is for those to say who ask for the simpler ones as well.
pub(crate) fn best_shape(
    screen: &Screen<'_, '_>,
    library: &Library<'_>,
    shapes: &[TermId],
    worth: f64,
) -> Option<Found> {
    let gains: Vec<(f64, TermId)> = shapes.iter().map(|id| (screen.gain(*id), *id)).collect();
    let most = gains.iter().map(|(gain, _)| *gain).max_by(f64::total_cmp)?;
    // Where noise is not known everything that is left speaks for a simpler shape, and there the fit decides.
    let is_noise_known = !library.session.hold_out.is_even.is_empty();
    let within = if is_noise_known { EQUALLY_GOOD } else { 0.0 };
    let freedom = |id: TermId| library.terms[id].freedom();
    let as_good = gains.iter().filter(|(gain, _)| most - gain <= (within * most.abs()).min(worth));
    let &(gain, id) = as_good.min_by(|a, b| freedom(a.1).cmp(&freedom(b.1)).then(b.0.total_cmp(&a.0)))?;
    let mut simpler: BTreeMap<usize, (f64, TermId)> = BTreeMap::new();
    let is_worth_it = |(other, _): &&(f64, TermId)| is_noise_known && *other > WORTH_A_LOOK * gain;
    for &(other, shape) in gains.iter().filter(is_worth_it) {
        let best = simpler.entry(freedom(shape)).or_insert((other, shape));
        if other > best.0 {
            *best = (other, shape);
        }
    }
    let simpler = simpler.range(..freedom(id)).map(|(_, best)| *best).collect();
    Some(Found { gain, id, simpler })
}
