//! How much a candidate could add to terms already chosen, from sums alone: the fall of the squared residual on the
//! blocks fitted, by block elimination (Schur complement). Cheap enough for thousands; the best are then fitted and scored.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

use crate::effects::Role;
use crate::fit::Design;
use crate::library::{Library, TermId};

/// The chosen terms, fitted on some blocks.
pub(crate) struct Screen<'l, 's> {
    library: &'l Library<'s>,
    terms: &'l [TermId],
    blocks: &'l [usize],
    offsets: Vec<usize>,
    parameters: DVector<f64>,
    /// Columns that are fitted, and the factor of their normal matrix.
    free: Vec<usize>,
    factor: Option<Cholesky<f64, Dyn>>,
}

impl<'l, 's> Screen<'l, 's> {
    /// Fits the terms on the blocks.
    pub(crate) fn new(library: &'l Library<'s>, terms: &'l [TermId], blocks: &'l [usize]) -> Self {
        let design = Design::new(library, terms);
        let (free, normal) = design.free_normal(blocks);
        let factor = if free.is_empty() { None } else { normal.cholesky() };
        Self {
            library,
            terms,
            blocks,
            parameters: design.solve(blocks),
            offsets: design.offsets,
            free,
            factor,
        }
    }

    /// Fall of the squared residual if the candidate joined; its pairs with the terms must be prepared.
    ///
    /// Nothing where the parameters would not be plausible.
    pub(crate) fn gain(&self, candidate: TermId) -> f64 {
        let term = &self.library.terms[candidate];
        let width = term.width();
        let Some((own, _)) = self.library.pair(candidate, candidate) else { return 0.0 };
        let sum = |at: &dyn Fn(usize) -> f64| self.blocks.iter().map(|block| at(*block)).sum::<f64>();
        let mut schur = DMatrix::from_fn(width, width, |r, c| sum(&|block| own.at(block, r, c)));
        let mut right = DVector::from_fn(width, |k, _| sum(&|block| term.gap[block * width + k]));
        let mut cross = DMatrix::zeros(self.parameters.len(), width);
        for (index, &other) in self.terms.iter().enumerate() {
            let Some((products, swapped)) = self.library.pair(other, candidate) else { continue };
            for r in 0..self.library.terms[other].width() {
                for c in 0..width {
                    cross[(self.offsets[index] + r, c)] = sum(&|block| {
                        if swapped { products.at(block, c, r) } else { products.at(block, r, c) }
                    });
                }
            }
        }
        right -= cross.tr_mul(&self.parameters);
        if let Some(factor) = &self.factor {
            let free = DMatrix::from_fn(self.free.len(), width, |r, c| cross[(self.free[r], c)]);
            schur -= free.tr_mul(&factor.solve(&free));
        }
        if term.columns.iter().all(|column| column.role == Role::Pinned) {
            return 2.0 * right.sum() - schur.sum();
        }
        for k in 0..width {
            // What the chosen terms already span must not divide by its own rounding.
            schur[(k, k)] += 1e-9 * sum(&|block| own.at(block, k, k));
        }
        let Some(factor) = schur.cholesky() else { return 0.0 };
        let parameters = factor.solve(&right);
        let mut headings = term.columns.iter().zip(parameters.iter());
        if headings.any(|(heading, value)| !(heading.range[0]..=heading.range[1]).contains(value)) {
            return 0.0;
        }
        parameters.dot(&right)
    }
}
