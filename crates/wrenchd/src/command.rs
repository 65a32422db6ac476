//! What the cycle is told while it runs, and what it answers: plain values.

use model::spatial::RigidBody;
use rig::tare::{TareRefusal, Tared};

/// What can be asked of the cycle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Order {
    /// Find every gauge's zero again (`rig::tare`).
    Tare,
    /// Take the calibration's zeros again.
    Untare,
    /// Subtract weight and inertia of this body at the tip (tip frame), in place of the one before.
    Payload(RigidBody),
}

/// A numbered order.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Command {
    /// Number that the answer repeats.
    pub number: u64,
    /// What is asked.
    pub order: Order,
}

/// What became of an order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Done {
    /// The tare is applied.
    Tared(Tared),
    /// The order was obeyed at once.
    Obeyed,
}

/// The answer to a command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Report {
    /// The command's number.
    pub number: u64,
    /// What became of it.
    pub outcome: Result<Done, TareRefusal>,
}
