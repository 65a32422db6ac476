//! What effects leave of themselves since real forms differ from the catalogue's (a power law from an exponential, a loop with round
//! corners from a play), and what would take that up: no cause of its own.

use std::collections::BTreeSet;

use crate::attribute::Chosen;
use crate::effects::CATALOGUE;
use crate::library::{Library, TermId};
use crate::location;

/// Share of an effect's part that may be left of it, where its form is one of several, and where it is the physics itself.
const REMAINDER: f64 = 0.08;
const REMAINDER_OF_EXACT: f64 = 0.01;

/// Whether an effect of `chosen` adds no more to `others`, the choice without it, on its own channels than these usually leave there of
/// themselves. On other channels the others may explain as much as they like.
pub(crate) fn is_remainder(
    library: &Library<'_>,
    others: &[Chosen],
    chosen: &[Chosen],
    effect: usize,
) -> bool {
    let terms = chosen.iter().flat_map(|part| &part.terms).map(|id| &library.terms[*id]);
    let own = terms.filter(|term| term.effect == effect);
    let channels: BTreeSet<usize> = own.flat_map(|term| term.channels.iter().copied()).collect();
    let left = |parts: &[Chosen]| {
        let left = location::by_channel(library, parts);
        channels.iter().map(|channel| left[*channel]).sum::<f64>()
    };
    let is_inexact = |id: TermId| !CATALOGUE[library.terms[id].effect].is_exact();
    let (nothing, exact) = (left(&without(others, |_| true)), left(&without(others, is_inexact)));
    let (others, all) = (left(others), left(chosen));
    let usual = REMAINDER_OF_EXACT * (nothing - exact) + REMAINDER * (exact - others);
    nothing > others && others - all < usual
}

/// The parts without these terms.
pub(crate) fn without(parts: &[Chosen], is_dropped: impl Fn(TermId) -> bool) -> Vec<Chosen> {
    let mut parts = parts.to_vec();
    parts.iter_mut().for_each(|part| part.terms.retain(|id| !is_dropped(*id)));
    parts
}
