//! A gauge's zero, as calibrated or found again later in a known state.

use super::Excitation;

/// Place of the bias among a gauge's numbers.
const BIAS: usize = 6;

/// A gauge's zero, and what is known of its reading because of it.
///
/// A zero found later, under the excitation `L0` and without a wrench, takes the calibration's error under that excitation away with it:
/// `z - shift = C . L + b + e` with `e = dC . (L - L0) + e0`, where `dC` is the error of compliance and terms and `e0` that of the
/// zero itself. Only the *difference* to `L0` is uncertain, so the same pose measures small wrenches best.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Zero {
    /// To be subtracted from the reading beside the calibrated bias, counts.
    pub shift_counts: f64,
    /// Variance of the shift itself, counts^2.
    pub variance_counts2: f64,
    /// Excitation under which the zero was found; `None`: the zero is the calibration's.
    pub found_at: Option<Excitation>,
}

impl Zero {
    /// The zero that the calibration found.
    pub const CALIBRATED: Self = Self { shift_counts: 0.0, variance_counts2: 0.0, found_at: None };

    /// The part of an excitation in which errors of the gauge's numbers still show.
    #[inline]
    pub(super) fn excited(&self, excitation: Excitation) -> Excitation {
        let Some(found_at) = &self.found_at else { return excitation };
        let mut excited = excitation - found_at;
        excited[BIAS] = 0.0;
        excited
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_zero_found_later_hides_errors_where_it_was_found() {
        let excitation = Excitation::from_fn(|k, _| if k == BIAS { 1.0 } else { k as f64 });
        assert_eq!(Zero::CALIBRATED.excited(excitation), excitation);
        let zero = Zero { shift_counts: 7.0, variance_counts2: 0.5, found_at: Some(excitation) };
        assert_eq!(zero.excited(excitation), Excitation::zeros());
        let other = zero.excited(Excitation::zeros());
        assert_eq!((other[BIAS], other[2], other[9]), (0.0, -2.0, -9.0));
    }
}
