//! Whether what was found has the same parameters all the time. A cause has; what only looks like one in some motion would want others
//! in every part of the recordings.

use crate::bootstrap::Bootstrap;
use crate::fit::Design;
use crate::library::{Library, TermId};
use crate::session::HoldOut;

/// Share of draws in which parameters of a part's own may fail to be better.
const DOUBT: f64 = 0.05;

/// Share of what an effect explains that it would explain only with parameters of their own in every half of a unit: fitted on the half's
/// even seconds beside the other effects, and judged on its odd ones against what all other halves ask for. 0 where that is not beyond
/// doubt, and where seconds do not count.
pub(crate) fn unsteady(
    library: &Library<'_>,
    terms: &[TermId],
    effect: usize,
    blocks: &[usize],
    bootstrap: &Bootstrap,
) -> f64 {
    let hold_out = &library.session.hold_out;
    if hold_out.is_even.is_empty() {
        return 0.0;
    }
    let is_own = |id: &TermId| library.terms[*id].effect == effect;
    let others: Vec<TermId> = terms.iter().copied().filter(|id| !is_own(id)).collect();
    let (with, without) = (Design::new(library, terms), Design::new(library, &others));
    let own: Vec<usize> =
        (0..terms.len()).filter(|k| is_own(&terms[*k])).flat_map(|k| with.columns_of(k)).collect();
    let mut better = vec![0.0; library.squared.len()];
    let mut explained = 0.0;
    for here in halves(hold_out, blocks) {
        let elsewhere: Vec<usize> = blocks.iter().copied().filter(|block| !here.contains(block)).collect();
        let (even, odd): (Vec<usize>, Vec<usize>) =
            here.into_iter().partition(|block| hold_out.is_even(*block));
        let common = with.solve(&elsewhere);
        let mut of_half = common.clone();
        with.fit_beside(&even, &|_| 1.0, &own, &mut of_half);
        let nothing = without.solve(&elsewhere);
        for block in odd {
            let left = with.residual(block, &of_half);
            better[block] = with.residual(block, &common) - left;
            explained += without.residual(block, &nothing) - left;
        }
    }
    let is_sure = explained > 0.0 && bootstrap.quantile_of_sum(&better, DOUBT) > 0.0;
    if is_sure { (better.iter().sum::<f64>() / explained).min(1.0) } else { 0.0 }
}

/// The two halves of every unit.
fn halves(hold_out: &HoldOut, blocks: &[usize]) -> Vec<Vec<usize>> {
    let of_unit = |unit: usize| -> Vec<usize> {
        blocks.iter().copied().filter(|block| hold_out.unit_of_block[*block] == unit).collect()
    };
    let units = (0..hold_out.units.len()).map(of_unit);
    let halves = units.flat_map(|own| {
        let (first, second) = own.split_at(own.len() / 2);
        [first.to_vec(), second.to_vec()]
    });
    halves.filter(|half| !half.is_empty()).collect()
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::effects::{Place, by_id};

    /// How unsteady a scale is that is off by these shares in the halves of both recordings.
    fn of_scale(shares: [f64; 2]) -> f64 {
        let dir = tempfile::tempdir().unwrap();
        let description = "format = 1\npurpose = \"comparison\"\ntable = \"table.csv\"\ntime = \"t\"\nrecording = \"run\"\n\
            [[channel]]\nname = \"c\"\nmeasured = \"z\"\nsimulated = \"s\"\nunit = \"N\"\nnoise = 0.1\n";
        let mut text = String::from("run,t,s,z\n");
        for k in 0..2000 {
            let force = 5.0 * (f64::from(k) * 0.1).sin();
            let noise = 0.1 * (f64::from(k) * 7.7).sin();
            let share = shares[(k % 1000) as usize / 500];
            text.push_str(&format!("r{},{k},{force},{}\n", k / 1000, force * (1.0 + share) + noise));
        }
        std::fs::write(dir.path().join("comparison.toml"), description).unwrap();
        std::fs::write(dir.path().join("table.csv"), text).unwrap();
        let mut session = crate::comparison::load(dir.path()).unwrap();
        let blocks: Vec<usize> = (0..session.blocks()).collect();
        session.hold_out.is_even = blocks.iter().map(|block| block % 2 == 0).collect();
        let mut library = Library::new(&session);
        let gain = by_id("gain").unwrap();
        let term = library.term(gain, Place::Channel(0), &[]).unwrap();
        unsteady(&library, &[term], gain, &blocks, &Bootstrap::new(blocks.len()))
    }

    #[test]
    fn a_cause_has_the_same_parameters_all_the_time() {
        let steady = of_scale([0.1, 0.1]);
        assert!(steady < 0.002, "{steady}");
        // The other halves together ask for 0.133 where it is 0.1, and for 0.117 where it is 0.15.
        let changing = of_scale([0.1, 0.15]);
        assert!((0.02..0.3).contains(&changing), "{changing}");
        assert!(of_scale([0.2, 0.01]) > changing + 0.1);
    }
}
