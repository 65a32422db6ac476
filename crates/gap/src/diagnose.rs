//! The whole diagnosis of a session.

use crate::attribute::{self, Chosen, Subsets};
use crate::bootstrap::Bootstrap;
use crate::candidates::{Candidates, Choice, Training};
use crate::diagnosis::{Diagnosis, Gap, NotTestable, Verdict};
use crate::effects::{CATALOGUE, OUT_OF_REACH};
use crate::folds;
use crate::library::{Library, TermId};
use crate::location;
use crate::refine::refine;
use crate::select::Search;
use crate::session::Session;
use crate::words;

/// After at most so many floors, or with this shrink, a gap is explained.
const NEAR_FLOOR: f64 = 1.15;
const EXPLAINED: f64 = 0.9;
const PARTLY: f64 = 0.3;

/// Where a session's gap lies, which effects cause it, and how far it shrinks on what was left out.
///
/// `tell(done, of)` is called now and then.
#[must_use]
pub fn diagnose(session: &Session, mut tell: impl FnMut(u64, u64)) -> Diagnosis {
    let outer = folds::outer(&session.hold_out);
    let steps = (CATALOGUE.len() + outer.len() + 3) as u64;
    let mut library = Library::new(session);
    let candidates = Candidates::all(&mut library, |effect| tell(effect as u64, steps));
    let bootstrap = Bootstrap::new(session.blocks());
    let mut done = CATALOGUE.len() as u64;
    let mut step = || {
        done += 1;
        tell(done, steps);
    };
    let mut chosen = Vec::with_capacity(outer.len());
    let mut main = None;
    for fold in outer {
        let training = folds::training(&session.hold_out, &fold.fit, floor_of(session, &fold.fit));
        let (choice, terms) = select(&mut library, &candidates, &training, &bootstrap);
        if !session.hold_out.reserved.is_empty() {
            main = Some((training, choice));
        }
        chosen.push(Chosen { fold, terms });
        step();
    }
    let (training, main) = main.unwrap_or_else(|| {
        let all: Vec<usize> = (0..session.blocks()).collect();
        let training = folds::training(&session.hold_out, &all, floor_of(session, &all));
        let choice = select(&mut library, &candidates, &training, &bootstrap).0;
        (training, choice)
    });
    step();
    let mut effects = attribute::established(&library, &main, &chosen);
    let mut notes = session.notes.clone();
    let subsets = loop {
        chosen
            .iter_mut()
            .for_each(|part| part.terms.retain(|id| effects.contains(&library.terms[*id].effect)));
        let subsets = Subsets::new(&library, &chosen, &effects);
        let Some(bit) = subsets.failing() else { break subsets };
        let id = CATALOGUE[effects.remove(bit)].id();
        notes.push(format!("{id} seemed to help on what was fitted, but did not on what was left out"));
    };
    let mut search =
        Search { library: &mut library, candidates: &candidates, training: &training, bootstrap: &bootstrap };
    let kept =
        main.terms.iter().copied().filter(|id| effects.contains(&search.library.terms[*id].effect)).collect();
    let main = search.choice(kept);
    let scored: Vec<usize> = chosen.iter().flat_map(|part| part.fold.score.clone()).collect();
    let measure = Measure::new(session, &subsets, &scored, &bootstrap);
    let mut findings = Vec::with_capacity(effects.len());
    for (bit, &effect) in effects.iter().enumerate() {
        let rivals = attribute::rivals(&mut search, &main, effect);
        let mut finding = attribute::describe(search.library, &main.terms, effect, &training.blocks);
        let value = subsets.shapley(bit);
        finding.share = value.iter().sum::<f64>() / measure.reducible().max(f64::MIN_POSITIVE);
        finding.share_ci95 = attribute::interval(&bootstrap, &value, &measure.reducible_blocks);
        finding.confidence = rivals.confidence;
        finding.indistinguishable_from =
            rivals.indistinguishable.iter().map(|rival| CATALOGUE[*rival].id().to_owned()).collect();
        finding.words = words::of_finding(&finding, effect);
        findings.push(finding);
    }
    findings.sort_by(|a, b| b.share.total_cmp(&a.share));
    step();
    let located = location::locate(search.library, &chosen);
    let verdict = measure.verdict();
    notes.extend(measure.note());
    Diagnosis {
        format: 1,
        verdict,
        next_experiment: words::next_experiment(session, verdict, &findings, &not_testable(session)),
        not_testable: not_testable(session),
        gap: measure.gap(located.raw),
        findings,
        location: located.location,
        hold_out: session.hold_out.words.clone(),
        notes,
    }
}

/// Chooses on a training set; also the chosen terms with their continuous parameters at their best.
fn select(
    library: &mut Library<'_>,
    candidates: &Candidates,
    training: &Training,
    bootstrap: &Bootstrap,
) -> (Choice, Vec<TermId>) {
    let mut search = Search { library, candidates, training, bootstrap };
    let mut choice = search.run();
    let terms = refine(library, candidates, &choice.terms, &training.blocks);
    choice.terms.clone_from(&terms);
    (choice, terms)
}

/// Squared residual that noise leaves on these blocks.
fn floor_of(session: &Session, blocks: &[usize]) -> f64 {
    let floors: f64 = session.channels.iter().map(|channel| channel.floor.powi(2)).sum();
    let rows = session.hold_out.block_of_row.iter().filter(|block| blocks.contains(block)).count();
    floors * rows as f64
}

fn not_testable(session: &Session) -> Vec<NotTestable> {
    let missing = CATALOGUE.iter().filter_map(|effect| {
        effect.missing(session).map(|missing| NotTestable { effect: effect.id().to_owned(), missing })
    });
    let beyond = OUT_OF_REACH.iter().map(|(effect, missing)| NotTestable {
        effect: (*effect).to_owned(),
        missing: (*missing).to_owned(),
    });
    missing.chain(beyond).collect()
}

/// The gap on scored blocks, in sums of squares.
struct Measure<'a> {
    before: Vec<f64>,
    after: Vec<f64>,
    reducible_blocks: Vec<f64>,
    values: Vec<f64>,
    floor: f64,
    bootstrap: &'a Bootstrap,
}

impl<'a> Measure<'a> {
    fn new(session: &Session, subsets: &Subsets, scored: &[usize], bootstrap: &'a Bootstrap) -> Self {
        let channels = session.channels.len().max(1) as f64;
        let floor = session.channels.iter().map(|channel| channel.floor.powi(2)).sum::<f64>() / channels;
        let mut values = vec![0.0; session.blocks()];
        for block in session.hold_out.block_of_row.iter().filter(|block| scored.contains(block)) {
            values[*block] += channels;
        }
        let reducible_blocks = subsets.before().iter().zip(&values).map(|(b, n)| b - floor * n).collect();
        Self {
            before: subsets.before().to_vec(),
            after: subsets.after().to_vec(),
            reducible_blocks,
            values,
            floor,
            bootstrap,
        }
    }

    fn reducible(&self) -> f64 {
        self.reducible_blocks.iter().sum()
    }

    fn rms(&self, squares: &[f64]) -> f64 {
        (squares.iter().sum::<f64>() / self.values.iter().sum::<f64>().max(1.0)).sqrt()
    }

    fn removed(&self) -> Vec<f64> {
        self.before.iter().zip(&self.after).map(|(b, a)| b - a).collect()
    }

    /// Nothing beyond noise: the interval of the gap reaches down to the floor. A gap of exactly nothing is none either.
    fn is_noise(&self) -> bool {
        let lowest = attribute::interval(self.bootstrap, &self.before, &self.values)[0];
        lowest <= self.floor || self.before.iter().all(|b| *b == 0.0)
    }

    fn shrink(&self) -> Option<f64> {
        (!self.is_noise() && self.reducible() > 0.0)
            .then(|| self.removed().iter().sum::<f64>() / self.reducible())
    }

    fn verdict(&self) -> Verdict {
        let Some(shrink) = self.shrink() else { return Verdict::NoGap };
        if shrink >= EXPLAINED
            || (self.floor > 0.0 && self.rms(&self.after) <= NEAR_FLOOR * self.floor.sqrt())
        {
            Verdict::Explained
        } else if shrink >= PARTLY {
            Verdict::PartlyExplained
        } else {
            Verdict::Unexplained
        }
    }

    fn gap(&self, raw: crate::diagnosis::Raw) -> Gap {
        Gap {
            before: self.rms(&self.before),
            after: self.rms(&self.after),
            floor: self.floor.sqrt(),
            shrink: self.shrink(),
            shrink_ci95: self
                .shrink()
                .map(|_| attribute::interval(self.bootstrap, &self.removed(), &self.reducible_blocks)),
            raw,
        }
    }

    fn note(&self) -> Option<String> {
        (self.floor == 0.0).then(|| {
            "how much of the gap is noise is not known: give `noise` for each [[channel]], or record a repeat".to_owned()
        })
    }
}
