//! What came of a session, against what was put in.

use sim::effects::{Kind, Place};
use wrenchd_gap::diagnosis::{Diagnosis, Finding, Verdict};
use wrenchd_gap::effects::Place as Site;

use crate::Result;
use crate::arms::Arm;
use crate::plan::{Case, OUTSIDE, Question};
use crate::session::{Recorded, record};

/// What is asserted with at least this confidence, and with nothing said to be alike, is asserted confidently.
pub(crate) const CONFIDENT: f64 = 0.5;

/// One session's result.
#[derive(Clone, Debug)]
pub(crate) struct Outcome {
    pub(crate) case: Case,
    /// Per effect that was put in: named or said to be alike.
    pub(crate) named: Vec<bool>,
    /// The right effect is the first finding, or said to be like it; at the right place too.
    pub(crate) is_first: bool,
    pub(crate) is_first_placed: bool,
    pub(crate) findings: Vec<Judged>,
    pub(crate) verdict: Verdict,
    pub(crate) shrink: Option<f64>,
    pub(crate) shrink_ci95: Option<[f64; 2]>,
    /// Shrink with effect and place given.
    pub(crate) oracle: Option<f64>,
    /// Findings without the effect in the catalogue.
    pub(crate) withheld: Option<Vec<Judged>>,
    pub(crate) seconds: f64,
    /// The same in a line for a person.
    pub(crate) line: String,
}

/// A finding against the truth.
#[derive(Clone, Debug)]
pub(crate) struct Judged {
    pub(crate) confidence: f64,
    /// Effects in its set: itself, and what is said to be alike.
    pub(crate) set: Vec<String>,
    /// Its own name is right; its set holds a right one; and the place is right, too.
    pub(crate) is_right: bool,
    pub(crate) holds_truth: bool,
    pub(crate) is_placed: bool,
    /// It is a neighbour of what was put in: of the same physics, so that a form which fits neither exactly may be called either.
    pub(crate) is_neighbour: bool,
    /// The same in words, with the evidence.
    pub(crate) line: String,
}

impl Judged {
    pub(crate) fn is_alone(&self) -> bool {
        self.set.len() == 1
    }
}

/// Effects that act alike on the signal: with one of them missing from the catalogue another is an honest name.
const NEIGHBOURS: &[&[&str]] = &[
    &["zero_offset", "drift", "temperature_offset", "creep", "random_walk", "zero_jumps"],
    &[
        "gain",
        "sensing_axis",
        "axial_force",
        "channel_coupling",
        "nonlinearity",
        "temperature_gain",
        "saturation",
        "quantisation",
    ],
    &["hysteresis", "creep", "lowpass", "delay", "friction"],
    &["lowpass", "delay", "frame_loss", "spikes"],
    &["friction", "cable_drag", "torque_ripple"],
    &["link_mass", "link_offset", "payload", "encoder_offset", "base_tilt", "joint_flexibility", "backlash"],
    &["link_offset", "sensing_axis"],
    &["spikes", "mains_pickup"],
    &["gain", "temperature_gain", "gain_walk"],
    &["channel_coupling", "nonlinearity", "product"],
];

fn are_neighbours(a: &str, b: &str) -> bool {
    NEIGHBOURS.iter().any(|group| group.contains(&a) && group.contains(&b))
}

/// Records, diagnoses and judges.
pub(crate) fn run(case: &Case, arm: &Arm) -> Result<Outcome> {
    let recorded = record(arm, &case.put_in, case.seed)?;
    let pairs: Vec<_> = recorded.runs.iter().zip(&recorded.recordings).collect();
    let began = std::time::Instant::now();
    let session = wrenchd_gap::runs::session(&arm.rig, &arm.model, &pairs)?;
    let diagnosis = wrenchd_gap::diagnose(&session, |_, _| {});
    let seconds = began.elapsed().as_secs_f64();
    let is_inside = case.put_in.iter().all(|(kind, _)| !OUTSIDE.contains(kind)) && !case.put_in.is_empty();
    let sites: Vec<(&str, Site)> = recorded
        .effects
        .list
        .iter()
        .map(|effect| (effect.kind.id(), site(effect.place, effect.kind)))
        .collect();
    let oracle = if is_inside { wrenchd_gap::oracle(&session, &sites) } else { None };
    let withheld = matches!(case.question, Question::Single { withheld: true, .. }).then(|| {
        let without = wrenchd_gap::diagnose_without(&session, &[sites[0].0], |_, _| {});
        judged(arm, &recorded, &without)
    });
    let mut outcome = judge(case, arm, &recorded, &diagnosis);
    (outcome.oracle, outcome.withheld, outcome.seconds) = (oracle, withheld, seconds);
    outcome.line = line(&outcome, &recorded, arm, &diagnosis);
    Ok(outcome)
}

fn site(place: Place, kind: Kind) -> Site {
    match place {
        Place::Gauge(gauge) => Site::Channel(gauge),
        Place::Joint(joint) => Site::Joint(joint),
        Place::Link(link) => Site::Link(link),
        Place::Arm if kind == Kind::BaseTilt => Site::Base,
        Place::Arm => Site::Tip,
    }
}

fn judge(case: &Case, arm: &Arm, recorded: &Recorded, diagnosis: &Diagnosis) -> Outcome {
    let put_in = &recorded.effects.list;
    let named = |id: &str| diagnosis.findings.iter().any(|finding| in_set(finding, id));
    let findings = judged(arm, recorded, diagnosis);
    Outcome {
        case: case.clone(),
        named: put_in.iter().map(|effect| named(effect.kind.id())).collect(),
        is_first: findings.first().is_some_and(|first| first.holds_truth),
        is_first_placed: findings.first().is_some_and(|first| first.holds_truth && first.is_placed),
        findings,
        verdict: diagnosis.verdict,
        shrink: diagnosis.gap.shrink,
        shrink_ci95: diagnosis.gap.shrink_ci95,
        oracle: None,
        withheld: None,
        seconds: 0.0,
        line: String::new(),
    }
}

fn in_set(finding: &Finding, id: &str) -> bool {
    finding.effect == id || finding.indistinguishable_from.iter().any(|like| like == id)
}

fn judged(arm: &Arm, recorded: &Recorded, diagnosis: &Diagnosis) -> Vec<Judged> {
    let put_in = &recorded.effects.list;
    let of = |finding: &Finding| {
        let truth = put_in.iter().filter(|effect| in_set(finding, effect.kind.id()));
        let mut judged = Judged {
            confidence: finding.confidence,
            set: std::iter::once(&finding.effect).chain(&finding.indistinguishable_from).cloned().collect(),
            is_right: put_in.iter().any(|effect| effect.kind.id() == finding.effect),
            holds_truth: truth.clone().next().is_some(),
            is_placed: truth.clone().any(|effect| is_at(arm, finding, effect)),
            is_neighbour: put_in.iter().any(|effect| are_neighbours(&finding.effect, effect.kind.id())),
            line: String::new(),
        };
        judged.line = line_of(finding, &judged);
        judged
    };
    diagnosis.findings.iter().map(of).collect()
}

/// Whether a finding sits where the effect was put in. A rival that is said to be alike may sit on the joint of that gauge, or on
/// the gauge of that joint.
fn is_at(arm: &Arm, finding: &Finding, effect: &sim::effects::Effect) -> bool {
    let joint_of = |gauge: usize| arm.rig.chain.joints[arm.rig.sections[gauge].joint].coordinate;
    let names = arm.rig.chain.coordinate_names();
    match effect.place {
        Place::Gauge(gauge) => finding.sensors.contains(&arm.rig.layout.gauges[gauge].name),
        Place::Joint(joint) => {
            let own = (0..arm.rig.sections.len()).filter(|gauge| joint_of(*gauge) == Some(joint));
            let mut sensors = own.map(|gauge| &arm.rig.layout.gauges[gauge].name);
            finding.joints.iter().any(|name| name == names[joint])
                || (finding.effect != effect.kind.id() && sensors.any(|name| finding.sensors.contains(name)))
        }
        Place::Link(link) => {
            finding.links.contains(&arm.rig.chain.joints[link].child_link)
                || (finding.effect != effect.kind.id() && finding.links.is_empty())
        }
        Place::Arm => true,
    }
}

/// A finding with its evidence in words: + where it is right, ~ where its set is, - where neither.
fn line_of(finding: &Finding, judged: &Judged) -> String {
    let at = [&finding.links, &finding.joints, &finding.sensors].into_iter().find(|list| !list.is_empty());
    let e = &finding.evidence;
    format!(
        "{}{}@{} {:.2} share {:.2} (wins {:.3} lead {:.3} {:.2} marg {:.3} wand {:.4} expl {:.3} exc {:.2} chosen {:.2} free {} unst {:.4} right {}){}",
        if judged.is_right {
            "+"
        } else if judged.holds_truth {
            "~"
        } else {
            "-"
        },
        finding.effect,
        at.map_or(String::new(), |at| at.join("/")),
        finding.confidence,
        finding.share,
        e.wins,
        e.lead,
        e.lead_sigmas,
        e.marginal,
        e.generic,
        e.explained,
        e.excess,
        e.chosen,
        e.freedom,
        e.unsteady,
        u8::from(judged.holds_truth && judged.is_placed),
        if judged.is_alone() { String::new() } else { format!(" or {}", judged.set[1..].join(",")) }
    )
}

fn line(outcome: &Outcome, recorded: &Recorded, arm: &Arm, diagnosis: &Diagnosis) -> String {
    let place = |place: Place| match place {
        Place::Gauge(gauge) => arm.rig.layout.gauges[gauge].name.clone(),
        Place::Joint(joint) => arm.rig.chain.coordinate_names()[joint].to_owned(),
        Place::Link(link) => arm.rig.chain.joints[link].child_link.clone(),
        Place::Arm => String::new(),
    };
    let put_in: Vec<String> = recorded
        .effects
        .list
        .iter()
        .map(|effect| {
            let size = effect.size.unwrap_or(0.0);
            format!("{}@{} {size} ({:.3e})", effect.kind.id(), place(effect.place), effect.strength)
        })
        .collect();
    let found: Vec<String> = outcome.findings.iter().map(|judged| judged.line.clone()).collect();
    let number = |value: Option<f64>| value.map_or("-".to_owned(), |value| format!("{value:.3}"));
    let notes = if diagnosis.notes.is_empty() {
        String::new()
    } else {
        format!(" notes: {}", diagnosis.notes.join("; "))
    };
    let withheld = outcome.withheld.as_ref().map_or(String::new(), |list| {
        let neighbour = |judged: &Judged| if judged.is_neighbour { " (neighbour)" } else { "" };
        let one = |judged: &Judged| format!("{}{}", judged.line, neighbour(judged));
        format!(" withheld: [{}]", list.iter().map(one).collect::<Vec<_>>().join(", "))
    });
    format!(
        "arm {} seed {:x} [{}] {:?} {:.3} -> {:.3} ({:.3}) shrink {} ({}) oracle {} {:.1} s: [{}]{withheld}{notes}",
        outcome.case.arm,
        outcome.case.seed,
        put_in.join(", "),
        outcome.verdict,
        diagnosis.gap.before,
        diagnosis.gap.after,
        diagnosis.gap.floor,
        number(outcome.shrink),
        outcome.shrink_ci95.map_or("-".to_owned(), |[low, high]| format!("{low:.3}..{high:.3}")),
        number(outcome.oracle),
        outcome.seconds,
        found.join(", "),
    )
}
