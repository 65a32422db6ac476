//! Findings and advice as sentences.

use crate::diagnosis::{Finding, NotTestable, Verdict};
use crate::effects::{CATALOGUE, Place, by_id};
use crate::session::Session;

/// A finding in a sentence: what, where, how much, what else it could be, what to do.
pub(crate) fn of_finding(finding: &Finding, effect: usize, place: Place) -> String {
    let entry = CATALOGUE[effect];
    let names = match place {
        Place::Channel(_) => &finding.sensors[..],
        Place::Joint(_) => &finding.joints,
        Place::Link(_) => &finding.links,
        Place::Tip | Place::Base => &[],
    };
    let at = if names.is_empty() { String::new() } else { format!(" at {}", names.join(", ")) };
    let like = if finding.indistinguishable_from.is_empty() {
        String::new()
    } else {
        format!(
            "; this data cannot tell it from {} ({} would)",
            finding.indistinguishable_from.join(", "),
            entry.experiment()
        )
    };
    format!(
        "{}{at}: {:.0} % of the reducible gap ({:.0}..{:.0} %){like}; {}",
        entry.words(),
        100.0 * finding.share,
        100.0 * finding.share_ci95[0],
        100.0 * finding.share_ci95[1],
        entry.remedy()
    )
}

/// What to record next.
pub(crate) fn next_experiment(
    session: &Session,
    verdict: Verdict,
    findings: &[Finding],
    not_testable: &[NotTestable],
) -> String {
    let unclear = findings.iter().find(|finding| !finding.indistinguishable_from.is_empty());
    if let Some(finding) = unclear {
        let experiment = by_id(&finding.effect).map_or("", |effect| CATALOGUE[effect].experiment());
        let others = finding.indistinguishable_from.join(" or ");
        return format!("to tell {} from {others}: {experiment}", finding.effect);
    }
    let mut missing: Vec<&str> = Vec::new();
    for entry in not_testable.iter().filter(|entry| entry.missing.contains('[')) {
        if missing.len() < MOST_MISSING && !missing.contains(&entry.missing.as_str()) {
            missing.push(&entry.missing);
        }
    }
    let missing = (!missing.is_empty()).then(|| missing.join("; with "));
    match (verdict, missing) {
        (Verdict::NoGap, _) => "nothing: the simulation agrees with the measurement within its noise".to_owned(),
        (Verdict::Explained, _) if session.hold_out.units.len() > 1 && session.time_s.is_some() => {
            "another recording with the finding put into the simulation".to_owned()
        }
        (Verdict::Explained, _) => "a second recording, to see whether the finding holds there".to_owned(),
        _ if is_load_unknown(session) => UNKNOWN_LOAD.to_owned(),
        (_, Some(missing)) => format!("the same with {missing}, so that more effects can be tested"),
        (_, None) => "the same motion twice, with and without a known load: what repeats is no noise, and what the load \
                      changes is no zero"
            .to_owned(),
    }
}

/// Missing quantities that are named at most.
const MOST_MISSING: usize = 3;

const UNKNOWN_LOAD: &str = "the same with what hangs on the tip declared ([[load]] in run.toml), or with a reference sensor (reference): \
                            until then a load that nobody declared looks like any fault of arm and gauges";

/// Whether recordings of an arm say nothing of what hung on its tip or pushed it.
fn is_load_unknown(session: &Session) -> bool {
    let is_run = session.channels.iter().any(|channel| channel.gauge.is_some());
    let is_bare = |arm: &crate::session::Kinematics| {
        arm.wrench.is_empty() && arm.carried.iter().all(|(_, body)| body.mass_kg == 0.0)
    };
    is_run && session.kinematics.as_ref().is_some_and(is_bare)
}
