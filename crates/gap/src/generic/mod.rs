//! Models that know no physics, for what they foretell better than the effects that were found: that is not what these say it is.
//!
//! Fitted on even seconds and judged on the odd ones, as events are.

mod smooth;
mod wandering;

use crate::bootstrap::Bootstrap;
use crate::location::Residuals;
use crate::select::WORTH;
use crate::session::Session;

/// Share of what a wandering zero foretells that may be missing from what was found: of an effect on one or two gauges, and of one on
/// more. With more missing it is refuted.
const REFUTES: [f64; 2] = [0.08, 0.15];
/// The same of a smooth function. On many gauges it may foretell another cause, not found, of one of them.
const REFUTES_IN_POSE: [f64; 2] = [0.12, 0.35];
/// So many gauges are few.
const FEW: usize = 2;
/// Share of draws in which that may fail to show.
const DOUBT: f64 = 0.05;
/// Share of it that must differ between two of the same motion: a form that is not quite the catalogue's comes again with the motion.
const WANDERS: f64 = 0.35;

/// Mean square over its noise that a gauge may wander by, or its calibration be off, without a cause of its own: where nothing is put in,
/// models without physics foretell up to so much of single gauges.
const NATURAL: f64 = 0.15;
/// Share of what was found that a model must foretell more with it than without, for that not to be a part of what it foretells.
const BESIDE: f64 = 0.03;

/// What a model leaves on odd seconds of what a channel has per row (both over its scale), fitted on even ones.
type Foretell = fn(&Session, usize, &[Option<f64>]) -> Vec<Option<f64>>;

/// A model without physics.
struct Model {
    foretell: Foretell,
    /// What it leaves of every channel's gap.
    left: Residuals,
    /// Whether it is refuted itself by what comes again with the motion.
    wanders: bool,
    /// Share of what it foretells that may be missing from what was found; with more, that is refuted.
    refutes: [f64; 2],
    words: &'static str,
}

/// All of them.
pub(crate) struct Generic {
    models: Vec<Model>,
}

/// What a model foretells that was not found: the share of all that it foretells, and what it is.
pub(crate) struct Lead {
    pub(crate) share: f64,
    refutes: f64,
    pub(crate) words: &'static str,
}

impl Lead {
    /// What speaks against the finding, over what refutes it.
    pub(crate) fn weight(&self) -> f64 {
        self.share / self.refutes
    }
}

/// What a model foretells better than what was found, in squares on odd seconds.
#[derive(Default)]
struct Ahead {
    /// What it foretells of the gap.
    foretold: f64,
    /// What it leaves less than what was found.
    all: f64,
    /// The same on motions that were made twice, and what of it did not come twice.
    repeated: f64,
    differs: f64,
}

impl Ahead {
    /// Share of what is foretold that was not found; of what wanders, where it comes again with the motion, no more than the part that does
    /// not: what walks is still near itself in a recording soon after, and what a form leaves comes again all but wholly.
    fn share(&self, wanders: bool) -> f64 {
        if self.foretold <= 0.0 {
            return 0.0;
        }
        let share = (self.all / self.foretold).clamp(0.0, 1.0);
        let comes_again = wanders && self.repeated > 0.0 && self.differs < WANDERS * self.repeated;
        if comes_again { share * (self.differs / self.repeated).max(0.0) } else { share }
    }
}

impl Generic {
    /// Of a session with even and odd seconds; none of others.
    pub(crate) fn new(session: &Session) -> Option<Self> {
        if session.hold_out.is_even.is_empty() {
            return None;
        }
        let channels: Vec<usize> = (0..session.channels.len()).collect();
        let found = crate::parallel::map(&channels, |channel| {
            let gap = gap(session, *channel);
            [wandering::of_channel, smooth::of_channel]
                .map(|foretell: Foretell| foretell(session, *channel, &gap))
        });
        let (wandering, smooth) = found.into_iter().map(|[wandering, smooth]| (wandering, smooth)).unzip();
        let models = vec![
            Model {
                foretell: wandering::of_channel,
                left: wandering,
                wanders: true,
                refutes: REFUTES,
                words: "a zero and a scale that wander foretell {} % more of the gap there; something that changes with time in its own way",
            },
            Model {
                foretell: smooth::of_channel,
                left: smooth,
                wanders: false,
                refutes: REFUTES_IN_POSE,
                words: "a smooth function of loads and joint angles foretells {} % more of the gap there; something that goes with load and pose in its own way",
            },
        ];
        Some(Self { models })
    }

    /// The model that foretells most of these channels' gap on left-out odd seconds that was not found, `after` being what was left per row;
    /// a share of 0 where that is not beyond doubt or so little that the calibration's own errors may do it. Of an event nothing comes again.
    pub(crate) fn lead(
        &self,
        session: &Session,
        channels: &[usize],
        after: &Residuals,
        bootstrap: &Bootstrap,
        is_event: bool,
    ) -> Lead {
        let of = |model: &Model| Lead {
            share: model.lead(session, channels, after, bootstrap, is_event),
            refutes: model.refutes[usize::from(channels.len() > FEW)],
            words: model.words,
        };
        let leads = self.models.iter().map(of).max_by(|a, b| a.weight().total_cmp(&b.weight()));
        leads.unwrap_or(Lead { share: 0.0, refutes: REFUTES[0], words: "" })
    }
}

/// A channel's gap per row over its scale, where it has a reading.
fn gap(session: &Session, channel: usize) -> Vec<Option<f64>> {
    let own = &session.channels[channel];
    (0..session.rows()).map(|row| own.is_read(row).then(|| own.gap[row] / own.scale)).collect()
}

impl Model {
    fn lead(
        &self,
        session: &Session,
        channels: &[usize],
        after: &Residuals,
        bootstrap: &Bootstrap,
        is_event: bool,
    ) -> f64 {
        let mut by_block = vec![0.0; session.blocks()];
        let mut ahead = Ahead::default();
        let mut most = 0.0_f64;
        for &channel in channels {
            let known = ahead.all;
            self.add(session, channel, &after[channel], &mut ahead, &mut by_block);
            most = most.max(ahead.all - known);
        }
        let hold_out = &session.hold_out;
        let odd = hold_out.block_of_row.iter().filter(|block| !hold_out.is_even(**block)).count() as f64;
        let is_worth = ahead.all > WORTH * odd * channels.len() as f64 && most > NATURAL * odd;
        let is_sure = is_worth && bootstrap.quantile_of_sum(&by_block, DOUBT) > 0.0;
        let is_refuted = is_sure && !self.needs(session, channels, after, bootstrap);
        if is_refuted { ahead.share(self.wanders && !is_event) } else { 0.0 }
    }

    /// Whether the model foretells beyond doubt more of these channels with what was found than without: then that is no part of
    /// what it foretells, but beside it.
    fn needs(&self, session: &Session, channels: &[usize], after: &Residuals, bootstrap: &Bootstrap) -> bool {
        let mut by_block = vec![0.0; session.blocks()];
        let (mut more, mut found) = (0.0, 0.0);
        for &channel in channels {
            let beside = (self.foretell)(session, channel, &after[channel]);
            let gap = gap(session, channel);
            for row in 0..session.rows() {
                let squares = [gap[row], after[channel][row], self.left[channel][row], beside[row]];
                let [Some(gap), Some(after), Some(alone), Some(beside)] =
                    squares.map(|value| value.map(|v| v * v))
                else {
                    continue;
                };
                by_block[session.hold_out.block_of_row[row]] += alone - beside;
                more += alone - beside;
                found += gap - after;
            }
        }
        more > BESIDE * found && bootstrap.quantile_of_sum(&by_block, DOUBT) > 0.0
    }

    fn add(
        &self,
        session: &Session,
        channel: usize,
        after: &[Option<f64>],
        ahead: &mut Ahead,
        by_block: &mut [f64],
    ) {
        let own = &session.channels[channel];
        let left = |row: usize| Some([after[row]?, self.left[channel][row]?]);
        for row in 0..session.rows() {
            let Some([after, foretold]) = left(row) else { continue };
            let more = after * after - foretold * foretold;
            by_block[session.hold_out.block_of_row[row]] += more;
            ahead.all += more;
            ahead.foretold += (own.gap[row] / own.scale).powi(2) - foretold * foretold;
        }
        for (first, second) in session.repeats.iter().flat_map(|(a, b)| a.clone().zip(b.clone())) {
            let (Some(first), Some(second)) = (left(first), left(second)) else { continue };
            let [sum, difference] = [1.0, -1.0].map(|sign| {
                let [after, foretold] = [0, 1].map(|k| first[k] + sign * second[k]);
                0.5 * (after * after - foretold * foretold)
            });
            ahead.repeated += sum + difference;
            // Half of what differs by itself is in the sum, half in the difference.
            ahead.differs += 2.0 * difference;
        }
    }
}
