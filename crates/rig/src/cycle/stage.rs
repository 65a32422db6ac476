//! The last part of the cycle: a snapshot and the joints' motion to a wrench.

use can::assembly::{Absence, Snapshot};
use model::estimator::{GaugeModel, GaugeReading, Solution, WrenchEstimator};
use model::motion::JointMotion;
use model::spatial::RigidBody;
use model::terms::{Conditioner, Effect};

use super::{Estimate, INVALID_ABOVE_N, PARITY_LIMIT_SIGMA, Refusal, STUCK_AFTER, UNCERTAIN_ABOVE_N};
use crate::Rig;
use crate::model_file::ModelFile;
use crate::status::Status;
use crate::tare::{Tare, TareRefusal, Tared};

/// Snapshot and joint motion to a wrench: the last part of the cycle, also used with a motion known from elsewhere.
#[derive(Clone, Debug)]
pub struct Stage {
    estimator: WrenchEstimator,
    /// Readings that are fit for a zero at the last instant, and those among them that are part of the wrench.
    heard: Vec<Option<GaugeReading>>,
    used: Vec<Option<GaugeReading>>,
    watches: Vec<StuckWatch>,
    conditioners: Vec<Conditioner>,
    /// Whether a gauge's readings are corrected for its temperature.
    thermal: Vec<bool>,
    states: Vec<GaugeState>,
    tare: Tare,
    /// What hangs at the tip for now and is subtracted, tip frame.
    payload: RigidBody,
}

/// What became of a gauge's reading at the last instant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GaugeState {
    /// It is part of the wrench.
    Used,
    /// There was none.
    Absent(Absence),
    /// It says the same again and again.
    Stuck,
    /// The tare that is applied has no zero for it.
    NotTared,
}

impl GaugeState {
    /// Whether its reading says something about load.
    fn is_fit(self) -> bool {
        matches!(self, Self::Used | Self::NotTared)
    }
}

/// Tells a gauge that stands still from one that is quiet.
#[derive(Clone, Copy, Debug)]
struct StuckWatch {
    /// Whether the gauge's noise is large enough for equal readings to mean something.
    noisy: bool,
    last_counts: f64,
    repeats: u32,
}

impl StuckWatch {
    fn new(gauge: &GaugeModel) -> Self {
        /// Noise of so many counts makes equal readings in a row rarer than one in a million.
        const NOISY_COUNTS: f64 = 10.0;
        Self { noisy: gauge.noise_counts2 > NOISY_COUNTS.powi(2), last_counts: f64::NAN, repeats: 0 }
    }

    /// Takes in the next reading; whether the gauge is stuck.
    fn is_stuck(&mut self, counts: f64) -> bool {
        self.repeats = if counts == self.last_counts { self.repeats.saturating_add(1) } else { 0 };
        self.last_counts = counts;
        self.noisy && self.repeats >= STUCK_AFTER
    }
}

impl Stage {
    /// For a robot as its URDF has it, and its gauges.
    pub fn new(rig: &Rig, gauges: Vec<GaugeModel>) -> Self {
        Self::with(WrenchEstimator::new(&rig.chain, &rig.sections, gauges))
    }

    /// For a robot as it was calibrated.
    pub fn of_model(rig: &Rig, model: &ModelFile) -> Self {
        let (chain, arm) = model.arm(&rig.chain);
        Self::with(WrenchEstimator::with_arm(&chain, &rig.sections, model.gauges(), arm))
    }

    fn with(estimator: WrenchEstimator) -> Self {
        let is_thermal = |gauge: &GaugeModel| {
            gauge.terms.terms.iter().any(|term| matches!(term.effect, Effect::Temperature { .. }))
        };
        let gauges = estimator.gauges();
        Self {
            watches: gauges.iter().map(StuckWatch::new).collect(),
            conditioners: gauges.iter().map(|gauge| Conditioner::new(&gauge.terms)).collect(),
            thermal: gauges.iter().map(is_thermal).collect(),
            heard: Vec::with_capacity(gauges.len()),
            used: Vec::with_capacity(gauges.len()),
            states: vec![GaugeState::Absent(Absence::NeverSeen); gauges.len()],
            tare: Tare::new(gauges.len(), estimator.dynamics().coordinates()),
            payload: RigidBody::zero(),
            estimator,
        }
    }

    /// Takes in a snapshot's gauges and temperatures; what to flag of them.
    pub(super) fn listen(&mut self, snapshot: &Snapshot) -> Status {
        let mut status = Status::GOOD;
        self.heard.clear();
        self.used.clear();
        for (k, gauge) in snapshot.gauges.iter().enumerate() {
            let state = match gauge {
                Err(absence) => GaugeState::Absent(*absence),
                Ok(reading) if self.watches[k].is_stuck(reading.value) => GaugeState::Stuck,
                Ok(_) if self.tare.is_left_out(k) => GaugeState::NotTared,
                Ok(_) => GaugeState::Used,
            };
            self.states[k] = state;
            status = status.with(left_out(state));
            let counts = gauge.as_ref().ok().filter(|_| state.is_fit()).map(|reading| reading.value);
            let temperature = snapshot.temperatures[k].ok().map(|reading| reading.value);
            if self.thermal[k] && temperature.is_none() {
                status = status.with(Status::STALE);
            }
            let conditioner = &mut self.conditioners[k];
            conditioner.push(snapshot.instant_ns, counts, temperature);
            let heard = counts.map(|counts| GaugeReading {
                counts,
                regressors: *conditioner.regressors(),
                unsettled_counts2: conditioner.unsettled_counts2(),
            });
            self.heard.push(heard);
            self.used.push(heard.filter(|_| state == GaugeState::Used));
        }
        status
    }

    /// The wrench of a snapshot, given every coordinate's motion at its instant. The same snapshot may come twice.
    pub fn estimate(&mut self, snapshot: &Snapshot, motion: &[JointMotion], status: Status) -> Estimate {
        let mut status = status.with(self.listen(snapshot));
        let outcome = self.estimator.estimate(motion, &self.used).map_err(Refusal::Estimator);
        let outcome = outcome.and_then(|solution| match worst_sigma_n(&solution) <= INVALID_ABOVE_N {
            true => Ok(solution),
            false => Err(Refusal::TooUncertain),
        });
        status = status.with(match &outcome {
            Ok(solution) => judge(solution),
            Err(Refusal::TooUncertain) => Status::INVALID.with(Status::UNCERTAIN),
            Err(_) => Status::INVALID,
        });
        let tared = if self.tare.applied().is_some() { Status::TARED } else { Status::GOOD };
        status = status.with(tared);
        if outcome.is_ok() {
            let heard = self.heard.iter().copied();
            self.tare.observe(snapshot.instant_ns, heard, motion, &mut self.estimator);
        }
        Estimate {
            instant_ns: snapshot.instant_ns,
            last_stamp_ns: snapshot.last_stamp_ns,
            round: snapshot.round,
            outcome,
            status,
        }
    }

    /// The estimator with the state of the last estimate.
    pub fn estimator(&self) -> &WrenchEstimator {
        &self.estimator
    }

    /// What became of each gauge's reading at the last instant.
    pub fn gauge_states(&self) -> &[GaugeState] {
        &self.states
    }

    /// Each gauge's reading as far as it was used at the last instant.
    pub fn used(&self) -> &[Option<GaugeReading>] {
        &self.used
    }

    /// Begins to average for a tare; [`Stage::take_tare_outcome`] tells how it ended.
    pub fn begin_tare(&mut self) {
        self.tare.begin();
    }

    /// Gives up a tare that runs.
    pub fn refuse_tare(&mut self, refusal: TareRefusal) {
        self.tare.refuse(refusal);
    }

    /// Takes the calibration's zeros again.
    pub fn untare(&mut self) {
        self.tare.undo(&mut self.estimator);
    }

    /// The tare that is applied.
    pub fn tared(&self) -> Option<Tared> {
        self.tare.applied()
    }

    /// How a tare ended, once.
    pub fn take_tare_outcome(&mut self) -> Option<Result<Tared, TareRefusal>> {
        self.tare.take_outcome()
    }

    /// Subtracts weight and inertia of a body that is rigidly at the tip (tip frame), from the next estimate on and in place of
    /// the one before; a body without mass takes it off.
    pub fn set_payload(&mut self, body: &RigidBody) {
        self.payload = *body;
        self.estimator.set_payload(body);
    }

    /// The body at the tip that is subtracted, tip frame.
    pub fn payload(&self) -> &RigidBody {
        &self.payload
    }

    /// Goes on with the payload of another stage, and with its tare where the gauges are calibrated as there.
    pub fn take_over(&mut self, other: &Self) {
        self.set_payload(&other.payload);
        if self.estimator.gauges() == other.estimator.gauges() {
            self.tare.take_over(&other.tare);
            for (gauge, zero) in other.estimator.zeros().iter().enumerate() {
                self.estimator.set_zero(gauge, *zero);
            }
        }
    }
}

/// What a gauge's state means for the wrench.
fn left_out(state: GaugeState) -> Status {
    match state {
        GaugeState::Used => Status::GOOD,
        GaugeState::Absent(Absence::Saturated) => Status::DEGRADED.with(Status::SATURATED),
        GaugeState::Absent(Absence::Stale | Absence::NeverSeen) => Status::DEGRADED.with(Status::STALE),
        GaugeState::Absent(_) | GaugeState::Stuck | GaugeState::NotTared => Status::DEGRADED,
    }
}

/// Standard deviation of the worst direction, N (moments over the characteristic length).
fn worst_sigma_n(solution: &Solution) -> f64 {
    1.0 / solution.singular_values_per_n[5]
}

/// What a solution says about itself.
fn judge(solution: &Solution) -> Status {
    let uncertain = worst_sigma_n(solution) > UNCERTAIN_ABOVE_N;
    let limit = PARITY_LIMIT_SIGMA.powi(2) + solution.parity_dof as f64;
    let parity = solution.parity_dof > 0 && solution.parity_chi2 > limit;
    let flag = |raised: bool, status| if raised { status } else { Status::GOOD };
    flag(uncertain, Status::UNCERTAIN).with(flag(parity, Status::PARITY))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gauge(noise_counts: f64) -> GaugeModel {
        GaugeModel {
            compliance: nalgebra::Vector6::zeros(),
            bias_counts: 0.0,
            covariance: nalgebra::SMatrix::zeros(),
            assumed: None,
            noise_counts2: noise_counts * noise_counts,
            terms: model::terms::GaugeTerms::default(),
        }
    }

    #[test]
    fn a_noisy_gauge_that_repeats_itself_is_stuck_until_it_moves() {
        let mut watch = StuckWatch::new(&gauge(700.0));
        let stuck: Vec<bool> = [3.0, 3.0, 3.0, 3.0, 3.0, 3.0, 3.0, 4.0].map(|c| watch.is_stuck(c)).into();
        assert_eq!(stuck, [false, false, false, false, false, true, true, false]);
    }

    #[test]
    fn a_quiet_gauge_may_repeat_itself() {
        let mut watch = StuckWatch::new(&gauge(0.5));
        assert!((0..100).all(|_| !watch.is_stuck(3.0)));
    }
}
