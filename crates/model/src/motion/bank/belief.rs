//! How likely the filters of a bank, as far as each is believed, take a position to be.

use wide::f64x8;

use super::super::kalman::UNIT_S;
use super::Bank;

/// From this weight on rest is believed.
const RESTS: f64 = 0.5;

impl Bank {
    /// How much each filter's word counts: a joint that moves is not at rest because nothing else explains a reading.
    fn witnesses(&self) -> f64x8 {
        let mut weights = self.weights;
        let rest = &mut weights.as_mut_array()[0];
        *rest = if *rest < RESTS { 0.0 } else { *rest };
        weights
    }

    /// How far a position is from where each filter expects it, rad^2, and the variances of that, rad^2, if it was read at a time of this
    /// variance (inner units).
    fn innovations(&self, position_rad: f64, variance_rad2: f64, time2: f64) -> (f64x8, f64x8) {
        let own = f64x8::splat(variance_rad2);
        let off_rad = f64x8::splat(position_rad) - self.states.mean[0];
        (off_rad * off_rad, (self.states.covariance[0] + own + self.smear_rad2(time2)).max(own))
    }

    /// Whether a position is no farther out than so many standard deviations make unlikely, by the filters that are believed and by the
    /// boards' own time: `unsure` is the variance of the last step (inner units), for which one joint alone is no witness.
    ///
    /// The filters are not one bell curve: that a joint may have come to rest, and would be behind then, does not make likely what lies between.
    pub(in super::super) fn expects(
        &self,
        position_rad: f64,
        variance_rad2: f64,
        jitter_s: f64,
        unsure: f64,
        sigmas: f64,
    ) -> bool {
        /// Weight of a filter that alone may expect it, and minus twice its logarithm.
        const HEAVY: (f64, f64) = (0.01, 9.210_340_371_976_182);
        let (off2, variances) =
            self.innovations(position_rad, variance_rad2, (jitter_s / UNIT_S).powi(2) - unsure);
        let off2 = off2 / variances;
        let weights = self.witnesses();
        let heavy = weights.simd_ge(f64x8::splat(HEAVY.0));
        if (heavy & off2.simd_le(f64x8::splat(sigmas.powi(2) - HEAVY.1))).any() {
            return true;
        }
        let likely = f64x8::new((off2 * -0.5).to_array().map(f64::exp));
        (likely * weights).reduce_add() >= (-0.5 * sigmas.powi(2)).exp()
    }

    /// Logarithm of the probability density of a position by the filters that are believed.
    pub(in super::super) fn likelihood_ln(
        &self,
        position_rad: f64,
        variance_rad2: f64,
        jitter_s: f64,
    ) -> f64 {
        let (off2, variances) = self.innovations(position_rad, variance_rad2, (jitter_s / UNIT_S).powi(2));
        let off2 = off2 / variances;
        let weights = self.witnesses();
        // The nearest apart, so that all may be far.
        let believed = weights.simd_gt(f64x8::ZERO).select(off2, f64x8::splat(f64::INFINITY));
        let nearest = believed.to_array().into_iter().fold(f64::INFINITY, f64::min);
        let likely = f64x8::new(((believed - f64x8::splat(nearest)) * -0.5).to_array().map(f64::exp));
        (likely * weights / variances.sqrt()).reduce_add().ln() - 0.5 * nearest
    }
}
