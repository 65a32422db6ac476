//! Whether found terms are more than what noise and the simulation's own uncertainty make of nothing.
//!
//! Under the hypothesis that the added terms are nothing, their least-squares estimate has the covariance
//! `N^-1 (S + (A'F)(F'A)) N^-1`: `S` the sandwich of the blocks (P. Huber, 1967, blocks as clusters, so that correlated noise
//! counts), `F` one standard deviation along every direction in which the simulation is uncertain. `x' C^-1 x` of the added
//! parameters then follows chi^2. Parameters of fixed size are judged as if it were free.

use nalgebra::{DMatrix, DVector};

use crate::effects::Role;
use crate::fit::Design;
use crate::library::{Library, TermId};

/// Standard normal quantile that an effect must exceed: some thousand (effect, place, shape) are tried in a session.
const QUANTILE: f64 = 4.5;

/// Whether the terms after the first `known` ones exceed noise and doubt on these blocks.
pub(crate) fn exceeds(library: &mut Library<'_>, terms: &[TermId], known: usize, blocks: &[usize]) -> bool {
    let doubts = library.doubts.clone();
    library.prepare(terms, &doubts);
    let design = Design::new(library, terms);
    let width = design.width();
    let first = design.offsets[known];
    let (mut normal, right) = design.sums(blocks);
    let scale: Vec<f64> = (0..width).map(|k| normal[(k, k)].max(f64::MIN_POSITIVE).sqrt().recip()).collect();
    for r in 0..width {
        (0..width).for_each(|c| normal[(r, c)] *= scale[r] * scale[c]);
        normal[(r, r)] += 1e-9;
    }
    let Some(factor) = normal.cholesky() else { return false };
    let scaled = DVector::from_fn(width, |k, _| right[k] * scale[k]);
    let parameters = factor.solve(&scaled);
    let mut spread = DMatrix::zeros(width, width);
    let mut used = 0_usize;
    for &block in blocks {
        let (own_normal, own_right) = design.block(block);
        let score = DVector::from_fn(width, |r, _| {
            let predicted: f64 = (0..width).map(|c| own_normal[(r, c)] * scale[c] * parameters[c]).sum();
            (own_right[r] - predicted) * scale[r]
        });
        used += usize::from(score.amax() > 0.0);
        spread += &score * score.transpose();
    }
    // Few blocks make the spread look smaller than it is.
    spread *= used as f64 / used.saturating_sub(width).max(1) as f64;
    for &doubt in &doubts {
        let by = products(library, terms, &design.offsets, doubt, blocks);
        let by = DVector::from_fn(width, |k, _| by[k] * scale[k]);
        spread += &by * by.transpose();
    }
    let inverse = factor.inverse();
    let covariance = &inverse * spread * &inverse;
    // What only comes along (a scale beside a bend) must not carry the effect.
    let roles = terms.iter().flat_map(|id| &library.terms[*id].columns).map(|column| column.role);
    let own: Vec<usize> = (0..width)
        .zip(roles)
        .skip(first)
        .filter(|(_, role)| *role != Role::Nuisance)
        .map(|(k, _)| k)
        .collect();
    let found = DVector::from_fn(own.len(), |k, _| parameters[own[k]]);
    let covariance = DMatrix::from_fn(own.len(), own.len(), |r, c| covariance[(own[r], own[c])]);
    statistic(covariance, &found) > chi2_quantile(own.len())
}

/// `x' C^-1 x` over the directions that the data shows.
fn statistic(covariance: DMatrix<f64>, found: &DVector<f64>) -> f64 {
    let sigma: Vec<f64> = covariance.diagonal().iter().map(|v| v.max(f64::MIN_POSITIVE).sqrt()).collect();
    let n = found.len();
    let correlation = DMatrix::from_fn(n, n, |r, c| covariance[(r, c)] / (sigma[r] * sigma[c]));
    let eigen = correlation.symmetric_eigen();
    let reduced = DVector::from_fn(n, |k, _| found[k] / sigma[k]);
    let parts = eigen.eigenvalues.iter().zip(eigen.eigenvectors.column_iter());
    parts.map(|(value, vector)| vector.dot(&reduced).powi(2) / value.max(1e-6)).sum()
}

/// Wilson and Hilferty's approximation (Proc. Nat. Acad. Sci. 17, 1931).
fn chi2_quantile(freedom: usize) -> f64 {
    let k = freedom as f64;
    let part = 2.0 / (9.0 * k);
    k * (1.0 - part + QUANTILE * part.sqrt()).powi(3)
}

/// Product of every column of the terms with a doubt's.
fn products(
    library: &Library<'_>,
    terms: &[TermId],
    offsets: &[usize],
    doubt: TermId,
    blocks: &[usize],
) -> Vec<f64> {
    let mut out = vec![0.0; offsets.last().copied().unwrap_or_default()];
    for (index, &term) in terms.iter().enumerate() {
        let Some((products, swapped)) = library.pair(term, doubt) else { continue };
        for k in 0..library.terms[term].width() {
            let at = |block: &usize| {
                if swapped { products.at(*block, 0, k) } else { products.at(*block, k, 0) }
            };
            out[offsets[index] + k] = blocks.iter().map(at).sum();
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_those_of_the_tables() {
        // The upper 3.4e-6 of chi^2 with 1, 4 and 10 degrees of freedom.
        for (freedom, expected) in [(1, 21.6), (4, 31.1), (10, 45.6)] {
            let quantile = chi2_quantile(freedom);
            assert!((quantile / expected - 1.0).abs() < 0.15, "{freedom}: {quantile}");
        }
    }

    #[test]
    fn a_statistic_is_the_square_in_standard_deviations() {
        let covariance = DMatrix::from_row_slice(2, 2, &[4.0, 1.0, 1.0, 9.0]);
        let found = DVector::from_column_slice(&[2.0, -3.0]);
        let inverse = covariance.clone().try_inverse().map(|inverse| found.dot(&(inverse * &found)));
        assert!((statistic(covariance, &found) - inverse.unwrap_or(0.0)).abs() < 1e-9);
    }
}
