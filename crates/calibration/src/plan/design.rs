//! Which candidates to hold: greedy growth, exchange, and the order of their worth.
//!
//! By the criterion alone a few poses would be held over and over. Errors that it does not know (of the arm, of the gauges'
//! linearity) would then repeat too, so each candidate is held once at most.

use nalgebra::SMatrix;

use super::LONGEST;
use super::candidates::Candidates;
use super::gauge::GaugeState;
use super::workspace::{Accuracy, Workspace};

/// Exchanges go through all poses so many times at most.
const PASSES: usize = 3;

/// A pose is exchanged for one that is worth this much more.
const WORTH_EXCHANGING: f64 = 1.01;

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

    /// Each pose against all candidates, given all the others, until nothing better is found.
    pub(super) fn exchange(&mut self) {
        for _ in 0..PASSES {
            let before = self.chosen.clone();
            (0..self.chosen.len()).for_each(|place| self.exchange_one(place));
            if self.chosen == before {
                return;
            }
        }
    }

    fn exchange_one(&mut self, place: usize) {
        let others = self.chosen.iter().enumerate().filter(|(k, _)| *k != place).map(|(_, c)| *c);
        let gauges = self.after(others);
        let weighing = self.workspace.weighing(&gauges);
        let own = self.worth(&gauges, &weighing, self.chosen[place]);
        match self.best(&gauges, &weighing, self.unused()) {
            Some((best, worth)) if worth > WORTH_EXCHANGING * own => self.chosen[place] = best,
            _ => {}
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

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::plan::{Weight, unknown};
    use model::dynamics::Dynamics;
    use rig::{Config, Rig};
    use std::path::Path;

    /// Mounted on a slope, so that weights show every direction of every gauge.
    fn arm() -> Rig {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/arm.toml");
        let mut config = Config::load(&file).unwrap();
        config.robot.gravity_m_s2 = [6.934, 0.0, -6.934];
        Rig::load(config).unwrap()
    }

    /// `phi = sum tr(P M)` is convex in the information: no other design of as many poses is below
    /// `phi + sum over its own poses of d(x) - n max d(x)`, `d(x) = x' P M P x / s^2` (Kiefer, Wolfowitz).
    #[test]
    fn no_other_poses_are_much_better() {
        let rig = arm();
        let mut dynamics = Dynamics::new(&rig.chain, &rig.sections);
        let known = unknown(&rig);
        let weights = [[0.0, 0.0, 0.05], [0.08, 0.0, 0.03], [0.0, 0.08, 0.03]]
            .map(|com_m| Weight { mass_kg: 0.5, com_m });
        let workspace = Workspace::new(&rig, &known, &mut dynamics, 3);
        let candidates = Candidates::new(&rig, &weights, &mut dynamics, 400, 3);
        let mut design = Design::new(&known, &candidates, &workspace);
        design.grow(&|_, poses| poses >= 40);
        design.exchange();
        let gauges = design.gauges();
        let weighing = workspace.weighing(&gauges);
        let phi: f64 = gauges.iter().zip(&weighing).map(|(g, m)| (g.covariance * m).trace()).sum();
        let d = |candidate: usize| -> f64 {
            let each = gauges.iter().zip(&weighing).zip(candidates.regressors(candidate));
            each.map(|((gauge, m), x)| gauge.sensitivity(x, m)).sum()
        };
        let own: f64 = design.chosen().iter().map(|c| d(*c)).sum();
        let largest = (0..candidates.len()).map(d).fold(0.0, f64::max);
        let best = (phi + own - 40.0 * largest) / phi;
        println!("no design of 40 poses has less than {best:.3} of this one's criterion");
        assert!(best > 0.7, "{best}");
        let mut distinct = design.chosen().to_vec();
        distinct.sort_unstable();
        distinct.dedup();
        assert_eq!(distinct.len(), 40, "no pose is held twice under one weight");
    }
}
