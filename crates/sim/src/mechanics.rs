//! The arm in motion under its loads: what every section feels at an instant, and the true wrench at the tip.

use model::dynamics::Dynamics;
use model::sensing::Compliance;
use model::spatial::{Tip, Wrench};
use nalgebra::Vector6;
use rig::Rig;
use rig::run::Loads;

use crate::imperfect::{Body, Imperfections, Spring};
use crate::motion::{JointState, Trajectory};
use crate::push::Push;
use crate::scenario::Scenario;

/// Rounds in which joints and the torque that they yield under come to rest: each leaves a thousandth of what was left.
const YIELD_ROUNDS: usize = 4;

/// The arm of a configuration on its way, with what hangs on its tip and what pushes it.
///
/// The loads are exact: positions, velocities and accelerations come from the trajectory's own formula. Joints that yield do so at
/// once, without motion of their own.
#[derive(Clone, Debug)]
pub struct Mechanics {
    dynamics: Dynamics,
    trajectory: Trajectory,
    loads: Loads,
    push: Push,
    state: JointState,
    tip: Wrench<Tip>,
    body: Option<Yielding>,
}

/// Joints whose links are elsewhere than their encoders say.
#[derive(Clone, Debug)]
struct Yielding {
    zeros_rad: Vec<f64>,
    springs: Vec<Spring>,
    links_rad: Vec<f64>,
}

impl Mechanics {
    /// The arm of a configuration in a scenario, at its beginning (t = 0 s).
    #[must_use]
    pub fn new(rig: &Rig, scenario: &Scenario) -> Self {
        let mut mechanics = Self {
            dynamics: Dynamics::new(&rig.chain, &rig.sections),
            trajectory: scenario.trajectory.clone(),
            loads: Loads::new(scenario.loads.clone()),
            push: scenario.push.clone(),
            state: JointState::at_rest(rig.chain.coordinates()),
            tip: Wrench::zero(),
            body: None,
        };
        mechanics.update(0.0);
        mechanics
    }

    /// The same arm as it was built.
    #[must_use]
    pub fn imperfect(rig: &Rig, scenario: &Scenario, faults: &Imperfections) -> Self {
        Self::of_body(rig, scenario, &faults.body, Loads::new(faults.hanging(&scenario.loads)))
    }

    /// Another arm with other loads than declared.
    #[must_use]
    pub fn of_body(rig: &Rig, scenario: &Scenario, built: &Body, loads: Loads) -> Self {
        let mut mechanics = Self {
            dynamics: Dynamics::new(&built.chain, &rig.sections),
            loads,
            body: Some(Yielding {
                zeros_rad: built.zeros_rad.clone(),
                springs: built.springs.clone(),
                links_rad: vec![0.0; built.zeros_rad.len()],
            }),
            ..Self::new(rig, scenario)
        };
        mechanics.update(0.0);
        mechanics
    }

    /// Goes to an instant (s since the beginning).
    pub fn update(&mut self, t_s: f64) {
        self.trajectory.at(t_s, &mut self.state);
        let (state, body, push) = (&self.state, self.loads.at(t_s), self.push.at(t_s));
        let Some(joints) = &mut self.body else {
            let (q, v, a) = (&state.positions_rad, &state.velocities_rad_s, &state.accelerations_rad_s2);
            self.dynamics.update_loads(q, v, a);
            self.tip = self.dynamics.payload_wrench(&body) + push;
            // Where nothing acts on the tip it does not matter from where it is seen.
            if self.tip != Wrench::zero() {
                self.dynamics.carry_tip();
            }
            return;
        };
        let yields = joints.springs.iter().any(|spring| spring.yield_rad(1.0) != 0.0);
        for round in 0..if yields { YIELD_ROUNDS } else { 1 } {
            for (k, link) in joints.links_rad.iter_mut().enumerate() {
                let torque_nm = if round > 0 { self.dynamics.joint_torque_nm(k, &self.tip) } else { 0.0 };
                *link = state.positions_rad[k] + joints.zeros_rad[k] + joints.springs[k].yield_rad(torque_nm);
            }
            self.dynamics.update(&joints.links_rad, &state.velocities_rad_s, &state.accelerations_rad_s2);
            self.tip = self.dynamics.payload_wrench(&body) + push;
        }
    }

    /// Motion of the joints at the instant as their encoders see it (rad, rad/s, rad/s^2).
    #[must_use]
    pub fn state(&self) -> &JointState {
        &self.state
    }

    /// Load of a section at the instant (N, Nm about S, in S): the arm's own weight and inertia, and what acts on the tip.
    #[must_use]
    pub fn load(&self, section: usize) -> Vector6<f64> {
        self.dynamics.load(section) + self.dynamics.load_of_tip_wrench(section, &self.tip).to_vector()
    }

    /// What a gauge in a section makes of a wrench on the tip at the instant: counts/N and counts/Nm, about E's origin, in E.
    #[must_use]
    pub fn row_to_tip(&self, section: usize, compliance: &Compliance) -> Vector6<f64> {
        // Seldom asked, so that the simulation itself need not carry the tip where nothing acts on it.
        let mut dynamics = self.dynamics.clone();
        dynamics.carry_tip();
        dynamics.row_to_tip(section, &compliance.vector())
    }

    /// What the environment applies to the end-effector at the instant (N, Nm about E's origin, in E): pushes, and weight
    /// and inertia of the loads. Configured tools are part of the arm.
    #[must_use]
    pub fn tip_wrench(&self) -> Wrench<Tip> {
        self.tip
    }

    /// What the loads leave for a reference sensor to measure at an instant (s): N, Nm about E's origin, in E.
    #[must_use]
    pub fn pushed(&self, t_s: f64) -> Wrench<Tip> {
        self.push.at(t_s)
    }
}
