//! What parts of the data call by other names than all of it does.
//!
//! Every part chooses for itself. Where effects look alike, chance names another one in each, and none would be established although all
//! say that something is there.

use std::collections::BTreeSet;

use crate::candidates::{Choice, sum_of_difference};
use crate::library::TermId;
use crate::select::{News, Search, UNCLEAR};

impl Search<'_, '_, '_> {
    /// The choice in the words of `main`, the choice on all data, where this training set may as well be told by these: where effects look
    /// alike, chance must not name another one in every part of the data. One that chose nothing by itself must ask for them.
    pub(crate) fn told_by(&mut self, own: &Choice, main: &[TermId]) -> Choice {
        if self.are_same_sites(&own.terms, main) {
            return own.clone();
        }
        if own.terms.is_empty() {
            return self.with_missing(own.clone(), main);
        }
        let (nothing, same) = (self.choice(Vec::new()), self.reshaped(main));
        let [gains, most] = [&same, own].map(|choice| sum_of_difference(&nothing, choice));
        if gains >= most || self.is_as_good(&same, gains, own, most, UNCLEAR) {
            return same;
        }
        self.renamed(own, main)
    }

    /// The choice with the effects that `main` names in the place of others that it does not, where both say that something is there and
    /// this training set asks for what `main` names.
    fn renamed(&mut self, own: &Choice, main: &[TermId]) -> Choice {
        let (known, named) = (self.effects(&own.terms), self.effects(main));
        let is_of =
            |id: &TermId, effects: &BTreeSet<usize>| effects.contains(&self.library.terms[*id].effect);
        let touches = |id: &TermId, others: &[TermId]| {
            others.iter().any(|other| self.library.terms[*id].touches(&self.library.terms[*other]))
        };
        let others: Vec<TermId> = own.terms.iter().copied().filter(|id| !is_of(id, &named)).collect();
        let missing: Vec<TermId> =
            main.iter().copied().filter(|id| !is_of(id, &known) && touches(id, &others)).collect();
        let stays = |id: &TermId| is_of(id, &named) || !touches(id, &missing);
        let kept = own.terms.iter().copied().filter(stays).collect();
        if missing.is_empty() {
            return own.clone();
        }
        let base = self.choice(kept);
        let renamed = self.with_missing(base.clone(), &missing);
        if renamed.terms.len() > base.terms.len() { renamed } else { own.clone() }
    }

    /// The choice with those of the given effects that it lacks, in shapes that suit this training set, if they improve it: as a further
    /// place of an effect must, since other parts of the data found them by themselves.
    pub(crate) fn with_missing(&mut self, choice: Choice, given: &[TermId]) -> Choice {
        let own = self.effects(&choice.terms);
        let missing: Vec<TermId> =
            given.iter().copied().filter(|id| !own.contains(&self.library.terms[*id].effect)).collect();
        if missing.is_empty() {
            return choice;
        }
        let all: Vec<TermId> = choice.terms.iter().copied().chain(missing).collect();
        let whole = self.reshaped(&all);
        let reducible = (self.choice(Vec::new()).residual.iter().sum::<f64>() - self.training.floor).max(0.0);
        let asks = self.is_plausible(&whole) && self.improves(&choice, &whole, News::Place, reducible);
        if asks { whole } else { choice }
    }

    /// The same effects at the same places, in the shapes that this training set asks for: what was left out of it has no say in
    /// them. Only what it cannot show keeps its own: an event, a limit that is not reached there.
    pub(crate) fn reshaped(&mut self, terms: &[TermId]) -> Choice {
        let choice = self.choice(terms.to_vec());
        let choice = self.better_shapes(choice);
        let choice = self.refined(choice, 0);
        let pairs = terms.iter().zip(choice.terms);
        let own = |(given, fitted): (&TermId, TermId)| {
            let shows = self.library.shows(*given, &self.training.blocks);
            if self.library.terms[*given].is_event() || !shows { *given } else { fitted }
        };
        let terms = pairs.map(own).collect();
        self.choice(terms)
    }

    /// Whether these are the same effects at the same places.
    fn are_same_sites(&self, some: &[TermId], others: &[TermId]) -> bool {
        let sites = |terms: &[TermId]| terms.iter().map(|id| self.site(*id)).collect::<BTreeSet<_>>();
        sites(some) == sites(others)
    }
}
