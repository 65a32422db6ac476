//! The README's table: one line a comparison.

use std::fmt;
use std::fs;

use wrenchd_tests::programs::workspace;
use wrenchd_tests::{Check, Failure, IoContext};

const BEGIN: &str = "<!-- benchmarks: written by `cargo bench -p wrenchd-tests --bench field` -->";
const END: &str = "<!-- /benchmarks -->";
const HEAD: &str = "| what | here | peer | ratio | goal |\n| --- | --- | --- | --- | --- |\n";

/// One comparison.
pub(crate) struct Line {
    what: String,
    here: String,
    peer: String,
    ratio: String,
    goal: String,
}

/// Runs of one program or of two in turns, by their middle, least and most.
#[derive(Clone, Copy)]
struct Spread([f64; 3]);

impl Spread {
    fn of(values: impl Iterator<Item = f64>) -> Self {
        let mut values: Vec<f64> = values.collect();
        values.sort_by(f64::total_cmp);
        let at = |k: usize| values.get(k).copied().unwrap_or(f64::NAN);
        Self([at(values.len() / 2), at(0), at(values.len().saturating_sub(1))])
    }
}

impl fmt::Display for Spread {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [middle, least, most] = self.0.map(short);
        write!(f, "{middle} ({least} to {most})")
    }
}

/// Three digits, whatever the size.
pub(crate) fn short(value: f64) -> String {
    let before = value.abs().max(1e-9).log10().floor() as i32;
    format!("{value:.*}", usize::try_from(2 - before).unwrap_or_default())
}

/// What is compared, and what for.
pub(crate) struct Compared {
    pub(crate) what: &'static str,
    pub(crate) peer: &'static str,
    pub(crate) unit: &'static str,
    /// What is hoped of the ratio.
    pub(crate) goal: &'static str,
}

impl Compared {
    /// Of the cost of both in turns, smaller being better: here over there.
    pub(crate) fn cost(&self, here: &[f64], there: &[f64]) -> Line {
        self.line(here, there, |here, there| here / there)
    }

    /// The same the other way round: how many times faster.
    pub(crate) fn speed(&self, here: &[f64], there: &[f64]) -> Line {
        self.line(here, there, |here, there| there / here)
    }

    fn line(&self, here: &[f64], there: &[f64], ratio: fn(f64, f64) -> f64) -> Line {
        let middle = |values: &[f64]| short(Spread::of(values.iter().copied()).0[0]);
        let ratios = Spread::of(here.iter().zip(there).map(|(here, there)| ratio(*here, *there)));
        Line {
            what: self.what.into(),
            here: format!("{} {}", middle(here), self.unit),
            peer: format!("{}: {} {}", self.peer, middle(there), self.unit),
            ratio: ratios.to_string(),
            goal: self.goal.into(),
        }
    }
}

impl Line {
    /// Something that has no peer.
    pub(crate) fn alone(what: &str, here: String) -> Self {
        Self { what: what.into(), here, peer: String::new(), ratio: String::new(), goal: String::new() }
    }

    /// What a line of the table is known by: what is compared with whom.
    fn key(line: &str) -> Option<(String, String)> {
        let cells: Vec<&str> = line.split('|').map(str::trim).collect();
        let peer = cells.get(3)?.split(':').next()?;
        Some(((*cells.get(1)?).to_owned(), peer.to_owned()))
    }
}

impl fmt::Display for Line {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { what, here, peer, ratio, goal } = self;
        write!(f, "| {what} | {here} | {peer} | {ratio} | {goal} |")
    }
}

/// Puts lines into the README's table, in place of those that compared the same.
pub(crate) fn keep(lines: &[Line]) -> Check {
    let path = workspace().join("README.md");
    let text = fs::read_to_string(&path).at("read", &path)?;
    let parts = text.split_once(BEGIN).and_then(|(before, rest)| Some((before, rest.split_once(END)?)));
    let (before, (table, after)) =
        parts.ok_or_else(|| Failure::new(format!("{} lacks the lines {BEGIN} and {END}", path.display())))?;
    let mut rows: Vec<String> =
        table.lines().filter(|line| line.starts_with('|')).skip(2).map(str::to_owned).collect();
    for line in lines.iter().map(ToString::to_string) {
        match rows.iter_mut().find(|row| Line::key(row) == Line::key(&line)) {
            Some(row) => *row = line,
            None => rows.push(line),
        }
    }
    let table = rows.join("\n");
    let temporary = path.with_extension("md.new");
    fs::write(&temporary, format!("{before}{BEGIN}\n{HEAD}{table}\n{END}{after}")).at("write", &temporary)?;
    fs::rename(&temporary, &path).at("replace", &path)
}
