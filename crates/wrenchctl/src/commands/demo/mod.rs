//! `wrenchctl demo`: simulated arm, bus and daemon on this machine; live wrench beside the truth.
//!
//! ```text
//! gauges drawn by seed -> calibration recording in memory -> model            (learn)
//! simulated boards -> in-process bus -> the daemon's own cycle -> records     (live)
//! records beside the truth -> table, verdict                                  (view, score)
//! ```

mod arm;
mod learn;
mod live;
mod nominal;
mod score;
mod view;

use std::collections::VecDeque;
use std::io::Write;
use std::path::PathBuf;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use can::source::Event;
use model::spatial::Wrench;
use nalgebra::Vector6;
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use rig::Rig;
use sim::motion::{MotionLimits, SPEED_SHARE};
use sim::push::Push;
use sim::{Options, Scenario, SimError, Simulator, Trajectory, Truth};
use wrenchd::published::Published;
use wrenchd::station::Clock;

use crate::{Error, Outcome, output};
use live::{LEAD_NS, Live, SystemClock};
use nominal::Nominal;
use score::{LEAST_VALID, LIMIT_SIGMA, Score, Verdict};
use view::{Shown, View};

/// Largest drawn pitch of a gauge, m.
const PITCH_M: f64 = 0.002;
/// Share of the joints' ranges in which the arm moves.
const POSE_SHARE: f64 = 0.6;
/// Largest force, N, and moment, Nm, of the simulated contact.
const PUSH: (f64, f64) = (5.0, 0.5);
/// How long the arm holds still between two moves, and the contact takes from one wrench to the next, s.
const HOLD_S: f64 = 1.5;
const PUSH_EVERY_S: f64 = 2.0;
/// The filters settle during the first of it, s.
const SETTLE_S: f64 = 1.0;
/// What is shown first, s.
const FIRST_LOOK_S: f64 = 0.5;
/// Between two looks at the records, and two estimates with the gauges taken at face value.
const LOOK: Duration = Duration::from_millis(10);
const NOMINAL_EVERY: Duration = Duration::from_millis(50);

/// What to show.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// How long the live part takes, s
    #[arg(long, value_name = "N", default_value = "60", value_parser = super::seconds)]
    pub seconds: Duration,
    /// Seed of gauges, poses, pushes and noise
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
    /// Configuration of another robot [default: the example arm, built in]
    #[arg(long, value_name = "CONFIG")]
    pub config: Option<PathBuf>,
}

/// Calibrates the simulated arm, runs it live, and judges the last ten seconds.
pub fn run(args: Args) -> Result<Outcome, Error> {
    let rig = arm::rig(args.config.as_deref())?;
    let truth = Truth::draw(&rig, args.seed, PITCH_M);
    let mut out = output::stdout();
    let model = learn::calibrate(&rig, &truth, args.seed, &mut out)?;
    let clock = SystemClock::new();
    let start_ns = clock.now().realtime_ns + LEAD_NS;
    let simulator = simulator(&rig, truth, &args, start_ns)?;
    writeln!(
        out,
        "live: {} gauges and {} joints at {:.0} Hz over an in-process bus, wrenches at {:.0} Hz",
        rig.sections.len(),
        rig.chain.coordinates(),
        simulator.rate_hz(),
        rig.config.publish.rate_hz
    )?;
    out.flush()?;
    let live = Live::start(&rig, &model, simulator, clock)?;
    let mut watch =
        Watch { live, nominal: Nominal::new(&rig, &model)?, score: Score::default(), start_ns, round: None };
    let followed = watch.follow(&rig, args.seconds, clock, &mut out);
    watch.live.stop()?;
    let whole = followed?;
    let verdict = watch.score.verdict();
    tell(&verdict, &mut out)?;
    if !whole {
        output::note(format_args!("interrupted: this is no verdict on the whole"));
    }
    Ok(if whole && verdict.agrees() { Outcome::Done } else { Outcome::No })
}

/// The arm in motion under a changing push, at the published rate where the bus can carry it.
fn simulator(rig: &Rig, truth: Truth, args: &Args, start_ns: i64) -> Result<Simulator, Error> {
    let scenario = scenario(rig, args)?;
    let at = |rate_hz| Options { seed: args.seed.wrapping_add(1), rate_hz, start_ns, ..Options::default() };
    let rate_hz = Some(rig.config.publish.rate_hz);
    match Simulator::new(rig, truth.clone(), &scenario, at(rate_hz)) {
        Err(SimError::Signal { what, problem }) => {
            let slower = Simulator::new(rig, truth, &scenario, at(None))?;
            output::note(format_args!("{what}: {problem}; simulated at {} Hz instead", slower.rate_hz()));
            Ok(slower)
        }
        simulator => Ok(simulator?),
    }
}

fn scenario(rig: &Rig, args: &Args) -> Result<Scenario, Error> {
    let limits = MotionLimits::of(&rig.chain)?;
    let mut rng = StdRng::seed_from_u64(args.seed);
    let pose = |rng: &mut StdRng| -> Vec<f64> {
        let middle = limits.middle();
        let joints = limits.joints.iter().zip(middle);
        let half = |joint: &sim::motion::JointLimits| (joint.upper_rad - joint.lower_rad) / 2.0 * POSE_SHARE;
        joints.map(|(joint, middle)| middle + half(joint) * rng.random_range(-1.0..=1.0)).collect()
    };
    // Beyond the end, so that frames come until the last moment.
    let duration_s = args.seconds.as_secs_f64() + 5.0;
    let mut trajectory = Trajectory::from_pose(pose(&mut rng));
    while trajectory.duration_s() < duration_s {
        trajectory.hold(HOLD_S);
        trajectory.move_to(pose(&mut rng), &limits, SPEED_SHARE);
    }
    let mut push = Push::none();
    push.knot(0.0, Wrench::zero());
    let mut t_s = SETTLE_S;
    while t_s < trajectory.duration_s() {
        push.knot(t_s, random_wrench(&mut rng));
        t_s += PUSH_EVERY_S;
    }
    let mut scenario = Scenario::of_motion(trajectory);
    scenario.push = push;
    Ok(scenario)
}

fn random_wrench(rng: &mut StdRng) -> Wrench<model::spatial::Tip> {
    let components = [PUSH.0, PUSH.0, PUSH.0, PUSH.1, PUSH.1, PUSH.1];
    Wrench::from_vector(&Vector6::from(components.map(|largest| rng.random_range(-largest..=largest))))
}

/// What is seen of the live part.
struct Watch {
    live: Live,
    nominal: Nominal,
    score: Score,
    start_ns: i64,
    /// Round of the last instant that was scored: a fixed grid publishes some twice
    round: Option<u64>,
}

impl Watch {
    /// Looks and shows until the time is over; false where Ctrl-C came first.
    fn follow(
        &mut self,
        rig: &Rig,
        length: Duration,
        clock: SystemClock,
        out: &mut impl Write,
    ) -> Result<bool, Error> {
        let interrupted = crate::live::interrupted();
        let names = rig.config.sensors.iter().map(|sensor| sensor.name.clone()).collect();
        let mut view = View::new(names);
        let mut published = VecDeque::from([(self.elapsed_s(clock), self.live.totals().published)]);
        let (mut show_at_s, mut nominal_at) = (FIRST_LOOK_S, Instant::now());
        let mut nominal = None;
        loop {
            let elapsed_s = self.elapsed_s(clock);
            if interrupted.load(Ordering::Relaxed) || self.live.has_ended() {
                return Ok(false);
            }
            if elapsed_s >= length.as_secs_f64() {
                return Ok(true);
            }
            std::thread::sleep(LOOK);
            let newest = self.look();
            if nominal_at.elapsed() >= NOMINAL_EVERY {
                nominal_at = Instant::now();
                nominal = self.look_at_face_value();
            }
            let Some(record) = newest.filter(|_| elapsed_s >= show_at_s) else { continue };
            show_at_s = elapsed_s + view.period_s();
            let totals = self.live.totals();
            published.push_back((elapsed_s, totals.published));
            while published.len() > 2 && published[1].0 < elapsed_s - 1.0 {
                published.pop_front();
            }
            let (since_s, before) = published[0];
            let truth = self.truth(record.instant_ns);
            let shown = Shown {
                elapsed_s,
                of_s: length.as_secs_f64(),
                record: &record,
                truth,
                nominal,
                snapshot: self.nominal.snapshot(),
                rate_hz: (totals.published - before) as f64 / (elapsed_s - since_s).max(1e-3),
                totals,
            };
            view.show(&shown, out)?;
        }
    }

    /// Since the simulated beginning, s.
    fn elapsed_s(&self, clock: SystemClock) -> f64 {
        (clock.now().realtime_ns - self.start_ns) as f64 * 1e-9
    }

    /// Takes in what was published and received since the last look; the newest record.
    fn look(&mut self) -> Option<Published> {
        while let Some(event) = self.live.frames.next_copy() {
            if let Event::Frame(stamped) = &event {
                self.nominal.push(stamped);
            }
        }
        let mut newest = None;
        while let Some(record) = self.live.records.next_record() {
            newest = Some(record);
            if record.published_ns < self.start_ns + (SETTLE_S * 1e9) as i64 {
                continue;
            }
            self.score.record(record.published_ns, record.is_valid());
            if self.round == Some(record.round) {
                continue;
            }
            self.round = Some(record.round);
            if let (Some(estimate), Some(sigma)) = view::parts(&record) {
                let error = estimate - self.truth(record.instant_ns);
                self.score.error(record.instant_ns, &error, &sigma);
            }
        }
        newest
    }

    /// The wrench if every gauge is taken at face value, N and Nm in E.
    fn look_at_face_value(&mut self) -> Option<Vector6<f64>> {
        let (instant_ns, wrench) = self.nominal.wrench()?;
        let error = wrench.to_vector() - self.truth(instant_ns);
        self.score.nominal_error(instant_ns, &error);
        Some(wrench.to_vector())
    }

    /// The true wrench at an instant, N and Nm in E.
    fn truth(&mut self, instant_ns: i64) -> Vector6<f64> {
        self.live.mechanics.update((instant_ns - self.start_ns) as f64 * 1e-9);
        self.live.mechanics.tip_wrench().to_vector()
    }
}

fn tell(verdict: &Verdict, out: &mut impl Write) -> Result<(), Error> {
    writeln!(
        out,
        "last {:.1} s: {} instants, {:.1} % of the records valid, error RMS {:.4} N and {:.5} Nm",
        verdict.span_s,
        verdict.instants,
        100.0 * verdict.valid,
        verdict.rms.0,
        verdict.rms.1
    )?;
    if let Some((force_n, moment_nm)) = verdict.nominal_rms {
        writeln!(out, "with nominal axes, as if without crosstalk: {force_n:.3} N and {moment_nm:.4} Nm")?;
    }
    let sigmas = verdict.sigmas.map(|sigmas| format!("{sigmas:.2}")).join(" ");
    writeln!(out, "error over sigma, RMS of fx fy fz tx ty tz: {sigmas} (limit {LIMIT_SIGMA})")?;
    let agrees = if verdict.agrees() { "agrees" } else { "DOES NOT AGREE" };
    writeln!(out, "the published wrench {agrees} with the truth")?;
    if verdict.valid < LEAST_VALID {
        let least = 100.0 * LEAST_VALID;
        output::note(format_args!(
            "less than {least} % of the records had a wrench; is the machine too busy? try again"
        ));
    }
    Ok(out.flush()?)
}
