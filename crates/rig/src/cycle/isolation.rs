//! Which gauge is at fault, when the spare gauges disagree and nothing but that tells of it.
//!
//! ```text
//! one instant  -> how far a fault that stays undetected can move the wrench (protection level); a fault that is seen, and who may have it
//! 50 ms        -> a fault that lasts: isolated where no other single gauge could cause what is seen, else suspects by name
//! left out     -> taken back after it agreed with the others for a second in poses that would have shown its fault
//! ```
//!
//! Everything is measured in standard deviations by the covariance that also weighs the gauges: noise, calibration, the arm's own uncertainty,
//! and motion. Over 50 ms only what is new at each instant averages out.

use model::estimator::{GaugeReading, Redundancy, Solution, WrenchEstimator};
use model::sensing::CHARACTERISTIC_LENGTH_M;

use super::one_frame::OneFrame;
use super::window::Window;
use super::{INVALID_ABOVE_N, PARITY_LIMIT_SIGMA};
use crate::Rig;
use crate::model_file::{ModelFile, Sensor};
use crate::status::Status;

/// What one gauge could cause is this far from what another could: they can be told apart.
pub(super) const APART_SIGMA: f64 = 5.0;

/// A fault's signature lies no farther from its gauge's line than noise takes it.
pub(super) const EXPLAINED_SIGMA: f64 = 4.0;

/// Noise adds so much to what an undetected fault can be: one instant in a million is beyond.
const MISSED_SIGMA: f64 = 5.0;

/// A contradiction so much larger (squared) than the least of the last instants is a sudden one: no zeros drift so, and nothing says how many gauges
/// it is.
const SUDDEN: f64 = 4.0;

/// So many instants are looked back upon for that.
const LAST: usize = 5;

/// A gauge that is left out agrees with the others within this.
const AGREES_SIGMA: f64 = 3.0;

/// Blocks of 10 ms in which a gauge must agree before it is taken back, the first time and at most.
const PROOF_BLOCKS: (u32, u32) = (100, 6400);

/// What one count more changes the wrench less than this by (N or Nm) does not move it at all.
const NO_GAIN: f64 = 1e-12;

/// What is known of a fault at an instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Judgement {
    /// The largest error that one gauge can hide, or make now that a fault is seen; N, Nm.
    pub(super) protection: [f64; 6],
    pub(super) status: Status,
    /// The gauges disagree at this instant as they did not before.
    pub(super) sudden: bool,
    /// What the wrench is worth.
    pub(super) worth: Worth,
    /// A gauge to be left out from this instant on.
    pub(super) isolated: Option<usize>,
}

impl Judgement {
    /// Nothing was checked.
    pub(super) const NONE: Self = Self {
        protection: [f64::INFINITY; 6],
        status: Status::GOOD,
        sudden: false,
        worth: Worth::Bounded,
        isolated: None,
    };
}

impl Judgement {
    /// Takes in that the wrench may be off by so much more (N, Nm).
    fn doubt(&mut self, more: &[f64; 6]) {
        self.protection.iter_mut().zip(more).for_each(|(level, more)| *level += more);
        self.status = self.status.with(Status::UNCERTAIN);
        if self.worth == Worth::Bounded && worst_n(&self.protection) > INVALID_ABOVE_N {
            self.worth = Worth::Unbounded;
        }
    }
}

/// What the spare gauges leave of a wrench.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Worth {
    /// Within its deviations and the protection level.
    Bounded,
    /// A gauge is at fault, and too much is at stake.
    Unbounded,
    /// The gauges contradict each other in a way that no single one can: as if all deviations were larger, the variances by this factor.
    Contradicted(f64),
    /// The gauges contradict each other and have done so since the start: nothing says that model, pose and counts belong together.
    Unproven,
}

impl Worth {
    /// The same where the gauges contradict each other by this factor as well.
    fn contradicted(self, factor: f64) -> Self {
        match self {
            Self::Bounded => Self::Contradicted(factor),
            Self::Unbounded | Self::Unproven => self,
            Self::Contradicted(other) => Self::Contradicted(factor.max(other)),
        }
    }
}

/// A gauge that is left out for what the others say of it.
#[derive(Clone, Copy, Debug, Default)]
struct Out {
    isolated: bool,
    /// Size of its fault, counts.
    fault_counts: f64,
    /// Blocks in which it agreed, of those in which its fault would show.
    agreed: u32,
    /// Blocks that it must agree in.
    needed: u32,
    /// Sum over the present block: deviation (counts), its standard deviation (counts), instants.
    sums: (f64, f64, u32),
}

/// Fault detection and isolation of one cycle. Allocates at construction only.
#[derive(Clone, Debug)]
pub(super) struct Isolation {
    one_frame: OneFrame,
    /// What a single frame may have made of the last instant, N and Nm.
    doubt: Option<[f64; 6]>,
    redundancy: Redundancy,
    means: Redundancy,
    window: Window,
    /// Variance of each gauge's reading that is new at each instant, counts^2.
    white_counts2: Vec<f64>,
    out: Vec<Out>,
    /// Who may be at fault by the window, by this instant alone, and by either.
    lasting: Vec<bool>,
    now: Vec<bool>,
    suspects: Vec<bool>,
    disagree: bool,
    /// The gauges have agreed over 50 ms since the start.
    proven: bool,
    /// Length squared of the window's residual over what is expected.
    excess: f64,
    /// The same of each of the last instants.
    last_excesses: [f64; LAST],
    last_ns: Option<i64>,
}

impl Isolation {
    pub(super) fn new(rig: &Rig, model: &ModelFile) -> Self {
        let n = model.sensors.len();
        Self {
            one_frame: OneFrame::new(rig),
            doubt: None,
            redundancy: Redundancy::new(n),
            means: Redundancy::new(n),
            window: Window::new(n),
            white_counts2: model.sensors.iter().map(Sensor::white_counts2).collect(),
            out: vec![Out { needed: PROOF_BLOCKS.0, ..Out::default() }; n],
            lasting: vec![false; n],
            now: vec![false; n],
            suspects: vec![false; n],
            disagree: false,
            proven: false,
            excess: 1.0,
            last_excesses: [1.0; LAST],
            last_ns: None,
        }
    }

    /// Whether a gauge is left out.
    pub(super) fn is_out(&self, gauge: usize) -> bool {
        self.out[gauge].isolated
    }

    /// Who may be at fault at the last instant; none where all agree.
    pub(super) fn suspects(&self) -> &[bool] {
        &self.suspects
    }

    /// Who alone can have caused what is seen at the last instant, whatever was before.
    pub(super) fn suspects_now(&self) -> &[bool] {
        &self.now
    }

    /// Model, pose and counts belong together, whatever the gauges say.
    pub(super) fn take_for_proven(&mut self) {
        self.proven = true;
    }

    /// Without a wrench nothing is known of faults.
    pub(super) fn pass(&mut self) {
        self.suspects.fill(false);
    }

    /// Leaves out what another left out: its gauges are these.
    pub(super) fn take_over(&mut self, other: &Self) {
        self.out.copy_from_slice(&other.out);
    }

    /// Takes in the wrench of an instant. `heard` are all readings that are fit, also of gauges that are left out.
    pub(super) fn judge(
        &mut self,
        instant_ns: i64,
        heard: &[Option<GaugeReading>],
        estimator: &mut WrenchEstimator,
        solution: &Solution,
    ) -> Judgement {
        self.now.fill(false);
        self.suspects.fill(false);
        let mut judgement = Judgement::NONE;
        if !estimator.redundancy(&solution.wrench, &mut self.redundancy) {
            return judgement;
        }
        // The same instant may be asked for twice; it happened once.
        let before = if self.last_ns == Some(instant_ns) {
            &self.last_excesses[..LAST - 1]
        } else {
            &self.last_excesses[..]
        };
        let (previous, least) =
            (before[before.len() - 1], before.iter().copied().fold(f64::INFINITY, f64::min));
        self.look(estimator, [previous, least], &mut judgement);
        if self.last_ns != Some(instant_ns) {
            self.doubt = self.one_frame.doubt(instant_ns, estimator, solution);
        }
        if let Some(doubt) = &self.doubt {
            judgement.doubt(doubt);
        }
        let step_ns = self.last_ns.map_or(0, |last_ns| instant_ns.saturating_sub(last_ns));
        if self.last_ns.replace(instant_ns) != Some(instant_ns) {
            let ends =
                self.window.push(instant_ns, step_ns, &self.redundancy, estimator.present(), &self.suspects);
            self.last_excesses.rotate_left(1);
            self.last_excesses[LAST - 1] = self.excess_now();
            self.hear_those_left_out(heard, estimator, solution, ends);
            if ends {
                judgement.isolated = self.decide(estimator, solution);
            }
        }
        self.now.copy_from_slice(&self.suspects);
        if self.disagree {
            judgement.status = judgement.status.with(Status::PARITY).with(Status::UNCERTAIN);
            self.suspects.iter_mut().zip(&self.lasting).for_each(|(suspect, lasting)| *suspect |= lasting);
            if !self.lasting.contains(&true) {
                judgement.worth = judgement.worth.contradicted(self.excess);
            }
        }
        if !self.proven && judgement.status.has(Status::PARITY) {
            judgement.worth = Worth::Unproven;
        }
        judgement
    }

    /// One instant by itself; `before` are the excess of the instant before and the least of the last ones.
    fn look(&mut self, estimator: &WrenchEstimator, before: [f64; 2], judgement: &mut Judgement) {
        let seen = &self.redundancy;
        let limit2 = limit2(seen.spare());
        let is_fault = seen.spare() > 0 && seen.chi2() > limit2;
        let mut protection = [0.0f64; 6];
        for (row, gauge) in estimator.present().enumerate() {
            let Some(sigma_counts) = seen.fault_sigma_counts(row) else {
                widen(&mut protection, seen.gain(row), f64::INFINITY);
                continue;
            };
            let may = is_fault && seen.beside2(row) <= apart2(seen.spare());
            self.suspects[gauge] = may;
            let shown = if may { seen.along(row).abs().max(limit2.sqrt()) } else { limit2.sqrt() };
            widen(&mut protection, seen.gain(row), (shown + MISSED_SIGMA) * sigma_counts);
        }
        judgement.protection = protection;
        if !is_fault {
            return;
        }
        judgement.status = Status::PARITY.with(Status::UNCERTAIN);
        let excess = self.excess_now();
        let [is_first, is_sudden] = before.map(|before| excess > SUDDEN * before.max(1.0));
        judgement.sudden = is_sudden;
        judgement.worth = match self.suspects.contains(&true) {
            // Frames with wrong bits look like a gauge's fault, by chance, for as long as a frame counts.
            _ if is_first => Worth::Unbounded,
            false if is_sudden => Worth::Unbounded,
            false => Worth::Contradicted(excess),
            true if worst_n(&protection) > INVALID_ABOVE_N => Worth::Unbounded,
            true => Worth::Bounded,
        };
    }

    /// Length squared of this instant's residual over what is expected.
    fn excess_now(&self) -> f64 {
        self.redundancy.chi2() / self.redundancy.spare().max(1) as f64
    }

    /// The last 50 ms: whether the gauges disagree, who may be at fault, and who is.
    fn decide(&mut self, estimator: &mut WrenchEstimator, solution: &Solution) -> Option<usize> {
        let instants = f64::from(self.window.instants());
        let (wrench, white) = (&solution.wrench, &self.white_counts2);
        if !estimator.redundancy_of_means(wrench, white, instants, &mut self.means) {
            return None;
        }
        let finding = self.window.find(&self.means)?;
        self.lasting.fill(false);
        self.disagree = finding.disagree;
        self.proven |= !finding.disagree;
        self.excess = finding.excess;
        for (row, gauge) in estimator.present().enumerate() {
            self.lasting[gauge] = finding.disagree && self.window.may(row);
        }
        // Before all have agreed once it may as well be the pose that is not the arm's.
        let row = finding.culprit.filter(|_| self.proven)?;
        let gauge = estimator.present().nth(row)?;
        let out = &mut self.out[gauge];
        // Whoever fails again has to prove itself for longer.
        let needed = if out.fault_counts > 0.0 { 2 * out.needed } else { out.needed };
        *out = Out {
            isolated: true,
            fault_counts: self.window.fault_counts(row),
            needed: needed.min(PROOF_BLOCKS.1),
            ..Out::default()
        };
        self.window.clear();
        self.lasting.fill(false);
        self.disagree = false;
        Some(gauge)
    }

    /// Lets gauges that are left out prove themselves against the others.
    fn hear_those_left_out(
        &mut self,
        heard: &[Option<GaugeReading>],
        estimator: &WrenchEstimator,
        solution: &Solution,
        ends: bool,
    ) {
        for (gauge, out) in self.out.iter_mut().enumerate().filter(|(_, out)| out.isolated) {
            if let Some(reading) = &heard[gauge] {
                let (deviation, sigma) = estimator.deviation_counts(gauge, reading, solution);
                out.sums = (out.sums.0 + deviation, out.sums.1 + sigma, out.sums.2 + 1);
            }
            if !ends {
                continue;
            }
            let (deviation, sigma, instants) = std::mem::take(&mut out.sums);
            let shows = instants > 0 && out.fault_counts * f64::from(instants) >= PARITY_LIMIT_SIGMA * sigma;
            if shows {
                out.agreed = if deviation.abs() <= AGREES_SIGMA * sigma { out.agreed + 1 } else { 0 };
            }
            out.isolated = out.agreed < out.needed;
        }
    }
}

/// Length of a residual squared that is beyond chance, with so many spare gauges.
pub(super) fn limit2(spare: usize) -> f64 {
    PARITY_LIMIT_SIGMA.powi(2) + spare as f64
}

/// Distance squared from a line beyond which its gauge is not the cause, with so many spare gauges.
pub(super) fn apart2(spare: usize) -> f64 {
    APART_SIGMA.powi(2) + spare.saturating_sub(2) as f64
}

fn widen(protection: &mut [f64; 6], gain: &[f64; 6], fault_counts: f64) {
    for (level, gain) in protection.iter_mut().zip(gain).filter(|(_, gain)| gain.abs() > NO_GAIN) {
        *level = level.max(gain.abs() * fault_counts);
    }
}

/// The worst component, N (moments over the characteristic length).
fn worst_n(protection: &[f64; 6]) -> f64 {
    let of = |(k, level): (usize, &f64)| if k < 3 { *level } else { level / CHARACTERISTIC_LENGTH_M };
    protection.iter().enumerate().map(of).fold(0.0, f64::max)
}
