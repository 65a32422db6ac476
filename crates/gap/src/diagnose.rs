//! The whole diagnosis of a session.

use crate::attribute::{self, Chosen};
use crate::bootstrap::Bootstrap;
use crate::candidates::{Candidates, Choice, Training};
use crate::diagnosis::{Diagnosis, Finding, NotTestable};
use crate::effects::{CATALOGUE, Place, by_id};
use crate::establish::{Ground, Kept, add_events};
use crate::folds;
use crate::generic::Generic;
use crate::library::{Library, Term, TermId};
use crate::location::{self, Located};
use crate::loops;
use crate::measure::Measure;
use crate::refine::refine;
use crate::select::Search;
use crate::session::Session;
use crate::steadiness;
use crate::words;
use std::collections::BTreeSet;

/// Where a session's gap lies, which effects cause it, and how far it shrinks on what was left out.
///
/// `tell(done, of)` is called now and then.
#[must_use]
pub fn diagnose(session: &Session, tell: impl FnMut(u64, u64)) -> Diagnosis {
    diagnose_without(session, &[], tell)
}

/// The same with these effects taken out of the catalogue: what is said of a cause that it does not know.
#[must_use]
pub fn diagnose_without(session: &Session, without: &[&str], mut tell: impl FnMut(u64, u64)) -> Diagnosis {
    let without: Vec<usize> = without.iter().filter_map(|id| by_id(id)).collect();
    let outer = folds::outer(&session.hold_out);
    let steps = (CATALOGUE.len() + outer.len() + 3) as u64;
    let mut library = Library::new(session);
    let candidates = Candidates::all(&mut library, &without, |effect| tell(effect as u64, steps));
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
        let found: Vec<_> = chosen.iter().flat_map(|part: &Chosen| part.terms.iter().copied()).collect();
        library.make_room(&found);
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
    let own_effects: Vec<BTreeSet<usize>> =
        chosen.iter().map(|part| part.terms.iter().map(|id| library.terms[*id].effect).collect()).collect();
    for (part, (training, own)) in chosen.iter_mut().zip(&trainings) {
        let mut search =
            Search { library: &mut library, candidates: &candidates, training, bootstrap: &bootstrap };
        part.terms = search.told_by(own, &main.terms).terms;
    }
    add_events(&mut library, &main, &mut chosen);
    let mut kept = Kept { terms: main.terms, effects: Vec::new(), notes: session.notes.clone() };
    let generic = Generic::new(session);
    let trainings: Vec<&Training> = trainings.iter().map(|(training, _)| training).collect();
    let ground = Ground {
        candidates: &candidates,
        bootstrap: &bootstrap,
        training: &training,
        trainings: &trainings,
        generic: generic.as_ref(),
    };
    loop {
        let subsets = kept.establish(&mut library, &mut chosen, &ground);
        let mut search = Search {
            library: &mut library,
            candidates: &candidates,
            training: &training,
            bootstrap: &bootstrap,
        };
        let main = search.choice(kept.terms.clone());
        let mut located = location::locate(search.library, &chosen);
        let measure = Measure::new(search.library, &subsets, &chosen, &located.floors, &bootstrap);
        let mut findings = Vec::with_capacity(kept.effects.len());
        for (bit, &effect) in kept.effects.iter().enumerate() {
            let mut finding = finding(&mut search, &main, effect, &located, &ground);
            (finding.share, finding.share_ci95) = measure.share(&subsets.shapley(bit));
            finding.evidence.chosen = often(&own_effects, effect);
            finding.words = words::of_finding(&finding, effect, place(search.library, &main, effect));
            findings.push(finding);
        }
        let least = if measure.surely_shrinks() { POSSIBLE } else { LIKELY };
        if let Some(bit) = least_likely(&findings, least) {
            kept.leave_out(&library, &mut chosen, bit);
            continue;
        }
        findings.sort_by(|a, b| b.share.total_cmp(&a.share));
        located.location.loops = loops::of(session, &findings, &located.left);
        step();
        let verdict = measure.verdict();
        kept.notes.extend(measure.note());
        return Diagnosis {
            format: 1,
            verdict,
            next_experiment: words::next_experiment(session, verdict, &findings, &not_testable(session)),
            not_testable: not_testable(session),
            gap: measure.gap(located.raw),
            findings,
            location: located.location,
            hold_out: session.hold_out.words.clone(),
            notes: kept.notes,
        };
    }
}

/// A finding rather wrong than right goes where the shrink as a whole is not certain.
const LIKELY: f64 = 0.5;

/// One that is wrong forty-nine times of fifty goes in any case.
const POSSIBLE: f64 = 0.02;

/// The finding that is least likely right, if that is less likely than this.
fn least_likely(findings: &[Finding], likely: f64) -> Option<usize> {
    let least =
        (0..findings.len()).min_by(|a, b| findings[*a].confidence.total_cmp(&findings[*b].confidence))?;
    (findings[least].confidence < likely).then_some(least)
}

/// What was found of one effect; its share and words are still to be told.
fn finding(
    search: &mut Search<'_, '_, '_>,
    main: &Choice,
    effect: usize,
    located: &Located,
    ground: &Ground<'_>,
) -> Finding {
    let rivals = attribute::rivals(search, main, effect);
    let mut finding = attribute::describe(search.library, &main.terms, effect, &ground.training.blocks);
    let terms = &search.library.terms;
    let own = || main.terms.iter().map(|id| &terms[*id]).filter(|term| term.effect == effect);
    let channels: BTreeSet<usize> = own().flat_map(|term| term.channels.clone()).collect();
    let is_event = own().any(Term::is_event);
    finding.evidence = rivals.evidence;
    finding.evidence.see(&located.location.sensors, &channels);
    if let Some(generic) = ground.generic {
        let channels: Vec<usize> = channels.into_iter().collect();
        let session = search.library.session;
        let lead = generic.lead(session, &channels, &located.left, ground.bootstrap, is_event);
        finding.evidence.generic = lead.weight();
    }
    let blocks = &ground.training.blocks;
    finding.evidence.unsteady =
        steadiness::unsteady(search.library, &main.terms, effect, blocks, ground.bootstrap);
    finding.confidence = finding.evidence.confidence();
    finding.indistinguishable_from =
        rivals.indistinguishable.iter().map(|rival| CATALOGUE[*rival].id().to_owned()).collect();
    attribute::order(&mut finding.sensors, &located.location.sensors);
    finding
}

/// Where the first of an effect's terms sits.
fn place(library: &Library<'_>, main: &Choice, effect: usize) -> Place {
    let mut terms = main.terms.iter().map(|id| &library.terms[*id]);
    terms.find(|term| term.effect == effect).map_or(Place::Base, |term| term.place)
}

/// Share of these choices that hold an effect.
fn often(choices: &[BTreeSet<usize>], effect: usize) -> f64 {
    choices.iter().filter(|own| own.contains(&effect)).count() as f64 / choices.len().max(1) as f64
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

#[cfg(test)]
mod tests {
    use super::*;

    fn with_confidences(confidences: &[f64]) -> Vec<Finding> {
        confidences
            .iter()
            .map(|confidence| Finding { confidence: *confidence, ..Finding::default() })
            .collect()
    }

    #[test]
    fn the_least_likely_finding_goes_if_it_is_rather_wrong_than_right() {
        assert_eq!(least_likely(&with_confidences(&[0.9, 0.3, 0.45]), LIKELY), Some(1));
        assert_eq!(least_likely(&with_confidences(&[0.9, 0.5, 0.6]), LIKELY), None);
        assert_eq!(least_likely(&with_confidences(&[0.9, 0.3, 0.01]), POSSIBLE), Some(2));
        assert_eq!(least_likely(&with_confidences(&[0.9, 0.3, 0.03]), POSSIBLE), None);
        assert_eq!(least_likely(&[], LIKELY), None);
    }
}
