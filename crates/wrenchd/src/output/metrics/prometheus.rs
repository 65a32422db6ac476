//! The Prometheus text format, version 0.0.4 (prometheus.io/docs/instrumenting/exposition_formats).

use std::fmt::{Display, Write};

use crate::board::GaugeReadback;
use crate::histogram::{BOUNDS_NS, Distribution};
use crate::network::Shared;
use crate::published::Published;
use crate::realtime::SystemClock;
use crate::station::Clock;
use crate::view::state_name;

const AXES: [(&str, &str); 6] =
    [("fx", "N"), ("fy", "N"), ("fz", "N"), ("tx", "Nm"), ("ty", "Nm"), ("tz", "Nm")];

/// Bits of the status that are published, from bit 0 up.
const STATUS_BITS: [&str; 7] = ["invalid", "degraded", "saturated", "stale", "uncertain", "parity", "tared"];

/// Families of samples, one after the other.
#[derive(Default)]
struct Text(String);

impl Text {
    /// Begins a family.
    fn family(&mut self, name: &str, kind: &str, words: &str) -> Family<'_> {
        // Writing to a string does not fail.
        let _ = writeln!(self.0, "# HELP wrenchd_{name} {words}\n# TYPE wrenchd_{name} {kind}");
        Family { text: &mut self.0, name: name.to_owned() }
    }

    fn gauge(&mut self, name: &str, words: &str, value: impl Display) {
        self.family(name, "gauge", words).sample("", &[], value);
    }
}

struct Family<'a> {
    text: &'a mut String,
    name: String,
}

impl Family<'_> {
    fn sample(&mut self, suffix: &str, labels: &[(&str, &str)], value: impl Display) {
        let labels: Vec<String> =
            labels.iter().map(|(key, value)| format!("{key}=\"{}\"", escaped(value))).collect();
        let labels = if labels.is_empty() { String::new() } else { format!("{{{}}}", labels.join(",")) };
        let _ = writeln!(self.text, "wrenchd_{}{suffix}{labels} {value}", self.name);
    }

    fn histogram(&mut self, distribution: &Distribution) {
        let mut below = 0;
        for (count, bound_ns) in distribution.classes.iter().zip(BOUNDS_NS) {
            below += count;
            let bound_s = (bound_ns as f64 * 1e-9).to_string();
            self.sample("_bucket", &[("le", &bound_s)], below);
        }
        self.sample("_bucket", &[("le", "+Inf")], distribution.count());
        self.sample("_sum", &[], distribution.sum_ns as f64 * 1e-9);
        self.sample("_count", &[], distribution.count());
    }
}

fn escaped(text: &str) -> String {
    text.replace('\\', "\\\\").replace('"', "\\\"").replace('\n', "\\n")
}

/// Everything that is measured.
pub(super) fn text(shared: &Shared) -> String {
    let robot = shared.robot.borrow().clone();
    let mut text = Text::default();
    let mut about = text.family("info", "gauge", "What runs; the value is 1.");
    let labels =
        [("version", env!("CARGO_PKG_VERSION")), ("model_sha256", &robot.model_sha256), ("mode", robot.mode)];
    about.sample("", &labels, 1);
    text.gauge("uptime_seconds", "Time since the start.", shared.started.elapsed().as_secs_f64());
    for counter in shared.health.named() {
        let name = format!("{}_total", counter.name);
        text.family(&name, "counter", counter.words).sample("", &[], counter.value);
    }
    let pulse = *shared.pulse.borrow();
    text.gauge("published_hertz", "Records published in the last second.", pulse.published_hz);
    text.gauge("frames_hertz", "Frames received in the last second.", pulse.frames_hz);
    let histograms = [
        (
            "latency_seconds",
            "From a last frame's stamp to the publication of what it completed.",
            &shared.health.latency,
        ),
        ("age_seconds", "From the instant of a published wrench to its publication.", &shared.health.age),
        (
            "lateness_seconds",
            "Fixed mode: from a point of the grid to the cycle's waking up.",
            &shared.health.lateness,
        ),
    ];
    for (name, words, histogram) in histograms {
        text.family(name, "histogram", words).histogram(&histogram.read());
    }
    let valid = shared.healthy().is_ok();
    text.gauge("healthy", "1 while valid wrenches are published.", u8::from(valid));
    if let Some(record) = shared.newest() {
        wrench(&mut text, &record);
    }
    let gauges: Vec<(&String, GaugeReadback)> = robot.gauges.iter().zip(robot.board.gauges()).collect();
    sensors(&mut text, &gauges);
    let now_ns = SystemClock.now().monotonic_ns;
    let age_s = robot.board.tared().map_or(0.0, |at| (now_ns - at.monotonic_ns) as f64 * 1e-9);
    text.gauge("tare_age_seconds", "Age of the tare that is applied; 0 without one.", age_s);
    text.gauge("payload_kilograms", "Mass of the payload that is subtracted.", robot.board.payload().mass_kg);
    text.0
}

fn wrench(text: &mut Text, record: &Published) {
    let mut bits = text.family("status", "gauge", "Bits of the newest record's status.");
    for (bit, name) in STATUS_BITS.iter().enumerate() {
        bits.sample("", &[("bit", name)], record.status.bits() >> bit & 1);
    }
    // Without a wrench there are no samples: never a stale or a zero one.
    let Ok(solution) = record.outcome else { return };
    let values = solution.wrench.to_vector();
    let mut newest = text.family("wrench", "gauge", "Environment's wrench about the tip's origin, tip axes.");
    for (k, (axis, unit)) in AXES.iter().enumerate() {
        newest.sample("", &[("axis", axis), ("unit", unit)], values[k]);
    }
    let mut sigma = text.family("wrench_sigma", "gauge", "Standard deviation of the wrench.");
    for (k, (axis, unit)) in AXES.iter().enumerate() {
        sigma.sample("", &[("axis", axis), ("unit", unit)], solution.covariance[(k, k)].max(0.0).sqrt());
    }
    let mut protection = text.family(
        "wrench_protection",
        "gauge",
        "Largest error that one faulty gauge can hide from the spare ones; +Inf where it can hide anything.",
    );
    for (k, (axis, unit)) in AXES.iter().enumerate() {
        let level = solution.protection[k];
        let words = if level.is_finite() { level.to_string() } else { "+Inf".to_owned() };
        protection.sample("", &[("axis", axis), ("unit", unit)], words);
    }
    let worst_n = 1.0 / solution.singular_values_per_n[5];
    text.gauge(
        "worst_sigma_newtons",
        "Standard deviation of the worst direction, moments over 0.1 m.",
        worst_n,
    );
    text.gauge("parity_chi2", "Sum of squares of the parity residual in sigmas.", solution.parity_chi2);
    text.gauge("parity_dof", "Spare gauges: what parity_chi2 is expected to be.", solution.parity_dof);
}

fn sensors(text: &mut Text, gauges: &[(&String, GaugeReadback)]) {
    let mut used =
        text.family("gauge_used", "gauge", "1 where the gauge is part of the newest wrench; its state.");
    for (name, gauge) in gauges {
        let is_used = gauge.state == rig::cycle::GaugeState::Used;
        used.sample("", &[("gauge", name), ("state", &state_name(gauge.state))], u8::from(is_used));
    }
    let mut suspect =
        text.family("gauge_suspect", "gauge", "1 where the gauges disagree and this one may be at fault.");
    for (name, gauge) in gauges {
        suspect.sample("", &[("gauge", name)], u8::from(gauge.suspect));
    }
    type Part = fn(&GaugeReadback) -> f64;
    let families: [(&str, &str, Part); 3] = [
        ("gauge_counts", "Last reading that was used.", |gauge| gauge.counts),
        ("gauge_residual_sigma", "The gauge's part of the parity residual.", |gauge| gauge.residual_sigma),
        ("gauge_zero_shift_counts", "What a tare subtracts.", |gauge| gauge.zero_shift_counts),
    ];
    for (name, words, part) in families {
        let mut family = text.family(name, "gauge", words);
        for (gauge, readback) in gauges {
            family.sample("", &[("gauge", gauge)], part(readback));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_that_would_break_the_format_are_escaped() {
        let mut text = Text::default();
        text.family("x", "gauge", "A thing.").sample("_y", &[("gauge", "a\"b\\c\nd"), ("k", "v")], 1.5);
        assert_eq!(
            text.0,
            "# HELP wrenchd_x A thing.\n# TYPE wrenchd_x gauge\nwrenchd_x_y{gauge=\"a\\\"b\\\\c\\nd\",k=\"v\"} 1.5\n"
        );
    }

    #[test]
    fn a_histogram_accumulates() {
        let histogram = crate::histogram::Histogram::default();
        [5_000, 15_000, 3_000_000_000].iter().for_each(|ns| histogram.note(*ns));
        let mut text = Text::default();
        text.family("h", "histogram", "H.").histogram(&histogram.read());
        for line in [
            "_bucket{le=\"0.00001\"} 1\n",
            "_bucket{le=\"0.00002\"} 2\n",
            "_bucket{le=\"1\"} 2\n",
            "_bucket{le=\"+Inf\"} 3\n",
            "_sum 3.00002\n",
            "_count 3\n",
        ] {
            assert!(text.0.contains(line), "{line}: {}", text.0);
        }
    }
}
