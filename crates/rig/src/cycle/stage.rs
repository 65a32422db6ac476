//! The last part of the cycle: a snapshot and the joints' motion to a wrench.

use can::assembly::{Absence, Snapshot};
use model::estimator::{GaugeModel, GaugeReading, Solution, WrenchEstimator};
use model::motion::JointMotion;
use model::spatial::RigidBody;
use model::terms::{Conditioner, Effect};

use super::isolation::{Isolation, Judgement, Worth};
use super::several::Several;
use super::stuck::StuckWatch;
use super::{Estimate, INVALID_ABOVE_N, Refusal, UNCERTAIN_ABOVE_N};
use crate::Rig;
use crate::model_file::{ModelFile, Sensor};
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
    /// Faults that only the other gauges tell of; none where gauges are known too little to check each other.
    isolation: Option<Isolation>,
    /// Gauges, then joints, that go astray.
    several: Several,
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
    /// It says something else than the others, and no other gauge can be the cause.
    Isolated,
}

impl GaugeState {
    /// Whether its reading says something about load.
    fn is_fit(self) -> bool {
        matches!(self, Self::Used | Self::NotTared | Self::Isolated)
    }
}

impl Stage {
    /// For a robot as its URDF has it, and its gauges; without a calibration they are not held against each other.
    pub fn new(rig: &Rig, gauges: Vec<GaugeModel>) -> Self {
        let white_counts2: Vec<f64> = gauges.iter().map(|gauge| gauge.noise_counts2).collect();
        Self::with(rig, WrenchEstimator::new(&rig.chain, &rig.sections, gauges), &white_counts2, None)
    }

    /// For a robot as it was calibrated.
    pub fn of_model(rig: &Rig, model: &ModelFile) -> Self {
        let (chain, arm) = model.arm(&rig.chain);
        let estimator = WrenchEstimator::with_arm(&chain, &rig.sections, model.gauges(), arm);
        let white_counts2: Vec<f64> = model.sensors.iter().map(Sensor::white_counts2).collect();
        Self::with(rig, estimator, &white_counts2, Some(Isolation::new(rig, model)))
    }

    /// With the variance of each gauge's reading that is new at each instant, counts^2.
    fn with(
        rig: &Rig,
        estimator: WrenchEstimator,
        white_counts2: &[f64],
        isolation: Option<Isolation>,
    ) -> Self {
        let is_thermal = |gauge: &GaugeModel| {
            gauge.terms.terms.iter().any(|term| matches!(term.effect, Effect::Temperature { .. }))
        };
        let gauges = estimator.gauges();
        let watches = rig.layout.gauges.iter().zip(white_counts2).map(|(gauge, white_counts2)| {
            StuckWatch::of_gauge(white_counts2.sqrt(), gauge.counts.spec.scale.abs())
        });
        Self {
            watches: watches.collect(),
            conditioners: gauges.iter().map(|gauge| Conditioner::new(&gauge.terms)).collect(),
            thermal: gauges.iter().map(is_thermal).collect(),
            heard: Vec::with_capacity(gauges.len()),
            used: Vec::with_capacity(gauges.len()),
            states: vec![GaugeState::Absent(Absence::NeverSeen); gauges.len()],
            several: Several::new(gauges.len() + estimator.dynamics().coordinates()),
            tare: Tare::new(gauges.len(), estimator.dynamics().coordinates()),
            payload: RigidBody::zero(),
            isolation,
            estimator,
        }
    }

    /// A daemon starts as valid only once the gauges have agreed; a recording is scored all the same, for its score tells how far they do.
    #[must_use]
    pub fn taken_for_proven(mut self) -> Self {
        self.isolation.iter_mut().for_each(Isolation::take_for_proven);
        self
    }

    /// Begins an instant, before what is to be said of it.
    pub(super) fn begin(&mut self, instant_ns: i64) {
        self.several.begin(instant_ns);
    }

    /// A joint's encoder says at this instant what cannot be.
    pub(super) fn doubt_joint(&mut self, joint: usize) {
        let gauges = self.estimator.gauges().len();
        self.several.note(|sensor| sensor == gauges + joint);
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
                Ok(_) if self.isolation.as_ref().is_some_and(|isolation| isolation.is_out(k)) => {
                    GaugeState::Isolated
                }
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

    /// Does ahead what the next estimate will need of the arm if this is its motion.
    pub(super) fn prepare(&mut self, motion: &[JointMotion]) {
        self.estimator.prepare(motion);
    }

    /// The wrench of a snapshot, given every coordinate's motion at its instant. The same snapshot may come twice.
    pub fn estimate(&mut self, snapshot: &Snapshot, motion: &[JointMotion], status: Status) -> Estimate {
        let mut status = status.with(self.listen(snapshot));
        self.begin(snapshot.instant_ns);
        let (mut outcome, mut said) = self.solve(snapshot.instant_ns, motion);
        if let Some(gauge) = said.isolated {
            self.states[gauge] = GaugeState::Isolated;
            self.used[gauge] = None;
            status = status.with(left_out(GaugeState::Isolated));
            (outcome, said) = self.solve(snapshot.instant_ns, motion);
        }
        status = status.with(said.status);
        status = status.with(match &outcome {
            Ok(solution) if worst_sigma_n(solution) > UNCERTAIN_ABOVE_N => Status::UNCERTAIN,
            Ok(_) => Status::GOOD,
            Err(Refusal::NothingYet | Refusal::JointUnknown(_) | Refusal::Estimator(_)) => Status::INVALID,
            Err(_) => Status::INVALID.with(Status::UNCERTAIN),
        });
        let tared = if self.tare.applied().is_some() { Status::TARED } else { Status::GOOD };
        status = status.with(tared);
        // Zeros that drifted contradict each other: a tare is the remedy.
        if outcome.as_ref().err().is_none_or(|refusal| refusal.is_of_zeros()) {
            let heard = self.heard.iter().copied();
            self.tare.observe(snapshot.instant_ns, heard, motion, &mut self.estimator);
        }
        Estimate {
            instant_ns: snapshot.instant_ns,
            delay_ns: 0,
            last_stamp_ns: snapshot.last_stamp_ns,
            round: snapshot.round,
            outcome,
            status,
        }
    }

    /// The wrench of the readings that are used, and what the spare ones say of it.
    fn solve(&mut self, instant_ns: i64, motion: &[JointMotion]) -> (Result<Solution, Refusal>, Judgement) {
        let mut solution = match self.estimator.estimate(motion, &self.used) {
            Ok(solution) => solution,
            Err(reason) => return (Err(Refusal::Estimator(reason)), self.silent()),
        };
        if worst_sigma_n(&solution) > INVALID_ABOVE_N {
            return (Err(Refusal::TooUncertain), self.silent());
        }
        let Some(isolation) = &mut self.isolation else { return (Ok(solution), Judgement::NONE) };
        let said = isolation.judge(instant_ns, &self.heard, &mut self.estimator, &solution);
        solution.protection = said.protection;
        if said.sudden {
            let suspects = isolation.suspects_now();
            self.several.note(|sensor| suspects.get(sensor).copied().unwrap_or_default());
        }
        if self.several.holds() {
            return (Err(Refusal::SeveralAstray), said);
        }
        let outcome = match said.worth {
            Worth::Bounded => Ok(solution),
            Worth::Unbounded => Err(Refusal::Fault),
            Worth::Unproven => Err(Refusal::Unproven),
            Worth::Contradicted(factor) => {
                widen(&mut solution, factor.max(1.0));
                let too_wide = worst_sigma_n(&solution) > INVALID_ABOVE_N;
                if too_wide { Err(Refusal::Contradiction) } else { Ok(solution) }
            }
        };
        (outcome, said)
    }

    fn silent(&mut self) -> Judgement {
        if let Some(isolation) = &mut self.isolation {
            isolation.pass();
        }
        Judgement::NONE
    }

    /// Whether a gauge may be at fault at the last instant, when the gauges disagreed and it was not clear which of them is wrong.
    pub fn is_suspect(&self, gauge: usize) -> bool {
        self.isolation.as_ref().is_some_and(|isolation| isolation.suspects()[gauge])
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
            if let (Some(own), Some(other)) = (&mut self.isolation, &other.isolation) {
                own.take_over(other);
            }
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
        GaugeState::Absent(_) | GaugeState::Stuck | GaugeState::NotTared | GaugeState::Isolated => {
            Status::DEGRADED
        }
    }
}

/// Takes all variances for larger by a factor, where what is seen is farther from what is expected by as much.
fn widen(solution: &mut Solution, factor: f64) {
    solution.covariance *= factor;
    solution.singular_values_per_n.iter_mut().for_each(|value| *value /= factor.sqrt());
}

/// Standard deviation of the worst direction, N (moments over the characteristic length).
fn worst_sigma_n(solution: &Solution) -> f64 {
    1.0 / solution.singular_values_per_n[5]
}
