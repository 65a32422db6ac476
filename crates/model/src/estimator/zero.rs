//! A gauge's zero, as calibrated or found again later in a known state.

use nalgebra::Vector6;

use super::GaugeCovariance;

/// A gauge's zero, and what is known of its reading because of it.
///
/// A zero found later, under the load `L0` and without a wrench, takes the calibration's error under that load away with it:
/// `z - shift = C . L + b + e` with `e = dC . (L - L0) + e0`, where `dC` is the compliance's error and `e0` that of the
/// zero itself. Only the *difference* to `L0` is uncertain, so the same pose measures small wrenches best.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Zero {
    /// To be subtracted from the reading beside the calibrated bias, counts.
    pub shift_counts: f64,
    /// Variance of the shift itself, counts^2.
    pub variance_counts2: f64,
    /// Load under which the zero was found, in S (N, Nm); `None`: the zero is the calibration's.
    pub found_at: Option<Vector6<f64>>,
}

impl Zero {
    /// The zero that the calibration found.
    pub const CALIBRATED: Self = Self { shift_counts: 0.0, variance_counts2: 0.0, found_at: None };

    /// Variance that the uncertainty of compliance and zero gives to the reading under a load (S; N, Nm), counts^2.
    pub(super) fn variance_counts2(&self, load: &Vector6<f64>, covariance: &GaugeCovariance) -> f64 {
        let excited = match self.found_at {
            None => load.push(1.0),
            Some(found_at) => (load - found_at).push(0.0),
        };
        excited.dot(&(covariance * excited)) + self.variance_counts2
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_zero_found_later_is_sure_where_it_was_found_and_less_so_elsewhere() {
        let covariance = GaugeCovariance::from_diagonal_element(4.0);
        let load = Vector6::new(1.0, 0.0, 2.0, 0.0, 0.0, 0.0);
        assert_eq!(Zero::CALIBRATED.variance_counts2(&load, &covariance), 4.0 * 6.0);
        let zero = Zero { shift_counts: 7.0, variance_counts2: 0.5, found_at: Some(load) };
        assert_eq!(zero.variance_counts2(&load, &covariance), 0.5);
        assert_eq!(zero.variance_counts2(&Vector6::zeros(), &covariance), 4.0 * 5.0 + 0.5);
    }
}
