//! What goes out: one record for each published instant, the same for every output.

use model::estimator::{NoWrench, Solution};
use model::spatial::Wrench;
use nalgebra::{Matrix6, Vector6};
use rig::Status;
use rig::cycle::Refusal;

/// Why a published instant has no wrench.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Why {
    /// No snapshot has been complete yet.
    NothingYet,
    /// The newest snapshot is older than it may be.
    Stale,
    /// The daemon is stopping; nothing follows.
    Stopping,
    /// The cycle has published nothing for long: what clients are told in its place.
    StandsStill,
    /// The newest snapshot gives no wrench.
    Refused(Refusal),
}

impl std::fmt::Display for Why {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::NothingYet => f.write_str("no complete snapshot yet"),
            Self::Stale => f.write_str("no snapshot within stale_after_s"),
            Self::Stopping => f.write_str("the daemon is stopping"),
            Self::StandsStill => f.write_str("the real-time cycle stands still"),
            Self::Refused(refusal) => refusal.fmt(f),
        }
    }
}

/// One published instant. `Copy` and of fixed size: it goes through rings and stays valid wherever it is kept.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Published {
    /// Number of this record since the start; each record has the next.
    pub sequence: u64,
    /// The instant that the wrench refers to, ns since the Unix epoch; 0 before the first.
    pub instant_ns: i64,
    /// Stamp of the last frame that went into it, ns since the Unix epoch; 0 before the first.
    pub last_stamp_ns: i64,
    /// When it was published, ns since the Unix epoch.
    pub published_ns: i64,
    /// From the instant to the publication, ns; grows while the same estimate is published again.
    pub age_ns: i64,
    /// Round of the snapshot it comes from.
    pub round: u64,
    /// What to know before using it; [`Status::INVALID`] is set exactly where `outcome` has no wrench.
    pub status: Status,
    /// The environment's wrench about E's origin, in E (N, Nm), with its covariance; or why there is none.
    pub outcome: Result<Solution, Why>,
}

/// What of a record must leave at once, before anything else is done: all but the times, which are read when it has left.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dispatch {
    /// Number of this record since the start.
    pub sequence: u64,
    /// What to know before using it.
    pub status: Status,
    /// The environment's wrench about E's origin, in E (N, Nm), with its covariance; or why there is none.
    pub outcome: Result<Solution, Why>,
}

/// Entries of the upper triangle of a symmetric 6x6.
const TRIANGLE: usize = 21;

impl Published {
    /// Number of words that a record is.
    pub const WORDS: usize = 8 + 6 + TRIANGLE + 6 + 2 + 6;

    /// What of it leaves at once.
    pub fn dispatch(&self) -> Dispatch {
        Dispatch { sequence: self.sequence, status: self.status, outcome: self.outcome }
    }

    /// What is left of the record when the cycle has stood still for so long since, ns: no wrench, and its age now.
    #[must_use]
    pub fn left_behind(self, standing_ns: i64) -> Self {
        let tared = if self.status.has(Status::TARED) { Status::TARED } else { Status::GOOD };
        Self {
            age_ns: self.age_ns.saturating_add(standing_ns),
            status: Status::INVALID.with(Status::STALE).with(tared),
            outcome: Err(Why::StandsStill),
            ..self
        }
    }

    /// Whether there is a wrench.
    pub fn is_valid(&self) -> bool {
        self.outcome.is_ok()
    }

    /// The record as plain words, for memory that threads share.
    pub fn to_words(&self) -> [u64; Self::WORDS] {
        let mut words = [0; Self::WORDS];
        let mut at = 0;
        let mut put = |word: u64| {
            words[at] = word;
            at += 1;
        };
        put(self.sequence);
        put(self.instant_ns as u64);
        put(self.last_stamp_ns as u64);
        put(self.published_ns as u64);
        put(self.age_ns as u64);
        put(self.round);
        put(self.status.bits().into());
        put(code(&self.outcome));
        if let Ok(solution) = &self.outcome {
            solution.wrench.to_vector().iter().for_each(|x| put(x.to_bits()));
            for row in 0..6 {
                (row..6).for_each(|column| put(solution.covariance[(row, column)].to_bits()));
            }
            solution.singular_values_per_n.iter().for_each(|x| put(x.to_bits()));
            put(solution.parity_chi2.to_bits());
            put(solution.parity_dof as u64);
            solution.protection.iter().for_each(|x| put(x.to_bits()));
        }
        words
    }

    /// The record that these words are.
    pub fn from_words(words: &[u64; Self::WORDS]) -> Self {
        let number = |at: usize| f64::from_bits(words[at]);
        let mut covariance = Matrix6::zeros();
        let mut at = 14;
        for row in 0..6 {
            for column in row..6 {
                covariance[(row, column)] = number(at);
                covariance[(column, row)] = number(at);
                at += 1;
            }
        }
        let solution = Solution {
            wrench: Wrench::from_vector(&Vector6::from_fn(|k, _| number(8 + k))),
            covariance,
            singular_values_per_n: std::array::from_fn(|k| number(14 + TRIANGLE + k)),
            parity_chi2: number(20 + TRIANGLE),
            parity_dof: words[21 + TRIANGLE] as usize,
            protection: std::array::from_fn(|k| number(22 + TRIANGLE + k)),
        };
        Self {
            sequence: words[0],
            instant_ns: words[1] as i64,
            last_stamp_ns: words[2] as i64,
            published_ns: words[3] as i64,
            age_ns: words[4] as i64,
            round: words[5],
            status: Status::from_bits(words[6] as u8),
            outcome: why(words[7]).map_or(Ok(solution), Err),
        }
    }
}

fn code(outcome: &Result<Solution, Why>) -> u64 {
    match outcome {
        Ok(_) => 0,
        Err(Why::NothingYet) => 1,
        Err(Why::Stale) => 2,
        Err(Why::Stopping) => 3,
        Err(Why::Refused(Refusal::NothingYet)) => 4,
        Err(Why::Refused(Refusal::Estimator(NoWrench::TooFewGauges))) => 5,
        Err(Why::Refused(Refusal::Estimator(NoWrench::Singular))) => 6,
        Err(Why::Refused(Refusal::Estimator(NoWrench::NotFinite))) => 7,
        Err(Why::Refused(Refusal::TooUncertain)) => 8,
        Err(Why::Refused(Refusal::Fault)) => 9,
        Err(Why::Refused(Refusal::Contradiction)) => 10,
        Err(Why::Refused(Refusal::SeveralAstray)) => 11,
        Err(Why::Refused(Refusal::Unproven)) => 12,
        Err(Why::StandsStill) => 13,
        Err(Why::Refused(Refusal::JointUnknown(coordinate))) => 256 + *coordinate as u64,
    }
}

fn why(code: u64) -> Option<Why> {
    Some(match code {
        0 => return None,
        1 => Why::NothingYet,
        2 => Why::Stale,
        3 => Why::Stopping,
        4 => Why::Refused(Refusal::NothingYet),
        5 => Why::Refused(Refusal::Estimator(NoWrench::TooFewGauges)),
        6 => Why::Refused(Refusal::Estimator(NoWrench::Singular)),
        7 => Why::Refused(Refusal::Estimator(NoWrench::NotFinite)),
        8 => Why::Refused(Refusal::TooUncertain),
        9 => Why::Refused(Refusal::Fault),
        10 => Why::Refused(Refusal::Contradiction),
        11 => Why::Refused(Refusal::SeveralAstray),
        12 => Why::Refused(Refusal::Unproven),
        13 => Why::StandsStill,
        joint => Why::Refused(Refusal::JointUnknown(joint.saturating_sub(256) as usize)),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_round_trip() {
        let symmetric = Matrix6::from_fn(|r, c| 1.0 + r as f64 * c as f64 + (r + c) as f64 / 7.0);
        let solution = Solution {
            wrench: Wrench::from_vector(&Vector6::new(1.0, -2.0, 3.5, -0.25, 1e-9, 7.0)),
            covariance: symmetric,
            singular_values_per_n: [9.0, 8.0, 7.0, 6.0, 5.0, 4.0],
            parity_chi2: 2.5,
            parity_dof: 2,
            protection: [0.5, 1.0, f64::INFINITY, 0.01, 0.02, 0.0],
        };
        let estimator = |why| Err(Why::Refused(Refusal::Estimator(why)));
        let outcomes = [
            Ok(solution),
            Err(Why::NothingYet),
            Err(Why::Stale),
            Err(Why::Stopping),
            Err(Why::StandsStill),
            Err(Why::Refused(Refusal::NothingYet)),
            Err(Why::Refused(Refusal::JointUnknown(5))),
            Err(Why::Refused(Refusal::TooUncertain)),
            Err(Why::Refused(Refusal::Fault)),
            Err(Why::Refused(Refusal::Contradiction)),
            Err(Why::Refused(Refusal::SeveralAstray)),
            Err(Why::Refused(Refusal::Unproven)),
            estimator(NoWrench::TooFewGauges),
            estimator(NoWrench::Singular),
            estimator(NoWrench::NotFinite),
        ];
        for outcome in outcomes {
            let record = Published {
                sequence: u64::MAX,
                instant_ns: -1,
                last_stamp_ns: 2,
                published_ns: i64::MAX,
                age_ns: 5,
                round: 6,
                status: Status::DEGRADED,
                outcome,
            };
            assert_eq!(Published::from_words(&record.to_words()), record);
        }
    }
}
