//! From chosen terms to findings: established effects, gap before and after, shares, look-alikes, parameters.

use std::collections::{BTreeMap, BTreeSet};

use crate::bootstrap::{Bootstrap, quantile, weighted};
use crate::candidates::{Choice, differences, sum_of_difference, without};
use crate::diagnosis::{Evidence, Finding, Parameter, SensorGap};
use crate::doubt::exceeds;
use crate::effects::{CATALOGUE, Fitted, Place, Role};
use crate::fit::{Design, Fold};
use crate::library::{Library, TermId};
use crate::refine::shape_sigma;
use crate::select::{LEAST_OF_WORTH, Search, WORTH};

/// An outer fold with what was chosen on its training blocks.
#[derive(Clone)]
pub(crate) struct Chosen {
    pub(crate) fold: Fold,
    pub(crate) terms: Vec<TermId>,
}

/// Squared residual per scored block with subsets of the effects, by bit mask over `effects`.
pub(crate) struct Subsets {
    pub(crate) effects: Vec<usize>,
    pub(crate) residuals: Vec<Vec<f64>>,
}

/// Share of what goes away on left-out units that an effect must account for to be listed.
const LEAST_SHARE: f64 = 0.01;

impl Subsets {
    /// Fits every subset in every outer fold.
    pub(crate) fn new(library: &Library<'_>, chosen: &[Chosen], effects: &[usize]) -> Self {
        let subset = |mask: usize| {
            let mut residual = vec![0.0; library.squared.len()];
            for part in chosen {
                let kept = |id: &&TermId| {
                    let effect = library.terms[**id].effect;
                    effects.iter().position(|known| *known == effect).is_some_and(|bit| mask >> bit & 1 == 1)
                };
                let terms: Vec<TermId> = part.terms.iter().filter(kept).copied().collect();
                let scored = Design::new(library, &terms).left_out(std::slice::from_ref(&part.fold));
                residual.iter_mut().zip(scored).for_each(|(sum, value)| *sum += value);
            }
            residual
        };
        Self { effects: effects.to_vec(), residuals: (0..1 << effects.len()).map(subset).collect() }
    }

    /// As simulated, per block.
    pub(crate) fn before(&self) -> &[f64] {
        &self.residuals[0]
    }

    /// With all effects, per block.
    pub(crate) fn after(&self) -> &[f64] {
        &self.residuals[self.residuals.len() - 1]
    }

    /// The effect that helps least, if that is next to nothing: where noise is known a fraction of one channel's noise, for a share of a
    /// large gap would hide the others; else a share of what goes away.
    pub(crate) fn failing(&self, library: &Library<'_>) -> Option<usize> {
        let values = (0..self.effects.len()).map(|bit| (self.shapley(bit).iter().sum::<f64>(), bit));
        let (value, bit) = values.min_by(|a, b| a.0.total_cmp(&b.0))?;
        let all: f64 = self.before().iter().zip(self.after()).map(|(before, after)| before - after).sum();
        let session = library.session;
        let least = if session.hold_out.is_even.is_empty() {
            LEAST_SHARE * all.max(0.0)
        } else {
            LEAST_OF_WORTH * WORTH * library.counts.iter().sum::<f64>() / session.channels.len().max(1) as f64
        };
        (value <= least).then_some(bit)
    }

    /// Per block the Shapley value of an effect's part in the fall of the squared residual (L. Shapley, A value for n-person
    /// games, 1953): the mean over all orders of what it adds to those before it. Values of all effects add up to the fall.
    pub(crate) fn shapley(&self, bit: usize) -> Vec<f64> {
        let count = self.effects.len();
        let factorial = |n: usize| (1..=n).map(|k| k as f64).product::<f64>();
        let mut value = vec![0.0; self.before().len()];
        for mask in (0..self.residuals.len()).filter(|mask| mask >> bit & 1 == 0) {
            let size = mask.count_ones() as usize;
            let weight = factorial(size) * factorial(count - size - 1) / factorial(count);
            let (without, with) = (&self.residuals[mask], &self.residuals[mask | 1 << bit]);
            for (sum, (a, b)) in value.iter_mut().zip(without.iter().zip(with)) {
                *sum += weight * (a - b);
            }
        }
        value
    }
}

/// Effects chosen on everything that may be used and in at least half of the outer folds.
pub(crate) fn established(library: &Library<'_>, main: &[TermId], chosen: &[Chosen]) -> Vec<usize> {
    let of = |terms: &[TermId]| terms.iter().map(|id| library.terms[*id].effect).collect::<BTreeSet<usize>>();
    let often = |effect: &usize| {
        2 * chosen.iter().filter(|part| of(&part.terms).contains(effect)).count() >= chosen.len()
    };
    of(main).into_iter().filter(often).collect()
}

/// Effects that explain left-out data as well as this one, and how sure it is that none of the others does better.
pub(crate) struct Rivals {
    pub(crate) indistinguishable: Vec<usize>,
    pub(crate) evidence: Evidence,
}

/// A rival explains at least this share of what the effect explains, and cannot be told from it by drawing blocks ...
const NEAR: f64 = 0.85;
/// ... or at least this share, whatever the draws say.
const AS_GOOD: f64 = 0.94;

/// Share of draws in which what does better with many more parameters may fail to.
const BETTER: f64 = 0.45;
/// Share of an effect's gain by which another may be ahead for nothing: a calibration's errors look like a little of everything.
const NOTHING: f64 = 0.003;

/// Puts every other effect into the place of this one, term by term, and as a whole.
pub(crate) fn rivals(search: &mut Search<'_, '_, '_>, main: &Choice, effect: usize) -> Rivals {
    let own: Vec<usize> =
        (0..main.terms.len()).filter(|k| search.library.terms[main.terms[*k]].effect == effect).collect();
    let taken: BTreeSet<usize> = main.terms.iter().map(|id| search.library.terms[*id].effect).collect();
    let mut as_good: BTreeMap<usize, f64> = BTreeMap::new();
    let mut total = 0.0;
    for &index in &own {
        let rest = without(&main.terms, index);
        let base = search.choice(rest.clone());
        let gain = sum_of_difference(&base, main).max(0.0);
        total += gain;
        let freedom = search.library.terms[main.terms[index]].freedom();
        let worth = worth(search, main, index, gain);
        let mut found = BTreeSet::new();
        let most_freedom = 2 * freedom + 1;
        for id in search.rivals_of(&rest, main.terms[index], most_freedom, |other| !taken.contains(&other)) {
            let term = &search.library.terms[id];
            let (rival, free) = (term.effect, term.own_freedom());
            let other = search.choice(rest.iter().copied().chain([id]).collect());
            // What needs many more parameters to do the same is no rival, but what clearly does better is.
            let is_simple = free <= most_freedom;
            let other = if is_simple { with_own_shapes(search, main, other, worth) } else { other };
            let is_rival = (is_simple
                && is_as_good(search, main, &other, worth)
                && (search.library.session.hold_out.is_even.is_empty()
                    || exceeds(search.library, &other.terms, rest.len(), &search.training.blocks)))
                || is_better(search, main, &other, gain);
            if is_rival && found.insert(rival) {
                *as_good.entry(rival).or_default() += gain;
            }
        }
    }
    let indistinguishable: Vec<usize> =
        as_good.into_iter().filter(|(_, part)| *part > 0.5 * total).map(|(rival, _)| rival).collect();
    let mut others: Vec<Choice> = search
        .replacements(main, effect)
        .into_iter()
        .filter(|(rival, other)| !indistinguishable.contains(rival) && other.terms.len() <= main.terms.len())
        .map(|(_, other)| other)
        .collect();
    own.iter().for_each(|index| others.extend(search.elsewhere(main, *index)));
    let rest = main.terms.iter().copied().filter(|id| search.library.terms[*id].effect != effect).collect();
    let without = sum_of_difference(&search.choice(rest), main);
    let leads = search.bootstrap.distribution(|weights| {
        let own = weighted(weights, &main.residual);
        let behind = |other: &Choice| weighted(weights, &other.residual) - own + NOTHING * without;
        others.iter().map(behind).min_by(f64::total_cmp)
    });
    let all = sum_of_difference(&search.choice(Vec::new()), main);
    let evidence = Evidence {
        marginal: without / all.max(f64::MIN_POSITIVE),
        lead: if leads.is_empty() { 1.0 } else { quantile(&leads, 0.5) / without.max(f64::MIN_POSITIVE) },
        wins: leads.iter().filter(|lead| **lead > 0.0).count() as f64 / leads.len().max(1) as f64,
        lead_sigmas: lead_sigmas(&leads),
        freedom: own
            .iter()
            .map(|index| search.library.terms[main.terms[*index]].freedom())
            .max()
            .unwrap_or(0),
        ..Evidence::default()
    };
    Rivals { indistinguishable, evidence }
}

/// What a term explains, as the measure of what a rival may lack. Where noise is known that is what it adds to the others. Where it is not,
/// what is left are errors of all forms together, and a term that shares its part with others would be measured by theirs: then
/// the mean of what it explains after the others and before them counts (Shapley's value of two).
fn worth(search: &mut Search<'_, '_, '_>, main: &Choice, index: usize, gain: f64) -> f64 {
    if !search.library.session.hold_out.is_even.is_empty() {
        return gain;
    }
    let nothing = search.choice(Vec::new());
    let alone = search.choice(vec![main.terms[index]]);
    gain.max(0.5 * (gain + sum_of_difference(&nothing, &alone)))
}

/// A rival that explains at least this share has its own and the other terms' shapes fitted beside it ...
const MAY_BE: f64 = 0.5;

/// ... as they were fitted beside the effect: else it is judged by what suits the other.
fn with_own_shapes(search: &mut Search<'_, '_, '_>, main: &Choice, rival: Choice, gain: f64) -> Choice {
    let reached = gain - sum_of_difference(&rival, main);
    if !(MAY_BE * gain..AS_GOOD * gain).contains(&reached) {
        return rival;
    }
    let rival = search.better_shapes(rival);
    search.refined(rival, 0)
}

/// Lead over its spread; a large number where nobody is behind it.
fn lead_sigmas(leads: &[f64]) -> f64 {
    let spread = (quantile(leads, 0.84) - quantile(leads, 0.16)) / 2.0;
    if spread > 0.0 { quantile(leads, 0.5) / spread } else { 10.0 }
}

/// Whether `other` leaves less than `main` by more than the calibration's own errors may do, nearly however blocks are drawn.
fn is_better(search: &Search<'_, '_, '_>, main: &Choice, other: &Choice, gain: f64) -> bool {
    let ahead = differences(main, other);
    ahead.iter().sum::<f64>() > NOTHING * gain && search.bootstrap.quantile_of_sum(&ahead, BETTER) > 0.0
}

/// Whether `other` reaches (nearly) the gain of `main`. Where noise is not known, what is left is what both forms lack: they are not told
/// apart by less than that.
fn is_as_good(search: &Search<'_, '_, '_>, main: &Choice, other: &Choice, gain: f64) -> bool {
    let behind = differences(other, main);
    let lacks: f64 = behind.iter().sum();
    let is_noise_known = !search.library.session.hold_out.is_even.is_empty();
    let is_unclear = || {
        (!is_noise_known && lacks <= main.residual.iter().sum())
            || search.bootstrap.quantile_of_sum(&behind, 0.05) <= 0.0
    };
    let reached = gain - lacks;
    reached >= AS_GOOD * gain || (reached >= NEAR * gain && is_unclear())
}

/// Interval of 95 % of a ratio of sums over scored blocks.
pub(crate) fn interval(bootstrap: &Bootstrap, upper: &[f64], lower: &[f64]) -> [f64; 2] {
    let ratios = bootstrap.distribution(|weights| {
        let below = weighted(weights, lower);
        (below > 0.0).then(|| weighted(weights, upper) / below)
    });
    [quantile(&ratios, 0.025), quantile(&ratios, 0.975)]
}

/// Where the terms of an effect sit and what their parameters are, fitted on these blocks with all terms together.
pub(crate) fn describe(
    library: &mut Library<'_>,
    terms: &[TermId],
    effect: usize,
    blocks: &[usize],
) -> Finding {
    let design = Design::new(library, terms);
    let values = design.solve(blocks);
    let sigmas = design.sigmas(blocks, &values);
    let mut finding = Finding { effect: CATALOGUE[effect].id().to_owned(), ..Finding::default() };
    let own: Vec<usize> = (0..terms.len()).filter(|k| library.terms[terms[*k]].effect == effect).collect();
    for &index in &own {
        let term = library.terms[terms[index]].clone();
        let place = name_place(library, &term.channels, term.place, &mut finding);
        let name = |parameter: &str| match (&place, own.len()) {
            (Some(place), 2..) => format!("{parameter}[{place}]"),
            _ => parameter.to_owned(),
        };
        for (k, (parameter, unit)) in CATALOGUE[effect].shape_parameters().iter().enumerate() {
            let sigma = if k == 0 { shape_sigma(library, terms, index, blocks) } else { None };
            let value = Parameter { value: term.shape[k], sigma, unit: (*unit).to_owned() };
            finding.parameters.insert(name(parameter), value);
        }
        let range = design.offsets[index]..design.offsets[index] + term.width();
        let fitted = Fitted {
            place: term.place,
            shape: &term.shape,
            values: &values.as_slice()[range.clone()],
            sigmas: &sigmas.as_slice()[range],
        };
        finding.compensations.extend(CATALOGUE[effect].compensate(library.session, &fitted));
        if let Some(reported) = CATALOGUE[effect].report(library.session, &fitted) {
            for (parameter, value, sigma, unit) in reported {
                finding.parameters.insert(name(&parameter), Parameter { value, sigma, unit });
            }
            continue;
        }
        for (k, heading) in term.columns.iter().enumerate() {
            let at = design.offsets[index] + k;
            let of =
                |value: f64, sigma: f64| Parameter { value, sigma: Some(sigma), unit: heading.unit.clone() };
            match heading.role {
                Role::Value => {
                    finding.parameters.insert(name(&heading.parameter), of(values[at], sigmas[at]));
                }
                // One over a compliance, to first order.
                Role::Inverse if values[at] > 0.0 => {
                    let stiffness = of(1.0 / values[at], sigmas[at] / (values[at] * values[at]));
                    finding.parameters.insert(name(&heading.parameter), stiffness);
                }
                // The cosine follows its sine.
                Role::Sine => {
                    let amplitude = values[at].hypot(values[at + 1]);
                    let sigma = sigmas[at].hypot(sigmas[at + 1]) / std::f64::consts::SQRT_2;
                    finding.parameters.insert(name(&heading.parameter), of(amplitude, sigma));
                }
                Role::Pinned | Role::Cosine | Role::Nuisance | Role::Inverse => {}
            }
        }
    }
    finding
}

/// Names of channels, those first whose gap shrinks most over its scale.
pub(crate) fn order(names: &mut [String], sensors: &[SensorGap]) {
    let fall = |name: &String| {
        let own = sensors.iter().find(|sensor| sensor.name == *name);
        own.map_or(0.0, |own| own.before * own.before - own.after * own.after)
    };
    names.sort_by(|a, b| fall(b).total_cmp(&fall(a)));
}

/// Adds a place's names to the finding; gives the one that tells it from other places.
fn name_place(
    library: &Library<'_>,
    channels: &[usize],
    place: Place,
    finding: &mut Finding,
) -> Option<String> {
    let session = library.session;
    let sensors = || channels.iter().map(|channel| session.channels[*channel].name.clone());
    let add = |list: &mut Vec<String>, name: &str| {
        if !list.iter().any(|known| known == name) {
            list.push(name.to_owned());
        }
    };
    match place {
        Place::Channel(channel) => {
            let name = &session.channels[channel].name;
            add(&mut finding.sensors, name);
            if let Some(joint) = session.channels[channel].joint {
                add(&mut finding.joints, &session.joints[joint].name);
            }
            Some(name.clone())
        }
        Place::Joint(joint) => {
            sensors().for_each(|name| add(&mut finding.sensors, &name));
            add(&mut finding.joints, &session.joints[joint].name);
            Some(session.joints[joint].name.clone())
        }
        Place::Link(link) => {
            let name = &session.kinematics.as_ref()?.chain.joints.get(link)?.child_link;
            add(&mut finding.links, name);
            Some(name.clone())
        }
        Place::Tip | Place::Base => None,
    }
}
