//! Which sessions are tried.

use sim::effects::Kind;

use crate::random::Random;

/// What is outside the catalogue of a diagnosis.
pub(crate) const OUTSIDE: [Kind; 4] = [Kind::RandomWalk, Kind::ZeroJumps, Kind::GainWalk, Kind::Product];

/// What a session is for.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Question {
    /// Nothing was put in.
    Null,
    /// One effect of this size; asked again without the effect in the catalogue where `withheld`.
    Single { size: f64, withheld: bool },
    /// Several effects.
    Several,
    /// An effect that no catalogue has.
    Outside { size: f64 },
}

/// One session to be diagnosed.
#[derive(Clone, Debug)]
pub(crate) struct Case {
    pub(crate) question: Question,
    pub(crate) put_in: Vec<(Kind, f64)>,
    pub(crate) arm: usize,
    pub(crate) seed: u64,
}

/// How much is tried.
#[derive(Clone, Debug)]
pub(crate) struct Extent {
    pub(crate) arms: usize,
    pub(crate) sizes: Vec<f64>,
    /// Sessions without any effect, with pairs and triples, an arm.
    pub(crate) nulls: usize,
    pub(crate) pairs: usize,
    pub(crate) triples: usize,
    pub(crate) seed: u64,
    /// Only effects whose names begin so, several with commas between.
    pub(crate) only: Option<String>,
}

/// Size of effects in pairs and triples, and of effects that are withheld from the catalogue.
const SIZE: f64 = 3.0;

/// Every effect of the catalogue that can be simulated.
pub(crate) fn inside() -> Vec<Kind> {
    Kind::ALL.iter().copied().filter(|kind| !OUTSIDE.contains(kind)).collect()
}

impl Extent {
    /// All sessions, in an order in which any beginning is a fair sample.
    pub(crate) fn cases(&self) -> Vec<Case> {
        let mut random = Random::new(self.seed);
        let mut cases = Vec::new();
        for arm in 0..self.arms {
            let mut add = |question: Question, put_in: Vec<(Kind, f64)>| {
                cases.push(Case { question, put_in, arm, seed: random.next() });
            };
            (0..self.nulls).for_each(|_| add(Question::Null, Vec::new()));
            for kind in inside() {
                for &size in &self.sizes {
                    add(Question::Single { size, withheld: size == SIZE }, vec![(kind, size)]);
                }
            }
            for kind in OUTSIDE {
                for size in self.sizes.iter().copied().filter(|size| *size >= 1.0) {
                    add(Question::Outside { size }, vec![(kind, size)]);
                }
            }
            let mut draw = Random::new(self.seed ^ (arm as u64 + 1));
            for (count, effects) in [(self.pairs, 2), (self.triples, 3)] {
                for _ in 0..count {
                    add(Question::Several, several(effects, &mut draw));
                }
            }
        }
        if let Some(only) = &self.only {
            let is_asked = |case: &Case| {
                case.put_in.iter().any(|(kind, _)| only.split(',').any(|only| kind.id().starts_with(only)))
            };
            cases.retain(is_asked);
        }
        for k in (1..cases.len()).rev() {
            cases.swap(k, random.below(k + 1));
        }
        cases
    }
}

/// So many different effects.
fn several(count: usize, random: &mut Random) -> Vec<(Kind, f64)> {
    let mut left = inside();
    (0..count).map(|_| (left.swap_remove(random.below(left.len())), SIZE)).collect()
}
