//! The motion some rounds ago, from the readings before and after it: the smoother for the cycle that may wait. Bounded work, no allocation.
//!
//! The same bank and recursion (Rauch, Tung, Striebel) as [`super::smooth`] has for whole recordings, over a ring of the last rounds.

use super::kalman::{State, UNIT_S, inner_density};
use super::smoother::{DENSITIES, Step, WEIGHING_S, blend};
use super::{Fate, JointMotion, Sampled};
use nalgebra::Matrix4;

const BANK: usize = DENSITIES.len();

/// More rounds than these after an instant tell nothing more of it.
const AHEAD: usize = 64;

/// Filters that fit so much less than the best (log-likelihood) are not smoothed.
const HOPELESS: f64 = 12.0;

/// One filter of the bank at one round.
#[derive(Clone, Copy, Debug)]
struct Node {
    /// Before and after the round's reading.
    predicted: State,
    filtered: State,
    /// The smoother's gain from this round to the one before.
    gain: Matrix4<f64>,
    /// Log-likelihood of the reading.
    fit: f64,
    /// Sum of those before, less the older they are.
    past: f64,
}

/// One round of one joint.
#[derive(Clone, Copy, Debug)]
struct Round {
    at: Sampled,
    /// Nothing before it counts for it.
    anew: bool,
    /// It has a reading.
    read: bool,
    bank: [Node; BANK],
}

/// Motion of one joint some rounds ago.
#[derive(Clone, Debug)]
pub struct LagSmoother {
    variance_rad2: f64,
    ring: Vec<Round>,
    /// Rounds so far; the last is at `(rounds - 1) % ring.len()`.
    rounds: usize,
}

impl LagSmoother {
    /// For an encoder whose single reading has this standard deviation (rad), to look back up to so many rounds.
    pub fn new(encoder_sigma_rad: f64, most_back: usize) -> Self {
        let variance_rad2 = encoder_sigma_rad * encoder_sigma_rad;
        let state = State::from_position(0.0, variance_rad2);
        let node = Node { predicted: state, filtered: state, gain: Matrix4::zeros(), fit: 0.0, past: 0.0 };
        let empty = Round { at: Sampled::default(), anew: true, read: false, bank: [node; BANK] };
        Self { variance_rad2, ring: vec![empty; most_back + 2], rounds: 0 }
    }

    /// Takes in the next round: a position (rad) and what the causal filter made of it, or none. `jitter_s` is how uncertain its sampling time is against `at`.
    pub fn push(&mut self, at: Sampled, jitter_s: f64, position_rad: Option<(f64, Fate)>) {
        let reading = position_rad.filter(|(_, fate)| !matches!(fate, Fate::Ignored | Fate::PassedOver));
        let anew = self.rounds == 0 || matches!(reading, Some((_, Fate::Anew)));
        let next = match reading {
            Some((position_rad, _)) if anew => self.first(at, position_rad),
            _ => {
                let last = self.rounds.checked_sub(1).map_or(&self.ring[0], |last| self.round(last));
                let mut next = last.carried_on(at);
                if let Some((position_rad, _)) = reading {
                    next.read = true;
                    next.bank.iter_mut().for_each(|node| {
                        node.fit = node.filtered.measure_position(position_rad, self.variance_rad2, jitter_s);
                    });
                }
                next
            }
        };
        let slot = self.rounds % self.ring.len();
        self.ring[slot] = next;
        self.rounds += 1;
    }

    /// Takes in a velocity (rad/s, with its standard deviation) sampled together with the last position.
    pub fn measure_velocity(&mut self, velocity_rad_s: f64, sigma_rad_s: f64) {
        let Some(last) = self.rounds.checked_sub(1) else { return };
        let slot = last % self.ring.len();
        for node in &mut self.ring[slot].bank {
            node.fit += node.filtered.measure(1, velocity_rad_s * UNIT_S, (sigma_rad_s * UNIT_S).powi(2));
        }
    }

    /// The last reading was not the joint's after all.
    pub fn revoke(&mut self) {
        let oldest = self.rounds.saturating_sub(self.ring.len());
        let Some(read) = (oldest..self.rounds).rev().find(|number| self.round(*number).read) else { return };
        let slots = self.ring.len();
        let round = &mut self.ring[read % slots];
        round.read = false;
        round.bank.iter_mut().for_each(|node| (node.filtered, node.fit) = (node.predicted, 0.0));
        for number in read + 1..self.rounds {
            self.ring[number % slots] = self.round(number - 1).carried_on(self.round(number).at);
        }
    }

    /// Motion at a time near the round that came so many rounds before the last one; `None` where that is longer ago than what is kept.
    pub fn motion(&self, back: usize, at: Sampled) -> Option<JointMotion> {
        let then = self.rounds.checked_sub(back + 1).filter(|_| back + 1 < self.ring.len())?;
        let end = then + AHEAD.min(back) + 1;
        let end = (then + 1..end).find(|round| self.round(*round).anew).unwrap_or(end);
        let scores: [f64; BANK] = std::array::from_fn(|k| self.score(k, then, end));
        let best = scores.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let weights = scores.map(|score| if score > best - HOPELESS { (score - best).exp() } else { 0.0 });
        let total: f64 = weights.iter().sum();
        let hopeful = || (0..BANK).filter(|k| weights[*k] > 0.0);
        let from = &self.round(then).at;
        let mut states = [self.round(then).bank[0].filtered; BANK];
        for k in hopeful() {
            states[k] = self.smoothed(k, then, end);
            if from.at_ns != at.at_ns {
                states[k] = Step::carrying(from, &at, inner_density(DENSITIES[k])).forward(&states[k]);
            }
        }
        Some(blend(hopeful().map(|k| (&states[k], weights[k] / total))).motion())
    }

    fn round(&self, number: usize) -> &Round {
        &self.ring[number % self.ring.len()]
    }

    /// How well a filter fits the readings around a round, the less the farther they are.
    fn score(&self, k: usize, then: usize, end: usize) -> f64 {
        let at_ns = self.round(then).at.at_ns;
        let after = (then + 1..end).map(|number| {
            let round = self.round(number);
            round.bank[k].fit * fading((round.at.at_ns - at_ns) as f64 * 1e-9)
        });
        let node = &self.round(then).bank[k];
        node.past + node.fit + after.sum::<f64>()
    }

    /// A round's state in the light of those up to `end`.
    fn smoothed(&self, k: usize, then: usize, end: usize) -> State {
        let mut state = self.round(end - 1).bank[k].filtered;
        for number in (then + 1..end).rev() {
            let (next, before) = (&self.round(number).bank[k], &self.round(number - 1).bank[k]);
            state = before.filtered.in_the_light_of(&state, &next.predicted, &next.gain);
        }
        state
    }

    fn first(&self, at: Sampled, position_rad: f64) -> Round {
        let state = State::from_position(position_rad, self.variance_rad2);
        let node = Node { predicted: state, filtered: state, gain: Matrix4::zeros(), fit: 0.0, past: 0.0 };
        Round { at, anew: true, read: true, bank: [node; BANK] }
    }
}

impl Round {
    /// The round after this one, without its reading.
    fn carried_on(&self, at: Sampled) -> Self {
        // A reading may be sampled before the one of the last round: then it counts as sampled with it.
        let at = Sampled { at_ns: at.at_ns.max(self.at.at_ns), ..at };
        let fading = fading((at.at_ns - self.at.at_ns) as f64 * 1e-9);
        let bank = std::array::from_fn(|k| {
            let (node, step) = (&self.bank[k], Step::new(&self.at, &at, inner_density(DENSITIES[k])));
            let predicted = step.forward(&node.filtered);
            let gain = step.gain(&node.filtered, &predicted).unwrap_or_else(Matrix4::zeros);
            Node { predicted, filtered: predicted, gain, fit: 0.0, past: (node.past + node.fit) * fading }
        });
        Self { at, anew: false, read: false, bank }
    }
}

fn fading(step_s: f64) -> f64 {
    (-step_s / WEIGHING_S).exp()
}

#[cfg(test)]
mod tests {
    use super::super::smooth;
    use super::*;

    const SIGMA_RAD: f64 = 20e-6;

    fn exactly(k: usize) -> Sampled {
        Sampled { at_ns: k as i64 * 8_000_000, ..Sampled::default() }
    }

    /// A swing that begins after a second of standing, with rounding for noise: position and acceleration.
    fn swing(k: usize) -> (f64, f64) {
        let (w, t) = (6.0f64, (k as f64 * 0.008 - 1.0).max(0.0));
        let sin = (w * t).sin();
        (0.2 * (w * t - sin), 0.2 * w * w * sin)
    }

    fn reading(k: usize) -> f64 {
        let hash = (k as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 40;
        swing(k).0 + SIGMA_RAD * 12f64.sqrt() * (hash as f64 / (1u64 << 24) as f64 - 0.5)
    }

    fn smoother(rounds: usize, back: usize) -> LagSmoother {
        let mut smoother = LagSmoother::new(SIGMA_RAD, back);
        for k in 0..rounds {
            smoother.push(exactly(k), 0.0, Some((reading(k), Fate::Taken)));
        }
        smoother
    }

    /// Motion at the round so many rounds back.
    fn of(smoother: &LagSmoother, back: usize) -> JointMotion {
        smoother.motion(back, smoother.round(smoother.rounds - 1 - back).at).unwrap()
    }

    #[test]
    fn far_back_it_is_the_smoother_of_whole_recordings() {
        let at: Vec<Sampled> = (0..300).map(exactly).collect();
        let positions: Vec<f64> = (0..300).map(reading).collect();
        let whole = smooth(&at, &positions, SIGMA_RAD);
        let lagged = smoother(300, 60);
        for back in [30, 40, 50] {
            let (now, then) = (of(&lagged, back), &whole[299 - back]);
            let sigma = then.covariance[(2, 2)].sqrt();
            assert!((now.acceleration_rad_s2 - then.acceleration_rad_s2).abs() < sigma, "{now:?} {then:?}");
            assert!(now.covariance[(2, 2)].sqrt() < 1.5 * sigma, "{now:?} {then:?}");
        }
    }

    #[test]
    fn waiting_makes_accelerations_better_and_says_so() {
        let (mut squares, mut expected) = ([0.0; 3], [0.0; 3]);
        for rounds in 140..400 {
            let lagged = smoother(rounds, 20);
            for (k, back) in [0, 3, 12].into_iter().enumerate() {
                let motion = of(&lagged, back);
                squares[k] += (motion.acceleration_rad_s2 - swing(rounds - 1 - back).1).powi(2);
                expected[k] += motion.covariance[(2, 2)];
            }
        }
        assert!(squares[1] < 0.25 * squares[0] && squares[2] < 0.6 * squares[1], "{squares:?}");
        for k in 0..3 {
            let nees = squares[k] / expected[k];
            assert!((0.05..2.0).contains(&nees), "{k}: {nees}");
        }
    }

    #[test]
    fn what_came_after_shows_where_a_motion_began() {
        for rounds in 120..150 {
            let motion = of(&smoother(rounds, 10), 8);
            let error = motion.acceleration_rad_s2 - swing(rounds - 9).1;
            assert!(error.abs() < 5.0 * motion.covariance[(2, 2)].sqrt(), "{rounds}: {error} {motion:?}");
        }
    }

    #[test]
    fn a_reading_that_was_not_the_joint_s_is_taken_back() {
        let (mut with, mut without) = (smoother(200, 20), smoother(200, 20));
        with.push(exactly(200), 0.0, Some((reading(200) + 0.01, Fate::Taken)));
        with.push(exactly(201), 0.0, None);
        without.push(exactly(200), 0.0, Some((reading(200) + 0.01, Fate::PassedOver)));
        without.push(exactly(201), 0.0, None);
        with.revoke();
        for k in 202..210 {
            with.push(exactly(k), 0.0, Some((reading(k), Fate::Taken)));
            without.push(exactly(k), 0.0, Some((reading(k), Fate::Taken)));
        }
        assert_eq!(of(&with, 10), of(&without, 10));
        assert_eq!(of(&with, 2), of(&without, 2));
    }

    #[test]
    fn what_began_anew_says_nothing_of_what_was_before() {
        let mut smoother = smoother(200, 20);
        let before = of(&smoother, 0);
        smoother.push(exactly(200), 0.0, Some((-1.0, Fate::Anew)));
        smoother.push(exactly(201), 0.0, Some((-1.0, Fate::Taken)));
        assert_eq!(of(&smoother, 2), before);
        assert!((of(&smoother, 1).position_rad + 1.0).abs() < 1e-3);
        assert_eq!(smoother.motion(21, exactly(180)), None);
    }
}
