//! A reload takes on a good model and refuses a bad one, without a missed instant.

use std::fs;
use std::time::{Duration, Instant};

use can::channel::ChannelSender;
use rig::config::PublishMode;
use sim::Simulator;

use super::supervisor;
use crate::common::{model, rig, simulator, truth};
use crate::published::Published;
use crate::service::supervise::Supervisor;

/// What is published of the next 700 frames, a tenth of a second.
fn published(supervisor: &mut Supervisor, sender: &ChannelSender, arm: &mut Simulator) -> Vec<Published> {
    let mut reader = supervisor.clients.shared.feed.reader();
    let frames: Vec<_> = arm.take(700).collect();
    let before = supervisor.health.totals().frames;
    assert!(frames.iter().all(|frame| sender.send(*frame)));
    let begun = Instant::now();
    while supervisor.health.totals().frames < before + frames.len() as u64 {
        assert!(begun.elapsed() < Duration::from_secs(20), "the cycle stands still");
        std::thread::sleep(Duration::from_millis(1));
    }
    let records: Vec<_> = std::iter::from_fn(|| reader.next_record()).collect();
    assert!(records.windows(2).all(|pair| pair[1].sequence == pair[0].sequence + 1));
    records
}

fn force_n(records: &[Published]) -> f64 {
    let forces: Vec<f64> =
        records.iter().filter_map(|record| Some(record.outcome.ok()?.wrench.force_n.norm())).collect();
    assert!(forces.len() > 90, "{} of {} are valid", forces.len(), records.len());
    forces.iter().sum::<f64>() / forces.len() as f64
}

#[tokio::test]
async fn a_bad_model_changes_nothing_and_a_good_one_is_taken_on() {
    let folder = tempfile::tempdir().unwrap();
    let (mut daemon, sender) = supervisor(folder.path());
    daemon.clients.take_on();
    let mut arm = simulator(&daemon.loaded.rig, 1000.0);
    let weight_n = 0.4 * 9.80665;
    assert!((force_n(&published(&mut daemon, &sender, &mut arm)) / weight_n - 1.0).abs() < 0.05);
    let (hash, file) = (daemon.loaded.model_sha256.clone(), folder.path().join("model.toml"));
    let good = fs::read_to_string(&file).unwrap();
    for bad in [&good[..good.len() / 2], &good.replace("section_8", "section_7"), ""] {
        fs::write(&file, bad).unwrap();
        assert!(daemon.reload().unwrap_err().contains("model.toml"));
        assert_eq!(daemon.loaded.model_sha256, hash);
    }
    fs::remove_file(&file).unwrap();
    daemon.reload().unwrap_err();
    let last = published(&mut daemon, &sender, &mut arm);
    assert!((force_n(&last) / weight_n - 1.0).abs() < 0.05, "the old model goes on");
    // A model of the same arm with other biases shows that it was really exchanged.
    let (robot, mut shifted) = (rig(PublishMode::Event), truth(&rig(PublishMode::Event)));
    for gauge in &mut shifted.gauges {
        gauge.bias_counts += 3e6;
    }
    fs::write(&file, model(&robot, &shifted).to_toml()).unwrap();
    daemon.reload().unwrap();
    assert_ne!(daemon.loaded.model_sha256, hash);
    let begun = Instant::now();
    while !daemon.runner.free_retired() {
        assert!(begun.elapsed() < Duration::from_secs(20), "the cycle does not take it");
        std::thread::sleep(Duration::from_millis(1));
    }
    let next = published(&mut daemon, &sender, &mut arm);
    assert!(next[0].sequence > last[last.len() - 1].sequence, "the sequence counts on");
    // The other biases contradict what the gauges say: nothing of it is published as a wrench that is good.
    let last = next.last().unwrap();
    assert!(next.len() > 50 && next.iter().all(|r| r.status != rig::Status::GOOD), "{last:?}");
    let Supervisor { runner, health, .. } = daemon;
    runner.stop().unwrap();
    assert_eq!(health.totals().lost_frames, 0);
}
