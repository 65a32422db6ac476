//! What would be left on other draws of the data: parameters are fitted anew on every draw of blocks.
//!
//! Drawing only the blocks that are scored would take the parameters for known, although all blocks of a fold share their errors
//! (B. Efron, R. Tibshirani, An Introduction to the Bootstrap, 1993, ch. 9).

use crate::attribute::Chosen;
use crate::bootstrap::{Bootstrap, quantile};
use crate::fit::{Design, Fold};
use crate::library::{Library, TermId};
use crate::parallel;

/// Per draw the squared residual on the scored blocks, each as often as it weighs.
pub(crate) fn left(
    library: &Library<'_>,
    chosen: &[Chosen],
    scored: &[bool],
    bootstrap: &Bootstrap,
) -> Vec<f64> {
    let parts: Vec<(Design, &Fold)> =
        chosen.iter().map(|part| (Design::new(library, &part.terms), &part.fold)).collect();
    let of_fold = |(design, fold): &(Design, &Fold), weights: &[f64]| {
        let parameters = design.solve_weighted(fold, &|block| weights[block]);
        let scored = fold.score.iter().filter(|block| scored[**block]);
        scored.map(|block| weights[*block] * design.residual(*block, &parameters)).sum::<f64>()
    };
    parallel::map(bootstrap.draws(), |weights| parts.iter().map(|part| of_fold(part, weights)).sum())
}

/// Whether what these terms do, beyond the others, stays above nothing over the draws: an event's many parameters are fitted on few
/// seconds, and what they gain on the others is no more certain than they are.
pub(crate) fn is_sure(
    library: &Library<'_>,
    chosen: &[Chosen],
    is_own: impl Fn(TermId) -> bool,
    bootstrap: &Bootstrap,
) -> bool {
    let hold_out = &library.session.hold_out;
    let scored: Vec<bool> = (0..library.session.blocks()).map(|block| !hold_out.is_even(block)).collect();
    let mut others = chosen.to_vec();
    others.iter_mut().for_each(|part| part.terms.retain(|id| !is_own(*id)));
    let [without, with] = [others.as_slice(), chosen].map(|chosen| {
        let mut left = left(library, chosen, &scored, bootstrap);
        left.push(estimate(library, chosen, &scored));
        left
    });
    let mut gains: Vec<f64> = without.iter().zip(&with).map(|(without, with)| without - with).collect();
    let Some(gain) = gains.pop() else { return false };
    gains.sort_by(f64::total_cmp);
    gain + quantile(&gains, 0.025) - quantile(&gains, 0.5) > 0.0
}

/// Squared residual on the scored blocks as they are.
fn estimate(library: &Library<'_>, chosen: &[Chosen], scored: &[bool]) -> f64 {
    let of_part = |part: &Chosen| {
        let residual = Design::new(library, &part.terms).left_out(std::slice::from_ref(&part.fold));
        residual.iter().zip(scored).filter(|(_, scored)| **scored).map(|(residual, _)| residual).sum::<f64>()
    };
    chosen.iter().map(of_part).sum()
}
