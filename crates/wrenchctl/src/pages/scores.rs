//! Errors of the three methods as sentences, table and bars.

use calibration::validate::{Score, Validation};
use report::{Bars, Cell, Grid, Heading, List, Page, Table, Text, number};

use super::validation::COMPONENTS;

/// Puts the scores onto a page: in short, then in full.
pub fn add_to(page: &mut Page, result: &Validation) {
    in_short(page, result);
    errors(page, result);
}

fn in_short(page: &mut Page, result: &Validation) {
    if let Some(ours) = result.still.force_rms_all_n {
        let mut words = format!("Force RMS of still instants: {} N", number(ours, 3));
        if let Some(percent) = result.still.force_rms_percent_fs {
            words += &format!(
                " ({} % of the {} N in the recording)",
                number(percent, 2),
                number(result.full_scale_n, 3)
            );
        }
        for (name, baseline) in
            [("five parameters", &result.five_parameter), ("nominal axes", &result.nominal_axes)]
        {
            if let Some(theirs) = baseline.still.force_rms_all_n {
                words += &format!("; {} N with {name}", number(theirs, 3));
            }
        }
        page.add(Text::new(words + "."));
    }
    let status: Vec<String> = result.status.iter().map(|(name, n)| format!("{n} {name}")).collect();
    page.add(Text::new(format!("Status of the scored instants: {}.", status.join(", "))));
}

fn errors(page: &mut Page, result: &Validation) {
    page.add(Heading::section("Errors"));
    let mut table = Table::new(
        "Root mean square of estimate less reference",
        &[
            ("method", ""),
            ("instants", ""),
            ("n", ""),
            ("force", "N"),
            ("Fx", "N"),
            ("Fy", "N"),
            ("Fz", "N"),
            ("torque", "mNm"),
            ("Tx", "mNm"),
            ("Ty", "mNm"),
            ("Tz", "mNm"),
        ],
    );
    let (five, nominal) = (&result.five_parameter, &result.nominal_axes);
    let methods = [
        ("nominal axes", [&nominal.still, &nominal.moving, &nominal.all]),
        ("five parameters", [&five.still, &five.moving, &five.all]),
        ("this model", [&result.still, &result.moving, &result.all]),
    ];
    for (name, scores) in methods {
        for (which, score) in ["still", "moving", "all"].into_iter().zip(scores) {
            table.row(error_row(name, which, score));
        }
    }
    page.add(table);
    let still = methods.map(|(_, [still, ..])| still);
    let bars = |title: &str, unit: &str, values: &dyn Fn(&Score, usize) -> Option<f64>, first: usize| {
        let bars = Bars::new(title, unit, &methods.map(|(name, _)| name));
        (0..3).fold(bars, |bars, k| bars.row(COMPONENTS[first + k].0, &still.map(|score| values(score, k))))
    };
    let force = |score: &Score, k: usize| score.force_rms_n.map(|f| f[k]);
    let torque = |score: &Score, k: usize| score.torque_rms_nm.map(|t| 1e3 * t[k]);
    page.add(Grid::broad().with(bars("Force RMS, still", "N", &force, 0)).with(bars(
        "Torque RMS, still",
        "mNm",
        &torque,
        3,
    )));
    honesty(page, result);
}

fn error_row(name: &str, which: &str, score: &Score) -> Vec<Cell> {
    let mut row = vec![Cell::from(name), Cell::from(which), Cell::Right(score.n.to_string())];
    row.push(Cell::Number(score.force_rms_all_n, 3));
    row.extend((0..3).map(|k| Cell::Number(score.force_rms_n.map(|f| f[k]), 3)));
    row.push(Cell::Number(score.torque_rms_all_nm.map(|t| 1e3 * t), 3));
    row.extend((0..3).map(|k| Cell::Number(score.torque_rms_nm.map(|t| 1e3 * t[k]), 3)));
    row
}

/// Whether errors are as large as reported.
fn honesty(page: &mut Page, result: &Validation) {
    let columns: Vec<(&str, &str)> =
        [("instants", "")].into_iter().chain(COMPONENTS.map(|(name, _)| (name, ""))).collect();
    let mut table = Table::new("Squared error over reported variance (nees): 1 is honest", &columns);
    for (which, score) in [("still", &result.still), ("moving", &result.moving)] {
        let Some(nees) = score.nees else { continue };
        let cells = nees.map(|n| Cell::Judged(Some(n), 2, (0.5..=2.0).contains(&n)));
        table.row([Cell::from(which)].into_iter().chain(cells));
    }
    page.add(table);
    let over = result.still.nees.is_some_and(|nees| nees.iter().any(|n| *n > 2.0));
    page.add(List::new(over.then(|| {
        "Errors are larger than the reported deviations allow: the model leaves something out, or the truth is off.".to_owned()
    })));
}
