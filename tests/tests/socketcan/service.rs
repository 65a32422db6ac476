//! The daemon as a service: links that go and come back, reloads, refusals, its end.

use crate::live::{STOP_LIMIT, Totals, wait_for_silence};
use crate::published::{self, DEGRADED, INVALID, Published, SILENCE, STALE, ensure_equal, pair};
use crate::rig::{Arm, Form, Player};
use nix::sys::signal::Signal;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant, SystemTime};
use wrenchd_tests::candump::{self, Line};
use wrenchd_tests::guest::Guest;
use wrenchd_tests::process::Program;
use wrenchd_tests::programs::programs;
use wrenchd_tests::suite::{Need, Scenario};
use wrenchd_tests::{Check, Failure, IoContext, ensure};

const NEEDS: &[Need] = &[Need::Programs, Need::Python];
const LIMIT: Duration = Duration::from_secs(120);
const STEP: Duration = Duration::from_secs(20);
const PERIOD_NS: i64 = 8_000_000;

pub(crate) const SCENARIOS: &[Scenario] = &[
    Scenario { name: "service::an_input_goes_and_comes_back", needs: NEEDS, limit: LIMIT, run: input },
    Scenario { name: "service::an_output_goes_and_comes_back", needs: NEEDS, limit: LIMIT, run: output },
    Scenario { name: "service::a_bad_reload_changes_nothing", needs: NEEDS, limit: LIMIT, run: bad_reload },
    Scenario { name: "service::a_good_reload_takes_over", needs: NEEDS, limit: LIMIT, run: good_reload },
    Scenario { name: "service::it_stops_when_told", needs: NEEDS, limit: LIMIT, run: stop },
    Scenario { name: "service::bad_input_is_refused", needs: &[Need::Programs], limit: LIMIT, run: refusals },
];

/// Nanoseconds since the Unix epoch, on the clock of the stamps.
fn now_ns() -> Check<i64> {
    Ok(i64::try_from(SystemTime::now().duration_since(SystemTime::UNIX_EPOCH)?.as_nanos())?)
}

fn pause(milliseconds: u64) {
    std::thread::sleep(Duration::from_millis(milliseconds));
}

/// So many rounds of the arm in a held pose.
pub(crate) fn held(arm: &Arm, rounds: usize) -> Check<Vec<Line>> {
    let pieces = candump::rounds(&arm.recording()?);
    Ok(candump::repeated(pieces.get(..200).unwrap_or(&pieces), rounds, PERIOD_NS))
}

/// Starts to play the run directory.
fn play(run: &Path) -> Check<Program> {
    Program::start(&mut Player::Wrenchctl.command(run)?)
}

/// The records of a stretch of time.
fn within(records: &[Published], from_ns: i64, to_ns: i64) -> Vec<&Published> {
    records.iter().filter(|record| (from_ns..to_ns).contains(&record.time_ns)).collect()
}

/// In a stretch of silence there are records, and all say that there is no wrench.
fn ensure_silent(records: &[Published], from_ns: i64, to_ns: i64) -> Check {
    let told = within(records, from_ns, to_ns);
    ensure!(told.len() >= 2, "{} records in {} ns of silence", told.len(), to_ns - from_ns);
    let wrong = told.iter().filter(|record| record.status != SILENCE).count();
    ensure!(wrong == 0, "{wrong} of {} records in a silence do not say so", told.len());
    Ok(())
}

/// In a stretch of play there are wrenches, nearly all of them good.
fn ensure_good(records: &[Published], from_ns: i64, to_ns: i64) -> Check {
    let told = within(records, from_ns, to_ns);
    let good = told.iter().filter(|record| record.status & (INVALID | DEGRADED | STALE) == 0).count();
    ensure!(good >= 60 && 10 * good > 8 * told.len(), "{good} of {} records are good", told.len());
    Ok(())
}

fn input(guest: &Guest) -> Check {
    let arm = Arm::new(guest, Form::Classical)?;
    // Much longer than is waited for: it must still be sending when its link goes, on a machine that stands still for seconds too.
    let run = arm.to_play(guest, &held(&arm, 3000)?)?;
    let far = guest.capture("vcan1")?;
    let daemon = arm.daemon(guest, None)?;
    let (mut silences, mut plays) = (Vec::new(), Vec::new());
    let interrupt =
        |guest: &Guest, fail: &dyn Fn(&Guest) -> Check, mend: &dyn Fn(&Guest) -> Check| -> Check<[i64; 3]> {
            let playing = play(&run)?;
            let begun_ns = now_ns()?;
            pause(2000);
            fail(guest)?;
            let failed_ns = now_ns()?;
            // Who sends on a link that goes is told so.
            let sender = playing.finish(STEP)?.expect_code(2)?;
            ensure!(sender.stderr().contains("vcan0 is down or gone"), "replay said: {}", sender.stderr());
            pause(1500);
            let mended_ns = now_ns()?;
            mend(guest)?;
            Ok([begun_ns, failed_ns, mended_ns])
        };
    let down = |guest: &Guest| guest.set_link("vcan0", false);
    let up = |guest: &Guest| guest.set_link("vcan0", true);
    let delete = |guest: &Guest| guest.delete_link("vcan0");
    let add = |guest: &Guest| {
        guest.add_link("vcan0")?;
        guest.wait_for_receivers("vcan0", 1)
    };
    for [begun, failed, mended] in [interrupt(guest, &down, &up)?, interrupt(guest, &delete, &add)?] {
        plays.push((begun, failed));
        silences.push((failed, mended));
    }
    let back = play(&run)?;
    let begun_ns = now_ns()?;
    pause(2000);
    plays.push((begun_ns, now_ns()?));
    drop(back);
    Totals::stop(daemon)?;
    let records = published::decode(&far.stop()?)?;
    for (from_ns, to_ns) in plays {
        // Starting a program takes its time, and so do the first rounds.
        ensure_good(&records, from_ns + 500_000_000, to_ns)?;
    }
    for (from_ns, to_ns) in silences {
        ensure_silent(&records, from_ns + 150_000_000, to_ns)?;
    }
    Ok(())
}

fn output(guest: &Guest) -> Check {
    let arm = Arm::new(guest, Form::Classical)?;
    let run = arm.to_play(guest, &held(&arm, 9000)?)?;
    let daemon = arm.daemon(guest, None)?;
    let playing = play(&run)?;
    pause(1000);
    let heard = |guest: &Guest| -> Check {
        let far = guest.capture("vcan1")?;
        let from_ns = now_ns()?;
        pause(1500);
        let captured = far.stop_at_once()?;
        ensure_good(&published::decode_cut(&captured)?, from_ns, i64::MAX)
    };
    // A host that stands still makes inputs stale: once it goes on, wrenches are good again.
    let good = |guest: &Guest| -> Check {
        let until = Instant::now() + STEP;
        loop {
            match heard(guest) {
                Err(_) if Instant::now() < until => {}
                outcome => return outcome,
            }
        }
    };
    good(guest)?;
    guest.set_link("vcan1", false)?;
    pause(300);
    guest.set_link("vcan1", true)?;
    good(guest)?;
    guest.delete_link("vcan1")?;
    pause(300);
    guest.add_link("vcan1")?;
    pause(1000);
    good(guest)?;
    drop(playing);
    let totals = Totals::stop(daemon)?;
    let unsent = totals.value("unsent")?;
    ensure!(unsent > 0, "vcan1 was away, and the daemon says that it sent everything");
    totals.expect("lost_frames", 0)
}

/// Exchanges a file as an editor does.
fn replace(path: &Path, text: &str) -> Check {
    let new = path.with_extension("new");
    fs::write(&new, text).at("write", &new)?;
    fs::rename(&new, path).at("rename", &new)
}

fn bad_reload(guest: &Guest) -> Check {
    let arm = Arm::new(guest, Form::Classical)?;
    let lines = held(&arm, 1000)?;
    let run = arm.to_play(guest, &lines)?;
    let read = |path: &Path| fs::read_to_string(path).at("read", path);
    let (config, model) = (read(&arm.config)?, read(&arm.model)?);
    let good_model = guest.dir().join("good.toml");
    fs::write(&good_model, &model).at("write", &good_model)?;
    let recording = guest.dir().join("recorded.log");
    let far = guest.capture("vcan1")?;
    let mut daemon = arm.daemon(guest, Some(&recording))?;
    let playing = play(&run)?;
    pause(1000);
    let half = model.get(..model.len() / 2).unwrap_or_default();
    let bad: [(&Path, &str, &str, &str); 4] = [
        (&arm.model, &model, half, "model.toml"),
        (&arm.model, &model, &another_arm(&model)?, "another arm"),
        (&arm.config, &config, &config.replace("[bus]", "[bus"), "arm.toml"),
        (&arm.config, &config, &config.replace("mode = \"event\"", "mood = \"event\""), "mood"),
    ];
    for (number, (path, good, bad, word)) in bad.into_iter().enumerate() {
        replace(path, bad)?;
        daemon.signal(Signal::SIGHUP)?;
        let said = daemon.wait_for_nth("not reloaded", number + 1, STEP)?;
        ensure!(said.contains(word), "the reason does not name {word:?}: {said}");
        replace(path, good)?;
    }
    playing.finish(STEP)?.expect_code(0)?;
    wait_for_silence(guest)?;
    Totals::stop(daemon)?;
    let records = published::decode(&far.stop()?)?;
    // The old model went on without missing an instant.
    let offline = arm.offline(guest, &recording, &good_model)?;
    let pairs = pair(&records, &offline, &candump::read(&recording)?)?;
    ensure!(pairs.len() > 990, "1000 rounds gave {} wrenches", pairs.len());
    ensure_equal(&pairs)
}

/// The model with the fingerprint of another arm.
fn another_arm(model: &str) -> Check<String> {
    let line = model.lines().find(|line| line.starts_with("kinematics_sha256 = "));
    let line = line.ok_or_else(|| Failure::new("the model names no kinematics"))?;
    Ok(model.replace(line, &format!("kinematics_sha256 = \"{}\"", "0".repeat(64))))
}

fn good_reload(guest: &Guest) -> Check {
    let arm = Arm::new(guest, Form::Classical)?;
    let run = arm.to_play(guest, &held(&arm, 1000)?)?;
    let recording = guest.dir().join("recorded.log");
    // A heavier tool: the gauges agree as before, on another wrench.
    let old = fs::read_to_string(&arm.config).at("read", &arm.config)?;
    let new = old.clone() + "\n[tool]\nmass = 0.1\ncom = [0.0, 0.0, 0.05]\n";
    let model = fs::read_to_string(&arm.model).at("read", &arm.model)? + "\n# The same, said anew.\n";
    let far = guest.capture("vcan1")?;
    let mut daemon = arm.daemon(guest, Some(&recording))?;
    let playing = play(&run)?;
    pause(3000);
    replace(&arm.model, &model)?;
    replace(&arm.config, &new)?;
    let asked_ns = now_ns()?;
    daemon.signal(Signal::SIGHUP)?;
    daemon.wait_for(" reloaded ", STEP)?;
    let done_ns = now_ns()?;
    playing.finish(STEP)?.expect_code(0)?;
    wait_for_silence(guest)?;
    Totals::stop(daemon)?;
    // Its sequence has no gap: that is what reading it checks.
    let records = published::decode(&far.stop()?)?;
    let first_ns = candump::read(&recording)?.first().map_or(0, |line| line.stamp_ns);
    let nearest = |config: &str, from_ns: i64, to_ns: i64| -> Check<(usize, f64)> {
        replace(&arm.config, config)?;
        let offline = arm.offline(guest, &recording, &arm.model)?;
        let mut differences_n = Vec::new();
        for live in within(&records, from_ns, to_ns).into_iter().filter(|live| live.is_valid()) {
            // The instant that was published is the last before.
            let before = offline.partition_point(|offline| first_ns + offline.time_ns < live.time_ns);
            let Some(offline) =
                before.checked_sub(1).map(|at| &offline[at]).filter(|offline| offline.is_valid())
            else {
                continue;
            };
            let difference =
                (0..3).map(|axis| (live.wrench[axis] - offline.wrench[axis]).abs()).fold(0.0, f64::max);
            differences_n.push(difference);
        }
        // The median: where the sender paused, a new engine and one with a history may see other rounds.
        differences_n.sort_by(f64::total_cmp);
        Ok((differences_n.len(), differences_n.get(differences_n.len() / 2).copied().unwrap_or(f64::NAN)))
    };
    let settled_ns = done_ns + 500_000_000;
    for (config, from_ns, to_ns, same) in [
        (&old, 0, asked_ns, true),
        (&new, 0, asked_ns, false),
        (&new, settled_ns, i64::MAX, true),
        (&old, settled_ns, i64::MAX, false),
    ] {
        let (count, median_n) = nearest(config, from_ns, to_ns)?;
        ensure!(count > 100, "{count} wrenches before or after the reload");
        ensure!(
            if same { median_n < 0.05 } else { median_n > 0.2 },
            "{} tool {} the reload: the wrench differs by {median_n} N (median)",
            if *config == new { "with the" } else { "without a" },
            if to_ns == asked_ns { "before" } else { "after" }
        );
    }
    Ok(())
}

fn stop(guest: &Guest) -> Check {
    let arm = Arm::new(guest, Form::Classical)?;
    // Where nothing comes at all, and in the middle of a stream.
    for rounds in [0, 1000] {
        let far = guest.capture("vcan1")?;
        let daemon = arm.daemon(guest, None)?;
        let playing = if rounds > 0 {
            let run = arm.to_play(guest, &held(&arm, rounds)?)?;
            Some(play(&run)?)
        } else {
            None
        };
        pause(1500);
        let asked = Instant::now();
        let totals = Totals::stop(daemon)?;
        let took = asked.elapsed();
        ensure!(took < STOP_LIMIT / 3, "it took {took:?} to stop");
        drop(playing);
        let records = published::decode(&far.stop()?)?;
        totals.expect("published", records.len())?;
        totals.expect("lost_frames", 0)?;
        ensure!(
            records.last().is_some_and(|last| last.status == SILENCE),
            "the last record does not say that nothing follows"
        );
        let good = records.iter().filter(|record| record.is_valid()).count();
        ensure!((rounds == 0) == (good == 0), "{good} wrenches from {rounds} rounds");
    }
    Ok(())
}

fn refusals(guest: &Guest) -> Check {
    let arm = Arm::new(guest, Form::Classical)?;
    let read = |path: &Path| fs::read_to_string(path).at("read", path);
    let (config, model) = (read(&arm.config)?, read(&arm.model)?);
    let dir = guest.dir();
    let file = |name: &str, text: &str| -> Check<PathBuf> {
        let path = dir.join(name);
        fs::write(&path, text).at("write", &path)?;
        Ok(path)
    };
    let half = model.get(..model.len() / 2).unwrap_or_default();
    let cases: Vec<(PathBuf, PathBuf, &[&str])> = vec![
        (dir.join("gone.toml"), arm.model.clone(), &["gone.toml"]),
        (arm.config.clone(), dir.join("gone.toml"), &["gone.toml"]),
        (
            file("broken.toml", &config.replace("[bus]", "[bus"))?,
            arm.model.clone(),
            &["broken.toml:", "[bus"],
        ),
        (
            file("key.toml", &config.replace("interfaces", "interface"))?,
            arm.model.clone(),
            &["key.toml", "interfaces"],
        ),
        (file("input.toml", &config.replace("vcan0", "vcan7"))?, arm.model.clone(), &["vcan7"]),
        (file("output.toml", &config.replace("vcan1", "vcan8"))?, arm.model.clone(), &["vcan8"]),
        (arm.config.clone(), file("half.toml", half)?, &["half.toml"]),
        (arm.config.clone(), file("other.toml", &another_arm(&model)?)?, &["other.toml", "another arm"]),
    ];
    for (config, model, words) in &cases {
        let mut command = Command::new(&programs()?.wrenchd);
        command.arg("--config").arg(config).arg("--model").arg(model);
        let finished = Program::start(&mut command)?.finish(STEP)?.expect_code(2)?;
        let said = finished.stderr();
        let messages = said.lines().filter(|line| line.contains("error: ")).count();
        ensure!(messages == 1 && finished.stdout().is_empty(), "not one message:\n{}", finished.text());
        for word in *words {
            ensure!(said.contains(word), "the message does not name {word:?}: {said}");
        }
    }
    Ok(())
}
