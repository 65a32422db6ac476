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

/// Temperature of every gauge (degC) over time.
#[derive(Clone, Debug)]
pub(crate) struct Climate {
    offsets_k: Vec<f64>,
}

impl Climate {
    pub(crate) fn new(gauges: usize, seed: u64) -> Self {
        let mut rng = stream(seed, Purpose::Climate);
        Self { offsets_k: (0..gauges).map(|_| rng.random_range(-SPREAD_K..SPREAD_K)).collect() }
    }

    /// Temperature of a gauge at an instant (s since the start), degC.
    pub(crate) fn at_c(&self, gauge: usize, t_s: f64) -> f64 {
        let warm_up_k = WARM_UP_K * -(-t_s / WARM_UP_TIME_S).exp_m1();
        ROOM_C + self.offsets_k.get(gauge).copied().unwrap_or(0.0) + warm_up_k
    }
}
