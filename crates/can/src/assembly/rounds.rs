//! Where the boards' cycle is: to which round a frame belongs, and when one ends

use super::order::Order;
use super::stream::Stream;

/// After so many contradictions in a row a learned phase is given up: boards whose clocks drift past each other
pub(super) const MAX_IN_A_ROW: u8 = 3;

/// After so long with nothing but frames at less than half or more than twice the period it is another one, ns
const MAX_UNTYPICAL_NS: i64 = 1_000_000_000;

/// After so many looks in a row at which rounds seemed to begin in the wrong place they begin elsewhere
const MAX_UNFIT: u8 = 3;
/// So many rounds in a row that begin right after the one before and pause within begin in the wrong place
const MAX_SPLIT: u8 = 8;
/// So many rounds at the beginning are looked at more often, and once is enough
const EARLY_ROUNDS: u64 = 32;

/// The boards' cycle as the stamps show it
///
/// A frame lost at a cycle's border must not let the next cycle's frame take its place: that would shift a message by one
/// cycle from then on. So each message's place in the cycle is learned, and a frame is put into the cycle nearest to it.
/// Where stamps scatter by more than an eighth of the cycle (bursts of a USB adapter) this says nothing.
#[derive(Clone, Debug, Default)]
pub(super) struct Rhythm {
    period_ns: Option<f64>,
    jitter_ns: f64,
    /// Since when frames come much sooner or later than a period after the one before
    untypical_since_ns: Option<i64>,
    /// Whether the open round began about a period after the last
    in_time: bool,
    /// Whether any frame of the open round whose cycle was counted came in its place, once there was one; and whether the round before was borne out
    counted_in_place: Option<bool>,
    borne_out_before: bool,
    /// Latest stamp of any message that is waited for
    last_any_ns: Option<i64>,
    /// Start of the round that is open, else of the last one
    origin_ns: Option<i64>,
    /// A period became known and the phases were not looked at since
    pub(super) fresh: bool,
    first_ns: i64,
    last_ns: i64,
    largest_gap_ns: i64,
    /// Stamp of the open round's first frame after its last long pause
    resumed_ns: Option<i64>,
    frames: u32,
    /// Times in a row that rounds seemed to begin in the wrong place
    unfit: u8,
    /// Rounds in a row that only the rhythm ended
    cuts: u8,
    /// Whether the open round began without a pause before it, and rounds in a row that did and paused within
    followed_on: bool,
    split: u8,
    order: Order,
}

impl Rhythm {
    pub(super) fn new(messages: usize) -> Self {
        Self { order: Order::new(messages), ..Self::default() }
    }

    /// Forgets where in the cycle we are, keeps what was learned
    pub(super) fn lose_origin(&mut self) {
        self.origin_ns = None;
        self.last_any_ns = None;
    }

    /// The boards' period, ns
    pub(super) fn period_ns(&self) -> i64 {
        self.period_ns.map_or(0, |period| period as i64)
    }

    /// A quarter of the period, or 1 ms while it is unknown: identical frames closer than this are duplicates
    pub(super) fn duplicate_ns(&self) -> i64 {
        self.period_ns.map_or(1_000_000, |period| (period / 4.0) as i64)
    }

    fn period_if_steady(&self) -> Option<f64> {
        self.period_ns.filter(|period| self.jitter_ns < period / 8.0)
    }

    /// Learns from the time between two arrivals of a message, one round apart
    pub(super) fn observe_interval(&mut self, stream: &Stream, round: u64, stamp_ns: i64) {
        let (Some(last_round), Some(last_ns)) = (stream.last_round, stream.stamp_ns) else { return };
        let interval = (stamp_ns - last_ns) as f64;
        if round != last_round + 1 || interval <= 0.0 {
            return;
        }
        match &mut self.period_ns {
            Some(period) if (*period / 2.0..*period * 2.0).contains(&interval) => {
                self.untypical_since_ns = None;
                *period += (interval - *period) / 16.0;
            }
            // A pause or the burst after it says nothing about the boards, unless it never ends.
            Some(period) => {
                let since_ns = *self.untypical_since_ns.get_or_insert(stamp_ns);
                if stamp_ns - since_ns > MAX_UNTYPICAL_NS {
                    self.untypical_since_ns = None;
                    *period = interval;
                }
            }
            None => {
                self.period_ns = Some(interval);
                self.fresh = true;
            }
        }
    }

    /// Cycles from the round that is open (else the last one) to the one that a frame belongs to; `None`: cannot tell
    pub(super) fn cycles_ahead(&self, stream: &Stream, stamp_ns: i64) -> Option<i64> {
        let period = self.period_if_steady()?;
        let offset = stamp_ns - stream.phase_ns? - self.origin_ns?;
        Some((offset as f64 / period).round() as i64)
    }

    /// Whether the stamps can be believed at present: steady, and the open round (else the last one) began in its time and without a pause
    fn in_step(&self) -> bool {
        self.period_if_steady().is_some() && self.in_time && self.resumed_ns.is_none()
    }

    /// Whether a frame comes where its message is expected in the open round
    pub(super) fn is_in_place(&self, stream: &Stream, stamp_ns: i64) -> bool {
        self.in_step() && self.cycles_ahead(stream, stamp_ns) == Some(0)
    }

    /// Whether it comes there as closely as its message usually does: one that was held back by more than half a cycle is nearer to the next
    /// round's place than to its own, but not in it
    pub(super) fn is_well_in_place(&self, stream: &Stream, stamp_ns: i64) -> bool {
        let place = stream.phase_ns.zip(self.origin_ns).map(|(phase, origin)| phase + origin);
        let near = |place: i64| ((stamp_ns - place).abs() as f64) < self.scatters_up_to_ns();
        self.in_step() && place.is_some_and(near)
    }

    /// A frame whose cycle was counted joins the open round
    pub(super) fn bear_out(&mut self, stream: &Stream, stamp_ns: i64) {
        let in_place = self.is_well_in_place(stream, stamp_ns);
        self.counted_in_place = Some(in_place || self.counted_in_place == Some(true));
    }

    /// Whether the open round is where the boards' cycle is by more than the places of frames that nobody counts: those may all be a cycle late and in
    /// step with each other
    pub(super) fn is_borne_out(&self) -> bool {
        self.counted_in_place.unwrap_or(self.borne_out_before && self.in_time)
    }

    /// Whether a frame follows the last one of its message by less than half a period
    pub(super) fn is_soon(&self, stream: &Stream, stamp_ns: i64) -> bool {
        let since = stream.stamp_ns.map(|last| (stamp_ns - last) as f64);
        since.zip(self.period_if_steady()).is_some_and(|(since, period)| since < 0.5 * period)
    }

    /// Whether a frame that would begin a round can be of none: others usually come before it, and it is in its place in no later cycle. One that
    /// was held back by itself looks so; when the sender pauses the others come with it
    pub(super) fn is_astray(&self, number: usize, streams: &[Stream], stamp_ns: i64) -> bool {
        let (Some(period), Some(phase), Some(origin)) =
            (self.period_if_steady(), streams[number].phase_ns, self.origin_ns)
        else {
            return false;
        };
        let cycles = (stamp_ns - phase - origin) as f64 / period;
        let in_place = cycles > 0.5 && (cycles - cycles.round()).abs() <= 0.25;
        self.in_step() && !in_place && (0..streams.len()).any(|other| self.order.usual(other, number))
    }

    /// Whether a frame comes before its place in the open round, or before others that usually come before it
    pub(super) fn comes_early(&self, number: usize, streams: &[Stream], round: u64, stamp_ns: i64) -> bool {
        let awaited = |other: &Stream| !other.arrived && other.due(round);
        let overtakes =
            || (0..streams.len()).any(|other| self.order.usual(other, number) && awaited(&streams[other]));
        let place = streams[number].phase_ns.zip(self.origin_ns).map(|(phase, origin)| phase + origin);
        let before = |place: i64| ((place - stamp_ns) as f64) > self.scatters_up_to_ns();
        self.in_step() && place.is_some_and(before) || overtakes()
    }

    /// How far frames usually are from their places, ns
    fn scatters_up_to_ns(&self) -> f64 {
        3.0 * self.jitter_ns + self.period_ns.map_or(f64::MAX, |period| period / 100.0)
    }

    /// Whether a frame that came late for the open round belongs to it all the same: it follows those that have come, and is not in
    /// its place in a later cycle either. So the sender paused; frames that are lost leave the others in their places.
    pub(super) fn paused(&self, number: usize, streams: &[Stream], stamp_ns: i64) -> bool {
        let (Some(period), Some(phase), Some(origin)) =
            (self.period_ns, streams[number].phase_ns, self.origin_ns)
        else {
            return false;
        };
        let mut arrived = (0..streams.len()).filter(|other| streams[*other].arrived);
        let follows = arrived.all(|other| self.order.last(other, number));
        let cycles = (stamp_ns - phase - origin) as f64 / period;
        follows && (cycles - cycles.round()).abs() > 0.125
    }

    /// Whether more than a quarter of a cycle passed since the open round's last frame; also while no period is known
    pub(super) fn long_since(&self, stamp_ns: i64) -> bool {
        self.period_ns.is_none_or(|period| (stamp_ns - self.last_ns) as f64 > period / 4.0)
    }

    /// Whether a frame that usually comes before one of the open round's begins the next: it comes long after them, or in a later cycle's
    /// place, or in a burst, in which only the order tells. One that was handed on late with its own stamp comes before them by that
    pub(super) fn begins_anew(&self, number: usize, streams: &[Stream], stamp_ns: i64) -> bool {
        let behind = |other: &Stream| other.arrived && other.stamp_ns <= Some(stamp_ns);
        let mut before = (0..streams.len()).filter(|other| behind(&streams[*other]));
        let later = || self.cycles_ahead(&streams[number], stamp_ns).is_some_and(|ahead| ahead > 0);
        self.period_ns.is_some()
            && (self.long_since(stamp_ns) || self.resumed_ns.is_some() || !self.in_time || later())
            && before.any(|other| self.order.usual(number, other))
    }

    /// The counters say that a cycle is missing: so what came before the open round's pause was of that cycle, and the rest of it
    /// is lost
    pub(super) fn leave_out_what_came_before_the_pause(&self, streams: &mut [Stream], round: u64) {
        let Some(resumed) = self.resumed_ns else { return };
        for stream in streams.iter_mut().filter(|stream| stream.arrived) {
            if stream.stamp_ns.is_some_and(|stamp| stamp < resumed) {
                stream.arrived = false;
                stream.last_round = round.checked_sub(1);
            }
        }
    }

    /// The round was ended by the rhythm alone, or not; always means that the phases are wrong
    pub(super) fn ended(&mut self, by_rhythm: bool, streams: &mut [Stream]) {
        let split = self.followed_on && self.resumed_ns.is_some();
        self.split = if split { self.split.saturating_add(1) } else { 0 };
        self.cuts = if by_rhythm { self.cuts + 1 } else { 0 };
        if self.cuts > MAX_IN_A_ROW {
            self.cuts = 0;
            self.origin_ns = None;
            self.order.forget();
            streams.iter_mut().for_each(|stream| stream.phase_ns = None);
        }
    }

    /// A round begins with this frame
    pub(super) fn open(&mut self, stream: &Stream, stamp_ns: i64) {
        let origin = stamp_ns - stream.phase_ns.unwrap_or(0);
        let since = self.origin_ns.map(|before| (origin - before) as f64);
        self.borne_out_before = self.is_borne_out();
        self.counted_in_place = None;
        self.in_time =
            since.zip(self.period_ns).is_none_or(|(since, period)| 4.0 * (since - period).abs() < period);
        self.followed_on = self.origin_ns.is_some() && !self.long_since(stamp_ns);
        self.origin_ns = Some(origin);
        self.first_ns = stamp_ns;
        self.last_ns = stamp_ns;
        self.largest_gap_ns = 0;
        self.resumed_ns = None;
        self.frames = 0;
    }

    /// A frame takes its place in the open round
    pub(super) fn join(&mut self, number: usize, streams: &mut [Stream], stamp_ns: i64) {
        self.order.observe(number, streams);
        let stream = &mut streams[number];
        stream.arrived = true;
        self.frames += 1;
        if self.period_ns.is_some() && self.long_since(stamp_ns) {
            self.resumed_ns = Some(stamp_ns);
        }
        self.largest_gap_ns = self.largest_gap_ns.max(stamp_ns - self.last_ns);
        self.last_ns = self.last_ns.max(stamp_ns);
        stream.behind = 0;
        let bound = self.scatters_up_to_ns();
        let Some(origin) = self.origin_ns else { return };
        let place = stamp_ns - origin;
        match &mut stream.phase_ns {
            None => stream.phase_ns = Some(place),
            // A pause of the sender, or the burst after it, says nothing about where frames usually are.
            Some(phase) if self.frames > 1 && self.in_time && self.resumed_ns.is_none() => {
                let error = ((place - *phase) as f64).clamp(-bound, bound);
                *phase += (error / 16.0) as i64;
                self.jitter_ns += (error.abs() - self.jitter_ns) / 16.0;
            }
            Some(_) => {}
        }
    }

    /// Whether the round that ends looks like the end of one cycle and the beginning of the next (no period known yet)
    pub(super) fn looks_cut(&self) -> bool {
        let span = self.last_ns - self.first_ns;
        self.period_ns.is_none() && self.frames >= 3 && 5 * self.largest_gap_ns > 3 * span
    }

    /// Whether it is time to look where rounds begin
    pub(super) fn looks(&self, round: u64) -> bool {
        self.fresh || round.is_multiple_of(if round <= EARLY_ROUNDS { 4 } else { 16 })
    }

    /// Learns how long the bus usually pauses before a message, whatever rounds are made of it: a median in steps, which neither
    /// a host that stops nor the burst after it moves far
    pub(super) fn observe_pause(&mut self, stream: &mut Stream, round: u64, stamp_ns: i64) {
        /// Of the logarithm: quick at first, then slowly.
        const STEPS: (f64, f64) = (0.25, 0.05);
        if let Some(last_ns) = self.last_any_ns {
            let pause = (((stamp_ns - last_ns) as f64).max(1e3)).ln();
            stream.pause_ln = Some(match stream.pause_ln {
                Some(usual) => {
                    let step = if round <= EARLY_ROUNDS { STEPS.0 } else { STEPS.1 };
                    usual + (pause - usual).clamp(-step, step)
                }
                None => pause,
            });
        }
        self.last_any_ns = Some(self.last_any_ns.map_or(stamp_ns, |last| last.max(stamp_ns)));
    }

    /// Lets rounds begin with the message before which the bus pauses longest; true if they did not before
    pub(super) fn realign(&mut self, streams: &mut [Stream], round: u64) -> bool {
        let fresh = std::mem::take(&mut self.fresh);
        let Some(period) = self.period_ns else { return false };
        let pauses = |number: usize| streams[number].pause_ln.unwrap_or(f64::NEG_INFINITY);
        let numbers = || 0..streams.len();
        let Some(longest) = numbers().max_by(|&a, &b| pauses(a).total_cmp(&pauses(b))) else { return false };
        let known = numbers().filter(|&number| streams[number].phase_ns.is_some());
        let Some(first) = known.min_by_key(|&number| streams[number].phase_ns) else { return false };
        // A cycle that is full of frames has no pause: then it may begin anywhere, as long as it stays there.
        let begins_there = longest == first || pauses(longest) < pauses(first) + 3f64.ln();
        let fits = pauses(longest) < (period / 4.0).ln() || self.split < MAX_SPLIT && begins_there;
        self.unfit = if fits { 0 } else { self.unfit + 1 };
        // At the beginning at once; later the sender's pauses may make it seem so for a while.
        if fits || !fresh && round > EARLY_ROUNDS && self.unfit < MAX_UNFIT {
            return false;
        }
        self.unfit = 0;
        self.split = 0;
        self.origin_ns = None;
        self.order.forget();
        for (number, stream) in streams.iter_mut().enumerate() {
            stream.phase_ns = (number == longest).then_some(0);
        }
        true
    }
}
