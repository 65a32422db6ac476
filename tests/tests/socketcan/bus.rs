//! The machine itself: what every other scenario takes for granted.

use nix::sys::signal::Signal;
use std::path::Path;
use std::process::Command;
use std::time::Duration;
use wrenchd_tests::candump::{self, Line};
use wrenchd_tests::guest::{Guest, ensure_same_frames, send};
use wrenchd_tests::process::{self, Program};
use wrenchd_tests::suite::Scenario;
use wrenchd_tests::{Check, IoContext, ensure, machine};

const LIMIT: Duration = Duration::from_secs(60);
const STEP: Duration = Duration::from_secs(20);

pub(crate) const SCENARIOS: &[Scenario] = &[
    Scenario { name: "bus::links_are_up_and_take_can_fd", needs: &[], limit: LIMIT, run: links },
    Scenario { name: "bus::generated_frames_arrive", needs: &[], limit: LIMIT, run: generated },
    Scenario { name: "bus::a_recording_arrives_as_it_was", needs: &[], limit: LIMIT, run: recording },
    Scenario { name: "bus::an_fd_recording_arrives_as_it_was", needs: &[], limit: LIMIT, run: fd_recording },
    Scenario { name: "bus::a_full_buffer_is_counted_by_the_kernel", needs: &[], limit: LIMIT, run: drops },
    Scenario { name: "bus::a_thousand_rounds_a_second_arrive", needs: &[], limit: LIMIT, run: rounds },
    Scenario { name: "bus::a_link_goes_and_comes_back", needs: &[], limit: LIMIT, run: link_returns },
    Scenario {
        name: "bus::a_namespace_serves_where_there_is_vcan",
        needs: &[],
        limit: LIMIT,
        run: namespace,
    },
];

fn links(_: &Guest) -> Check {
    for name in ["vcan0", "vcan1"] {
        let shown = process::run(Command::new("ip").args(["-d", "link", "show", name]), STEP)?.stdout();
        for word in ["mtu 72", "LOWER_UP", "vcan"] {
            ensure!(shown.contains(word), "{name} is not {word}: {shown}");
        }
    }
    Ok(())
}

fn generated(guest: &Guest) -> Check {
    let (near, far) = (guest.capture("vcan0")?, guest.capture("vcan1")?);
    send(
        Command::new("cangen").args(["-n", "500", "-g", "0", "-I", "i", "-L", "8", "-D", "i", "vcan0"]),
        STEP,
    )?;
    let (near, far) = (near.stop()?, far.stop()?);
    ensure!(far.lines.is_empty(), "frames sent to vcan0 arrived on vcan1: {}", far.lines.len());
    ensure!(near.lines.len() == 500, "500 frames generated, {} arrived", near.lines.len());
    for (number, line) in near.lines.iter().enumerate() {
        let id = u32::from_str_radix(&line.id, 16)?;
        ensure!(id as usize == number % 0x800, "frame {number} has the identifier {id:x}");
    }
    Ok(())
}

/// Plays a recording onto vcan0 with canplayer and returns what arrived there.
fn play(guest: &Guest, lines: &[Line], limit: Duration) -> Check<Vec<Line>> {
    let log = guest.dir().join("played.log");
    candump::write(&log, lines)?;
    let capture = guest.capture("vcan0")?;
    send(Command::new("canplayer").arg("-I").arg(&log).arg("vcan0=can0"), limit)?;
    Ok(capture.stop()?.lines)
}

fn capture_of_arm_a() -> Check<Vec<Line>> {
    candump::read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("captures/accuracy/can.log.gz"))
}

fn span_ns(lines: &[Line]) -> i64 {
    lines.first().zip(lines.last()).map_or(0, |(first, last)| last.stamp_ns - first.stamp_ns)
}

fn recording(guest: &Guest) -> Check {
    let lines: Vec<Line> = capture_of_arm_a()?.into_iter().take(2000).collect();
    let arrived = play(guest, &lines, STEP)?;
    ensure_same_frames(&lines, &arrived)?;
    // A busy computer may be late, but nothing may come early.
    let (sent_ns, arrived_ns) = (span_ns(&lines), span_ns(&arrived));
    ensure!(
        arrived_ns > sent_ns - 20_000_000,
        "{sent_ns} ns of recording took {arrived_ns} ns by the kernel's stamps"
    );
    Ok(())
}

fn fd_recording(guest: &Guest) -> Check {
    let classical: Vec<Line> = capture_of_arm_a()?.into_iter().take(2000).collect();
    let lines = candump::as_fd(&classical);
    ensure!(lines.iter().filter(|line| line.data.len() == 64).count() > 200, "few rounds were repacked");
    ensure_same_frames(&lines, &play(guest, &lines, STEP)?)
}

fn drops(guest: &Guest) -> Check {
    let mut command = Command::new("candump");
    command.args(["-L", "-d", "-r", "4096", "vcan0"]);
    let slow = guest.start_listening(&mut command, "vcan0")?;
    slow.signal(Signal::SIGSTOP)?;
    send(Command::new("cangen").args(["-n", "1000", "-g", "0", "vcan0"]), STEP)?;
    slow.signal(Signal::SIGCONT)?;
    // The count comes with the first frame that is received after the loss.
    let mut number = 0;
    let said = loop {
        send(Command::new("cansend").args(["vcan0", "123#00"]), STEP)?;
        // candump's output is a pipe: it is seen when its buffer is full, or at the end.
        std::thread::sleep(Duration::from_millis(100));
        number += 1;
        if number == 3 {
            break slow.stop(STEP)?.text();
        }
    };
    let count = said
        .lines()
        .find_map(|line| line.strip_prefix("DROPCOUNT: dropped "))
        .and_then(|rest| rest.split(' ').next()?.parse::<u32>().ok());
    let received = said.lines().filter(|line| line.contains(" vcan0 ")).count();
    ensure!(
        count.is_some_and(|count| count > 500 && count as usize + received == 1000 + number),
        "of 1000 + {number} frames {received} were received, and the kernel counted {count:?} dropped"
    );
    Ok(())
}

fn rounds(guest: &Guest) -> Check {
    const ROUNDS: usize = 3000;
    let pieces = candump::rounds(&capture_of_arm_a()?);
    let lines = candump::repeated(&pieces, ROUNDS, 1_000_000);
    let arrived = play(guest, &lines, STEP)?;
    ensure_same_frames(&lines, &arrived)?;
    println!(
        "  {ROUNDS} rounds meant for 1000 Hz came at {:.0} Hz",
        1e9 * ROUNDS as f64 / span_ns(&arrived) as f64
    );
    Ok(())
}

fn link_returns(guest: &Guest) -> Check {
    guest.set_link("vcan1", false)?;
    let refused = Program::start(Command::new("cansend").args(["vcan1", "123#00"]))?.finish(STEP)?;
    ensure!(refused.code() != Some(0), "a frame was sent on a link that is down");
    guest.set_link("vcan1", true)?;
    guest.delete_link("vcan1")?;
    ensure!(guest.ip(&["link", "show", "vcan1"]).is_err(), "vcan1 is still there");
    guest.add_link("vcan1")?;
    let capture = guest.capture("vcan1")?;
    send(Command::new("cansend").args(["vcan1", "123#CAFE"]), STEP)?;
    let lines = capture.stop()?.lines;
    ensure!(lines.len() == 1 && lines[0].frame() == "123#CAFE", "after its return vcan1 carried {lines:?}");
    Ok(())
}

/// This kernel has vcan: started here as a user starts it, the target must choose a namespace, and find its links there.
fn namespace(guest: &Guest) -> Check {
    let build = guest.dir().join("build");
    std::fs::create_dir(&build).at("create", &build)?;
    let tag = build.join("CACHEDIR.TAG");
    std::fs::write(&tag, "").at("write", &tag)?;
    let (own, executable) = (std::env::current_exe()?, build.join("socketcan"));
    std::fs::copy(&own, &executable).at("copy", &own)?;
    let mut command = Command::new(&executable);
    machine::as_if_outside(&mut command);
    let said = process::run(command.args(["--exact", SCENARIOS[0].name]), LIMIT / 2)?.stdout();
    for word in ["machine: network namespace", "1 passed, 0 failed"] {
        ensure!(said.contains(word), "it did not say {word:?} but:\n{said}");
    }
    Ok(())
}
