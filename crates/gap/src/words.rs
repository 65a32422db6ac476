//! Findings and advice as sentences.

use crate::diagnosis::{Finding, NotTestable, Verdict};
use crate::effects::{CATALOGUE, by_id};
use crate::session::Session;

/// A finding in a sentence: what, where, how much, what else it could be, what to do.
pub(crate) fn of_finding(finding: &Finding, effect: usize) -> String {
    let entry = CATALOGUE[effect];
    let place = if finding.links.is_empty() && finding.joints.len() == finding.sensors.len() {
        &finding.sensors
    } else if !finding.links.is_empty() {
        &finding.links
    } else if !finding.joints.is_empty() {
        &finding.joints
    } else {
        &finding.sensors
    };
    let at = if place.is_empty() { String::new() } else { format!(" at {}", place.join(", ")) };
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
    let missing =
        not_testable.iter().map(|entry| entry.missing.as_str()).find(|missing| missing.contains('['));
    match (verdict, missing) {
        (Verdict::NoGap, _) => "nothing: the simulation agrees with the measurement within its noise".to_owned(),
        (Verdict::Explained, _) if session.hold_out.units.len() > 1 && session.time_s.is_some() => {
            "another recording with the finding put into the simulation".to_owned()
        }
        (Verdict::Explained, _) => "a second recording, to see whether the finding holds there".to_owned(),
        (_, Some(missing)) => format!("the same with {missing}, so that more effects can be tested"),
        (_, None) => "the same motion twice, with and without a known load: what repeats is no noise, and what the load \
                      changes is no zero"
            .to_owned(),
    }
}
