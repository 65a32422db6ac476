//! How often a finding so well supported is right, effect and place: what the blind benchmark showed.

use std::collections::BTreeSet;

use crate::diagnosis::{Evidence, SensorGap};

impl Evidence {
    /// Takes in what is left on the finding's channels.
    pub(crate) fn see(&mut self, sensors: &[SensorGap], channels: &BTreeSet<usize>) {
        let pool = |of: fn(&SensorGap) -> f64| channels.iter().map(|k| of(&sensors[*k]).powi(2)).sum::<f64>();
        let (before, after, floor) = (pool(|s| s.before), pool(|s| s.after), pool(|s| s.floor));
        // Where no more than noise was there, nothing shows that it went.
        self.explained = if before > floor { (before - after) / (before - floor) } else { 0.0 };
        self.excess = ((before - floor).max(0.0) / floor.max(f64::MIN_POSITIVE)).sqrt();
    }

    /// The frequency with which such a finding is right, effect (or one of its look-alikes) and place.
    pub(crate) fn confidence(&self) -> f64 {
        let evidence = [
            1.0,
            self.lead.clamp(LEAST_LEAD, 1.0).ln(),
            self.marginal.clamp(LEAST_MARGINAL, 1.0).ln(),
            (1.0 - self.explained).clamp(LEAST_LEFT, 1.0).ln(),
            (self.generic.clamp(0.0, 1.0) / LITTLE_OF_GENERIC).ln_1p(),
            (self.unsteady.clamp(0.0, 1.0) / LITTLE_UNSTEADY).ln_1p(),
            (self.freedom.max(1) as f64).ln(),
        ];
        let log_odds: f64 = evidence.iter().zip(WEIGHTS).map(|(value, weight)| value * weight).sum();
        1.0 / (1.0 + (-log_odds).exp())
    }
}

/// Log odds per unit of the evidence: constant; logarithms of the lead over the best rival, of what leaving it out would cost and of what is
/// left on its channels; lead of the model that knows no physics, and what wants other parameters in every part of the recordings (logarithms,
/// too, from a little on); logarithm of the number of its parameters at a place. By ridge regression (D. Cox, J. R. Statist. Soc. B 20, 1958) on the findings
/// of development sessions of the blind benchmark (seeds 777, 515151, 9001 to 9003, 9101), among them those that are told where the effect which
/// was put in is withheld from the catalogue: a user's arm may have a cause that no catalogue holds. Sessions of other seeds, in the README's
/// table of reliability, judge it.
const WEIGHTS: [f64; 7] = [4.08, 0.65, 1.10, -0.48, -1.07, -0.54, -0.97];
/// What counts as next to nothing.
const LEAST_LEAD: f64 = 0.001;
const LEAST_MARGINAL: f64 = 0.01;
const LEAST_LEFT: f64 = 0.003;
const LITTLE_OF_GENERIC: f64 = 0.05;
const LITTLE_UNSTEADY: f64 = 0.01;

#[cfg(test)]
mod tests {
    use super::*;

    fn strong() -> Evidence {
        Evidence { lead: 0.3, marginal: 1.0, explained: 0.99, freedom: 2, ..Evidence::default() }
    }

    #[test]
    fn whatever_speaks_against_a_finding_lowers_its_confidence() {
        let against = [
            Evidence { lead: 0.003, ..strong() },
            Evidence { unsteady: 0.1, ..strong() },
            Evidence { marginal: 0.05, ..strong() },
            Evidence { explained: 0.4, ..strong() },
            Evidence { generic: 0.95, ..strong() },
            Evidence { freedom: 20, ..strong() },
        ];
        assert!(strong().confidence() > 0.95);
        for weaker in against {
            assert!(weaker.confidence() < strong().confidence() - 0.01, "{weaker:?}");
        }
        assert!(Evidence::default().confidence() < 0.5);
    }
}
