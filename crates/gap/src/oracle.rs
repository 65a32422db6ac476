//! How far the gap shrinks once effect and place are known: the yardstick of a benchmark, on the folds of a diagnosis.
//!
//! Shapes are chosen as a diagnosis chooses them, by what was left out inside the training data: of those that explain most of what they
//! are fitted on, the widest would be taken, and be no yardstick on another motion.

use crate::attribute::{Chosen, Subsets};
use crate::bootstrap::Bootstrap;
use crate::candidates::{Candidates, differences};
use crate::effects::{CATALOGUE, Place, by_id};
use crate::folds;
use crate::library::{Library, TermId};
use crate::location;
use crate::measure::Measure;
use crate::select::Search;
use crate::session::Session;

/// Rounds in which every effect takes its best shape beside the others.
const ROUNDS: usize = 2;
/// Share of draws in which a shape with more parameters may fail to be better.
const DOUBT: f64 = 0.05;

/// Share of the reducible gap that goes away with these effects at these places, their parameters fitted on the same folds as in
/// [`crate::diagnose`]; none where they do not show in this data.
#[must_use]
pub fn oracle(session: &Session, put_in: &[(&str, Place)]) -> Option<f64> {
    let sites: Vec<(usize, Place)> =
        put_in.iter().map(|(id, place)| Some((by_id(id)?, *place))).collect::<Option<_>>()?;
    let mut library = Library::new(session);
    let candidates = Candidates::at(&mut library, &sites);
    let bootstrap = Bootstrap::new(session.blocks());
    let mut chosen = Vec::new();
    let all: Vec<usize> = (0..session.blocks()).collect();
    let main = given(&mut library, &candidates, &bootstrap, &all);
    for fold in folds::outer(&session.hold_out) {
        let own = given(&mut library, &candidates, &bootstrap, &fold.fit);
        // A limit that is not reached without the left-out unit is taken from all data, as in a diagnosis.
        let is_own = |main: TermId| {
            let term = &library.terms[main];
            library.shows(main, &fold.fit) && !CATALOGUE[term.effect].is_read_off(&term.shape)
        };
        let seen = |(own, main): (TermId, &TermId)| if is_own(*main) { own } else { *main };
        let terms: Vec<TermId> = own.into_iter().zip(&main).map(seen).collect();
        library.prepare(&terms, &terms);
        chosen.push(Chosen { fold, terms });
    }
    if chosen.iter().any(|part| part.terms.is_empty()) {
        return None;
    }
    let effects: Vec<usize> =
        (0..CATALOGUE.len()).filter(|k| sites.iter().any(|site| site.0 == *k)).collect();
    let subsets = Subsets::new(&library, &chosen, &effects);
    let located = location::locate(&library, &chosen);
    let measure = Measure::new(&library, &subsets, &chosen, &located.floors, &bootstrap);
    measure.removed_share()
}

/// Every candidate at its place, as these blocks ask for it.
fn given(
    library: &mut Library<'_>,
    candidates: &Candidates,
    bootstrap: &Bootstrap,
    blocks: &[usize],
) -> Vec<TermId> {
    let training = folds::training(&library.session.hold_out, blocks, 0.0);
    Search { library, candidates, training: &training, bootstrap }.given(ROUNDS)
}

impl Search<'_, '_, '_> {
    /// Every candidate at its place, with the shape that leaves least of what was left out.
    fn given(&mut self, rounds: usize) -> Vec<TermId> {
        let sites: Vec<Vec<TermId>> = self.candidates.iter().map(|(_, shapes)| shapes.to_vec()).collect();
        let mut best = self.choice(sites.iter().map(|shapes| shapes[0]).collect());
        for _ in 0..rounds {
            for (index, shapes) in sites.iter().enumerate() {
                for &shape in shapes {
                    let mut terms = best.terms.clone();
                    terms[index] = shape;
                    let other = self.choice(terms);
                    let gains = differences(&best, &other);
                    let freedom = |id: TermId| self.library.terms[id].freedom();
                    // One with more parameters that is hardly better fails on another motion.
                    let doubt = if freedom(shape) > freedom(best.terms[index]) { DOUBT } else { 0.5 };
                    if self.bootstrap.quantile_of_sum(&gains, doubt) > 0.0 {
                        best = other;
                    }
                }
            }
            best = self.refined(best, 0);
        }
        best.terms
    }
}
