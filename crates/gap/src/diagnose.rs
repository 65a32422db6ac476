//! The whole diagnosis of a session.

use crate::attribute::{self, Chosen, Subsets};
use crate::bootstrap::Bootstrap;
use crate::candidates::{Candidates, Choice, Training, sum_of_difference};
use crate::diagnosis::{Diagnosis, NotTestable};
use crate::effects::CATALOGUE;
use crate::folds;
use crate::library::{Library, TermId};
use crate::location;
use crate::measure::Measure;
use crate::refine::refine;
use crate::select::Search;
use crate::session::Session;
use crate::words;
use std::collections::BTreeSet;

/// A fold's choice gives way to that of all data if this explains at least so much of what it does on the fold's own training data.
const ALIKE: f64 = 0.97;

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
    let mut trainings = Vec::new();
    for fold in outer {
        let training = folds::training(&session.hold_out, &fold.fit, floor_of(session, &fold.fit));
        let (choice, terms) = select(&mut library, &candidates, &training, &bootstrap);
        if !session.hold_out.reserved.is_empty() {
            main = Some((training, choice));
            chosen.push(Chosen { fold, terms });
            step();
            continue;
        }
        chosen.push(Chosen { fold, terms });
        trainings.push((training, choice));
        step();
    }
    let (training, main) = main.unwrap_or_else(|| {
        let all: Vec<usize> = (0..session.blocks()).collect();
        let training = folds::training(&session.hold_out, &all, floor_of(session, &all));
        let choice = select(&mut library, &candidates, &training, &bootstrap).0;
        (training, choice)
    });
    step();
    for (part, (training, own)) in chosen.iter_mut().zip(&trainings) {
        let mut search =
            Search { library: &mut library, candidates: &candidates, training, bootstrap: &bootstrap };
        let nothing = search.choice(Vec::new());
        let same = search.choice(main.terms.clone());
        // Where effects look alike, chance must not name another one in every part of the data.
        if sum_of_difference(&nothing, &same) >= ALIKE * sum_of_difference(&nothing, own) {
            part.terms.clone_from(&main.terms);
        }
    }
    add_events(&library, &main, &mut chosen);
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
    let located = location::locate(search.library, &chosen);
    let measure = Measure::new(search.library, &subsets, &chosen, &located.floors, &bootstrap);
    let mut findings = Vec::with_capacity(effects.len());
    for (bit, &effect) in effects.iter().enumerate() {
        let rivals = attribute::rivals(&mut search, &main, effect);
        let mut finding = attribute::describe(search.library, &main.terms, effect, &training.blocks);
        let value = subsets.shapley(bit);
        (finding.share, finding.share_ci95) = measure.share(&value);
        finding.confidence = rivals.confidence;
        finding.indistinguishable_from =
            rivals.indistinguishable.iter().map(|rival| CATALOGUE[*rival].id().to_owned()).collect();
        finding.words = words::of_finding(&finding, effect);
        findings.push(finding);
    }
    findings.sort_by(|a, b| b.share.total_cmp(&a.share));
    step();
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
    let terms = refine(library, candidates, &choice.terms, 0, &training.blocks);
    choice.terms.clone_from(&terms);
    (choice, terms)
}

/// What exists in one unit only cannot be chosen where that unit is left out: there it is taken from the choice on everything,
/// and its size from the unit's even seconds.
fn add_events(library: &Library<'_>, main: &Choice, chosen: &mut [Chosen]) {
    let units = &library.session.hold_out.unit_of_block;
    for part in chosen {
        let left_out: BTreeSet<usize> = part.fold.score.iter().map(|block| units[*block]).collect();
        for id in &main.terms {
            let term = &library.terms[*id];
            let mut own = term.columns.iter().filter_map(|column| column.unit_only);
            let site = |other: &TermId| {
                let other = &library.terms[*other];
                (other.effect, other.place) == (term.effect, term.place)
            };
            if own.any(|unit| left_out.contains(&unit)) && !part.terms.iter().any(site) {
                part.terms.push(*id);
            }
        }
    }
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
    missing.collect()
}
