//! A recording played through the daemon, with every frame on both links accounted for.

use crate::published::{self, Published, ensure_equal, pair};
use crate::rig::{Arm, Player};
use std::path::PathBuf;
use std::time::{Duration, Instant};
use wrenchd_tests::candump::{self, Line};
use wrenchd_tests::guest::{Capture, Captured, Guest, ensure_same_frames, send};
use wrenchd_tests::process::Program;
use wrenchd_tests::{Check, Failure, ensure};

const PLAY_LIMIT: Duration = Duration::from_secs(400);
const SETTLE_LIMIT: Duration = Duration::from_secs(60);
pub(crate) const STOP_LIMIT: Duration = Duration::from_secs(30);

/// What went over the two links while the daemon ran.
pub(crate) struct Live {
    /// What the daemon recorded: every frame that it received, with the kernel's stamp.
    pub(crate) recorded: Vec<Line>,
    pub(crate) recording: PathBuf,
    /// What the daemon published.
    pub(crate) published: Vec<Published>,
}

/// What the machine's one processor, on which every wake-up is slow, has to carry.
#[derive(Clone, Copy, PartialEq)]
pub(crate) enum Load {
    /// An arm at 125 Hz. candump captures the daemon's input too, and must have what the daemon recorded, to the stamp.
    Moderate,
    /// 7000 frames a second: the kernel counts them, and the daemon is not woken for each.
    Heavy,
}

impl Live {
    /// Starts the daemon, plays the recording, and stops the daemon, which must end well; fails if a frame was lost anywhere.
    pub(crate) fn run(guest: &Guest, arm: &Arm, player: Player, load: Load, lines: &[Line]) -> Check<Self> {
        Self::run_beside(guest, arm, player, load, lines, |_, play| play())
    }

    /// The same with something done meanwhile, which plays the recording in its time.
    pub(crate) fn run_beside(
        guest: &Guest,
        arm: &Arm,
        player: Player,
        load: Load,
        lines: &[Line],
        beside: impl FnOnce(&Program, &dyn Fn() -> Check) -> Check,
    ) -> Check<Self> {
        let played = arm.to_play(guest, lines)?;
        let recording = guest.dir().join("recorded.log");
        // The daemon keeps what is there, and records under another name.
        let _ = std::fs::remove_file(&recording);
        let near = if load == Load::Moderate { Some(guest.capture("vcan0")?) } else { None };
        let far = guest.capture("vcan1")?;
        let daemon = match load {
            Load::Moderate => arm.daemon(guest, Some(&recording))?,
            Load::Heavy => arm.daemon_in_batches(guest, Some(&recording))?,
        };
        let before = [guest.carried("vcan0")?, guest.carried("vcan1")?];
        beside(&daemon, &|| send(&mut player.command(&played)?, PLAY_LIMIT))?;
        wait_for_silence(guest)?;
        let totals = Totals::stop(daemon)?;
        let carried = guest.carried("vcan0")? - before[0];
        let near = near.map(Capture::stop).transpose()?;
        let sent = far.stop()?;
        let recorded = candump::read(&recording)?;

        ensure!(carried == lines.len() as u64, "{} frames to send, vcan0 carried {carried}", lines.len());
        ensure_same_frames(lines, &recorded)?;
        if let Some(near) = near {
            ensure_witnessed(&near, &recorded)?;
        }
        totals.expect("frames", lines.len())?;
        totals.expect("lost_frames", 0)?;
        totals.expect("lost", 0)?;
        totals.expect("unsent", 0)?;
        // Every output counts what it sent; that of vcan1 is held against `published` below.
        let (counted, came) = (totals.value("sent")?, sent.lines.len() as u64);
        ensure!(counted >= came, "the daemon counts sent={counted}, {came} frames came");
        let published = published::decode(&sent)?;
        totals.expect("published", published.len())?;
        Ok(Self { recorded, recording, published })
    }

    /// The wrenches, each beside the one that the tool computes offline from the daemon's own recording; fails unless they are equal.
    pub(crate) fn beside_offline<'a>(
        &'a self,
        offline: &'a [Published],
    ) -> Check<Vec<(&'a Published, &'a Published)>> {
        let pairs = pair(&self.published, offline, &self.recorded)?;
        ensure_equal(&pairs)?;
        Ok(pairs)
    }
}

/// The capture and the daemon's recording hold the same frames with the same stamps, which the capture has in microseconds.
fn ensure_witnessed(near: &Captured, recorded: &[Line]) -> Check {
    ensure_same_frames(&near.lines, recorded)?;
    for (at, (seen, recorded)) in near.lines.iter().zip(recorded).enumerate() {
        let (a, b) = (seen.stamp_ns, recorded.stamp_ns);
        ensure!((b - a).abs() < 1000, "frame {at}: stamp {a} ns by candump, {b} ns by the daemon");
    }
    Ok(())
}

/// Waits until the daemon, in event mode, has published all it will and only tells of silence.
pub(crate) fn wait_for_silence(guest: &Guest) -> Check {
    const WINDOW: Duration = Duration::from_millis(350);
    let deadline = Instant::now() + SETTLE_LIMIT;
    let mut before = guest.carried("vcan1")?;
    loop {
        std::thread::sleep(WINDOW);
        let now = guest.carried("vcan1")?;
        // Silence is told twenty times a second, in three frames; the recordings have 125 rounds a second.
        if (3..=30).contains(&(now - before)) {
            return Ok(());
        }
        ensure!(
            Instant::now() < deadline,
            "{} frames in {WINDOW:?} on vcan1, {SETTLE_LIMIT:?} after the last on vcan0",
            now - before
        );
        before = now;
    }
}

/// What the daemon says at its end.
pub(crate) struct Totals {
    said: String,
}

impl Totals {
    /// Stops the daemon, which must end with exit status 0.
    pub(crate) fn stop(daemon: Program) -> Check<Self> {
        let said = daemon.stop(STOP_LIMIT)?.expect_code(0)?.text();
        ensure!(said.contains(" stopped "), "the daemon did not say that it stopped:\n{said}");
        Ok(Self { said })
    }

    /// The last number of this name.
    pub(crate) fn value(&self, name: &str) -> Check<u64> {
        let start = format!("{name}=");
        let numbers = self.said.split_ascii_whitespace().filter_map(|word| word.strip_prefix(start.as_str()));
        let last = numbers.filter_map(|number| number.parse().ok()).next_back();
        last.ok_or_else(|| Failure::new(format!("the daemon did not say {name}:\n{}", self.said)))
    }

    /// Fails unless the last number of this name is this one.
    pub(crate) fn expect(&self, name: &str, number: usize) -> Check {
        let value = self.value(name)?;
        ensure!(value == number as u64, "the daemon counts {name}={value}, {number} are due:\n{}", self.said);
        Ok(())
    }
}
