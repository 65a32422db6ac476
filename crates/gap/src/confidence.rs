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

    /// Takes in how much the finding explains on each of its channels.
    pub(crate) fn see_each(&mut self, falls: &[f64]) {
        let all: f64 = falls.iter().map(|fall| fall.max(0.0)).sum();
        let most = falls.iter().copied().fold(0.0, f64::max);
        self.lone = if falls.len() > 1 && all > 0.0 { most / all } else { 0.0 };
    }

    /// The frequency with which such a finding is right, effect (or one of its look-alikes) and place.
    pub(crate) fn confidence(&self) -> f64 {
        let evidence = [
            1.0,
            self.wins,
            self.marginal.clamp(LEAST_MARGINAL, 1.0).ln(),
            (1.0 - self.explained).clamp(LEAST_LEFT, 1.0).ln(),
            self.generic.min(1.0),
            f64::from(self.lone > LONE),
            (self.freedom.max(1) as f64).ln(),
        ];
        let log_odds: f64 = evidence.iter().zip(WEIGHTS).map(|(value, weight)| value * weight).sum();
        1.0 / (1.0 + (-log_odds).exp())
    }
}

/// Log odds per unit of the evidence: constant, draws won, logarithm of what leaving it out would cost, logarithm of what is left on its
/// channels, lead of the model that knows no physics, whether a single channel shows it though several should, logarithm of the number of its
/// parameters. By ridge regression (D. Cox, J. R. Statist. Soc. B 20, 1958) on the findings of development sessions of the blind benchmark
/// (seeds 777 and 515151); sessions of other seeds, in the README's table of reliability, judge it.
const WEIGHTS: [f64; 7] = [0.455, 1.738, 0.783, -0.669, -1.005, -1.113, -0.837];
/// Part of a finding that a single one of its channels shows where the others show nothing.
const LONE: f64 = 0.98;
/// What counts as next to nothing.
const LEAST_MARGINAL: f64 = 0.01;
const LEAST_LEFT: f64 = 0.003;

#[cfg(test)]
mod tests {
    use super::*;

    fn strong() -> Evidence {
        Evidence { wins: 1.0, marginal: 1.0, explained: 0.99, freedom: 2, ..Evidence::default() }
    }

    #[test]
    fn whatever_speaks_against_a_finding_lowers_its_confidence() {
        let against = [
            Evidence { wins: 0.2, ..strong() },
            Evidence { marginal: 0.05, ..strong() },
            Evidence { explained: 0.4, ..strong() },
            Evidence { generic: 0.95, ..strong() },
            Evidence { lone: 1.0, ..strong() },
            Evidence { freedom: 20, ..strong() },
        ];
        assert!(strong().confidence() > 0.95);
        for weaker in against {
            assert!(weaker.confidence() < strong().confidence() - 0.01, "{weaker:?}");
        }
        assert!(Evidence::default().confidence() < 0.5);
    }
}
