//! A small blind benchmark, so that a diagnosis that got worse is noticed: one arm, what is in the sessions drawn from a seed. The whole
//! of it is `cargo run --release -p wrenchd-gap --example blind`, whose generator this is.
#![allow(dead_code, reason = "the benchmark's tables are not printed here")]
#![allow(clippy::unwrap_used, reason = "a test may fail")]

#[path = "../examples/blind/arms.rs"]
mod arms;
#[path = "../examples/blind/plan.rs"]
mod plan;
#[path = "../examples/blind/random.rs"]
mod random;
#[path = "../examples/blind/score.rs"]
mod score;
#[path = "../examples/blind/session.rs"]
mod session;

use arms::Arm;
use plan::{Case, Question};
use score::Outcome;
use sim::effects::Kind;

type Error = Box<dyn std::error::Error + Send + Sync>;
type Result<T> = std::result::Result<T, Error>;

const SEED: u64 = 31;
/// Effects in noise floors.
const SIZE: f64 = 3.0;
const LARGE: f64 = 10.0;
/// Effects whose form is not that of their small beginnings when they are large: an axis that turned far, a cable slack over part of its
/// way, a limit that is reached often.
const CURVED: [Kind; 3] = [Kind::SensingAxis, Kind::CableDrag, Kind::Saturation];
/// What practice adds to the usual effects.
const OF_PRACTICE: [Kind; 4] = [Kind::Backlash, Kind::LinkOffset, Kind::FrameLoss, Kind::Quantisation];
const INSIDE: [Kind; 7] = [
    Kind::Gain,
    Kind::ChannelCoupling,
    Kind::MainsPickup,
    Kind::TorqueRipple,
    Kind::Friction,
    Kind::Lowpass,
    Kind::BaseTilt,
];
const OUTSIDE: [Kind; 2] = [Kind::ZeroJumps, Kind::GainWalk];

fn cases() -> Vec<Case> {
    let case =
        |(question, put_in): (Question, Vec<(Kind, f64)>), seed| Case { question, put_in, arm: 0, seed };
    let nulls = (0..2).map(|_| (Question::Null, Vec::new()));
    let singles =
        INSIDE.map(|kind| (Question::Single { size: SIZE, withheld: false }, vec![(kind, SIZE)])).into_iter();
    let outside = OUTSIDE.map(|kind| (Question::Outside { size: SIZE }, vec![(kind, SIZE)])).into_iter();
    nulls.chain(singles).chain(outside).zip(SEED..).map(|(what, seed)| case(what, seed)).collect()
}

#[test]
fn large_effects_that_are_not_linear_in_their_size_are_found_at_their_place() {
    let arm = Arm::new(SEED).unwrap();
    for (kind, seed) in CURVED.into_iter().zip(SEED..) {
        let question = Question::Single { size: LARGE, withheld: false };
        let case = Case { question, put_in: vec![(kind, LARGE)], arm: 0, seed };
        let outcome = score::run(&case, &arm).unwrap();
        assert!(outcome.is_first_placed, "{}", outcome.line);
        let (shrink, oracle) = (outcome.shrink.unwrap(), outcome.oracle.unwrap());
        assert!(shrink > 0.9 && shrink > oracle - 0.05, "{}", outcome.line);
    }
}

#[test]
fn effects_of_practice_are_found_at_their_place() {
    let arm = Arm::new(SEED).unwrap();
    for (kind, seed) in OF_PRACTICE.into_iter().zip(SEED..) {
        let question = Question::Single { size: SIZE, withheld: false };
        let case = Case { question, put_in: vec![(kind, SIZE)], arm: 0, seed };
        let outcome = score::run(&case, &arm).unwrap();
        assert!(outcome.is_first_placed, "{}", outcome.line);
    }
}

#[test]
fn what_was_put_in_is_found_nothing_is_found_in_nothing_and_what_is_unknown_is_not_asserted() {
    let arm = Arm::new(SEED).unwrap();
    let cases = cases();
    let (even, odd): (Vec<_>, Vec<_>) = cases.iter().enumerate().partition(|(k, _)| k % 2 == 0);
    let run = |own: Vec<(usize, &Case)>| -> Vec<Outcome> {
        own.into_iter().map(|(_, case)| score::run(case, &arm).unwrap()).collect()
    };
    let outcomes: Vec<Outcome> = std::thread::scope(|scope| {
        let other = scope.spawn(|| run(odd));
        run(even).into_iter().chain(other.join().unwrap()).collect()
    });
    let lines: Vec<&str> = outcomes.iter().map(|outcome| outcome.line.as_str()).collect();
    let all = lines.join("\n");
    let of = |question: fn(&Question) -> bool| outcomes.iter().filter(move |o| question(&o.case.question));

    assert!(of(|q| *q == Question::Null).all(|o| o.findings.is_empty()), "a cause of nothing:\n{all}");
    let right = of(|q| matches!(q, Question::Single { .. })).filter(|o| o.is_first_placed).count();
    assert!(right + 1 >= INSIDE.len(), "{right} of {} at their place:\n{all}", INSIDE.len());
    let is_sure = |o: &Outcome| o.findings.iter().any(|f| f.is_alone() && f.confidence >= score::CONFIDENT);
    assert!(
        !of(|q| matches!(q, Question::Outside { .. })).any(is_sure),
        "sure of what it cannot know:\n{all}"
    );
}
