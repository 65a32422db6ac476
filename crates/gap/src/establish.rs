//! Which of the chosen effects stay: what most parts of the data chose by themselves, what helps on what was left out, and what a
//! model that knows no physics does not foretell better.

use std::collections::BTreeSet;

use crate::attribute::{self, Chosen, Subsets};
use crate::bootstrap::Bootstrap;
use crate::candidates::{Candidates, Choice, Training};
use crate::effects::{CATALOGUE, Role};
use crate::generic::Generic;
use crate::library::{Library, TermId};
use crate::location;
use crate::remainder::{is_remainder, without};
use crate::select::Search;

/// What effects are chosen from and judged on.
pub(crate) struct Ground<'a> {
    pub(crate) candidates: &'a Candidates,
    pub(crate) bootstrap: &'a Bootstrap,
    /// All data that may be fitted.
    pub(crate) training: &'a Training,
    /// The same of every outer fold; none where units are reserved.
    pub(crate) trainings: &'a [&'a Training],
    pub(crate) generic: Option<&'a Generic>,
}

impl Ground<'_> {
    /// Fits the shapes of what is left anew: of all data, and of every part of it, with what that part's own training data asks for.
    fn refit(&self, library: &mut Library<'_>, terms: &mut Vec<TermId>, chosen: &mut [Chosen]) {
        let (candidates, bootstrap) = (self.candidates, self.bootstrap);
        let mut search = Search { library, candidates, training: self.training, bootstrap };
        *terms = search.reshaped(terms).terms;
        for (part, training) in chosen.iter_mut().zip(self.trainings) {
            let mut search = Search { library: &mut *search.library, candidates, training, bootstrap };
            let own = search.reshaped(&part.terms);
            part.terms = search.with_missing(own, terms).terms;
        }
        if self.trainings.is_empty() {
            chosen.iter_mut().for_each(|part| part.terms.clone_from(terms));
        }
    }
}

/// What is left of a choice after everything that speaks against it.
pub(crate) struct Kept {
    pub(crate) terms: Vec<TermId>,
    pub(crate) effects: Vec<usize>,
    pub(crate) notes: Vec<String>,
}

impl Kept {
    /// Takes away what most parts of the data did not choose, what does not help on what was left out, and what a model that knows
    /// no physics foretells better.
    ///
    /// What stays takes the shapes that suit it without what went, each part of the data by itself; and a part that had chosen what went in
    /// place of what stays takes that, if its own training data asks for it.
    pub(crate) fn establish(
        &mut self,
        library: &mut Library<'_>,
        chosen: &mut [Chosen],
        ground: &Ground<'_>,
    ) -> Subsets {
        self.effects = attribute::established(library, &self.terms, chosen);
        let mut known = chosen.iter().map(|part| part.terms.len()).sum::<usize>() + self.terms.len();
        loop {
            self.terms.retain(|id| self.effects.contains(&library.terms[*id].effect));
            for part in chosen.iter_mut() {
                part.terms.retain(|id| self.effects.contains(&library.terms[*id].effect));
            }
            let kept = chosen.iter().map(|part| part.terms.len()).sum::<usize>() + self.terms.len();
            if kept < known {
                ground.refit(library, &mut self.terms, chosen);
                known = chosen.iter().map(|part| part.terms.len()).sum::<usize>() + self.terms.len();
            }
            let subsets = Subsets::new(library, chosen, &self.effects);
            if !self.drops(library, chosen, &subsets, ground) {
                return subsets;
            }
        }
    }

    /// Takes an effect away that is rather wrong than right, where nothing is certain to shrink.
    pub(crate) fn leave_out(&mut self, library: &Library<'_>, chosen: &mut [Chosen], bit: usize) {
        let effect = self.effects.remove(bit);
        let others = |id: &TermId| library.terms[*id].effect != effect;
        self.terms.retain(others);
        chosen.iter_mut().for_each(|part| part.terms.retain(others));
        self.notes.push(format!(
            "{} is as likely not there: nothing is certain to shrink by it",
            CATALOGUE[effect].id()
        ));
    }

    /// Takes one effect (or what is outdone) away, and says why; whether there was one.
    fn drops(
        &mut self,
        library: &Library<'_>,
        chosen: &mut [Chosen],
        subsets: &Subsets,
        ground: &Ground<'_>,
    ) -> bool {
        let (bit, why) = if let Some(bit) = self.remainder(library, chosen) {
            (
                bit,
                "would take up a little of what a larger effect leaves on the same gauges: a form that is not quite the catalogue's",
            )
        } else if let Some(bit) = subsets.failing(library) {
            (bit, "seemed to help on what was fitted, but did not on what was left out")
        } else if let Some(bit) = self.uncertain_event(library, chosen, ground.bootstrap) {
            (bit, "seemed to be there for a while, but not for certain on the seconds that were left out")
        } else {
            let generic = ground.generic;
            return generic.is_some_and(|generic| self.outdone(library, chosen, generic, ground.bootstrap));
        };
        let id = CATALOGUE[self.effects.remove(bit)].id();
        self.notes.push(format!("{id} {why}"));
        true
    }

    /// An effect that would take up what others leave of themselves; only where noise is known.
    fn remainder(&self, library: &Library<'_>, chosen: &[Chosen]) -> Option<usize> {
        if library.session.hold_out.is_even.is_empty() || self.effects.len() < 2 {
            return None;
        }
        let adds_little = |effect: &usize| {
            let others = without(chosen, |id| library.terms[id].effect == *effect);
            is_remainder(library, &others, chosen, *effect)
        };
        self.effects.iter().position(adds_little)
    }

    /// An event that may as well be noise.
    fn uncertain_event(
        &self,
        library: &Library<'_>,
        chosen: &[Chosen],
        bootstrap: &Bootstrap,
    ) -> Option<usize> {
        let is_uncertain = |effect: &usize| {
            let is_own = |id: TermId| library.terms[id].effect == *effect;
            let own = || self.terms.iter().filter(|id| is_own(**id));
            own().all(|id| library.terms[*id].is_event())
                && !crate::refit::is_sure(library, chosen, is_own, bootstrap)
        };
        self.effects.iter().position(is_uncertain)
    }

    /// Takes terms away where the generic model is better; whether there were any.
    fn outdone(
        &mut self,
        library: &Library<'_>,
        chosen: &mut [Chosen],
        generic: &Generic,
        bootstrap: &Bootstrap,
    ) -> bool {
        let session = library.session;
        let after = location::residuals(library, chosen);
        let site = |id: &TermId| (library.terms[*id].effect, library.terms[*id].place);
        let mut outdone = Vec::new();
        for id in &self.terms {
            let term = &library.terms[*id];
            let lead = generic.lead(session, &term.channels, &after, bootstrap, term.is_event());
            if lead.weight() <= 1.0 {
                continue;
            }
            outdone.push(site(id));
            let names: Vec<&str> = term.channels.iter().map(|k| session.channels[*k].name.as_str()).collect();
            let more = lead.words.replace("{}", &format!("{:.0}", 100.0 * lead.share));
            let id = CATALOGUE[term.effect].id();
            self.notes.push(format!("{id} of {} is not the cause: {more}", names.join(", ")));
        }
        self.terms.retain(|id| !outdone.contains(&site(id)));
        chosen.iter_mut().for_each(|part| part.terms.retain(|id| !outdone.contains(&site(id))));
        let has_terms = |effect: &usize| self.terms.iter().any(|id| library.terms[*id].effect == *effect);
        self.effects.retain(has_terms);
        !outdone.is_empty()
    }
}

/// What exists in one unit only (a contact, a limit that is reached) cannot be chosen where that unit is left out: there it is
/// taken from the choice on everything, and its size from the unit's even seconds, as a shape is that was read off all readings' even seconds.
pub(crate) fn add_events(library: &mut Library<'_>, main: &Choice, chosen: &mut [Chosen]) {
    let units = &library.session.hold_out.unit_of_block;
    for part in chosen {
        let left_out: BTreeSet<usize> = part.fold.score.iter().map(|block| units[*block]).collect();
        for id in &main.terms {
            let term = &library.terms[*id];
            let real = term.columns.iter().filter(|column| column.role != Role::Nuisance);
            let mut own = real.filter_map(|column| column.unit_only);
            let site = |other: &TermId| {
                let other = &library.terms[*other];
                (other.effect, other.place) == (term.effect, term.place)
            };
            let is_unseen = own.any(|unit| left_out.contains(&unit)) || !library.shows(*id, &part.fold.fit);
            match part.terms.iter().position(site) {
                None if is_unseen => part.terms.push(*id),
                // The other of two limits may be reached in what was left out only.
                Some(known) if CATALOGUE[term.effect].is_read_off(&term.shape) => part.terms[known] = *id,
                _ => {}
            }
        }
        library.prepare(&part.terms, &part.terms);
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::effects::{Place, by_id};
    use crate::fit::Fold;

    /// One channel in two recordings of a hundred rows, the first of which alone goes beyond 0.5 and the second alone below -0.5.
    fn session() -> crate::Session {
        let dir = tempfile::tempdir().unwrap();
        let description = "format = 1\npurpose = \"comparison\"\ntable = \"table.csv\"\nrecording = \"run\"\n\
            [[channel]]\nname = \"c\"\nmeasured = \"z\"\nsimulated = \"s\"\nunit = \"N\"\n";
        let mut text = String::from("run,s,z\n");
        for (run, sign) in [("up", 1.0), ("down", -1.0)] {
            for k in 0..100 {
                let force = sign * (f64::from(k) / 50.0 - 1.0).max(-0.4);
                text.push_str(&format!("{run},{force},{}\n", force.clamp(-0.5, 0.5)));
            }
        }
        std::fs::write(dir.path().join("comparison.toml"), description).unwrap();
        std::fs::write(dir.path().join("table.csv"), text).unwrap();
        crate::comparison::load(dir.path()).unwrap()
    }

    #[test]
    fn a_part_that_saw_one_rail_only_is_given_both_as_they_were_read_off() {
        let session = session();
        let mut library = Library::new(&session);
        let effect = by_id("saturation").unwrap();
        let mut limit = |shape: &[f64]| library.term(effect, Place::Channel(0), shape).unwrap();
        let [both, high] = [limit(&[0.5, -0.5]), limit(&[0.5])];
        let unit = |unit: usize| -> Vec<usize> {
            let of_block = &session.hold_out.unit_of_block;
            (0..of_block.len()).filter(|block| of_block[*block] == unit).collect()
        };
        let fitted_on_up = || Fold { fit: unit(0), score: unit(1) };
        let part = |terms: &[TermId]| Chosen { fold: fitted_on_up(), terms: terms.to_vec() };
        let terms_with = |library: &mut Library<'_>, main: TermId, own: &[TermId]| {
            let mut chosen = vec![part(own)];
            let main = Choice { terms: vec![main], residual: Vec::new() };
            add_events(library, &main, &mut chosen);
            chosen.remove(0).terms
        };
        assert_eq!(terms_with(&mut library, both, &[high]), [both]);
        // A rail that was searched for shows in what was fitted: a part that did not choose it does without, another keeps its own.
        assert_eq!(terms_with(&mut library, high, &[]), [] as [TermId; 0]);
        let other = library.term(effect, Place::Channel(0), &[0.45]).unwrap();
        assert_eq!(terms_with(&mut library, high, &[other]), [other]);
        // One that what was fitted does not show at all is taken from the choice on everything.
        let low = library.term(effect, Place::Channel(0), &[-0.5]).unwrap();
        assert_eq!(terms_with(&mut library, low, &[]), [low]);
    }
}
