//! What the spare gauges said over the last 50 ms.
//!
//! Five blocks of 10 ms on a fixed grid (one instant each where cycles are longer), so the work and the memory do not depend on the rate. A
//! hypothesis is followed at each instant in that instant's geometry: "gauge i alone is at fault" leaves of the residual only what lies beside
//! its line, whatever the fault does in time and however the arm moves.

use std::collections::VecDeque;

use model::estimator::Redundancy;

use super::isolation::{APART_SIGMA, EXPLAINED_SIGMA, apart2, limit2};

/// Length of a block, ns.
const BLOCK_NS: i64 = 10_000_000;

/// Blocks of the window.
const BLOCKS: usize = 5;

/// Blocks that must show a fault for it to last: the first may hold but its beginning.
const LASTING_BLOCKS: usize = BLOCKS - 1;

/// A block shows a fault where its part along the line is at least this share of the window's.
const SHARE_OF_BLOCK: f64 = 0.25;

/// After a gap of so many blocks the window begins anew.
const FORGET_BLOCKS: i64 = 20;

#[derive(Clone, Debug)]
struct Block {
    index: i64,
    instants: u32,
    /// Instants at which the residual was beyond chance.
    seen: u32,
    /// Of these, instants at which the row was the only one that could be at fault.
    votes: Vec<u32>,
    /// Sum of squares of each row's guess of its fault, counts^2.
    faults_counts2: Vec<f64>,
    /// Sums of each row's residual, counts.
    residuals_counts: Vec<f64>,
    /// For each row as the culprit: sums of what is left of each row's residual without it, counts.
    left_counts: Vec<f64>,
}

impl Block {
    fn new(n: usize) -> Self {
        Self {
            index: 0,
            instants: 0,
            seen: 0,
            votes: vec![0; n],
            faults_counts2: vec![0.0; n],
            residuals_counts: vec![0.0; n],
            left_counts: vec![0.0; n * n],
        }
    }

    fn clear(&mut self, index: i64) {
        self.index = index;
        self.instants = 0;
        self.seen = 0;
        self.votes.fill(0);
        self.faults_counts2.fill(0.0);
        self.residuals_counts.fill(0.0);
        self.left_counts.fill(0.0);
    }
}

/// What the window shows.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Finding {
    /// The gauges disagree beyond chance.
    pub(super) disagree: bool,
    /// Length squared of the residual over what is expected of it.
    pub(super) excess: f64,
    /// The row that alone can be the cause, where there is one and its fault lasts.
    pub(super) culprit: Option<usize>,
}

/// Sums over the last blocks. Allocates at construction only.
#[derive(Clone, Debug)]
pub(super) struct Window {
    blocks: VecDeque<Block>,
    /// Gauges that were there at the instants in the blocks, in the order of rows.
    gauges: Vec<usize>,
    rows: usize,
    /// Rows that may be the cause, after [`Window::find`].
    may: Vec<bool>,
    mean: Vec<f64>,
    left: Vec<f64>,
}

impl Window {
    /// For up to so many gauges.
    pub(super) fn new(n: usize) -> Self {
        // Empty blocks wait at the front, those in use are at the back.
        Self {
            blocks: (0..BLOCKS).map(|_| Block::new(n)).collect(),
            gauges: Vec::with_capacity(n),
            rows: n,
            may: vec![false; n],
            mean: vec![0.0; n],
            left: vec![0.0; n],
        }
    }

    pub(super) fn clear(&mut self) {
        self.blocks.iter_mut().for_each(|block| block.clear(0));
        self.may.fill(false);
        self.gauges.clear();
    }

    /// Instants in the window.
    pub(super) fn instants(&self) -> u32 {
        self.blocks.iter().map(|block| block.instants).sum()
    }

    /// Whether a row may be the cause of what was last found.
    pub(super) fn may(&self, row: usize) -> bool {
        self.may[row]
    }

    /// Size of a row's fault over the window (root of the mean square), counts.
    pub(super) fn fault_counts(&self, row: usize) -> f64 {
        let sum: f64 = self.blocks.iter().map(|block| block.faults_counts2[row]).sum();
        (sum / f64::from(self.instants().max(1))).sqrt()
    }

    /// Adds an instant, `step_ns` after the last; whether a block ends with it. Instants at which other gauges have readings than at those before
    /// are passed over, until there is nothing else for the length of the window.
    pub(super) fn push(
        &mut self,
        instant_ns: i64,
        step_ns: i64,
        seen: &Redundancy,
        gauges: impl ExactSizeIterator<Item = usize> + Clone,
        suspects: &[bool],
    ) -> bool {
        let index = instant_ns.div_euclid(BLOCK_NS);
        // Stamps may lie by centuries.
        let ends = instant_ns.saturating_add(step_ns.max(1)).div_euclid(BLOCK_NS) > index;
        let newest = self.blocks[BLOCKS - 1].index;
        let long_ago = (index - newest).abs() > FORGET_BLOCKS;
        let same = self.gauges.iter().copied().eq(gauges.clone());
        // Long blocks: a window of fewer than five cycles waits for five of them.
        let lapsed = index - newest >= (BLOCKS as i64).max(step_ns.saturating_mul(3) / BLOCK_NS);
        if !same && !lapsed && !long_ago && !self.gauges.is_empty() {
            return false;
        }
        if !same || long_ago {
            self.clear();
            self.gauges.extend(gauges);
        }
        if self.blocks[BLOCKS - 1].instants == 0 || self.blocks[BLOCKS - 1].index != index {
            self.blocks.rotate_left(1);
            self.blocks[BLOCKS - 1].clear(index);
        }
        let sole = match suspects.iter().filter(|suspect| **suspect).count() {
            1 => suspects.iter().position(|suspect| *suspect),
            _ => None,
        };
        let rows = self.rows;
        let block = &mut self.blocks[BLOCKS - 1];
        block.instants += 1;
        block.seen += u32::from(seen.spare() > 0 && seen.chi2() > limit2(seen.spare()));
        for (row, gauge) in self.gauges.iter().enumerate() {
            let fault_counts = seen.fault_counts(row);
            block.votes[row] += u32::from(sole == Some(*gauge));
            block.faults_counts2[row] += fault_counts * fault_counts;
            block.residuals_counts[row] += seen.residual_counts(row);
            for other in 0..self.gauges.len() {
                block.left_counts[row * rows + other] +=
                    seen.residual_counts(other) - seen.signature(other, row) * fault_counts;
            }
        }
        ends
    }

    /// What the whole window shows, in the metric of means over it; none while it is not full.
    pub(super) fn find(&mut self, means: &Redundancy) -> Option<Finding> {
        let (n, spare) = (self.gauges.len(), means.spare());
        if means.len() != n || self.blocks.iter().any(|block| block.instants == 0) {
            return None;
        }
        self.may.fill(false);
        if spare == 0 {
            return Some(Finding::default());
        }
        if let Some(row) = self.outvoted() {
            self.may[row] = true;
            return Some(Finding { disagree: true, excess: 1.0, culprit: Some(row) });
        }
        self.average(|block, row| block.residuals_counts[row], |window| &mut window.mean);
        let (along, beside2) = means.parts(&self.mean[..n], 0);
        let length2 = along * along + beside2;
        if length2 <= limit2(spare) {
            return Some(Finding::default());
        }
        let mut closest = (f64::INFINITY, 0);
        let rows = self.rows;
        for row in (0..n).filter(|row| means.fault_sigma_counts(*row).is_some()) {
            self.average(|block, other| block.left_counts[row * rows + other], |window| &mut window.left);
            let (_, beside2) = means.parts(&self.left[..n], row);
            self.may[row] = beside2 <= apart2(spare);
            if beside2 < closest.0 {
                closest = (beside2, row);
            }
        }
        let (beside2, row) = closest;
        let clear = beside2 <= apart2(spare) - APART_SIGMA.powi(2) + EXPLAINED_SIGMA.powi(2);
        let sole = self.may.iter().filter(|may| **may).count() == 1;
        let culprit = (spare > 1 && clear && sole && self.lasts(means, row)).then_some(row);
        Some(Finding { disagree: true, excess: length2 / spare as f64, culprit })
    }

    /// The row whose fault was seen for most of the window, by itself in every instant that could tell.
    fn outvoted(&self) -> Option<usize> {
        let seen: u32 = self.blocks.iter().map(|block| block.seen).sum();
        let votes = |row: usize| self.blocks.iter().map(|block| block.votes[row]).sum::<u32>();
        let all: u32 = (0..self.gauges.len()).map(votes).sum();
        let row = (0..self.gauges.len()).max_by_key(|row| votes(*row))?;
        let lasting = self.blocks.iter().filter(|block| block.votes[row] > 0).count() >= LASTING_BLOCKS;
        let most = 2 * seen >= self.instants() && 2 * votes(row) >= seen;
        (lasting && most && votes(row) == all).then_some(row)
    }

    /// Whether the blocks show a row's fault one after the other, and alike.
    fn lasts(&mut self, means: &Redundancy, row: usize) -> bool {
        let n = self.gauges.len();
        let (whole, _) = means.parts(&self.mean[..n], row);
        let mut lasting = 0;
        for at in 0..BLOCKS {
            let block = &self.blocks[at];
            for (mean, sum) in self.left.iter_mut().zip(&block.residuals_counts) {
                *mean = sum / f64::from(block.instants.max(1));
            }
            let (part, _) = means.parts(&self.left[..n], row);
            lasting += usize::from(part / whole >= SHARE_OF_BLOCK);
        }
        lasting >= LASTING_BLOCKS
    }

    fn average(&mut self, sum: impl Fn(&Block, usize) -> f64, into: fn(&mut Self) -> &mut Vec<f64>) {
        let instants = f64::from(self.instants().max(1));
        for row in 0..self.gauges.len() {
            let mean = self.blocks.iter().map(|block| sum(block, row)).sum::<f64>() / instants;
            into(self)[row] = mean;
        }
    }
}
