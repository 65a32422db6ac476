//! Which effects, and where: forward steps with a search of shapes, swaps of effects, then backward steps, all scored on what
//! was left out.
//!
//! A forward step takes one (effect, place), or an effect at all places where it helps at once. It must lower the squared
//! residual of left-out folds by a practical minimum, beyond what drawing blocks anew explains, and in most folds. Where
//! several are as good within that, the one with the fewest parameters is taken.

use std::collections::{BTreeMap, BTreeSet};

use crate::attribute::Chosen;
use crate::bootstrap::Bootstrap;
use crate::candidates::{Candidates, Choice, Training, differences, sum_of_difference, without};
use crate::doubt::exceeds;
use crate::effects::Place;
use crate::fit::{Design, Fold};
use crate::library::{Library, Term, TermId};
use crate::refine::refine;
use crate::remainder::is_remainder;
use crate::screen::Screen;
use crate::shapes::{EQUALLY_GOOD, Found, best_shape};

/// Share of the reducible gap that a further effect must explain, and a further place of one already found.
const LEAST_SHARE: f64 = 0.01;
const LEAST_SHARE_OF_PLACE: f64 = 0.003;
/// Effects at most.
const MOST_EFFECTS: usize = 6;
/// Steps at most: effects times places.
const MOST_STEPS: usize = 40;
/// Candidates of a step that are fitted and scored after the screening.
const SCORED: usize = 8;
/// Effects that are also tried at several places at once.
const GROUPS: usize = 6;
/// Share of draws in which an improvement may fail to show: of a further effect, and of a further place of one already found.
const DOUBT: f64 = 0.005;
const DOUBT_OF_PLACE: f64 = 0.05;
/// So far apart they may be if drawing blocks anew does not tell them apart.
pub(crate) const UNCLEAR: f64 = 0.2;
const UNCLEAR_AT_THE_END: f64 = 0.05;
/// Effects from which the search begins, each by itself.
const BEGINNINGS: usize = 3;

/// Share of all folds' changes below which a fold's change counts for nothing.
const LEAST_OF_FOLD: f64 = 0.02;

/// Mean square over its noise by which a channel must improve, at most.
pub(crate) const WORTH: f64 = 0.05;

/// Part of [`WORTH`] which makes a finding if it is beyond doubt: what is left of a small effect on other motions is less than all of it.
pub(crate) const LEAST_OF_WORTH: f64 = 0.5;

/// What a step brings.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum News {
    /// An effect not found before.
    Effect,
    /// A further place of an effect already found.
    Place,
}

/// How much a choice may do; the less, the simpler.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Extent {
    freedom: usize,
    channels: usize,
}

/// The search on one training set.
pub(crate) struct Search<'c, 'l, 's> {
    pub(crate) library: &'l mut Library<'s>,
    pub(crate) candidates: &'c Candidates,
    pub(crate) training: &'c Training,
    pub(crate) bootstrap: &'c Bootstrap,
}

impl Search<'_, '_, '_> {
    /// Chooses terms: from each of the best beginnings on, and then the best end.
    pub(crate) fn run(&mut self) -> Choice {
        let nothing = self.choice(Vec::new());
        let reducible = (nothing.residual.iter().sum::<f64>() - self.training.floor).max(0.0);
        let mut ends = Vec::new();
        for beginning in self.steps(&nothing, reducible, BEGINNINGS) {
            let mut choice = self.refined(beginning, 0);
            for _ in 0..MOST_STEPS {
                choice = self.better_shapes(choice);
                let Some(next) = self.steps(&choice, reducible, 1).pop() else { break };
                choice = self.refined(next, choice.terms.len());
            }
            choice = self.swapped(choice, reducible);
            choice = self.moved(choice);
            choice = self.backward(choice, reducible);
            choice = self.without_remainders(choice);
            ends.push((sum_of_difference(&nothing, &choice), self.extent(&choice.terms), choice));
        }
        self.simplest(&ends, UNCLEAR_AT_THE_END).unwrap_or(nothing)
    }

    /// The choice with the continuous parameters of its newest terms at their best: what a coarse shape leaves would else be
    /// taken for further effects.
    pub(crate) fn refined(&mut self, choice: Choice, known: usize) -> Choice {
        let terms = refine(self.library, self.candidates, &choice.terms, known, &self.training.blocks);
        let refined = self.choice(terms);
        if sum_of_difference(&choice, &refined) > 0.0 { refined } else { choice }
    }

    /// The terms with their left-out residuals.
    pub(crate) fn choice(&mut self, terms: Vec<TermId>) -> Choice {
        self.library.prepare(&terms, &terms);
        let residual = Design::new(self.library, &terms).left_out(&self.training.folds);
        Choice { terms, residual }
    }

    pub(crate) fn effects(&self, terms: &[TermId]) -> BTreeSet<usize> {
        terms.iter().map(|id| self.library.terms[*id].effect).collect()
    }

    /// Best shape of every (effect, place) that may be added, with its fall of the squared residual where it is fitted.
    pub(crate) fn screened(&mut self, terms: &[TermId], allowed: impl Fn(usize) -> bool) -> Vec<Found> {
        let taken: BTreeSet<(usize, Place)> = terms.iter().map(|id| self.site(*id)).collect();
        let open: Vec<&[TermId]> = self
            .candidates
            .iter()
            .filter(|(effect, shapes)| allowed(*effect) && !taken.contains(&self.site(shapes[0])))
            .map(|(_, shapes)| shapes)
            .collect();
        let all: Vec<TermId> = open.iter().flat_map(|shapes| shapes.iter().copied()).collect();
        self.library.prepare(&all, terms);
        let screen = Screen::new(self.library, terms, &self.training.blocks);
        let worth = self.worth();
        open.iter().filter_map(|shapes| best_shape(&screen, self.library, shapes, worth)).collect()
    }

    pub(crate) fn site(&self, id: TermId) -> (usize, Place) {
        (self.library.terms[id].effect, self.library.terms[id].place)
    }

    /// How much a choice may do: its parameters, and where these are as many the channels that its events may show on (a push further out
    /// can do what one further in does, and a little of the outer gauges' noise besides).
    fn extent(&self, terms: &[TermId]) -> Extent {
        let terms = || terms.iter().map(|id| &self.library.terms[*id]);
        let events = terms().filter(|term| term.is_event());
        Extent {
            freedom: terms().map(Term::freedom).sum(),
            channels: events.map(|term| term.channels.len()).sum(),
        }
    }

    /// The best ways to go on, one an effect, the best last; none where nothing improves.
    fn steps(&mut self, choice: &Choice, reducible: f64, wanted: usize) -> Vec<Choice> {
        let effects = self.effects(&choice.terms);
        let may_grow = effects.len() < MOST_EFFECTS;
        let mut screened = self.screened(&choice.terms, |effect| may_grow || effects.contains(&effect));
        screened.sort_by(|a, b| b.gain.total_cmp(&a.gain));
        let shapes = |found: &Found| {
            found.simpler.iter().map(|(_, id)| *id).chain([found.id]).map(|id| vec![id]).collect::<Vec<_>>()
        };
        let mut steps: Vec<Vec<TermId>> = screened.iter().take(SCORED).flat_map(shapes).collect();
        steps.extend(self.groups(&screened, reducible));
        let mut scored: BTreeMap<usize, Vec<(f64, Extent, Choice)>> = BTreeMap::new();
        for step in steps {
            let effect = self.library.terms[step[0]].effect;
            let news = if effects.contains(&effect) { News::Place } else { News::Effect };
            let extent = self.extent(&step);
            let next = self.choice(choice.terms.iter().copied().chain(step).collect());
            let improves = self.is_plausible(&next) && self.improves(choice, &next, news, reducible);
            if improves && self.is_beyond_doubt(choice, &next) {
                scored.entry(effect).or_default().push((sum_of_difference(choice, &next), extent, next));
            }
        }
        let mut best: Vec<(f64, Extent, Choice)> = Vec::new();
        for ways in scored.into_values() {
            let Some(simplest) = self.simplest(&ways, UNCLEAR) else { continue };
            best.push((sum_of_difference(choice, &simplest), self.extent(&simplest.terms), simplest));
        }
        if wanted == 1 {
            return self.simplest(&best, UNCLEAR).into_iter().collect();
        }
        best.sort_by(|a, b| a.0.total_cmp(&b.0));
        best.split_off(best.len().saturating_sub(wanted)).into_iter().map(|(_, _, choice)| choice).collect()
    }

    /// The one with the fewest parameters among those (gain, extent, choice) that are as good as the best.
    fn simplest(&self, ways: &[(f64, Extent, Choice)], unclear: f64) -> Option<Choice> {
        let (gain, _, best) = ways.iter().max_by(|a, b| a.0.total_cmp(&b.0))?;
        let as_good =
            |other: &&(f64, Extent, Choice)| self.is_as_good(&other.2, other.0, best, *gain, unclear);
        let simplest = ways.iter().filter(as_good).min_by(|a, b| a.1.cmp(&b.1).then(b.0.total_cmp(&a.0)))?;
        Some(simplest.2.clone())
    }

    /// Whether a choice that gains so much may do as well as the best: what it is behind is little, or drawing blocks anew does not show it.
    pub(crate) fn is_as_good(
        &self,
        other: &Choice,
        gains: f64,
        best: &Choice,
        most: f64,
        unclear: f64,
    ) -> bool {
        let behind = differences(other, best);
        most - gains <= self.equally_good(most)
            || (most - gains <= unclear * most && self.bootstrap.quantile_of_sum(&behind, 0.05) <= 0.0)
    }

    /// By how much one that explains so much may be behind for nothing: a share, but where noise is known never more than is worth a
    /// finding, or of a large gap the wrong cause would do.
    fn equally_good(&self, gain: f64) -> f64 {
        let share = EQUALLY_GOOD * gain;
        if self.library.session.hold_out.is_even.is_empty() { share } else { share.min(self.worth()) }
    }

    /// Whether the parameters that all training blocks ask for are plausible.
    pub(crate) fn is_plausible(&self, choice: &Choice) -> bool {
        let design = Design::new(self.library, &choice.terms);
        design.is_plausible(&design.solve(&self.training.blocks))
    }

    /// Puts another effect in the place of one, where that is better beyond doubt.
    fn swapped(&mut self, mut choice: Choice, reducible: f64) -> Choice {
        for effect in self.effects(&choice.terms) {
            let others = self.replacements(&choice, effect).into_iter().map(|(_, other)| other);
            let better = others
                .filter(|other| {
                    self.is_plausible(other) && self.improves(&choice, other, News::Effect, reducible)
                })
                .min_by(|a, b| a.residual.iter().sum::<f64>().total_cmp(&b.residual.iter().sum()));
            choice = better.unwrap_or(choice);
        }
        choice
    }

    /// Puts an effect to another place where it does better there and may do no more, or does better beyond doubt.
    fn moved(&mut self, mut choice: Choice) -> Choice {
        for index in 0..choice.terms.len() {
            let Some(other) = self.elsewhere(&choice, index) else { continue };
            let gains = differences(&choice, &other);
            let is_simple = self.extent(&other.terms) <= self.extent(&choice.terms);
            let doubt = if is_simple { 0.5 } else { DOUBT_OF_PLACE };
            if self.bootstrap.quantile_of_sum(&gains, doubt) > 0.0 && self.is_plausible(&other) {
                choice = other;
            }
        }
        choice
    }

    /// Best terms of other effects that touch what this one touches, the most helpful first: of each effect the best, and the best of
    /// those with at most so many parameters.
    pub(crate) fn rivals_of(
        &mut self,
        others: &[TermId],
        term: TermId,
        most_freedom: usize,
        allowed: impl Fn(usize) -> bool,
    ) -> Vec<TermId> {
        let own = self.library.terms[term].clone();
        let found = self.screened(others, |effect| effect != own.effect && allowed(effect));
        let all =
            found.into_iter().flat_map(|found| found.simpler.into_iter().chain([(found.gain, found.id)]));
        let mut all: Vec<(f64, TermId)> = all.collect();
        all.retain(|(gain, id)| *gain > 0.0 && self.library.terms[*id].touches(&own));
        all.sort_by(|a, b| b.0.total_cmp(&a.0));
        let (mut seen, mut seen_simple) = (BTreeSet::new(), BTreeSet::new());
        let is_wanted = |id: &TermId| {
            let term = &self.library.terms[*id];
            let is_first = seen.insert(term.effect);
            (term.own_freedom() <= most_freedom && seen_simple.insert(term.effect)) || is_first
        };
        all.into_iter().map(|(_, id)| id).filter(is_wanted).collect()
    }

    /// The choice with a term of the same effect at the best of its other places; none where it has none.
    pub(crate) fn elsewhere(&mut self, choice: &Choice, index: usize) -> Option<Choice> {
        let own = self.library.terms[choice.terms[index]].clone();
        let rest = without(&choice.terms, index);
        let mut found = self.screened(&rest, |effect| effect == own.effect);
        found.retain(|found| found.gain > 0.0 && self.library.terms[found.id].place != own.place);
        let best = found.into_iter().max_by(|a, b| a.gain.total_cmp(&b.gain))?;
        Some(self.choice(rest.into_iter().chain([best.id]).collect()))
    }

    /// The choice with another effect, at as many places at most, instead of this one.
    pub(crate) fn replacements(&mut self, choice: &Choice, effect: usize) -> Vec<(usize, Choice)> {
        let (own, rest): (Vec<TermId>, Vec<TermId>) =
            choice.terms.iter().partition(|id| self.library.terms[**id].effect == effect);
        let taken = self.effects(&choice.terms);
        let mut by_effect: BTreeMap<usize, Vec<(f64, TermId)>> = BTreeMap::new();
        for Found { gain, id, .. } in self.screened(&rest, |other| !taken.contains(&other)) {
            let term = &self.library.terms[id];
            if gain > 0.0 && own.iter().any(|own| self.library.terms[*own].touches(term)) {
                by_effect.entry(term.effect).or_default().push((gain, id));
            }
        }
        let mut out = Vec::with_capacity(by_effect.len());
        for (other, mut terms) in by_effect {
            terms.sort_by(|a, b| b.0.total_cmp(&a.0));
            terms.truncate(own.len());
            let terms = rest.iter().copied().chain(terms.iter().map(|(_, id)| *id)).collect();
            out.push((other, self.choice(terms)));
        }
        out
    }

    /// Every effect at all the places where it could help.
    fn groups(&self, screened: &[Found], reducible: f64) -> Vec<Vec<TermId>> {
        let mut groups: BTreeMap<usize, Vec<TermId>> = BTreeMap::new();
        for Found { gain, id, .. } in screened {
            if *gain > self.least(LEAST_SHARE_OF_PLACE, reducible) {
                groups.entry(self.library.terms[*id].effect).or_default().push(*id);
            }
        }
        let mut groups: Vec<Vec<TermId>> = groups.into_values().filter(|terms| terms.len() > 1).collect();
        let worth = |terms: &Vec<TermId>| {
            screened.iter().filter(|found| terms.contains(&found.id)).map(|found| found.gain).sum::<f64>()
        };
        groups.sort_by(|a, b| worth(b).total_cmp(&worth(a)));
        groups.truncate(GROUPS);
        groups
    }

    /// Fall of the squared residual that is worth a finding: a share of what can go away, but where noise is known never more
    /// than a fraction of one channel's noise, or a large gap would hide the others.
    fn least(&self, share: f64, reducible: f64) -> f64 {
        let session = self.library.session;
        if session.hold_out.is_even.is_empty() {
            return share * reducible;
        }
        (share * reducible).min(self.worth() * LEAST_OF_WORTH)
    }

    /// A fraction of one channel's noise, as a fall of the squared residual.
    fn worth(&self) -> f64 {
        let values: f64 = self.training.blocks.iter().map(|block| self.library.counts[*block]).sum();
        WORTH * values / self.library.session.channels.len().max(1) as f64
    }

    /// Whether what `next` adds is more than noise and the simulation's own uncertainty make of nothing.
    fn is_beyond_doubt(&mut self, now: &Choice, next: &Choice) -> bool {
        if self.library.session.hold_out.is_even.is_empty() {
            // A comparison states neither noise nor doubt that could be exceeded.
            return true;
        }
        let added: Vec<TermId> = next.terms[now.terms.len()..].to_vec();
        // Each by itself: in a crowd one could do the work for all.
        added.iter().all(|id| {
            let others = next.terms.iter().copied().filter(|other| other != id);
            let terms: Vec<TermId> = others.chain([*id]).collect();
            exceeds(self.library, &terms, terms.len() - 1, &self.training.blocks)
        })
    }

    /// Whether `next` is better than `now` on what was left out: by a practical minimum, beyond doubt and in most folds.
    pub(crate) fn improves(&self, now: &Choice, next: &Choice, news: News, reducible: f64) -> bool {
        let mut gains = differences(now, next);
        let mut terms = now.terms.iter().chain(&next.terms);
        if terms.any(|id| self.library.terms[*id].is_event()) {
            // Even seconds were fitted on: what is seen on the odd ones stands for both.
            let hold_out = &self.library.session.hold_out;
            for (block, gain) in gains.iter_mut().enumerate() {
                *gain *= if hold_out.is_even(block) { 0.0 } else { 2.0 };
            }
        }
        let folds = &self.training.folds;
        let by_fold: Vec<f64> =
            folds.iter().map(|fold| fold.score.iter().map(|block| gains[*block]).sum::<f64>()).collect();
        // A fold where nothing changes (a limit that is not reached, a joint that stands still) says neither yes nor no.
        let weighty = LEAST_OF_FOLD * by_fold.iter().map(|gain| gain.abs()).sum::<f64>();
        let asked = by_fold.iter().filter(|gain| gain.abs() >= weighty).count();
        let better = by_fold.iter().filter(|gain| **gain >= weighty && **gain > 0.0).count();
        let (least, doubt, most) = match news {
            News::Effect => (LEAST_SHARE, DOUBT, 3 * better >= 2 * asked),
            News::Place => (LEAST_SHARE_OF_PLACE, DOUBT_OF_PLACE, 2 * better >= asked),
        };
        let quantile = self.bootstrap.quantile_of_sum(&gains, doubt);
        gains.iter().sum::<f64>() > self.least(least, reducible) && most && quantile > 0.0
    }

    /// Tries the other shapes of every term.
    pub(crate) fn better_shapes(&mut self, mut choice: Choice) -> Choice {
        for index in 0..choice.terms.len() {
            let site = self.site(choice.terms[index]);
            let found = self.candidates.iter().find(|(_, shapes)| self.site(shapes[0]) == site);
            let Some((_, shapes)) = found.filter(|(_, shapes)| shapes.len() > 1) else { continue };
            let others: Vec<TermId> = without(&choice.terms, index);
            self.library.prepare(shapes, &others);
            let screen = Screen::new(self.library, &others, &self.training.blocks);
            let best = best_shape(&screen, self.library, shapes, self.worth());
            let Some(best) = best else { continue };
            for id in best.simpler.into_iter().map(|(_, id)| id).chain([best.id]) {
                let mut terms = choice.terms.clone();
                terms[index] = id;
                let other = self.choice(terms);
                if sum_of_difference(&choice, &other) > 0.0 {
                    choice = other;
                }
            }
        }
        choice
    }

    /// Drops terms whose use is in doubt, the least useful first, once all effects are together: before, a place may seem
    /// useless only because another effect is still missing.
    fn backward(&mut self, mut choice: Choice, reducible: f64) -> Choice {
        let mut uses: Vec<(f64, TermId)> = Vec::with_capacity(choice.terms.len());
        for index in 0..choice.terms.len() {
            let smaller = self.choice(without(&choice.terms, index));
            uses.push((sum_of_difference(&smaller, &choice), choice.terms[index]));
        }
        uses.sort_by(|a, b| a.0.total_cmp(&b.0));
        for (_, id) in uses {
            let Some(index) = choice.terms.iter().position(|known| *known == id) else { continue };
            let only = choice.terms.iter().filter(|other| self.same_effect(**other, id)).count() == 1;
            let smaller = self.choice(without(&choice.terms, index));
            let news = if only { News::Effect } else { News::Place };
            if !self.improves(&smaller, &choice, news, reducible) {
                choice = smaller;
            }
        }
        choice
    }

    /// Drops an effect that stands for no more than what the others on its channels leave of themselves, once these take the shapes that
    /// suit them without it: real forms differ from the catalogue's. Only where noise is known.
    fn without_remainders(&mut self, mut choice: Choice) -> Choice {
        if self.library.session.hold_out.is_even.is_empty() {
            return choice;
        }
        for effect in self.effects(&choice.terms) {
            let is_own = |id: &TermId| self.library.terms[*id].effect == effect;
            let (own, rest): (Vec<TermId>, Vec<TermId>) = choice.terms.iter().copied().partition(is_own);
            let shares = |other: &TermId| {
                own.iter().any(|id| self.library.terms[*id].touches(&self.library.terms[*other]))
            };
            if !rest.iter().any(shares) {
                continue;
            }
            let smaller = self.choice(rest);
            let smaller = self.better_shapes(smaller);
            let smaller = self.refined(smaller, 0);
            if self.adds_a_remainder(&smaller, &choice, effect) && self.is_plausible(&smaller) {
                choice = smaller;
            }
        }
        choice
    }

    /// Whether what `choice` has and `smaller` has not is no more than a remainder on its own channels.
    fn adds_a_remainder(&self, smaller: &Choice, choice: &Choice, effect: usize) -> bool {
        let parts = |terms: &[TermId]| -> Vec<Chosen> {
            let part = |fold: &Fold| Chosen { fold: fold.clone(), terms: terms.to_vec() };
            self.training.folds.iter().map(part).collect()
        };
        is_remainder(self.library, &parts(&smaller.terms), &parts(&choice.terms), effect)
    }

    fn same_effect(&self, a: TermId, b: TermId) -> bool {
        self.library.terms[a].effect == self.library.terms[b].effect
    }
}
