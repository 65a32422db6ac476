//! What a search may choose from, what it is trained on, and what it chose.

use std::collections::BTreeMap;

use crate::effects::CATALOGUE;
use crate::fit::Fold;
use crate::library::{Library, TermId};

/// What may be chosen: per (effect, place) the terms of its shapes.
pub(crate) struct Candidates {
    shapes: BTreeMap<(usize, usize), Vec<TermId>>,
}

impl Candidates {
    /// All terms of the testable effects.
    pub(crate) fn all(library: &mut Library<'_>, mut tell: impl FnMut(usize)) -> Self {
        let mut shapes = BTreeMap::new();
        for (effect, entry) in CATALOGUE.iter().enumerate() {
            tell(effect);
            if entry.missing(library.session).is_some() {
                continue;
            }
            for (number, place) in entry.places(library.session).into_iter().enumerate() {
                let terms: Vec<TermId> = entry
                    .shapes(library.session, place)
                    .iter()
                    .filter_map(|shape| library.term(effect, place, shape))
                    .collect();
                if !terms.is_empty() {
                    shapes.insert((effect, number), terms);
                }
            }
        }
        Self { shapes }
    }

    /// Terms by effect and place.
    pub(crate) fn iter(&self) -> impl Iterator<Item = (usize, &[TermId])> {
        self.shapes.iter().map(|((effect, _), terms)| (*effect, terms.as_slice()))
    }
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

/// How much less `next` leaves than `now`.
pub(crate) fn sum_of_difference(now: &Choice, next: &Choice) -> f64 {
    now.residual.iter().zip(&next.residual).map(|(a, b)| a - b).sum()
}

pub(crate) fn without(terms: &[TermId], index: usize) -> Vec<TermId> {
    terms.iter().enumerate().filter(|(k, _)| *k != index).map(|(_, id)| *id).collect()
}
