//! Which candidates to hold: greedy growth, exchange, a search around each, and the order of their worth.
//!
//! By the criterion alone a few poses would be held over and over. Errors that it does not know (of the arm, of the gauges'
//! linearity) would then repeat too, so each pose is held once at most under one weight.

use nalgebra::SMatrix;

use super::LONGEST;
use super::candidates::Candidates;
use super::gauge::{GaugeState, Regressor};
use super::workspace::{Accuracy, Workspace};

/// Exchanges go through all poses so many times at most.
const PASSES: usize = 4;

/// Exchanges begin anew with fewer poses so many times at most.
const ROUNDS: usize = 6;

/// A pose is exchanged for one that is worth this much more.
const WORTH_EXCHANGING: f64 = 1.01;

/// Steps of the search around a pose, shares of half a joint's range: it begins with the first and ends below the second.
const STEPS: (f64, f64) = (0.3, 0.02);

/// A step is taken where it is worth this much more; with it the search ends.
const WORTH_STEPPING: f64 = 1.0005;

type Weighing = [SMatrix<f64, 7, 7>];

/// The chosen candidates.
pub(super) struct Design<'a> {
    known: &'a [GaugeState],
    candidates: Candidates,
    workspace: &'a Workspace,
    chosen: Vec<usize>,
}

impl<'a> Design<'a> {
    pub(super) fn new(known: &'a [GaugeState], candidates: Candidates, workspace: &'a Workspace) -> Self {
        Self { known, candidates, workspace, chosen: Vec::new() }
    }

    pub(super) fn candidates(&self) -> &Candidates {
        &self.candidates
    }

    pub(super) fn chosen(&self) -> &[usize] {
        &self.chosen
    }

    /// What is known after all chosen poses.
    pub(super) fn gauges(&self) -> Vec<GaugeState> {
        self.after(self.chosen.iter().copied())
    }

    /// The fewest poses found that reach enough, or as many as there may be; how well the wrench is known after each.
    pub(super) fn find(&mut self, reached: &impl Fn(&Accuracy, usize) -> bool) -> Vec<Accuracy> {
        self.grow(reached);
        let enough =
            |progress: &[Accuracy]| progress.last().is_some_and(|last| reached(last, progress.len()));
        let mut progress = self.order(reached);
        if !enough(&progress) {
            return progress;
        }
        for _ in 0..ROUNDS {
            let before = self.chosen.clone();
            self.exchange();
            let better = self.order(reached);
            // Exchanges look at the whole workspace: where its worst place is asked for they may fail.
            if !enough(&better) {
                self.chosen = before;
                break;
            }
            progress = better;
            // Fewer poses than before are the better for one more exchange among themselves.
            if self.chosen.len() == before.len() {
                break;
            }
        }
        progress
    }

    /// Adds the best candidate until enough is reached.
    fn grow(&mut self, reached: &impl Fn(&Accuracy, usize) -> bool) {
        let mut gauges = self.known.to_vec();
        while self.chosen.len() < LONGEST && !reached(&self.workspace.accuracy(&gauges), self.chosen.len()) {
            let weighing = self.workspace.weighing(&gauges);
            let Some((best, _)) = self.best(&gauges, &weighing, self.unused()) else { return };
            self.hold(&mut gauges, best);
            self.chosen.push(best);
        }
    }

    /// Each pose against all candidates and those around it, given all the others, until nothing better is found.
    fn exchange(&mut self) {
        for _ in 0..PASSES {
            let before = self.chosen.clone();
            (0..self.chosen.len()).for_each(|place| self.exchange_one(place));
            if self.chosen == before {
                return;
            }
        }
    }

    fn exchange_one(&mut self, place: usize) {
        let gauges = self.after(self.others(place));
        let weighing = self.workspace.weighing(&gauges);
        let own = self.worth(&gauges, &weighing, self.chosen[place]);
        if let Some((best, worth)) = self.best(&gauges, &weighing, self.unused())
            && worth > WORTH_EXCHANGING * own
        {
            self.chosen[place] = best;
        }
        self.search(place, &gauges, &weighing);
    }

    /// Moves one pose joint by joint, and changes its weight, as long as it is worth more.
    fn search(&mut self, place: usize, gauges: &[GaugeState], weighing: &Weighing) {
        let begin = self.chosen[place];
        let mut pose_rad = self.candidates.pose_rad(begin).to_vec();
        let mut own = self.worth(gauges, weighing, begin);
        let mut found = None;
        let mut step = STEPS.0;
        while step > STEPS.1 {
            match self.step(place, &pose_rad, step, gauges, weighing) {
                Some(better) if better.worth > WORTH_STEPPING * own => {
                    own = better.worth;
                    pose_rad.clone_from(&better.pose_rad);
                    found = Some(better);
                }
                _ => step *= 0.5,
            }
        }
        if let Some(found) = found {
            let first = self.candidates.add(found.pose_rad, found.choices);
            self.chosen[place] = first + found.weight;
        }
    }

    /// The best of the poses one step away, under any weight.
    fn step(
        &mut self,
        place: usize,
        pose_rad: &[f64],
        step: f64,
        gauges: &[GaugeState],
        weighing: &Weighing,
    ) -> Option<Neighbour> {
        let mut best: Option<Neighbour> = None;
        for pose_rad in self.candidates.neighbours(pose_rad, step) {
            let choices = self.candidates.loads(&pose_rad);
            let free = |weight: &usize| !self.candidates.is_near(&pose_rad, *weight, self.others(place));
            let each = (0..choices.len()).filter(free).map(|w| (w, gain(gauges, weighing, &choices[w])));
            let Some((weight, worth)) = each.max_by(|a, b| a.1.total_cmp(&b.1)) else { continue };
            if best.as_ref().is_none_or(|best| worth > best.worth) {
                best = Some(Neighbour { pose_rad, choices, weight, worth });
            }
        }
        best
    }

    fn others(&self, place: usize) -> impl Iterator<Item = usize> + '_ {
        self.chosen.iter().enumerate().filter(move |(k, _)| *k != place).map(|(_, chosen)| *chosen)
    }

    /// Puts the chosen poses in the order of their worth and leaves out those beyond what is to be reached; how well the
    /// wrench is known after each.
    fn order(&mut self, reached: &impl Fn(&Accuracy, usize) -> bool) -> Vec<Accuracy> {
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

    /// Candidates that are not nearly what is held already.
    fn unused(&self) -> impl Iterator<Item = usize> + '_ {
        self.candidates.spread().filter(|candidate| {
            let (pose_rad, weight) =
                (self.candidates.pose_rad(*candidate), self.candidates.weight(*candidate));
            !self.candidates.is_near(pose_rad, weight, self.chosen.iter().copied())
        })
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

    fn worth(&self, gauges: &[GaugeState], weighing: &Weighing, candidate: usize) -> f64 {
        gain(gauges, weighing, self.candidates.regressors(candidate))
    }

    fn best(
        &self,
        gauges: &[GaugeState],
        weighing: &Weighing,
        among: impl Iterator<Item = usize>,
    ) -> Option<(usize, f64)> {
        among.map(|c| (c, self.worth(gauges, weighing, c))).max_by(|a, b| a.1.total_cmp(&b.1))
    }
}

/// A pose beside another, the best weight for it and what it is worth.
struct Neighbour {
    pose_rad: Vec<f64>,
    choices: Vec<Vec<Regressor>>,
    weight: usize,
    worth: f64,
}

/// What a held pose with these loads is worth.
fn gain(gauges: &[GaugeState], weighing: &Weighing, loads: &[Regressor]) -> f64 {
    gauges.iter().zip(weighing).zip(loads).map(|((gauge, weighing), x)| gauge.gain(x, weighing)).sum()
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
        let mut design = Design::new(&known, Candidates::new(&rig, &weights, 300, 3), &workspace);
        design.grow(&|_, poses| poses >= 40);
        design.exchange();
        let gauges = design.gauges();
        let weighing = workspace.weighing(&gauges);
        let phi: f64 = gauges.iter().zip(&weighing).map(|(g, m)| (g.covariance * m).trace()).sum();
        let candidates = design.candidates();
        let d = |loads: &[Regressor]| -> f64 {
            let each = gauges.iter().zip(&weighing).zip(loads);
            each.map(|((gauge, m), x)| gauge.sensitivity(x, m)).sum()
        };
        let own: f64 = design.chosen().iter().map(|c| d(candidates.regressors(*c))).sum();
        // Against poses that the design never saw as well as those it chose from.
        let fresh = Candidates::new(&rig, &weights, 2000, 77);
        let seen = candidates.spread().chain(design.chosen().iter().copied());
        let largest = seen.map(|c| d(candidates.regressors(c))).fold(0.0, f64::max);
        let largest = fresh.spread().map(|c| d(fresh.regressors(c))).fold(largest, f64::max);
        let best = (phi + own - 40.0 * largest) / phi;
        println!("no design of 40 poses has less than {best:.3} of this one's criterion");
        assert!(best > 0.8, "{best}");
        for (place, chosen) in design.chosen().iter().enumerate() {
            let (pose, weight) = (candidates.pose_rad(*chosen), candidates.weight(*chosen));
            assert!(!candidates.is_near(pose, weight, design.others(place)), "a pose held twice: {pose:?}");
        }
    }
}
