//! Least squares on some blocks, squared residuals on others, for a set of terms.

use nalgebra::{DMatrix, DVector};

use crate::effects::Role;
use crate::library::{Library, TermId};

/// Weight of the plausible range of a parameter, as a share of one block's values: enough to keep directions that the
/// data does not see at zero, too little to matter where it sees them.
const PRIOR_WEIGHT: f64 = 0.05;

/// Blocks to fit on and blocks to score on.
#[derive(Debug, Clone)]
pub(crate) struct Fold {
    pub(crate) fit: Vec<usize>,
    pub(crate) score: Vec<usize>,
}

/// The normal equations of a set of terms, block by block.
pub(crate) struct Design {
    /// Column numbers of every term, one after the other.
    pub(crate) offsets: Vec<usize>,
    pinned: Vec<bool>,
    /// Inverse squares of the plausible ranges.
    prior: Vec<f64>,
    ranges: Vec<[f64; 2]>,
    blocks: Vec<(DMatrix<f64>, DVector<f64>)>,
    squared: Vec<f64>,
    block_values: f64,
    /// Columns that exist in one unit only, with the unit.
    events: Vec<(usize, usize)>,
    /// Per block its unit, and whether what exists in that unit only may be fitted on it.
    places: Vec<(usize, bool)>,
}

impl Design {
    /// Assembles the terms; their pairs must be prepared.
    pub(crate) fn new(library: &Library<'_>, terms: &[TermId]) -> Self {
        let mut offsets = vec![0];
        let (mut pinned, mut prior, mut ranges) = (Vec::new(), Vec::new(), Vec::new());
        let mut events = Vec::new();
        for &id in terms {
            for column in &library.terms[id].columns {
                events.extend(column.unit_only.map(|unit| (pinned.len(), unit)));
                pinned.push(column.role == Role::Pinned);
                prior.push(column.plausible.powi(-2));
                ranges.push(column.range);
            }
            offsets.push(pinned.len());
        }
        let width = pinned.len();
        let count = library.squared.len();
        let mut blocks = vec![(DMatrix::zeros(width, width), DVector::zeros(width)); count];
        for (i, &a) in terms.iter().enumerate() {
            let own = library.terms[a].width();
            for (block, (_, right)) in blocks.iter_mut().enumerate() {
                for k in 0..own {
                    right[offsets[i] + k] = library.terms[a].gap[block * own + k];
                }
            }
            for (j, &b) in terms.iter().enumerate() {
                let Some((products, swapped)) = library.pair(a, b) else { continue };
                for (block, (normal, _)) in blocks.iter_mut().enumerate() {
                    for r in 0..own {
                        for c in 0..library.terms[b].width() {
                            normal[(offsets[i] + r, offsets[j] + c)] =
                                if swapped { products.at(block, c, r) } else { products.at(block, r, c) };
                        }
                    }
                }
            }
        }
        let block_values = library.counts.iter().sum::<f64>() / count.max(1) as f64;
        let hold_out = &library.session.hold_out;
        let places = hold_out.unit_of_block.iter().enumerate().map(|(k, unit)| (*unit, hold_out.is_even(k)));
        Self {
            offsets,
            pinned,
            prior,
            ranges,
            blocks,
            squared: library.squared.clone(),
            block_values,
            events,
            places: places.collect(),
        }
    }

    /// Columns of a term, by its position.
    pub(crate) fn columns_of(&self, term: usize) -> std::ops::Range<usize> {
        self.offsets[term]..self.offsets[term + 1]
    }

    /// Number of columns.
    pub(crate) fn width(&self) -> usize {
        self.pinned.len()
    }

    fn sum(&self, blocks: &[usize]) -> (DMatrix<f64>, DVector<f64>) {
        self.weighted(blocks, &|_| 1.0)
    }

    /// The same with a weight a block.
    fn weighted(&self, blocks: &[usize], weight: &dyn Fn(usize) -> f64) -> (DMatrix<f64>, DVector<f64>) {
        let width = self.width();
        let mut sum = (DMatrix::zeros(width, width), DVector::zeros(width));
        for &block in blocks {
            let (normal, right) = &self.blocks[block];
            let weight = weight(block);
            sum.0.zip_apply(normal, |sum, value| *sum += weight * value);
            sum.1.axpy(weight, right, 1.0);
        }
        sum
    }

    /// Parameters that these blocks ask for.
    pub(crate) fn solve(&self, blocks: &[usize]) -> DVector<f64> {
        let (normal, right) = self.sum(blocks);
        self.solve_sums(&normal, &right)
    }

    fn solve_sums(&self, normal: &DMatrix<f64>, right: &DVector<f64>) -> DVector<f64> {
        let width = self.width();
        let free: Vec<usize> = (0..width).filter(|k| !self.pinned[*k]).collect();
        let mut solution = DVector::from_fn(width, |k, _| f64::from(u8::from(self.pinned[k])));
        if free.is_empty() {
            return solution;
        }
        let reduced = self.regular(normal, &free);
        let scale: Vec<f64> =
            (0..free.len()).map(|k| reduced[(k, k)].max(f64::MIN_POSITIVE).sqrt()).collect();
        let matrix = DMatrix::from_fn(free.len(), free.len(), |r, c| reduced[(r, c)] / (scale[r] * scale[c]));
        let rest = DVector::from_fn(free.len(), |r, _| {
            let fixed: f64 = (0..width).filter(|c| self.pinned[*c]).map(|c| normal[(free[r], c)]).sum();
            (right[free[r]] - fixed) / scale[r]
        });
        let Some(factor) = matrix.cholesky() else { return solution };
        for (k, value) in factor.solve(&rest).iter().enumerate() {
            solution[free[k]] = value / scale[k];
        }
        solution
    }

    /// Columns that are fitted, and their part of the normal matrix on these blocks, with the prior.
    pub(crate) fn free_normal(&self, blocks: &[usize]) -> (Vec<usize>, DMatrix<f64>) {
        let free: Vec<usize> = (0..self.width()).filter(|k| !self.pinned[*k]).collect();
        let normal = self.regular(&self.sum(blocks).0, &free);
        (free, normal)
    }

    /// The free part of the normal matrix with the prior.
    fn regular(&self, normal: &DMatrix<f64>, free: &[usize]) -> DMatrix<f64> {
        let weight = PRIOR_WEIGHT * self.block_values;
        DMatrix::from_fn(free.len(), free.len(), |r, c| {
            let own =
                if r == c { weight * self.prior[free[r]] + 1e-12 * normal[(free[r], free[r])] } else { 0.0 };
            normal[(free[r], free[c])] + own
        })
    }

    /// Whether all parameters are what physics and practice allow.
    pub(crate) fn is_plausible(&self, parameters: &DVector<f64>) -> bool {
        let mut fitted = (0..self.width()).filter(|k| !self.pinned[*k]);
        fitted.all(|k| (self.ranges[k][0]..=self.ranges[k][1]).contains(&parameters[k]))
    }

    /// Squared residual of a block.
    pub(crate) fn residual(&self, block: usize, parameters: &DVector<f64>) -> f64 {
        let (normal, right) = &self.blocks[block];
        let bilinear = (normal * parameters).dot(parameters);
        // Rounding may take a vanishing residual below zero.
        (self.squared[block] - 2.0 * right.dot(parameters) + bilinear).max(0.0)
    }

    /// Parameters that a fold's fitted blocks ask for; of what exists in a left-out unit only, those that its even seconds do.
    pub(crate) fn solve_fold(&self, fold: &Fold) -> DVector<f64> {
        self.solve_weighted(fold, &|_| 1.0)
    }

    /// The same with a weight a block.
    pub(crate) fn solve_weighted(&self, fold: &Fold, weight: &dyn Fn(usize) -> f64) -> DVector<f64> {
        let (normal, right) = self.weighted(&fold.fit, weight);
        let mut parameters = self.solve_sums(&normal, &right);
        self.fit_events(fold, weight, &mut parameters);
        parameters
    }

    fn fit_events(&self, fold: &Fold, weight: &dyn Fn(usize) -> f64, parameters: &mut DVector<f64>) {
        let mut units: Vec<usize> = self.events.iter().map(|(_, unit)| *unit).collect();
        units.sort_unstable();
        units.dedup();
        for unit in units {
            let here: Vec<usize> =
                fold.score.iter().copied().filter(|block| self.places[*block] == (unit, true)).collect();
            if here.is_empty() {
                continue;
            }
            let own = |column: &&(usize, usize)| column.1 == unit && !self.pinned[column.0];
            let columns: Vec<usize> = self.events.iter().filter(own).map(|(column, _)| *column).collect();
            self.fit_beside(&here, weight, &columns, parameters);
        }
    }

    /// Fits these columns on some blocks beside the others, whose parameters stay.
    pub(crate) fn fit_beside(
        &self,
        blocks: &[usize],
        weight: &dyn Fn(usize) -> f64,
        columns: &[usize],
        parameters: &mut DVector<f64>,
    ) {
        columns.iter().for_each(|column| parameters[*column] = 0.0);
        let (normal, right) = self.weighted(blocks, weight);
        let rest = right - &normal * &*parameters;
        let Some(factor) = self.regular(&normal, columns).cholesky() else { return };
        let rest = DVector::from_fn(columns.len(), |k, _| rest[columns[k]]);
        for (column, value) in columns.iter().zip(factor.solve(&rest).iter()) {
            parameters[*column] = *value;
        }
    }

    /// Normal matrix and right side of all columns on these blocks, those of a fixed size included.
    pub(crate) fn sums(&self, blocks: &[usize]) -> (DMatrix<f64>, DVector<f64>) {
        self.sum(blocks)
    }

    /// Right side of a block.
    pub(crate) fn block(&self, block: usize) -> &(DMatrix<f64>, DVector<f64>) {
        &self.blocks[block]
    }

    /// Squared residual of every scored block of the folds, 0 elsewhere, each fold fitted on its own blocks.
    pub(crate) fn left_out(&self, folds: &[Fold]) -> Vec<f64> {
        let mut out = vec![0.0; self.squared.len()];
        // Every fold of several fits on what the others score: all blocks less its own.
        let all: Vec<usize> = folds.iter().flat_map(|fold| fold.score.iter().copied()).collect();
        let total = (folds.len() > 1).then(|| self.sum(&all));
        for fold in folds {
            let mut parameters = match &total {
                Some((normal, right)) => {
                    let own = self.sum(&fold.score);
                    self.solve_sums(&(normal - own.0), &(right - own.1))
                }
                None => self.solve(&fold.fit),
            };
            self.fit_events(fold, &|_| 1.0, &mut parameters);
            for &block in &fold.score {
                out[block] = self.residual(block, &parameters);
            }
        }
        out
    }

    /// Standard deviations of the parameters, from how much the blocks disagree (P. Huber's sandwich, blocks as clusters).
    pub(crate) fn sigmas(&self, blocks: &[usize], parameters: &DVector<f64>) -> DVector<f64> {
        let (normal, _) = self.sum(blocks);
        let free: Vec<usize> = (0..self.width()).filter(|k| !self.pinned[*k]).collect();
        let mut sigmas = DVector::zeros(self.width());
        let Some(factor) = self.regular(&normal, &free).cholesky() else { return sigmas };
        let mut spread = DMatrix::zeros(free.len(), free.len());
        for &block in blocks {
            let (normal, right) = &self.blocks[block];
            let score = right - normal * parameters;
            let score = DVector::from_fn(free.len(), |k, _| score[free[k]]);
            spread += &score * score.transpose();
        }
        // Few blocks make the spread look smaller than it is.
        let small = blocks.len() as f64 / (blocks.len().saturating_sub(free.len())).max(1) as f64;
        let inverse = factor.inverse();
        let covariance = &inverse * spread * &inverse * small;
        for (k, &column) in free.iter().enumerate() {
            sigmas[column] = covariance[(k, k)].max(0.0).sqrt();
        }
        sigmas
    }
}
