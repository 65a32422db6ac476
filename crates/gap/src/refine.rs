//! A nonlinear parameter between the shapes that were tried, and how well it is known; columns that hold for parameters of the size found.

use crate::candidates::{Candidates, without};
use crate::effects::{CATALOGUE, Fitted};
use crate::fit::Design;
use crate::library::{Library, TermId};
use crate::screen::Screen;

/// Steps of the golden section: the interval shrinks to 0.6 % of the distance between neighbours.
const STEPS: usize = 10;
const GOLDEN: f64 = 0.618_033_988_749_895;

/// The terms with every continuous parameter of those after the first `known` ones at its best on these blocks.
pub(crate) fn refine(
    library: &mut Library<'_>,
    candidates: &Candidates,
    terms: &[TermId],
    known: usize,
    blocks: &[usize],
) -> Vec<TermId> {
    let mut terms = terms.to_vec();
    for index in known..terms.len() {
        if CATALOGUE[library.terms[terms[index]].effect].is_curved() {
            terms[index] = straightened(library, &terms, index, blocks);
        }
        let term = library.terms[terms[index]].clone();
        if !CATALOGUE[term.effect].is_continuous() || term.shape.is_empty() {
            continue;
        }
        let Some((low, high)) = neighbours(library, candidates, terms[index]) else { continue };
        let others = without(&terms, index);
        let mut gain = |value: f64| {
            let mut shape = term.shape.clone();
            shape[0] = value;
            let id = library.term(term.effect, term.place, &shape)?;
            library.prepare(&[id], &others);
            Some((Screen::new(library, &others, blocks).gain(id), id))
        };
        let mut best = gain(term.shape[0]);
        let (mut low, mut high) = (low, high);
        for _ in 0..STEPS {
            let (left, right) = (high - GOLDEN * (high - low), low + GOLDEN * (high - low));
            let (at_left, at_right) = (gain(left), gain(right));
            for found in [at_left, at_right].into_iter().flatten() {
                if best.is_none_or(|(gain, _)| found.0 > gain) {
                    best = Some(found);
                }
            }
            let worth = |found: Option<(f64, TermId)>| found.map_or(f64::NEG_INFINITY, |(gain, _)| gain);
            if worth(at_left) > worth(at_right) { high = right } else { low = left }
        }
        if let Some((_, id)) = best {
            terms[index] = id;
        }
    }
    library.prepare(&terms.clone(), &terms);
    terms
}

/// How often columns are made anew for the parameters that the last ones asked for.
const STRAIGHTENINGS: usize = 3;

/// The term with columns that hold for the parameters that these blocks ask for.
fn straightened(library: &mut Library<'_>, terms: &[TermId], index: usize, blocks: &[usize]) -> TermId {
    let mut terms = terms.to_vec();
    let others = without(&terms, index);
    for _ in 0..STRAIGHTENINGS {
        let term = library.terms[terms[index]].clone();
        library.prepare(&terms, &terms);
        let design = Design::new(library, &terms);
        let parameters = design.solve(blocks);
        let values = &parameters.as_slice()[design.offsets[index]..design.offsets[index + 1]];
        let fitted = Fitted { place: term.place, shape: &term.shape, values, sigmas: &[] };
        let next = CATALOGUE[term.effect].straightened(library.session, &fitted);
        let Some(next) = next.and_then(|shape| library.term(term.effect, term.place, &shape)) else { break };
        library.prepare(&[next], &others);
        let screen = Screen::new(library, &others, blocks);
        if screen.gain(next) <= screen.gain(terms[index]) {
            break;
        }
        terms[index] = next;
    }
    terms[index]
}

/// First parameters of the tried shapes beside this one.
fn neighbours(library: &Library<'_>, candidates: &Candidates, id: TermId) -> Option<(f64, f64)> {
    let term = &library.terms[id];
    let same = |other: &TermId| {
        let other = &library.terms[*other];
        other.effect == term.effect && other.place == term.place
    };
    let (_, shapes) = candidates.iter().find(|(_, shapes)| shapes.first().is_some_and(same))?;
    let alike = |id: &&TermId| library.terms[**id].shape[1..] == term.shape[1..];
    let values = || shapes.iter().filter(alike).map(|id| library.terms[*id].shape[0]);
    let own = term.shape[0];
    let below = values().filter(|v| *v < own).fold(f64::NEG_INFINITY, f64::max);
    let above = values().filter(|v| *v > own).fold(f64::INFINITY, f64::min);
    Some((if below.is_finite() { below } else { own }, if above.is_finite() { above } else { own }))
}

/// Standard deviation of a term's first nonlinear parameter: how much blocks disagree about where the squared residual is
/// lowest, over its curvature (the sandwich of `fit`, for a parameter that enters nonlinearly).
pub(crate) fn shape_sigma(
    library: &mut Library<'_>,
    terms: &[TermId],
    index: usize,
    blocks: &[usize],
) -> Option<f64> {
    let term = library.terms[terms[index]].clone();
    let own = *term.shape.first()?;
    let step = 0.02 * own;
    if step <= 0.0 || !CATALOGUE[term.effect].is_continuous() {
        return None;
    }
    let mut residuals = |value: f64| {
        let mut shape = term.shape.clone();
        shape[0] = value;
        let mut terms = terms.to_vec();
        terms[index] = library.term(term.effect, term.place, &shape)?;
        library.prepare(&terms.clone(), &terms);
        let design = Design::new(library, &terms);
        let parameters = design.solve(blocks);
        Some(blocks.iter().map(|block| design.residual(*block, &parameters)).collect::<Vec<f64>>())
    };
    let (below, at, above) = (residuals(own - step)?, residuals(own)?, residuals(own + step)?);
    let sum = |values: &[f64]| values.iter().sum::<f64>();
    let curvature = (sum(&below) - 2.0 * sum(&at) + sum(&above)) / (step * step);
    let scores = above.iter().zip(&below).map(|(a, b)| (a - b) / (2.0 * step));
    (curvature > 0.0).then(|| scores.map(|u| u * u).sum::<f64>().sqrt() / curvature)
}
