//! What a calibration leaves of the gauges' readings, over everything that it could go with.

use calibration::dataset::{Dataset, Window};
use calibration::{Calibration, Recording};
use nalgebra::Vector6;
use report::{Bars, Chart, Grid, Heading, Heat, Ink, Page, Size, Text};
use rig::Rig;
use rig::model_file::Sensor;

use super::joints::share_of_angle;
use super::temperatures::Temperatures;
use super::timeline::Timeline;
use super::{MOST_CHARTS, root_mean_square};

/// The methods that are compared, as legends name them; the same order as [`methods`].
const METHODS: [&str; 3] = ["nominal axes", "five parameters", "this model"];
const OURS: usize = 2;

/// What is left of one gauge in one held pose.
struct Left {
    window: usize,
    /// Mean residual under each method, in noise floors.
    residual: [f64; 3],
    /// What the gauge senses there under this model, Nm about its sensing line.
    sensed_nm: f64,
    temperature_c: Option<f64>,
}

/// What is left of every gauge in every held pose.
pub struct Residuals<'a> {
    rig: &'a Rig,
    sensors: &'a [Sensor],
    dataset: &'a Dataset,
    timeline: Timeline,
    left: Vec<Vec<Left>>,
}

/// Compliance and bias of a gauge under each method.
fn methods(sensor: &Sensor) -> [(Vector6<f64>, f64); 3] {
    let (nominal, five) = (&sensor.nominal_axes, &sensor.five_parameter);
    let torque_only = Vector6::new(0.0, 0.0, 0.0, 0.0, 0.0, nominal.k_counts_per_nm);
    [
        (torque_only, nominal.bias_counts),
        (five.compliance().vector(), five.bias_counts),
        (sensor.working(), sensor.bias_counts),
    ]
}

fn left_of(
    dataset: &Dataset,
    recordings: &[Recording],
    temperatures: &[Temperatures],
    gauge: usize,
    result: &Calibration,
) -> Vec<Left> {
    let sensor = &result.model.sensors[gauge];
    let methods = methods(sensor);
    let scale = methods[OURS].0.fixed_rows::<3>(3).norm();
    let mean = |window: &Window, compliance: &Vector6<f64>, bias: f64| {
        let all = (0..window.times_s.len())
            .filter_map(|k| Some(window.counts[gauge][k]? - bias - compliance.dot(&window.load(gauge, k))));
        let (sum, n) = all.fold((0.0, 0.0), |(sum, n), v| (sum + v, n + 1.0));
        (n > 0.0).then(|| sum / n)
    };
    let mut out: Vec<Left> = Vec::with_capacity(dataset.windows.len());
    for (index, window) in dataset.windows.iter().enumerate() {
        let of_method = |(compliance, bias): &(Vector6<f64>, f64)| mean(window, compliance, *bias);
        let [Some(a), Some(b), Some(own)] = methods.each_ref().map(of_method) else { continue };
        // A model that also corrects the arm and has terms leaves what the calibration itself found to be left.
        let Some(c) = result.left_counts.as_ref().map_or(Some(own), |left| left[gauge][index]) else {
            continue;
        };
        let middle = window.times_s.len() / 2;
        let at_ns = recordings[window.recording].start_ns + (window.times_s[middle] * 1e9) as i64;
        out.push(Left {
            window: index,
            residual: [a, b, c].map(|counts| counts / sensor.noise_floor_counts),
            sensed_nm: methods[OURS].0.dot(&window.load(gauge, middle)) / scale,
            temperature_c: temperatures[window.recording].at(at_ns, gauge),
        });
    }
    // The model has the zeros of the last session; the others' are taken out of what is left.
    for session in 0..dataset.sessions.len().saturating_sub(1) {
        for method in 0..METHODS.len() {
            let of_session = |l: &&mut Left| dataset.windows[l.window].session == session;
            let values: Vec<f64> = out.iter_mut().filter(of_session).map(|l| l.residual[method]).collect();
            let mean = values.iter().sum::<f64>() / values.len().max(1) as f64;
            out.iter_mut().filter(of_session).for_each(|l| l.residual[method] -= mean);
        }
    }
    out
}

impl<'a> Residuals<'a> {
    /// Of a calibration's gauges in the held poses of its dataset of `recordings`.
    pub fn new(
        rig: &'a Rig,
        result: &'a Calibration,
        dataset: &'a Dataset,
        recordings: &[Recording],
        temperatures: &[Temperatures],
    ) -> Self {
        let sensors = result.model.sensors.as_slice();
        let of = |gauge| left_of(dataset, recordings, temperatures, gauge, result);
        Self {
            rig,
            sensors,
            dataset,
            timeline: Timeline::new(recordings.iter()),
            left: (0..sensors.len()).map(of).collect(),
        }
    }

    /// RMS over all gauges and held poses under each method (nominal, five parameters, this model), noise floors.
    pub fn overall(&self) -> [Option<f64>; 3] {
        std::array::from_fn(|method| root_mean_square(self.left.iter().flatten().map(|l| l.residual[method])))
    }

    /// Puts them onto a page.
    pub fn add_to(&self, page: &mut Page) {
        page.add(Heading::section("What is left of the readings"));
        page.add(Text::new(
            "Reading less prediction as a mean over each held pose, in units of the gauge's noise floor. What is left should look like noise: a slope or a curve is something that the model does not know.",
        ));
        let bars = Bars::new("Residuals of held poses, RMS", "noise floors", &METHODS);
        page.add(self.sensors.iter().zip(&self.left).fold(bars, |bars, (sensor, left)| {
            let rms = |method: usize| root_mean_square(left.iter().map(|l| l.residual[method]));
            bars.row(sensor.name.clone(), &[rms(0), rms(1), rms(2)])
        }));
        page.add(Heading::small("Over load"));
        page.add(self.charts(
            "load",
            |_| "torque about the actual axis, Nm".to_owned(),
            |_, l| Some(l.sensed_nm),
        ));
        page.add(Heading::small("Over time"));
        page.add(self.charts("time", |_| self.timeline.axis().to_owned(), |_, l| self.begins_s(l)));
        page.add(Heading::small("Over temperature"));
        if self.left.iter().flatten().any(|l| l.temperature_c.is_some()) {
            page.add(self.charts(
                "temperature",
                |_| "temperature, \u{b0}C".to_owned(),
                |_, l| l.temperature_c,
            ));
        } else {
            page.add(Text::new("No gauge of this arm sends a temperature."));
        }
        self.add_over_pose(page);
    }

    /// How much of what is left each joint's angle explains, and each gauge over the joint that explains most.
    fn add_over_pose(&self, page: &mut Page) {
        page.add(Heading::small("Over pose"));
        let joints = self.rig.chain.coordinate_names();
        let columns = joints.iter().map(|joint| (*joint).to_owned());
        let mut heat = Heat::new("Share of the residuals' variance that goes with a joint's angle", columns)
            .remark("per cent")
            .full(100.0);
        let mut most = Vec::with_capacity(self.sensors.len());
        for (sensor, left) in self.sensors.iter().zip(&self.left) {
            let values: Vec<f64> = left.iter().map(|l| l.residual[OURS]).collect();
            let share = |joint: usize| {
                let angles: Vec<f64> = left.iter().map(|l| self.angle_rad(l, joint)).collect();
                share_of_angle(&angles, &values).map(|share| 100.0 * share)
            };
            let shares: Vec<Option<f64>> = (0..joints.len()).map(share).collect();
            let size = |joint: &usize| shares[*joint].unwrap_or(0.0);
            most.push((0..joints.len()).max_by(|a, b| size(a).total_cmp(&size(b))).unwrap_or(0));
            heat.row(sensor.name.clone(), shares);
        }
        page.add(heat);
        page.add(Text::new("Each gauge over the joint that explains most of what it has left:"));
        let axis = |gauge: usize| format!("{}, rad", joints.get(most[gauge]).copied().unwrap_or("no joint"));
        page.add(self.charts("pose", axis, |gauge, l| Some(self.angle_rad(l, most[gauge]))));
    }

    fn angle_rad(&self, left: &Left, joint: usize) -> f64 {
        self.dataset.windows[left.window].pose_rad[joint]
    }

    /// When a held pose begins on the common axis of time, s.
    fn begins_s(&self, left: &Left) -> Option<f64> {
        let window = &self.dataset.windows[left.window];
        Some(self.timeline.at(window.recording, *window.times_s.first()?))
    }

    /// A chart for each gauge over something, with the name of the axis.
    fn charts(
        &self,
        name: &str,
        axis: impl Fn(usize) -> String,
        x: impl Fn(usize, &Left) -> Option<f64>,
    ) -> Grid {
        let each = self.sensors.iter().zip(&self.left).take(MOST_CHARTS).enumerate();
        each.fold(Grid::default(), |grid, (gauge, (sensor, left))| {
            let points: Vec<(f64, f64)> =
                left.iter().filter_map(|l| Some((x(gauge, l)?, l.residual[OURS]))).collect();
            let title = format!("{} over {name}", sensor.name);
            let chart = Chart::new(title, axis(gauge), "residual, noise floors", Size::Small);
            grid.with(chart.dots("held pose", Ink::Series(gauge), &points).level(0.0))
        })
    }
}
