//! Which candidates to hold: greedy growth, exchange, and the order of their worth.
//!
//! By the criterion alone a few poses would be held over and over. Errors that it does not know (of the arm, of the gauges'
//! linearity) would then repeat too, so each candidate is held once at most.

use nalgebra::SMatrix;

use super::LONGEST;
use super::candidates::Candidates;
use super::gauge::GaugeState;
use super::workspace::{Accuracy, Workspace};

/// A pose is exchanged for one that is worth this much more.
const WORTH_EXCHANGING: f64 = 1.02;

/// The chosen candidates.
pub(super) struct Design<'a> {
    known: &'a [GaugeState],
    candidates: &'a Candidates,
    workspace: &'a Workspace,
    chosen: Vec<usize>,
}

impl<'a> Design<'a> {
    pub(super) fn new(known: &'a [GaugeState], candidates: &'a Candidates, workspace: &'a Workspace) -> Self {
        Self { known, candidates, workspace, chosen: Vec::new() }
    }

    pub(super) fn chosen(&self) -> &[usize] {
        &self.chosen
    }

    /// What is known after all chosen poses.
    pub(super) fn gauges(&self) -> Vec<GaugeState> {
        self.after(self.chosen.iter().copied())
    }

    /// Adds the best candidate until enough is reached.
    pub(super) fn grow(&mut self, reached: &impl Fn(&Accuracy, usize) -> bool) {
        let mut gauges = self.known.to_vec();
        while self.chosen.len() < LONGEST && !reached(&self.workspace.accuracy(&gauges), self.chosen.len()) {
            let weighing = self.workspace.weighing(&gauges);
            let Some((best, _)) = self.best(&gauges, &weighing, self.unused()) else { return };
            self.hold(&mut gauges, best);
            self.chosen.push(best);
        }
    }

    /// Each pose once more against all candidates, given all the others.
    pub(super) fn exchange(&mut self) {
        for place in 0..self.chosen.len() {
            let others = self.chosen.iter().enumerate().filter(|(k, _)| *k != place).map(|(_, c)| *c);
            let gauges = self.after(others);
            let weighing = self.workspace.weighing(&gauges);
            let own = self.worth(&gauges, &weighing, self.chosen[place]);
            match self.best(&gauges, &weighing, self.unused()) {
                Some((best, worth)) if worth > WORTH_EXCHANGING * own => self.chosen[place] = best,
                _ => {}
            }
        }
    }

    /// Puts the chosen poses in the order of their worth and leaves out those beyond what is to be reached; how well the
    /// wrench is known after each.
    pub(super) fn order(&mut self, reached: &impl Fn(&Accuracy, usize) -> bool) -> Vec<Accuracy> {
        let mut left = std::mem::take(&mut self.chosen);
        let mut gauges = self.known.to_vec();
        let mut progress: Vec<Accuracy> = Vec::with_capacity(left.len());
        while !progress.last().is_some_and(|last| reached(last, progress.len())) {
            let weighing = self.workspace.weighing(&gauges);
            let Some((best, _)) = self.best(&gauges, &weighing, left.iter().copied()) else { break };
            left.remove(left.iter().position(|c| *c == best).expect("the best is one of those left"));
            self.hold(&mut gauges, best);
            self.chosen.push(best);
            progress.push(self.workspace.accuracy(&gauges));
        }
        progress
    }

    fn unused(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.candidates.len()).filter(|candidate| !self.chosen.contains(candidate))
    }

    fn after(&self, chosen: impl Iterator<Item = usize>) -> Vec<GaugeState> {
        let mut gauges = self.known.to_vec();
        chosen.for_each(|candidate| self.hold(&mut gauges, candidate));
        gauges
    }

    fn hold(&self, gauges: &mut [GaugeState], candidate: usize) {
        for (gauge, x) in gauges.iter_mut().zip(self.candidates.regressors(candidate)) {
            gauge.hold(x);
        }
    }

    fn worth(&self, gauges: &[GaugeState], weighing: &[SMatrix<f64, 7, 7>], candidate: usize) -> f64 {
        let each = gauges.iter().zip(weighing).zip(self.candidates.regressors(candidate));
        each.map(|((gauge, weighing), x)| gauge.gain(x, weighing)).sum()
    }

    fn best(
        &self,
        gauges: &[GaugeState],
        weighing: &[SMatrix<f64, 7, 7>],
        among: impl Iterator<Item = usize>,
    ) -> Option<(usize, f64)> {
        among.map(|c| (c, self.worth(gauges, weighing, c))).max_by(|a, b| a.1.total_cmp(&b.1))
    }
}
