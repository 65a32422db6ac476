//! The daemon on a live bus: a recording goes in on vcan0, wrench frames come out on vcan1, and both are judged by programs that are
//! not the project's own.

use crate::live::{Live, Load};
use crate::published::{DEGRADED, INVALID, Published, STALE, STALE_AFTER_NS, UNCERTAIN};
use crate::rig::{Arm, Form, Player};
use std::fmt;
use std::time::Duration;
use wrenchd_tests::candump::{self, Line};
use wrenchd_tests::guest::Guest;
use wrenchd_tests::suite::{Need, Scenario};
use wrenchd_tests::{Check, Failure, ensure};

const NEEDS: &[Need] = &[Need::Programs, Need::Python];
const LIMIT: Duration = Duration::from_secs(180);
/// So many rounds at first the rhythm is young.
const YOUNG: usize = 64;
/// Instants that the motion filter needs before it knows how the joints move.
const WARM_UP: usize = 10;
/// The recording begins with so many rounds in a held pose.
const HELD_ROUNDS: usize = 480;
/// Then its motion begins, which a causal filter cannot know before it has gone on for some rounds.
const MOTION_BEGINS: std::ops::Range<usize> = 500..512;
/// After a silence of half a second nothing is known of the motion; stamps say it a little differently for each message.
const SILENCE_NS: i64 = 450_000_000;
/// A player that the machine kept waiting sends what it missed at once: so many rounds, if in less than half their time, are hurried.
const HURRIED_ROUNDS: usize = 12;
/// Then the joints seem to move as no arm can, and for so many rounds more the motion filter rightly knows little of them.
const CALM_ROUNDS: usize = 100;
/// So many wrenches in the held pose, and so many in motion, must have come of a player in its time, in one of so many runs.
const CALM_NEEDED: usize = 150;
const RUNS: usize = 4;

pub(crate) const SCENARIOS: &[Scenario] = &[
    Scenario {
        name: "daemon::a_replayed_recording_gives_the_offline_wrench",
        needs: NEEDS,
        limit: LIMIT,
        run: replayed,
    },
    Scenario { name: "daemon::canplayer_gives_the_offline_wrench", needs: NEEDS, limit: LIMIT, run: played },
    Scenario { name: "daemon::can_fd_gives_the_offline_wrench", needs: NEEDS, limit: LIMIT, run: fd },
    Scenario {
        name: "daemon::a_minute_at_1000_hz_loses_nothing",
        needs: NEEDS,
        limit: Duration::from_secs(600),
        run: minute,
    },
];

fn replayed(guest: &Guest) -> Check {
    live_equals_offline(guest, Form::Classical, Player::Wrenchctl)
}

fn played(guest: &Guest) -> Check {
    live_equals_offline(guest, Form::Classical, Player::Canplayer)
}

fn fd(guest: &Guest) -> Check {
    live_equals_offline(guest, Form::Fd, Player::Canplayer)
}

fn live_equals_offline(guest: &Guest, form: Form, player: Player) -> Check {
    let arm = Arm::new(guest, form)?;
    let lines = arm.recording()?;
    for _ in 0..RUNS {
        let live = Live::run(guest, &arm, player, Load::Moderate, &lines)?;
        let offline = arm.offline(guest, &live.recording, &arm.model)?;
        let pairs = live.beside_offline(&offline)?;
        let played = Played::new(&arm, &lines, &live.recorded);
        played.ensure_good(&pairs)?;
        if played.is_calm() {
            let truth = arm.truth()?;
            let fewer = match played.calm.contains(&false) {
                true => Some(undisturbed(guest, &arm, &lines, &truth, &played.calm)?),
                false => None,
            };
            played.errors(&pairs, &truth, &played.calm)?.ensure_reported(fewer.as_ref())?;
            return ensure_push(&pairs);
        }
    }
    Err(Failure::new(format!("this machine held the player back too often to tell, in each of {RUNS} runs")))
}

/// Errors of the wrenches computed from the recording as it was made, of those rounds.
fn undisturbed(
    guest: &Guest,
    arm: &Arm,
    lines: &[Line],
    truth: &[[f64; 6]],
    counted: &[bool],
) -> Check<HeldAndMoving> {
    let log = guest.dir().join("undisturbed.log");
    let on_vcan0 = |line: &Line| Line { interface: "vcan0".into(), ..line.clone() };
    candump::write(&log, &lines.iter().map(on_vcan0).collect::<Vec<_>>())?;
    let offline = arm.offline(guest, &log, &arm.model)?;
    let pairs: Vec<_> = offline.iter().map(|wrench| (wrench, wrench)).collect();
    Played::new(arm, lines, lines).errors(&pairs, truth, counted)
}

/// How a recording of complete rounds came over the bus.
struct Played {
    first_ns: i64,
    /// The stamp that the instant of each round has.
    instants_ns: Vec<i64>,
    /// Stamps of each round's first and last frame.
    spans_ns: Vec<(i64, i64)>,
    /// Whether instants must be where the boards' cycles have them.
    exact: bool,
    /// How many rounds before and with each came without a silence.
    settled: Vec<usize>,
    /// Whether each came with the rounds before it in about the time that they were recorded in.
    calm: Vec<bool>,
}

impl Played {
    fn new(arm: &Arm, meant: &[Line], recorded: &[Line]) -> Self {
        let rounds = arm.rounds(recorded).all;
        let stamp_ns = |line: &usize| recorded[*line].stamp_ns;
        let instants_ns: Vec<i64> = rounds.iter().map(|(_, gauge, _)| stamp_ns(gauge)).collect();
        let meant_ns: Vec<i64> =
            arm.rounds(meant).all.iter().map(|(_, gauge, _)| meant[*gauge].stamp_ns).collect();
        let mut settled = 0;
        let count = |at: usize| {
            let silent = at > 0 && instants_ns[at] - instants_ns[at - 1] > SILENCE_NS;
            settled = if silent { 1 } else { settled + 1 };
            settled
        };
        Self {
            first_ns: recorded.first().map_or(0, |line| line.stamp_ns),
            settled: (0..instants_ns.len()).map(count).collect(),
            calm: calm(&meant_ns, &instants_ns),
            spans_ns: rounds.iter().map(|(first, _, last)| (stamp_ns(first), stamp_ns(last))).collect(),
            exact: true,
            instants_ns,
        }
    }

    /// For a sender whom the machine's one processor leaves in the middle of rounds all the time: then nothing tells where the boards'
    /// cycle begins, and an instant may be that of any frame of a round.
    fn breathless(self) -> Self {
        Self { exact: false, ..self }
    }

    /// The round of an instant; none for the first ones, at the beginning and after a silence.
    fn settled_round(&self, offline: &Published) -> Option<usize> {
        let at_ns = self.first_ns + offline.time_ns;
        // The offline wrenches have their time in microseconds.
        let round = match self.exact {
            true => self.instants_ns.iter().position(|instant_ns| (instant_ns - at_ns).abs() <= 1000),
            false => {
                self.spans_ns.iter().position(|(first, last)| (first - 1000..=last + 1000).contains(&at_ns))
            }
        };
        round.filter(|round| self.settled[*round] > WARM_UP)
    }

    /// Whether a round, or the way to it, took so long that what came first is rightly called stale.
    fn is_stalled(&self, round: usize) -> bool {
        let since_ns = self.spans_ns[round.saturating_sub(1)].1.min(self.spans_ns[round].0);
        self.spans_ns[round].1 - since_ns > STALE_AFTER_NS
    }

    /// Whether the wrench of a round may be called uncertain to uselessness: only where the joints seem to race.
    fn may_be_unknown(&self, round: usize, status: u8) -> bool {
        const UNKNOWN: u8 = INVALID | UNCERTAIN;
        !self.calm[round] && status & UNKNOWN == UNKNOWN && status & (DEGRADED | STALE) == 0
    }

    /// Whether enough rounds came in their time to judge errors by.
    fn is_calm(&self) -> bool {
        let (held, moving) = self.calm.split_at(HELD_ROUNDS);
        [held, moving].iter().all(|rounds| rounds.iter().filter(|calm| **calm).count() >= CALM_NEEDED)
    }

    /// Each wrench is usable and made of all that there is, however this computer held the sender back.
    fn ensure_good(&self, pairs: &[(&Published, &Published)]) -> Check {
        const TROUBLE: u8 = INVALID | DEGRADED | STALE;
        let settled =
            pairs.iter().filter_map(|(live, offline)| Some((self.settled_round(offline)?, live.status)));
        let settled: Vec<(usize, u8)> = settled.collect();
        let bad = |(round, status): &&(usize, u8)| {
            let excused = self.may_be_unknown(*round, *status) || !self.exact && self.is_stalled(*round);
            status & TROUBLE != 0 && !excused
        };
        let wrong: Vec<_> = settled.iter().filter(bad).collect();
        let (rounds, count) = (self.instants_ns.len(), settled.len());
        let calm = settled.iter().filter(|(round, _)| self.calm[*round]).count();
        println!(
            "  {count} of {rounds} rounds have a wrench beyond the first of a stretch, {calm} of them in their time, {} bad",
            wrong.len()
        );
        let expected = self.settled.iter().filter(|settled| **settled > WARM_UP).count();
        // Where rounds begin may be found anew once while the rhythm is young, and again after each stop of the sender then; at any time where
        // rounds come as fast as they can be sent.
        let young = if self.exact { YOUNG.min(rounds) } else { rounds };
        let stops = (0..young).filter(|round| self.is_stalled(*round)).count();
        let short = expected.saturating_sub(count);
        ensure!(short <= 1 + stops, "{count} wrenches of {expected} rounds beyond the first of a stretch");
        ensure!(2 * count > rounds, "only {count} of {rounds} rounds are not the first of a stretch");
        ensure!(wrong.is_empty(), "{} of {count} wrenches have a bad status: {wrong:x?}", wrong.len());
        Ok(())
    }

    /// Errors against the truth of those rounds, in the held pose and in motion. Where the joints seem to race, the truth is not that of
    /// the motion that the daemon saw.
    fn errors(
        &self,
        pairs: &[(&Published, &Published)],
        truth: &[[f64; 6]],
        counted: &[bool],
    ) -> Check<HeldAndMoving> {
        let rounds = self.instants_ns.len();
        ensure!(rounds == truth.len(), "{rounds} rounds, {} rows of truth", truth.len());
        let mut errors = HeldAndMoving::default();
        for (live, offline) in pairs.iter().filter(|(live, _)| live.is_valid()) {
            let Some(round) = self.settled_round(offline).filter(|round| counted[*round]) else { continue };
            let errors = if round < HELD_ROUNDS { &mut errors.held } else { &mut errors.moving };
            errors.add(round, live, &truth[round], offline.sigma.unwrap_or([f64::NAN; 6]));
        }
        Ok(errors)
    }
}

/// The recording holds a push of 5 N: a wrench that stays at zero would be wrong, whatever it says of itself.
fn ensure_push(pairs: &[(&Published, &Published)]) -> Check {
    let held_n = pairs.iter().take(HELD_ROUNDS).skip(WARM_UP).filter(|(live, _)| live.is_valid());
    let largest_n = held_n.map(|(live, _)| live.force_n()).fold(0.0, f64::max);
    ensure!((4.5..6.0).contains(&largest_n), "a push of 5 N gave at most {largest_n} N");
    Ok(())
}

/// Of each round, whether it came long enough after the last hurried ones.
fn calm(meant_ns: &[i64], came_ns: &[i64]) -> Vec<bool> {
    let span_ns = |stamps: &[i64], at: usize| stamps[at] - stamps[at - HURRIED_ROUNDS];
    let is_hurried = |at: &usize| *at >= HURRIED_ROUNDS && 2 * span_ns(came_ns, *at) < span_ns(meant_ns, *at);
    let mut last = None;
    let mut is_calm = |at: usize| {
        last = Some(at).filter(is_hurried).or(last);
        last.is_none_or(|last| at - last > CALM_ROUNDS)
    };
    (0..came_ns.len().min(meant_ns.len())).map(&mut is_calm).collect()
}

#[derive(Default)]
struct HeldAndMoving {
    held: Errors,
    moving: Errors,
}

impl HeldAndMoving {
    /// The errors are what the reported standard deviations say, or, where only some rounds are judged, what those rounds' are undisturbed.
    fn ensure_reported(&self, undisturbed: Option<&Self>) -> Check {
        println!("  held: {}\n  moving: {}", self.held, self.moving);
        self.held.ensure_reported(6.0, undisturbed.map(|errors| &errors.held))?;
        // What changes within a few rounds is known a little late: some instants of a motion lie further out than a Gaussian's.
        self.moving.ensure_reported(8.0, undisturbed.map(|errors| &errors.moving))
    }
}

/// Errors over reported standard deviations.
#[derive(Default)]
struct Errors {
    squares: [f64; 6],
    count: usize,
    /// The largest, its round and axis.
    largest: (f64, usize, usize),
}

impl Errors {
    fn add(&mut self, round: usize, live: &Published, truth: &[f64; 6], sigma: [f64; 6]) {
        self.count += 1;
        for axis in 0..6 {
            let error = ((live.wrench[axis] - truth[axis]) / sigma[axis]).abs();
            self.squares[axis] += error * error;
            let beginning = MOTION_BEGINS.contains(&round) && error.is_finite();
            if !beginning && (error > self.largest.0 || error.is_nan()) {
                self.largest = (error, round, axis);
            }
        }
    }

    fn nees(&self) -> [f64; 6] {
        self.squares.map(|sum| sum / self.count as f64)
    }

    /// Errors come in runs of alike ones: the fewer rounds count, the further their mean square may be from one, live as undisturbed.
    fn ensure_reported(&self, largest: f64, undisturbed: Option<&Self>) -> Check {
        const ALIKE: f64 = 1.2;
        let other = undisturbed.map(Self::nees);
        let is_alike = |axis: usize, nees: f64| {
            other.is_some_and(|other| (other[axis] / ALIKE..other[axis] * ALIKE).contains(&nees))
        };
        let fits = |(axis, nees): (usize, f64)| (0.3..1.6).contains(&nees) || is_alike(axis, nees);
        let fit = self.nees().into_iter().enumerate().all(fits) && self.largest.0 < largest;
        ensure!(fit, "errors do not fit the reported standard deviations: {self}; undisturbed: {other:.2?}");
        Ok(())
    }
}

impl fmt::Display for Errors {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (error, round, axis) = self.largest;
        let nees = self.nees();
        write!(
            f,
            "{} instants, nees {nees:.2?}, largest error {error:.1} sigma (round {round}, axis {axis})",
            self.count
        )
    }
}

fn minute(guest: &Guest) -> Check {
    const ROUNDS: usize = 60_000;
    const PERIOD_NS: i64 = 1_000_000;
    let arm = Arm::new(guest, Form::Classical)?;
    // A push in a held pose: played faster than it was recorded, a motion would be another one.
    let pieces = candump::rounds(&arm.recording()?);
    let held = pieces.get(..200).unwrap_or(&pieces);
    let lines: Vec<Line> = candump::repeated(held, ROUNDS, PERIOD_NS);
    let live = Live::run(guest, &arm, Player::WrenchctlInRounds, Load::Heavy, &lines)?;
    let offline = arm.offline(guest, &live.recording, &arm.model)?;
    let pairs = live.beside_offline(&offline)?;
    Played::new(&arm, &lines, &live.recorded).breathless().ensure_good(&pairs)?;
    let span_ns = live.recorded.first().zip(live.recorded.last()).map_or(0, |(a, b)| b.stamp_ns - a.stamp_ns);
    let rate_hz = 1e9 * ROUNDS as f64 / span_ns as f64;
    println!("  {ROUNDS} rounds meant for 1000 Hz came at {rate_hz:.1} Hz");
    Ok(())
}
