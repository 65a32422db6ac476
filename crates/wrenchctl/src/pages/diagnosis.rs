//! The page of `diagnose --report`: the verdict, what the gap consists of, where it lies, what else it could be, what to do next.

use gap::Diagnosis;
use gap::diagnosis::{Bin, Loop, LoopPoint, Verdict};
use report::{Bars, Cell, Chart, Grid, Heading, Heat, Ink, List, Page, Size, Table, Text, Trace, Waterfall};

/// Most quantities over which the gap is shown.
const MOST_PROFILES: usize = 24;

/// The page of a diagnosis of `what`.
pub fn page(diagnosis: &Diagnosis, what: &str) -> Page {
    let mut page = Page::new("Simulation and measurement", what);
    page.add(Text::new(verdict(diagnosis)));
    page.add(Text::new(diagnosis.hold_out.clone()));
    if diagnosis.gap.shrink.is_some() {
        page.add(waterfall(diagnosis));
    }
    page.add(Heading::section("Causes"));
    if diagnosis.findings.is_empty() {
        page.add(Text::new("No effect of the catalogue was established."));
    }
    page.add(List::new(
        diagnosis.findings.iter().map(|finding| format!("{}: {}", finding.effect, finding.words)),
    ));
    page.add(leaderboard(diagnosis));
    page.add(parameters(diagnosis));
    page.add(Heading::section("Where"));
    page.add(sensors(diagnosis));
    if !diagnosis.location.sensor_by_joint.is_empty() {
        page.add(map(diagnosis));
    }
    if !diagnosis.location.loops.is_empty() {
        page.add(Heading::small("Loops"));
        page.add(
            diagnosis.location.loops.iter().fold(Grid::default(), |grid, one| grid.with(hysteresis(one))),
        );
    }
    let spectra: Vec<Vec<&Bin>> = orders(diagnosis);
    if !spectra.is_empty() {
        page.add(Heading::small("Orders"));
        page.add(spectra.iter().fold(Grid::default(), |grid, bins| grid.with(spectrum(bins))));
    }
    page.add(Heading::small("Over what is known at every instant"));
    let mut grid = Grid::default();
    for (key, bins) in profiles(diagnosis).into_iter().take(MOST_PROFILES) {
        grid = grid.with(profile(key, &bins));
    }
    page.add(grid);
    page.add(Heading::section("What these recordings leave open"));
    let blind = diagnosis
        .not_testable
        .iter()
        .map(|entry| format!("{} cannot be seen: {}", entry.effect, entry.missing));
    page.add(List::new(blind.chain(diagnosis.notes.iter().cloned())));
    page.add(Text::new(format!("Record next: {}", diagnosis.next_experiment)));
    page
}

fn verdict(diagnosis: &Diagnosis) -> String {
    let gap = &diagnosis.gap;
    let shrink = gap.shrink.map_or_else(String::new, |shrink| {
        let interval = gap.shrink_ci95.map_or_else(String::new, |[low, high]| {
            format!(" (95 % interval {:.1} to {:.1} %)", 100.0 * low, 100.0 * high)
        });
        format!("; {:.1} % of what can go away goes{interval}", 100.0 * shrink)
    });
    let verdict = match diagnosis.verdict {
        Verdict::NoGap => {
            "No gap: the simulation agrees with the measurement within noise and its own uncertainty"
        }
        Verdict::Explained => "Explained",
        Verdict::PartlyExplained => "Partly explained",
        Verdict::Unexplained => "Unexplained: no effect of the catalogue is the cause",
    };
    format!(
        "{verdict}. On what was left out, over noise: {:.2} before, {:.2} after, {:.2} is noise{shrink}.",
        gap.before, gap.after, gap.floor
    )
}

/// From the gap to the floor, effect by effect, in mean squares: those add up.
fn waterfall(diagnosis: &Diagnosis) -> Waterfall {
    let gap = &diagnosis.gap;
    let reducible = gap.before * gap.before - gap.floor * gap.floor;
    let start = ("as simulated", gap.before * gap.before);
    let mut waterfall =
        Waterfall::new("What the gap consists of", "mean square over noise", start, "with all found")
            .remark(format!("{:.3} of it is noise.", gap.floor * gap.floor));
    for finding in &diagnosis.findings {
        waterfall = waterfall.step(finding.effect.clone(), -finding.share * reducible);
    }
    waterfall
}

fn leaderboard(diagnosis: &Diagnosis) -> Table {
    let columns = [
        ("effect", ""),
        ("share", "%"),
        ("from", "%"),
        ("to", "%"),
        ("confidence", ""),
        ("not to be told from", ""),
    ];
    let mut table = Table::new("Effects that were established", &columns);
    for finding in &diagnosis.findings {
        let [low, high] = finding.share_ci95;
        table.row([
            Cell::from(finding.effect.clone()),
            Cell::Number(Some(100.0 * finding.share), 3),
            Cell::Number(Some(100.0 * low), 3),
            Cell::Number(Some(100.0 * high), 3),
            Cell::Number(Some(finding.confidence), 2),
            Cell::from(finding.indistinguishable_from.join(", ")),
        ]);
    }
    table
}

fn parameters(diagnosis: &Diagnosis) -> Table {
    let columns = [("effect", ""), ("parameter", ""), ("value", ""), ("sigma", ""), ("unit", "")];
    let mut table = Table::new("Their parameters", &columns);
    for finding in &diagnosis.findings {
        for (name, parameter) in &finding.parameters {
            table.row([
                Cell::from(finding.effect.clone()),
                Cell::from(name.clone()),
                Cell::Number(Some(parameter.value), 4),
                Cell::Number(parameter.sigma, 2),
                Cell::from(parameter.unit.clone()),
            ]);
        }
    }
    table
}

fn sensors(diagnosis: &Diagnosis) -> Bars {
    let series = ["before", "after", "noise"];
    let mut bars = Bars::new("By channel", "RMS over noise", &series).remark("On what was left out.");
    for sensor in &diagnosis.location.sensors {
        bars = bars.row(sensor.name.clone(), &[Some(sensor.before), Some(sensor.after), Some(sensor.floor)]);
    }
    bars
}

/// Channels by joints: how much of each channel's gap goes with each joint's angle.
fn map(diagnosis: &Diagnosis) -> Heat {
    let entries = &diagnosis.location.sensor_by_joint;
    let mut joints: Vec<&str> = Vec::new();
    let mut sensors: Vec<&str> = Vec::new();
    for entry in entries {
        if !joints.contains(&entry.joint.as_str()) {
            joints.push(&entry.joint);
        }
        if !sensors.contains(&entry.sensor.as_str()) {
            sensors.push(&entry.sensor);
        }
    }
    let mut map =
        Heat::new("Gap that goes with a joint's angle, %", joints.iter().map(|name| (*name).to_owned()))
            .remark("Share of each channel's mean square, as simulated.")
            .full(100.0);
    for sensor in sensors {
        let share = |joint: &&str| {
            let own = entries.iter().find(|entry| entry.sensor == sensor && entry.joint == **joint);
            own.map(|entry| 100.0 * entry.before)
        };
        map.row(sensor, joints.iter().map(share));
    }
    map
}

/// The gap over one quantity after the other, those over which it changes most first.
fn profiles(diagnosis: &Diagnosis) -> Vec<(&str, Vec<&Bin>)> {
    let mut all: Vec<(&str, Vec<&Bin>)> = Vec::new();
    for (key, bins) in diagnosis.location.profiles.iter().filter(|(key, _)| *key != "order") {
        for bin in bins {
            match all.iter_mut().find(|(known, list)| known == key && list[0].name == bin.name) {
                Some((_, list)) => list.push(bin),
                None => all.push((key, vec![bin])),
            }
        }
    }
    let spread = |bins: &[&Bin]| {
        let values = || bins.iter().map(|bin| bin.before);
        values().fold(0.0, f64::max) - values().fold(f64::INFINITY, f64::min)
    };
    all.sort_by(|a, b| spread(&b.1).total_cmp(&spread(&a.1)));
    all
}

fn profile(key: &str, bins: &[&Bin]) -> Bars {
    let first = bins[0];
    let title = if first.name == key { key.to_owned() } else { format!("{key}: {}", first.name) };
    let mut bars = Bars::new(title, "RMS over noise", &["before", "after"]);
    for bin in bins {
        let name = format!("{} to {} {}", report::number(bin.from, 3), report::number(bin.to, 3), bin.unit);
        bars = bars.row(name, &[Some(bin.before), Some(bin.after)]);
    }
    bars
}

/// A channel's gap where a quantity rises and where it falls.
fn hysteresis(one: &Loop) -> Chart {
    let title = if one.over == one.sensor {
        format!("{} over its own signal", one.sensor)
    } else {
        format!("{} over {}", one.sensor, one.over)
    };
    let axis = format!("{}, {}", one.over, one.unit);
    let trace = |of: fn(&LoopPoint) -> Option<f64>| {
        let points: Vec<(f64, f64)> = one.points.iter().filter_map(|p| Some((p.at, of(p)?))).collect();
        Trace::of(&points)
    };
    Chart::new(title, axis, "mean gap over noise", Size::Small)
        .level(0.0)
        .line("rising", Ink::Series(0), trace(|p| p.rising_before))
        .line("falling", Ink::Series(1), trace(|p| p.falling_before))
        .line("rising, with all found", Ink::Series(2), trace(|p| p.rising_after))
        .line("falling, with all found", Ink::Series(3), trace(|p| p.falling_after))
}

/// A band of orders tells something where its wave is so many times as strong as the others, and so large over noise.
const STANDS_OUT: f64 = 3.0;
const WORTH_SHOWING: f64 = 0.1;

/// The bands of the joints in whose turns something ripples.
fn orders(diagnosis: &Diagnosis) -> Vec<Vec<&Bin>> {
    let all = diagnosis.location.profiles.get("order").map_or(&[][..], Vec::as_slice);
    let mut joints: Vec<Vec<&Bin>> = Vec::new();
    for bin in all {
        match joints.iter_mut().find(|own| own[0].name == bin.name) {
            Some(own) => own.push(bin),
            None => joints.push(vec![bin]),
        }
    }
    let tells = |bins: &Vec<&Bin>| {
        // The lower half is where slow things leak into.
        let mut upper: Vec<f64> = bins[bins.len() / 2..].iter().map(|bin| bin.before).collect();
        upper.sort_by(f64::total_cmp);
        let (middle, most) = (upper[upper.len() / 2], upper[upper.len() - 1]);
        let is_found = diagnosis
            .findings
            .iter()
            .any(|finding| finding.effect == "torque_ripple" && finding.joints.contains(&bins[0].name));
        is_found || (most > STANDS_OUT * middle && most > WORTH_SHOWING)
    };
    joints.into_iter().filter(tells).collect()
}

fn spectrum(bins: &[&Bin]) -> Chart {
    let trace = |of: fn(&Bin) -> f64| {
        let points: Vec<(f64, f64)> = bins.iter().map(|bin| ((bin.from + bin.to) / 2.0, of(bin))).collect();
        Trace::of(&points)
    };
    let title = format!("Turns of {}", bins[0].name);
    Chart::new(title, "cycles per turn", "strongest wave, RMS over noise", Size::Small)
        .line("before", Ink::Series(0), trace(|bin| bin.before))
        .line("after", Ink::Series(1), trace(|bin| bin.after))
}
