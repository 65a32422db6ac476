//! Random numbers: one independent, reproducible stream for each purpose.

use rand::SeedableRng;
use rand::rngs::StdRng;

/// What random numbers are for; each purpose has a stream of its own, so that changing one leaves the others as they are.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Purpose {
    Gauges = 1,
    GaugeNoise = 2,
    EncoderNoise = 3,
    Motion = 4,
    Bus = 5,
    Reference = 6,
    Climate = 7,
    Faults = 8,
    FaultStart = 9,
    Day = 10,
    Effects = 11,
}

/// The stream of a purpose under a seed.
pub(crate) fn stream(seed: u64, purpose: Purpose) -> StdRng {
    // Weyl step by the purpose, then a mix (SplitMix64), so that neighbouring seeds do not share streams.
    let mut z = seed.wrapping_add((purpose as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15));
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    StdRng::seed_from_u64((z ^ (z >> 31)) ^ (purpose as u64))
}
