//! The page of `validate --report`: the wrench beside the truth over time, errors of three methods, and what errors go with.

use calibration::Recording;
use calibration::validate::{Row, Validation};
use report::{Band, Chart, Grid, Heading, Ink, Page, Size, Text, Trace};
use rig::{ModelFile, Rig, Run};

use super::temperatures::Temperatures;
use super::timeline::Timeline;
use super::{MOST_CHARTS, left_out, scores};
use crate::Error;

/// Components of a wrench with their units; forces come first.
pub(super) const COMPONENTS: [(&str, &str); 6] =
    [("Fx", "N"), ("Fy", "N"), ("Fz", "N"), ("Tx", "Nm"), ("Ty", "Nm"), ("Tz", "Nm")];
/// Columns of the charts over time: about one a pixel.
const COLUMNS: usize = 900;
/// Instants further apart are not joined by a line, s.
const GAP_S: f64 = 0.5;
/// Still instants are averaged over so long for the charts of errors, s.
const BLOCK_S: f64 = 0.5;
/// The band about the estimate is so many reported standard deviations wide to either side.
const BAND_SIGMA: f64 = 2.0;

/// Takes in the scored instants one by one, in memory that does not grow with the recordings' rate.
pub struct Collector<'a> {
    rig: &'a Rig,
    recordings: Vec<&'a Recording>,
    temperatures: Vec<Temperatures>,
    timeline: Timeline,
    estimate: [Trace; 6],
    truth: [Trace; 6],
    band: [Band; 6],
    block: Block,
    blocks: Vec<Point>,
}

/// Still instants that are being averaged.
#[derive(Default)]
struct Block {
    from_s: f64,
    recording: usize,
    error: [f64; 6],
    force_n: f64,
    instant_ns: i64,
    n: f64,
}

/// A mean over still instants.
struct Point {
    error: [f64; 6],
    time_s: f64,
    force_n: f64,
    temperature_c: Option<f64>,
    pose_rad: Vec<f64>,
}

impl<'a> Collector<'a> {
    /// For the rows of these runs, in their order.
    pub fn new(rig: &'a Rig, runs: &'a [(&'a Run, Recording)]) -> Result<Self, Error> {
        let recordings: Vec<&Recording> = runs.iter().map(|(_, recording)| recording).collect();
        let timeline = Timeline::new(recordings.iter().copied());
        let temperatures =
            runs.iter().map(|(run, _)| Temperatures::read(run, rig)).collect::<Result<Vec<_>, _>>()?;
        let to_s = timeline.length_s();
        let trace = || std::array::from_fn(|_| Trace::new(0.0, to_s, COLUMNS, GAP_S));
        Ok(Self {
            rig,
            recordings,
            temperatures,
            timeline,
            estimate: trace(),
            truth: trace(),
            band: std::array::from_fn(|_| Band::new(0.0, to_s, COLUMNS)),
            block: Block::default(),
            blocks: Vec::new(),
        })
    }

    /// Takes in the next instant; excluded ones are not shown.
    pub fn add(&mut self, row: &Row) {
        let recording = self.timeline.recording_of(row.estimate.instant_ns, row.t_s);
        if self.recordings[recording].is_excluded(row.t_s) {
            return;
        }
        let time_s = self.timeline.at(recording, row.t_s);
        let truth = row.truth.to_vector();
        for k in 0..6 {
            self.truth[k].add(time_s, truth[k]);
        }
        let Ok(solution) = &row.estimate.outcome else {
            self.estimate.iter_mut().for_each(|trace| trace.add(time_s, f64::NAN));
            return self.finish_block();
        };
        let wrench = solution.wrench.to_vector();
        for k in 0..6 {
            let wide = BAND_SIGMA * solution.covariance[(k, k)].sqrt();
            self.estimate[k].add(time_s, wrench[k]);
            self.band[k].add(time_s, wrench[k] - wide, wrench[k] + wide);
        }
        let goes_on = self.block.n > 0.0
            && recording == self.block.recording
            && (0.0..BLOCK_S).contains(&(row.t_s - self.block.from_s));
        if !row.still || !goes_on {
            self.finish_block();
        }
        if row.still {
            if self.block.n == 0.0 {
                self.block = Block { from_s: row.t_s, recording, ..Block::default() };
            }
            self.block.n += 1.0;
            self.block.instant_ns = row.estimate.instant_ns;
            self.block.force_n += row.truth.force_n.norm();
            (0..6).for_each(|k| self.block.error[k] += wrench[k] - truth[k]);
        }
    }

    fn finish_block(&mut self) {
        let block = std::mem::take(&mut self.block);
        if block.n == 0.0 {
            return;
        }
        let recording = self.recordings[block.recording];
        let index = recording.at_ns.partition_point(|at| *at < block.instant_ns).min(recording.len() - 1);
        self.blocks.push(Point {
            error: block.error.map(|sum| sum / block.n),
            time_s: self.timeline.at(block.recording, block.from_s),
            force_n: block.force_n / block.n,
            temperature_c: self.temperatures[block.recording].mean(block.instant_ns),
            pose_rad: recording.positions_rad.iter().map(|q| q[index]).collect(),
        });
    }

    /// The whole page.
    pub fn page(mut self, result: &Validation, model: &ModelFile) -> Page {
        self.finish_block();
        let names: Vec<&str> = self.recordings.iter().map(|r| r.name.as_str()).collect();
        let source = &model.provenance;
        let subtitle = format!(
            "{} scored instants of {}; model of {} ({} axes, {})",
            result.all.n,
            names.join(", "),
            source.date,
            source.axes,
            source.tool
        );
        let mut page = Page::new("Validation", subtitle);
        scores::add_to(&mut page, result);
        self.over_time(&mut page);
        self.residuals(&mut page);
        page
    }

    fn over_time(&mut self, page: &mut Page) {
        page.add(Heading::section("Estimated against reference wrench"));
        page.add(Text::new(
            "The environment's wrench on the end-effector about the tip frame's origin, in its axes. The reference is the truth of the recording: the reference sensor and the known loads at the tip. Every sample is in the lines: where many fall on one place, the whole range between the lowest and the highest is drawn.",
        ));
        let take = |trace: &mut Trace| std::mem::replace(trace, Trace::of(&[]));
        for (k, (name, unit)) in COMPONENTS.into_iter().enumerate() {
            let quantity = if k < 3 { "force" } else { "moment" };
            let chart = Chart::new(name, self.timeline.axis(), format!("{quantity}, {unit}"), Size::Wide)
                .band(
                    format!("estimate \u{b1} {BAND_SIGMA} reported deviations"),
                    Ink::Series(1),
                    std::mem::replace(&mut self.band[k], Band::new(0.0, 0.0, 1)),
                )
                .line("estimate", Ink::Series(1), take(&mut self.estimate[k]))
                .line("reference", Ink::Series(0), take(&mut self.truth[k]));
            page.add(self.timeline.mark(chart));
        }
    }

    fn residuals(&self, page: &mut Page) {
        page.add(Heading::section("What the errors go with"));
        if self.blocks.is_empty() {
            page.add(Text::new(
                "The arm never holds still in these recordings: there is nothing to show here.",
            ));
            return;
        }
        page.add(Text::new(format!(
            "Force estimated less force of the reference, still instants averaged over {BLOCK_S} s. A slope or a curve is something that the model does not know.",
        )));
        let mut grid = Grid::default()
            .with(self.errors_over("Over load", "force of the reference, N", &|p| Some(p.force_n)))
            .with(self.errors_over("Over time", self.timeline.axis(), &|p| Some(p.time_s)));
        let warm = self.blocks.iter().any(|p| p.temperature_c.is_some());
        if warm {
            let axis = "mean of the gauges' thermometers, \u{b0}C";
            grid = grid.with(self.errors_over("Over temperature", axis, &|p| p.temperature_c));
        }
        page.add(grid);
        if !warm {
            page.add(Text::new("No gauge of this arm sends a temperature."));
        }
        page.add(Heading::small("Over pose"));
        let joints = self.rig.chain.coordinate_names();
        page.add(joints.iter().take(MOST_CHARTS).enumerate().fold(Grid::default(), |grid, (k, joint)| {
            let title = format!("Over {joint}");
            grid.with(self.errors_over(&title, "angle, rad", &|p| p.pose_rad.get(k).copied()))
        }));
        if let Some(text) = left_out(joints.len(), "joints") {
            page.add(text);
        }
    }

    fn errors_over(&self, title: &str, axis: &str, x: &dyn Fn(&Point) -> Option<f64>) -> Chart {
        let chart = Chart::new(title, axis, "force error, N", Size::Small).level(0.0);
        (0..3).fold(chart, |chart, k| {
            let points: Vec<(f64, f64)> =
                self.blocks.iter().filter_map(|p| Some((x(p)?, p.error[k]))).collect();
            chart.dots(COMPONENTS[k].0, Ink::Series(k), &points)
        })
    }
}
