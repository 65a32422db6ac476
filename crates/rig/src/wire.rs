//! The wrench as CAN frames: `WrenchForce`, `WrenchTorque` and `WrenchQuality` of `config/wrench.dbc`.
//!
//! All three have eight bytes and one `Sequence`, which counts published instants modulo 256, so that a receiver pairs
//! them. Published wrench: what the environment applies to the end-effector, about E's origin, in E's axes.
//!
//! | bytes | force, torque | quality |
//! | --- | --- | --- |
//! | 0..6 | x, y, z: signed, 16 bit, little endian, [`Scale`] per bit | fx, fy, fz, tx, ty, tz: [`sigma_from_raw`] |
//! | 6 | sequence | sequence |
//! | 7 | status | status |
//!
//! Parsing never fails on eight bytes, and `parse(emit(x)) == x` for whatever a frame can say.

/// Length of each of the three frames (bytes).
pub const FRAME_LEN: usize = 8;
/// Raw value of all three components of a frame that must not be used.
pub const INVALID_RAW: i16 = i16::MIN;
/// Status bit 0: do not use.
pub const STATUS_INVALID: u8 = 1 << 0;
/// Status bit 1: a sensor is left out.
pub const STATUS_DEGRADED: u8 = 1 << 1;
/// Status bit 2: a gauge is saturated.
pub const STATUS_SATURATED: u8 = 1 << 2;
/// Status bit 3: an input is stale.
pub const STATUS_STALE: u8 = 1 << 3;
/// Status bit 4: pose or calibration cannot observe a direction.
pub const STATUS_UNCERTAIN: u8 = 1 << 4;
/// Status bit 5: the spare sensors disagree.
pub const STATUS_PARITY: u8 = 1 << 5;
/// Status bit 6: a tare is applied.
pub const STATUS_TARED: u8 = 1 << 6;

/// Raw standard deviation that stands for "not determined".
pub const SIGMA_UNKNOWN_RAW: u8 = u8::MAX;
/// Raw steps in a decade of standard deviation.
pub const SIGMA_STEPS_PER_DECADE: f64 = 32.0;
/// Decimal logarithm of the standard deviation that raw 0 stands for (N or Nm).
pub const SIGMA_SMALLEST_LOG10: f64 = -5.0;
/// What a logarithm may be above a step by and still be that step: far below a step, far above rounding.
const SIGMA_STEP_TOLERANCE: f64 = 1e-6;

/// What does not have the eight bytes of a wrench frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("a wrench frame has {FRAME_LEN} bytes, this one {found}; is the identifier used by another sender?")]
pub struct WrongLength {
    /// Bytes found.
    pub found: usize,
}

/// Unit of one bit of a force (N) or torque (Nm) frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scale(pub f64);

/// One force frame (N) or torque frame (Nm), raw: what the eight bytes hold, bit for bit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TripleFrame {
    /// x, y, z in steps of the frame's [`Scale`], E's axes.
    pub raw: [i16; 3],
    /// Published instants, modulo 256.
    pub sequence: u8,
    /// Status bits, 0 = all good.
    pub status: u8,
}

impl TripleFrame {
    /// The frame of a force (N) or a moment about E's origin (Nm), in E's axes, rounded to the nearest bit.
    ///
    /// A component beyond the range, or not finite, makes the frame invalid: it is never clamped. So does a `status`
    /// that has [`STATUS_INVALID`] set.
    #[must_use]
    pub fn new(value: [f64; 3], scale: Scale, sequence: u8, status: u8) -> Self {
        let mut raw = [0; 3];
        for (raw, value) in raw.iter_mut().zip(value) {
            let steps = (value / scale.0).round();
            if !(steps > f64::from(i16::MIN) && steps <= f64::from(i16::MAX)) {
                return Self::invalid(sequence, status);
            }
            *raw = steps as i16;
        }
        if status & STATUS_INVALID != 0 {
            Self::invalid(sequence, status)
        } else {
            Self { raw, sequence, status }
        }
    }

    /// The frame that says: do not use this instant.
    #[must_use]
    pub const fn invalid(sequence: u8, status: u8) -> Self {
        Self { raw: [INVALID_RAW; 3], sequence, status: status | STATUS_INVALID }
    }

    /// Force (N) or moment about E's origin (Nm) in E's axes; none where the frame is invalid in any way.
    #[must_use]
    pub fn value(&self, scale: Scale) -> Option<[f64; 3]> {
        let invalid = self.status & STATUS_INVALID != 0 || self.raw.contains(&INVALID_RAW);
        (!invalid).then(|| self.raw.map(|raw| f64::from(raw) * scale.0))
    }

    /// The frame in eight bytes.
    pub fn parse(data: &[u8]) -> Result<Self, WrongLength> {
        let bytes = Bytes::new(data)?;
        Ok(Self { raw: bytes.components(), sequence: bytes.sequence(), status: bytes.status() })
    }

    /// The eight bytes of the frame.
    #[must_use]
    pub fn emit(&self) -> [u8; FRAME_LEN] {
        let [[a, b], [c, d], [e, f]] = self.raw.map(i16::to_le_bytes);
        [a, b, c, d, e, f, self.sequence, self.status]
    }
}

/// One quality frame, raw: standard deviations of the six components.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct QualityFrame {
    /// Logarithms of the standard deviations of fx, fy, fz (N), tx, ty, tz (Nm), see [`sigma_from_raw`].
    pub raw: [u8; 6],
    /// Published instants, modulo 256.
    pub sequence: u8,
    /// Status bits, 0 = all good.
    pub status: u8,
}

impl QualityFrame {
    /// The frame of the standard deviations of fx, fy, fz (N), tx, ty, tz (Nm), each rounded up to the next step.
    ///
    /// A `status` that has [`STATUS_INVALID`] set leaves all six undetermined.
    #[must_use]
    pub fn new(sigma: [f64; 6], sequence: u8, status: u8) -> Self {
        let invalid = status & STATUS_INVALID != 0;
        let raw = if invalid { [SIGMA_UNKNOWN_RAW; 6] } else { sigma.map(sigma_to_raw) };
        Self { raw, sequence, status }
    }

    /// Standard deviations of fx, fy, fz (N), tx, ty, tz (Nm); none for a component that is not determined.
    #[must_use]
    pub fn sigma(&self) -> [Option<f64>; 6] {
        self.raw.map(sigma_from_raw)
    }

    /// The frame in eight bytes.
    pub fn parse(data: &[u8]) -> Result<Self, WrongLength> {
        let bytes = Bytes::new(data)?;
        let [a, b, c, d, e, f, ..] = *bytes.0;
        Ok(Self { raw: [a, b, c, d, e, f], sequence: bytes.sequence(), status: bytes.status() })
    }

    /// The eight bytes of the frame.
    #[must_use]
    pub const fn emit(&self) -> [u8; FRAME_LEN] {
        let [a, b, c, d, e, f] = self.raw;
        [a, b, c, d, e, f, self.sequence, self.status]
    }
}

/// Standard deviation (N or Nm) of a raw value: `10^(raw / 32 - 5)`, 1e-5 .. 868; none for 255, not determined.
#[must_use]
pub fn sigma_from_raw(raw: u8) -> Option<f64> {
    let log10 = f64::from(raw) / SIGMA_STEPS_PER_DECADE + SIGMA_SMALLEST_LOG10;
    (raw != SIGMA_UNKNOWN_RAW).then(|| 10f64.powf(log10))
}

/// Raw value of a standard deviation (N or Nm), rounded up to the next step of 7.5 %, so that it is never understated.
///
/// What is above the largest step, or no finite number, is not determined (255); raw 0 means 1e-5 or less.
#[must_use]
pub fn sigma_to_raw(sigma: f64) -> u8 {
    if !sigma.is_finite() || sigma < 0.0 {
        return SIGMA_UNKNOWN_RAW;
    }
    let steps = (sigma.log10() - SIGMA_SMALLEST_LOG10) * SIGMA_STEPS_PER_DECADE - SIGMA_STEP_TOLERANCE;
    // The cast saturates: what is below 0 becomes 0, what is above 255 becomes 255.
    steps.ceil() as u8
}

/// View of the eight bytes of a wrench frame.
struct Bytes<'a>(&'a [u8; FRAME_LEN]);

impl<'a> Bytes<'a> {
    fn new(data: &'a [u8]) -> Result<Self, WrongLength> {
        data.try_into().map(Self).map_err(|_| WrongLength { found: data.len() })
    }

    fn components(&self) -> [i16; 3] {
        let [a, b, c, d, e, f, ..] = *self.0;
        [[a, b], [c, d], [e, f]].map(i16::from_le_bytes)
    }

    const fn sequence(&self) -> u8 {
        self.0[6]
    }

    const fn status(&self) -> u8 {
        self.0[7]
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const NEWTON: Scale = Scale(0.01);

    #[test]
    fn bytes_are_as_the_table_says() {
        let frame = TripleFrame::new([1.0, -1.0, 327.67], NEWTON, 200, STATUS_TARED);
        assert_eq!(frame.emit(), [100, 0, 0x9C, 0xFF, 0xFF, 0x7F, 200, 0x40]);
        let frame = TripleFrame::invalid(7, STATUS_STALE);
        assert_eq!(frame.emit(), [0, 0x80, 0, 0x80, 0, 0x80, 7, 0b1001]);
        let frame = QualityFrame::new([1e-5, 1.0, 0.1, 1e-9, 1e9, f64::NAN], 3, 0);
        assert_eq!(frame.emit(), [0, 160, 128, 0, 255, 255, 3, 0]);
        assert_eq!(frame.sigma()[3..], [Some(1e-5), None, None]);
    }

    #[test]
    fn beyond_range_is_invalid_not_clamped() {
        for value in [327.68, -327.68, 1e300, f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            for axis in 0..3 {
                let mut components = [1.0; 3];
                components[axis] = value;
                assert_eq!(
                    TripleFrame::new(components, NEWTON, 5, STATUS_TARED),
                    TripleFrame::invalid(5, STATUS_TARED)
                );
            }
        }
        assert_eq!(TripleFrame::new([-327.67, 0.0, 0.0], NEWTON, 0, 0).raw, [-32767, 0, 0]);
        assert_eq!(TripleFrame::new([1.0; 3], NEWTON, 0, STATUS_INVALID), TripleFrame::invalid(0, 0));
        assert_eq!(TripleFrame::invalid(0, 0).value(NEWTON), None);
    }

    #[test]
    fn other_lengths_are_refused() {
        for length in (0..64).filter(|length| *length != FRAME_LEN) {
            let data = vec![0; length];
            assert_eq!(TripleFrame::parse(&data), Err(WrongLength { found: length }));
            assert_eq!(QualityFrame::parse(&data), Err(WrongLength { found: length }));
        }
    }

    #[test]
    fn every_raw_sigma_comes_back() {
        for raw in 0..=u8::MAX {
            assert_eq!(sigma_to_raw(sigma_from_raw(raw).unwrap_or(f64::INFINITY)), raw);
        }
        assert_eq!(sigma_to_raw(0.0), 0);
        assert_eq!(sigma_to_raw(-1.0), SIGMA_UNKNOWN_RAW);
    }

    proptest! {
        #[test]
        fn triples_round_trip(data: [u8; 8]) {
            let frame = TripleFrame::parse(&data).unwrap();
            prop_assert_eq!(frame.emit(), data);
            if let Some(value) = frame.value(NEWTON) {
                prop_assert_eq!(TripleFrame::new(value, NEWTON, frame.sequence, frame.status), frame);
            }
        }

        #[test]
        fn values_are_kept_to_half_a_bit(value in prop::array::uniform3(-327.6..327.6), sequence: u8) {
            let back = TripleFrame::new(value, NEWTON, sequence, 0).value(NEWTON).unwrap();
            for axis in 0..3 {
                prop_assert!((back[axis] - value[axis]).abs() <= 0.005 + 1e-9);
            }
        }

        #[test]
        fn qualities_round_trip(data: [u8; 8]) {
            prop_assert_eq!(QualityFrame::parse(&data).unwrap().emit(), data);
        }

        #[test]
        fn sigmas_are_never_understated(log10 in -5.0..2.9) {
            let sigma = 10f64.powf(log10);
            let back = sigma_from_raw(sigma_to_raw(sigma)).unwrap();
            prop_assert!(back >= sigma * (1.0 - 1e-6) && back <= sigma * 1.0747, "{sigma} {back}");
        }
    }
}
