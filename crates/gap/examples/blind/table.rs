//! The results as tables, beside what is asked for.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use crate::plan::Question;
use crate::score::{CONFIDENT, Judged, Outcome};

/// Shrinks within this of the oracle's are as good.
const NEAR_ORACLE: f64 = 0.05;
/// Borders of the reliability table's bins.
const CONFIDENCES: [f64; 8] = [0.0, 0.3, 0.5, 0.7, 0.8, 0.9, 0.95, 1.0];

/// Everything about these outcomes.
pub(crate) fn of(outcomes: &[Outcome]) -> String {
    format!("{}\n{}\n{}", criteria(outcomes), by_effect(outcomes), reliability(outcomes))
}

/// A row: what, how many, what was reached, what is asked for.
struct Rows(String);

impl Rows {
    fn share(&mut self, what: &str, asked: &str, of: impl IntoIterator<Item = bool>) {
        let (mut count, mut yes) = (0_u32, 0_u32);
        for is in of {
            count += 1;
            yes += u32::from(is);
        }
        if count > 0 {
            let share = 100.0 * f64::from(yes) / f64::from(count);
            self.row(what, &count.to_string(), &format!("{share:.1} %"), asked);
        }
    }

    fn row(&mut self, what: &str, count: &str, reached: &str, asked: &str) {
        let _written = writeln!(self.0, "| {what} | {count} | {reached} | {asked} |");
    }
}

fn criteria(outcomes: &[Outcome]) -> String {
    let mut rows = Rows("| what | of | reached | asked |\n| --- | --- | --- | --- |\n".to_owned());
    let asking =
        |question: fn(&Question) -> bool| outcomes.iter().filter(move |o| question(&o.case.question));
    let nulls = || asking(|question| *question == Question::Null);
    rows.share("nothing put in: false cause", "<= 2 %", nulls().map(|o| !o.findings.is_empty()));
    let singles = || asking(|question| matches!(question, Question::Single { .. }));
    for (low, high, name, asked) in [
        (2.9, f64::INFINITY, "3 and more", ["95", "90"]),
        (0.9, 2.9, "1", ["90", "85"]),
        (0.0, 0.9, "0.3", ["75", "70"]),
    ] {
        let own = || singles().filter(|o| (low..high).contains(&o.case.put_in[0].1));
        rows.share(
            &format!("single, size {name}: right effect first, or in the first's set"),
            &format!(">= {} %", asked[0]),
            own().map(|o| o.is_first),
        );
        let what = format!("single, size {name}: right place, too");
        rows.share(&what, &format!(">= {} %", asked[1]), own().map(|o| o.is_first_placed));
    }
    let inside = || outcomes.iter().filter(|o| !matches!(o.case.question, Question::Outside { .. }));
    let findings = || inside().flat_map(|o| &o.findings);
    rows.share("asserted alone: right", ">= 95 %", findings().filter(|f| f.is_alone()).map(|f| f.is_right));
    let ambiguous = || findings().filter(|f| !f.is_alone());
    rows.share("said to be ambiguous: truth in the set", ">= 90 %", ambiguous().map(|f| f.holds_truth));
    let mut sizes: Vec<f64> = ambiguous().map(|f| f.set.len() as f64).collect();
    if let Some(median) = median(&mut sizes) {
        rows.row("size of such a set, median", &sizes.len().to_string(), &median.to_string(), "<= 2");
    }
    for (count, name, asked) in [(2, "pairs: both found", ">= 85 %"), (3, "triples: all found", ">= 75 %")] {
        let own = asking(|question| *question == Question::Several).filter(|o| o.case.put_in.len() == count);
        rows.share(name, asked, own.map(|o| o.named.iter().all(|named| *named)));
    }
    let outside = || asking(|question| matches!(question, Question::Outside { .. }));
    rows.share(
        "outside the catalogue: confidently wrong",
        "<= 5 %",
        outside().map(|o| o.findings.iter().any(is_confident)),
    );
    let is_wrong = |list: &[Judged]| list.iter().any(|f| is_confident(f) && !f.is_neighbour);
    rows.share(
        "outside the catalogue: confidently wrong, and no neighbour",
        "-",
        outside().map(|o| is_wrong(&o.findings)),
    );
    rows.share(
        "outside the catalogue: anything named at all",
        "-",
        outside().map(|o| !o.findings.is_empty()),
    );
    let withheld = || outcomes.iter().filter_map(|o| o.withheld.as_ref());
    rows.share(
        "its own effect withheld: confidently wrong (no neighbour)",
        "<= 5 %",
        withheld().map(|list| is_wrong(list)),
    );
    shrinks(&mut rows, outcomes);
    let mut seconds: Vec<f64> = outcomes.iter().map(|o| o.seconds).collect();
    if let Some(median) = median(&mut seconds) {
        rows.row("a diagnosis, median s", &seconds.len().to_string(), &format!("{median:.1}"), "-");
    }
    rows.0
}

fn is_confident(finding: &Judged) -> bool {
    finding.confidence >= CONFIDENT && finding.is_alone()
}

/// How the shrink compares with that of effect and place given.
fn shrinks(rows: &mut Rows, outcomes: &[Outcome]) {
    let pairs = || {
        let sizeable = outcomes.iter().filter(|o| o.case.put_in.iter().all(|(_, size)| *size >= 0.9));
        sizeable.filter_map(|o| Some((o, o.oracle?)))
    };
    let near = pairs().map(|(o, oracle)| o.shrink.unwrap_or(0.0) >= oracle - NEAR_ORACLE);
    rows.share("shrink at most 0.05 short of the oracle's (size 1 and more)", ">= 90 %", near);
    let covers = pairs().filter_map(|(o, oracle)| {
        let [low, high] = o.shrink_ci95?;
        Some((low..=high).contains(&oracle))
    });
    rows.share("its 95 % interval holds the oracle's (size 1 and more)", "90..98 %", covers);
}

fn median(values: &mut [f64]) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}

/// Right effect / right place, by effect and size.
fn by_effect(outcomes: &[Outcome]) -> String {
    let mut table: BTreeMap<&str, BTreeMap<u64, [u32; 3]>> = BTreeMap::new();
    let mut sizes: Vec<f64> = Vec::new();
    for outcome in outcomes {
        if !matches!(outcome.case.question, Question::Single { .. }) {
            continue;
        }
        let (kind, size) = outcome.case.put_in[0];
        let cell = table.entry(kind.id()).or_default().entry(size.to_bits()).or_default();
        cell[0] += 1;
        cell[1] += u32::from(outcome.is_first);
        cell[2] += u32::from(outcome.is_first_placed);
        if !sizes.contains(&size) {
            sizes.push(size);
        }
    }
    sizes.sort_by(f64::total_cmp);
    let heads: String = sizes.iter().map(|size| format!(" {size} |")).collect();
    let mut text = format!(
        "| right effect first (and place), of, at size |{heads}\n| --- |{}\n",
        " --- |".repeat(sizes.len())
    );
    for (effect, cells) in table {
        let cell = |size: &f64| {
            cells
                .get(&size.to_bits())
                .map_or(" |".to_owned(), |[all, first, placed]| format!(" {first} ({placed}) of {all} |"))
        };
        let cells: String = sizes.iter().map(cell).collect();
        let _written = writeln!(text, "| {effect} |{cells}");
    }
    text
}

/// How often findings of a stated confidence are right, effect (or its set) and place.
fn reliability(outcomes: &[Outcome]) -> String {
    let mut text =
        "| confidence said | findings | said, mean | right, effect and place |\n| --- | --- | --- | --- |\n"
            .to_owned();
    let findings: Vec<&Judged> = outcomes.iter().flat_map(|o| &o.findings).collect();
    for border in CONFIDENCES.windows(2) {
        let is_last = border[1] == 1.0;
        let inside = |f: &&&Judged| f.confidence >= border[0] && (f.confidence < border[1] || is_last);
        let own: Vec<&&Judged> = findings.iter().filter(inside).collect();
        if own.is_empty() {
            continue;
        }
        let count = own.len() as f64;
        let said = own.iter().map(|f| f.confidence).sum::<f64>() / count;
        let right = own.iter().filter(|f| f.holds_truth && f.is_placed).count() as f64 / count;
        let _written =
            writeln!(text, "| {} to {} | {} | {said:.2} | {right:.2} |", border[0], border[1], own.len());
    }
    text
}
