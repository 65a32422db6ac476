//! The cycle's state beside the wrench, for whoever wants to look: every value an atomic, written by the cycle alone.

use std::sync::atomic::{AtomicBool, AtomicI64, AtomicU64, Ordering};

use can::assembly::Absence;
use model::spatial::RigidBody;
use rig::cycle::{GaugeState, Stage};

use crate::engine::Now;

/// State of gauges, tare and payload; each value by itself is right, together they may be an instant apart.
#[derive(Debug)]
pub struct Board {
    gauges: Box<[Cell]>,
    /// When the tare was applied, on both clocks, ns; 0 without one.
    tared_realtime_ns: AtomicI64,
    tared_monotonic_ns: AtomicI64,
    payload: [AtomicU64; 10],
}

#[derive(Debug, Default)]
struct Cell {
    state: AtomicU64,
    counts: AtomicU64,
    residual: AtomicU64,
    shift: AtomicU64,
    suspect: AtomicBool,
}

/// One gauge at the last instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GaugeReadback {
    /// What became of its reading.
    pub state: GaugeState,
    /// Whether it may be at fault: the gauges disagree, and it is not clear which of them is wrong.
    pub suspect: bool,
    /// Its last reading that was used, counts.
    pub counts: f64,
    /// Its part of the parity residual, in standard deviations.
    pub residual_sigma: f64,
    /// What a tare subtracts from it, counts; 0 without one.
    pub zero_shift_counts: f64,
}

const STATES: [GaugeState; 12] = [
    GaugeState::Absent(Absence::NeverSeen),
    GaugeState::Used,
    GaugeState::Stuck,
    GaugeState::NotTared,
    GaugeState::Isolated,
    GaugeState::Absent(Absence::NotConfigured),
    GaugeState::Absent(Absence::Missed),
    GaugeState::Absent(Absence::Stale),
    GaugeState::Absent(Absence::Saturated),
    GaugeState::Absent(Absence::Repeated),
    GaugeState::Absent(Absence::WrongLength),
    GaugeState::Absent(Absence::NotFinite),
];

fn put(place: &AtomicU64, value: f64) {
    place.store(value.to_bits(), Ordering::Relaxed);
}

fn get(place: &AtomicU64) -> f64 {
    f64::from_bits(place.load(Ordering::Relaxed))
}

impl Board {
    /// For so many gauges.
    pub fn new(gauges: usize) -> Self {
        Self {
            gauges: (0..gauges).map(|_| Cell::default()).collect(),
            tared_realtime_ns: AtomicI64::new(0),
            tared_monotonic_ns: AtomicI64::new(0),
            payload: [const { AtomicU64::new(0) }; 10],
        }
    }

    /// Writes the gauges' state after an instant. Bounded work, no allocation, no lock, no system call.
    pub(crate) fn write_gauges(&self, stage: &Stage, valid: bool) {
        for (k, cell) in self.gauges.iter().enumerate() {
            let state = STATES.iter().position(|state| *state == stage.gauge_states()[k]).unwrap_or(0);
            cell.state.store(state as u64, Ordering::Relaxed);
            cell.suspect.store(stage.is_suspect(k), Ordering::Relaxed);
            if let Some(reading) = stage.used()[k] {
                put(&cell.counts, reading.counts);
            }
            put(&cell.residual, 0.0);
        }
        if valid {
            for (gauge, residual_sigma) in stage.estimator().residuals() {
                put(&self.gauges[gauge].residual, residual_sigma);
            }
        }
    }

    /// Writes what was ordered: tare and payload.
    pub(crate) fn write_orders(&self, stage: &Stage, tared: Option<Now>) {
        for (cell, zero) in self.gauges.iter().zip(stage.estimator().zeros()) {
            put(&cell.shift, zero.shift_counts);
        }
        for (place, value) in self.payload.iter().zip(stage.payload().parameters()) {
            put(place, value);
        }
        self.tared_realtime_ns.store(tared.map_or(0, |now| now.realtime_ns), Ordering::Relaxed);
        self.tared_monotonic_ns.store(tared.map_or(0, |now| now.monotonic_ns), Ordering::Relaxed);
    }

    /// Every gauge at the last instant.
    pub fn gauges(&self) -> impl ExactSizeIterator<Item = GaugeReadback> + '_ {
        self.gauges.iter().map(|cell| GaugeReadback {
            state: STATES[cell.state.load(Ordering::Relaxed) as usize],
            suspect: cell.suspect.load(Ordering::Relaxed),
            counts: get(&cell.counts),
            residual_sigma: get(&cell.residual),
            zero_shift_counts: get(&cell.shift),
        })
    }

    /// When the tare was applied, if one is.
    pub fn tared(&self) -> Option<Now> {
        let realtime_ns = self.tared_realtime_ns.load(Ordering::Relaxed);
        let monotonic_ns = self.tared_monotonic_ns.load(Ordering::Relaxed);
        (realtime_ns != 0).then_some(Now { realtime_ns, monotonic_ns })
    }

    /// The body at the tip that is subtracted (tip frame); without mass if there is none.
    pub fn payload(&self) -> RigidBody {
        RigidBody::from_parameters(&std::array::from_fn(|k| get(&self.payload[k])))
    }
}
