//! Temperatures of the gauges: a room, and electronics that warm up a little.

use rand::RngExt;

use crate::random::{Purpose, stream};

/// Temperature of the room, degC.
const ROOM_C: f64 = 24.0;
/// What the gauges warm up by in the end, K.
const WARM_UP_K: f64 = 0.5;
/// How fast they do, s.
const WARM_UP_TIME_S: f64 = 900.0;
/// Largest difference of a gauge from the room at the start, K.
const SPREAD_K: f64 = 0.4;

/// Temperature of a hall on some day, degC; what it changes by while one records, K; and how fast, s.
const DAY_C: (f64, f64) = (19.0, 27.0);
const DAY_CHANGE_K: f64 = 3.0;
const DAY_TIME_S: (f64, f64) = (200.0, 600.0);

/// Gauges warm up by different shares of what the arm does.
const WARMTH_SHARE: (f64, f64) = (0.7, 1.3);

/// What an arm warms up by (cools down, where negative) while one records: drives that are switched on, a hall's door.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Warming {
    /// In the end, K.
    pub change_k: f64,
    /// Time after which two thirds of it are reached, s.
    pub time_s: f64,
}

/// Temperature of every gauge (degC) over time.
#[derive(Clone, Debug)]
pub(crate) struct Climate {
    offsets_k: Vec<f64>,
    /// Per gauge the share of the warm-up that it takes.
    shares: Vec<f64>,
    room_c: f64,
    warm_up_k: f64,
    warm_up_time_s: f64,
}

impl Climate {
    pub(crate) fn new(gauges: usize, seed: u64) -> Self {
        let mut rng = stream(seed, Purpose::Climate);
        let offsets_k = (0..gauges).map(|_| rng.random_range(-SPREAD_K..SPREAD_K)).collect();
        Self {
            offsets_k,
            shares: vec![1.0; gauges],
            room_c: ROOM_C,
            warm_up_k: WARM_UP_K,
            warm_up_time_s: WARM_UP_TIME_S,
        }
    }

    /// An arm that warms up in its own way.
    pub(crate) fn warming(gauges: usize, seed: u64, warming: Warming) -> Self {
        let nominal = Self::new(gauges, seed);
        let mut rng = stream(seed, Purpose::Day);
        Self {
            shares: (0..gauges).map(|_| rng.random_range(WARMTH_SHARE.0..WARMTH_SHARE.1)).collect(),
            warm_up_k: warming.change_k,
            warm_up_time_s: warming.time_s,
            ..nominal
        }
    }

    /// Some day in a hall: colder or warmer than others, and still changing.
    pub(crate) fn some_day(gauges: usize, seed: u64) -> Self {
        let nominal = Self::new(gauges, seed);
        let mut rng = stream(seed, Purpose::Day);
        Self {
            room_c: rng.random_range(DAY_C.0..DAY_C.1),
            warm_up_k: DAY_CHANGE_K * if rng.random_bool(0.5) { 1.0 } else { -1.0 },
            warm_up_time_s: rng.random_range(DAY_TIME_S.0..DAY_TIME_S.1),
            ..nominal
        }
    }

    /// Temperature that all gauges are near at the beginning, degC.
    pub(crate) const MIDDLE_C: f64 = ROOM_C;

    /// Temperature of a gauge at an instant (s since the start), degC.
    pub(crate) fn at_c(&self, gauge: usize, t_s: f64) -> f64 {
        let warm_up_k = self.warm_up_k * -(-t_s / self.warm_up_time_s).exp_m1();
        let share = self.shares.get(gauge).copied().unwrap_or(1.0);
        self.room_c + self.offsets_k.get(gauge).copied().unwrap_or(0.0) + share * warm_up_k
    }
}
