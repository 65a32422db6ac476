//! Frames and time to records.

use can::frame::Stamped;
use rig::config::{Filter, PublishMode};
use rig::cycle::{Cycle, Estimate};
use rig::{Rig, Status};
use wrenchd::engine::{Engine, Now, SILENCE_PERIOD_NS, Told};
use wrenchd::published::{Published, Why};

use crate::common::{frames, model, rig, rig_with, simulator, truth};

const MS: i64 = 1_000_000;

fn engine(rig: &Rig) -> Engine {
    Engine::new(rig, &model(rig, &truth(rig))).unwrap()
}

/// What the cycle computes of these frames by itself.
fn offline(rig: &Rig, frames: &[Stamped]) -> Vec<Estimate> {
    let mut cycle = Cycle::new(rig, &model(rig, &truth(rig))).unwrap();
    let mut estimates = Vec::new();
    for frame in frames {
        cycle.push(frame, |estimate| estimates.push(estimate.clone()));
    }
    estimates
}

#[test]
fn event_mode_publishes_every_estimate_in_order_and_nothing_else() {
    let rig = rig(PublishMode::Event);
    let frames = frames(&rig, 1000.0, 0.5);
    let mut engine = engine(&rig);
    let mut records: Vec<Published> = Vec::new();
    for frame in &frames {
        let now = Now::simulated(frame.stamp_ns + 30_000);
        engine.push(frame, &mut Told::new(now, |record| records.push(*record)));
        engine.tick(now, &mut Told::new(now, |record| records.push(*record)));
    }
    let expected = offline(&rig, &frames);
    assert!(expected.len() >= 498, "{}", expected.len());
    assert_eq!(records.len(), expected.len());
    for (number, (record, estimate)) in records.iter().zip(&expected).enumerate() {
        assert_eq!(record.sequence, number as u64);
        assert_eq!(record.outcome, estimate.outcome.map_err(Why::Refused));
        assert_eq!(
            (record.instant_ns, record.last_stamp_ns, record.round, record.status),
            (estimate.instant_ns, estimate.last_stamp_ns, estimate.round, estimate.status)
        );
        assert_eq!(record.age_ns, record.published_ns - record.instant_ns);
        assert_eq!(record.is_valid(), !record.status.has(Status::INVALID));
    }
}

#[test]
fn the_published_wrench_is_the_true_one() {
    let rig = rig(PublishMode::Event);
    let mut world = simulator(&rig, 1000.0);
    let mut engine = engine(&rig);
    let mut squares = Vec::new();
    for frame in frames(&rig, 1000.0, 0.5) {
        engine.push(
            &frame,
            &mut Told::new(Now::simulated(frame.stamp_ns), |record| {
                let Ok(solution) = &record.outcome else { return };
                let truth = world.truth_at_ns(record.instant_ns);
                assert!(truth.force_n.norm() > 3.0, "a weight hangs there");
                for (k, error) in (solution.wrench.to_vector() - truth.to_vector()).iter().enumerate() {
                    squares.push(error.powi(2) / solution.covariance[(k, k)]);
                }
            }),
        );
    }
    let mean = squares.iter().sum::<f64>() / squares.len() as f64;
    assert!(
        squares.len() > 2900 && (0.5..2.0).contains(&mean),
        "{} errors, mean square {mean}",
        squares.len()
    );
}

#[test]
fn event_mode_tells_silence_at_once_then_now_and_then_until_frames_return() {
    let rig = rig(PublishMode::Event);
    let frames = frames(&rig, 1000.0, 0.2);
    let mut engine = engine(&rig);
    let mut records: Vec<(i64, Published)> = Vec::new();
    let start_ns = frames[0].stamp_ns - 300 * MS;
    // Nothing yet.
    for ms in 0..290 {
        let now = Now::simulated(start_ns + ms * MS);
        engine.tick(now, &mut Told::new(now, |record| records.push((ms, *record))));
    }
    let when: Vec<i64> = records.iter().map(|(ms, _)| *ms).collect();
    assert_eq!(
        when,
        [20, 70, 120, 170, 220, 270],
        "stale_after_s is 0.02, then every {SILENCE_PERIOD_NS} ns"
    );
    assert!(records.iter().all(|(_, r)| r.outcome == Err(Why::NothingYet) && r.instant_ns == 0));
    // Then frames, then silence.
    records.clear();
    for frame in &frames {
        let now = Now::simulated(frame.stamp_ns);
        engine.push(frame, &mut Told::new(now, |record| records.push((0, *record))));
        engine.tick(now, &mut Told::new(now, |record| records.push((-1, *record))));
    }
    let before = records.len();
    assert!(before >= 198 && records.iter().all(|(ms, _)| *ms == 0));
    let last = *records.last().map(|(_, record)| record).unwrap();
    for ms in 0..150 {
        let now = Now::simulated(last.published_ns + ms * MS);
        assert_eq!(engine.due_ns().is_some_and(|due| due <= now.monotonic_ns), [20, 70, 120].contains(&ms));
        engine.tick(now, &mut Told::new(now, |record| records.push((ms, *record))));
    }
    let silent = &records[before..];
    assert_eq!(silent.iter().map(|(ms, _)| *ms).collect::<Vec<_>>(), [20, 70, 120]);
    for (ms, record) in silent {
        assert_eq!(record.outcome, Err(Why::Stale));
        assert_eq!(record.status, Status::INVALID.with(Status::STALE));
        assert_eq!((record.instant_ns, record.age_ns), (last.instant_ns, last.age_ns + ms * MS));
    }
    let numbers: Vec<u64> = records.iter().map(|(_, record)| record.sequence).collect();
    assert!(numbers.windows(2).all(|pair| pair[1] == pair[0] + 1), "each record has the next number");
}

#[test]
fn fixed_mode_repeats_the_newest_with_its_age_until_it_is_stale() {
    let rig = rig(PublishMode::Fixed);
    let frames = frames(&rig, 1000.0, 0.1);
    let mut engine = engine(&rig);
    let mut records: Vec<Published> = Vec::new();
    engine.tick(
        Now::simulated(frames[0].stamp_ns),
        &mut Told::new(Now::simulated(frames[0].stamp_ns), |record| records.push(*record)),
    );
    assert_eq!(records[0].outcome, Err(Why::NothingYet));
    let mut newest_ns = 0;
    for frame in &frames {
        engine.push(
            frame,
            &mut Told::new(Now::simulated(frame.stamp_ns), |_| panic!("fixed mode publishes on its grid")),
        );
        newest_ns = frame.stamp_ns;
    }
    let valid_until = (0..40)
        .take_while(|ms| {
            engine.tick(
                Now::simulated(newest_ns + ms * MS),
                &mut Told::new(Now::simulated(newest_ns + ms * MS), |record| records.push(*record)),
            );
            records[records.len() - 1].is_valid()
        })
        .count();
    assert!((19..=20).contains(&valid_until), "20 ms after the instant it is stale: {valid_until}");
    let repeated = &records[1..=valid_until];
    assert!(
        repeated.iter().all(|r| r.outcome == repeated[0].outcome && r.instant_ns == repeated[0].instant_ns)
    );
    assert!(repeated.windows(2).all(|pair| pair[1].age_ns == pair[0].age_ns + MS));
    let stale = records[valid_until + 1];
    assert_eq!((stale.outcome, stale.status.bits()), (Err(Why::Stale), 0b1001));
    assert!(records.iter().enumerate().all(|(k, r)| r.sequence == k as u64));
}

#[test]
fn a_filter_that_waits_makes_old_instants_of_fresh_inputs() {
    let rig = rig_with(PublishMode::Fixed, Filter { cutoff_hz: Some(40.0), delay_s: Some(0.03) });
    let mut world = simulator(&rig, 1000.0);
    let mut engine = engine(&rig);
    let (mut valid, mut newest_ns) = (0, 0);
    for frame in &frames(&rig, 1000.0, 0.5) {
        newest_ns = frame.stamp_ns;
        engine.push(
            frame,
            &mut Told::new(Now::simulated(newest_ns), |_| panic!("fixed mode publishes on its grid")),
        );
        engine.tick(
            Now::simulated(newest_ns),
            &mut Told::new(Now::simulated(newest_ns), |record| {
                let Ok(solution) = &record.outcome else { return };
                valid += 1;
                // The low-pass's own delay, twice its time constant, comes on top.
                let most_ns = 31 * MS + 2 * (0.6436 / (std::f64::consts::TAU * 40.0) * 1e9) as i64 + MS;
                assert!((29 * MS..most_ns).contains(&record.age_ns), "{}", record.age_ns);
                let error = solution.wrench.to_vector() - world.truth_at_ns(record.instant_ns).to_vector();
                let sigmas = |k: usize| error[k].abs() / solution.covariance[(k, k)].sqrt();
                assert!((0..6).all(|k| sigmas(k) < 5.0), "{error} {}", solution.covariance);
            }),
        );
    }
    assert!(valid > 440 * 6, "{valid}");
    // And stale as soon as without it.
    engine.tick(
        Now::simulated(newest_ns + 15 * MS),
        &mut Told::new(Now::simulated(newest_ns + 15 * MS), |record| assert!(record.is_valid())),
    );
    engine.tick(
        Now::simulated(newest_ns + 24 * MS),
        &mut Told::new(Now::simulated(newest_ns + 24 * MS), |record| {
            assert_eq!(record.outcome, Err(Why::Stale))
        }),
    );
}

#[test]
fn a_step_of_the_wall_clock_makes_nothing_stale_and_nothing_fresh() {
    let rig = rig(PublishMode::Fixed);
    let frames = frames(&rig, 1000.0, 0.1);
    let mut engine = engine(&rig);
    let last_ns = frames[frames.len() - 1].stamp_ns;
    for frame in &frames {
        engine.push(frame, &mut Told::new(Now::simulated(frame.stamp_ns), |_| {}));
    }
    for step_ns in [-3_600_000 * MS, 3_600_000 * MS] {
        for (ms, valid) in [(1, true), (30, false)] {
            let now = Now { realtime_ns: last_ns + step_ns + ms * MS, monotonic_ns: last_ns + ms * MS };
            engine.tick(
                now,
                &mut Told::new(now, |record| assert_eq!(record.is_valid(), valid, "{step_ns} {ms}")),
            );
        }
    }
}

#[test]
fn the_end_is_told_and_another_engine_counts_on() {
    let rig = rig(PublishMode::Fixed);
    let mut first = engine(&rig);
    let mut numbers = Vec::new();
    for ms in 0..3 {
        first.tick(
            Now::simulated(ms * MS),
            &mut Told::new(Now::simulated(ms * MS), |record| numbers.push(record.sequence)),
        );
    }
    let mut second = engine(&rig);
    second.continue_from(&first);
    second.tick(
        Now::simulated(4 * MS),
        &mut Told::new(Now::simulated(4 * MS), |record| numbers.push(record.sequence)),
    );
    second.stop(&mut Told::new(Now::simulated(5 * MS), |record| {
        numbers.push(record.sequence);
        assert_eq!((record.outcome, record.status.bits()), (Err(Why::Stopping), 0b1001));
    }));
    assert_eq!(numbers, [0, 1, 2, 3, 4]);
}
