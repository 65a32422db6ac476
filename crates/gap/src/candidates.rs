//! What a search may choose from, what it is trained on, and what it chose.

use std::collections::BTreeMap;

use crate::effects::{CATALOGUE, Place};
use crate::fit::Fold;
use crate::library::{Library, TermId};

/// What may be chosen: per (effect, place) the terms of its shapes.
pub(crate) struct Candidates {
    shapes: BTreeMap<(usize, usize), Vec<TermId>>,
}

impl Candidates {
    /// All terms of the testable effects but those `without`, by index.
    pub(crate) fn all(library: &mut Library<'_>, without: &[usize], mut tell: impl FnMut(usize)) -> Self {
        let mut shapes = BTreeMap::new();
        for (effect, entry) in CATALOGUE.iter().enumerate() {
            tell(effect);
            if without.contains(&effect) || entry.missing(library.session).is_some() {
                continue;
            }
            for (number, place) in entry.places(library.session).into_iter().enumerate() {
                let terms = of_site(library, effect, place);
                if !terms.is_empty() {
                    shapes.insert((effect, number), terms);
                }
            }
        }
        Self { shapes }
    }

    /// Terms of these effects at these places only.
    pub(crate) fn at(library: &mut Library<'_>, sites: &[(usize, Place)]) -> Self {
        let mut shapes = BTreeMap::new();
        for (number, &(effect, place)) in sites.iter().enumerate() {
            let terms = of_site(library, effect, place);
            if !terms.is_empty() {
                shapes.insert((effect, number), terms);
            }
        }
        Self { shapes }
    }

    /// Terms by effect and place.
    pub(crate) fn iter(&self) -> impl Iterator<Item = (usize, &[TermId])> {
        self.shapes.iter().map(|((effect, _), terms)| (*effect, terms.as_slice()))
    }
}

/// Terms of an effect at a place, one a shape.
fn of_site(library: &mut Library<'_>, effect: usize, place: Place) -> Vec<TermId> {
    let shapes = CATALOGUE[effect].shapes(library.session, place);
    library.terms_of(effect, place, &shapes)
}

/// Blocks to choose on, in folds.
pub(crate) struct Training {
    pub(crate) blocks: Vec<usize>,
    pub(crate) folds: Vec<Fold>,
    /// Squared residual that noise leaves on all these blocks.
    pub(crate) floor: f64,
}

/// A set of terms with its squared residual per left-out block.
#[derive(Clone)]
pub(crate) struct Choice {
    pub(crate) terms: Vec<TermId>,
    pub(crate) residual: Vec<f64>,
}

/// How much less `next` leaves than `now`, per left-out block.
pub(crate) fn differences(now: &Choice, next: &Choice) -> Vec<f64> {
    now.residual.iter().zip(&next.residual).map(|(a, b)| a - b).collect()
}

/// The same of all blocks.
pub(crate) fn sum_of_difference(now: &Choice, next: &Choice) -> f64 {
    differences(now, next).iter().sum()
}

pub(crate) fn without(terms: &[TermId], index: usize) -> Vec<TermId> {
    terms.iter().enumerate().filter(|(k, _)| *k != index).map(|(_, id)| *id).collect()
}
