//! What the terminal shows, as a function of what was heard.

use std::collections::VecDeque;

use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Modifier, Style};
use ratatui::symbols::Marker;
use ratatui::text::{Line, Span};
use ratatui::widgets::{Axis, Block, Cell, Chart, Dataset, GraphType, Paragraph, Row, Table};
use wrenchd::control::Reply;
use wrenchd::view::{DaemonStatus, Gauge, Live};

use crate::Error;

/// Time that a trace shows, s.
const TRACE_S: f64 = 20.0;
/// Instants kept: a bound whatever the rate.
const MOST_SAMPLES: usize = 1000;
const AXES: [(&str, &str); 6] =
    [("Fx", "N"), ("Fy", "N"), ("Fz", "N"), ("Tx", "Nm"), ("Ty", "Nm"), ("Tz", "Nm")];
/// Smallest range of a trace: N, Nm.
const LEAST_RANGE: [f64; 2] = [0.5, 0.05];

/// What was heard last, and the wrenches of the last seconds.
#[derive(Debug, Default)]
pub(super) struct History {
    status: Option<DaemonStatus>,
    /// Publication (s) and wrench.
    samples: VecDeque<(f64, [f64; 6])>,
}

impl History {
    /// Takes in an answer; the daemon's refusal to stream is an error.
    pub(super) fn add(&mut self, reply: Reply) -> Result<(), Error> {
        let Some(status) = reply.status else {
            return Err(Error::usage(reply.error.unwrap_or_else(|| "the daemon does not stream".to_owned())));
        };
        if let Some(live) = &status.live {
            let now_s = live.published_s;
            if let Some(wrench) = live.wrench {
                self.samples.push_back((now_s, wrench));
            }
            let old = |(at_s, _): &(f64, [f64; 6])| *at_s < now_s - TRACE_S || *at_s > now_s;
            while self.samples.len() > MOST_SAMPLES || self.samples.front().is_some_and(old) {
                self.samples.pop_front();
            }
        }
        self.status = Some(*status);
        Ok(())
    }
}

/// Draws everything into whatever room there is.
pub(super) fn draw(frame: &mut Frame<'_>, history: &History) {
    let Some(status) = &history.status else { return };
    let gauges = status.live.as_ref().map_or(0, |live| live.gauges.len()) as u16;
    let rows =
        [Constraint::Length(2), Constraint::Min(10), Constraint::Length(gauges + 3), Constraint::Length(1)];
    let [head, traces, below, foot] = Layout::vertical(rows).areas(frame.area());
    frame.render_widget(Paragraph::new(heading(status)), head);
    let halves: [Rect; 2] = Layout::vertical([Constraint::Fill(1); 2]).areas(traces);
    for (half, from) in halves.into_iter().zip([0, 3]) {
        let columns: [Rect; 3] = Layout::horizontal([Constraint::Fill(1); 3]).areas(half);
        for (area, axis) in columns.into_iter().zip(from..) {
            trace(frame, area, axis, history);
        }
    }
    let [left, right] = Layout::horizontal([Constraint::Min(46), Constraint::Length(34)]).areas(below);
    if let Some(live) = &status.live {
        frame.render_widget(gauge_table(live, left.width), left);
    }
    frame.render_widget(Paragraph::new(facts(status)).block(Block::bordered().title("daemon")), right);
    frame.render_widget(
        Paragraph::new(
            "q: quit   value \u{b1} deviation (most that one faulty gauge can hide)   \u{2592} deviation",
        )
        .style(dim()),
        foot,
    );
}

fn dim() -> Style {
    Style::new().add_modifier(Modifier::DIM)
}

fn heading(status: &DaemonStatus) -> Vec<Line<'static>> {
    let name = Span::styled("wrenchd ", Style::new().add_modifier(Modifier::BOLD));
    let Some(live) = &status.live else {
        return vec![Line::from(vec![name, "nothing published yet".into()])];
    };
    let colour = match &live.wrench {
        None => Color::Red,
        Some(_) if live.status & !64 == 0 => Color::Green,
        Some(_) => Color::Yellow,
    };
    let state =
        Span::styled(live.status_names.join(" + "), Style::new().fg(colour).add_modifier(Modifier::BOLD));
    let reason = live.reason.clone().unwrap_or_default();
    vec![
        Line::from(vec![name, state, "  ".into(), reason.into()]),
        Line::styled(status.config.clone(), dim()),
    ]
}

fn trace(frame: &mut Frame<'_>, area: Rect, axis: usize, history: &History) {
    let (name, unit) = AXES[axis];
    let live = history.status.as_ref().and_then(|status| status.live.as_ref());
    let now_s = live.map_or(0.0, |live| live.published_s);
    let points: Vec<(f64, f64)> =
        history.samples.iter().map(|(at_s, wrench)| (at_s - now_s, wrench[axis])).collect();
    let least = LEAST_RANGE[axis / 3];
    let (low, high) = points.iter().fold((-least, least), |(low, high), (_, y)| (low.min(*y), high.max(*y)));
    let value = live.and_then(|live| Some((live.wrench?[axis], live.sigma?[axis])));
    let digits = if axis < 3 { 2 } else { 3 };
    let title = match value {
        Some((value, sigma)) => {
            let hides = match live.and_then(|live| live.protection).and_then(|levels| levels[axis]) {
                Some(level) => format!("{level:.digits$}"),
                None => "?".to_owned(),
            };
            format!("{name} {value:.digits$} \u{b1} {sigma:.digits$} ({hides}) {unit}")
        }
        None => format!("{name} \u{2013} {unit}"),
    };
    let label = |y: f64| format!("{y:>7.digits$}");
    let block = Block::bordered().title(title);
    // In the frame's own line: a small terminal has no row to spare.
    let block = match value {
        Some(value) => {
            let cells = area.width.saturating_sub(2).into();
            block.title_bottom(Line::styled(
                wrench_bar(value, (low, high), cells),
                Style::new().fg(Color::Cyan),
            ))
        }
        None => block,
    };
    let data = Dataset::default().marker(Marker::Braille).graph_type(GraphType::Line).data(&points);
    let chart = Chart::new(vec![data.style(Style::new().fg(Color::Cyan))])
        .block(block)
        .x_axis(Axis::default().bounds([-TRACE_S, 0.0]))
        .y_axis(Axis::default().bounds([low, high]).labels([label(low), label(high)]));
    frame.render_widget(chart, area);
}

/// A component (value and deviation) as a bar from zero, on the trace's scale from its lowest to its highest: shaded where the deviation reaches.
fn wrench_bar((value, sigma): (f64, f64), (low, high): (f64, f64), cells: usize) -> String {
    let last = cells.saturating_sub(1) as f64;
    let cell = |y: f64| ((y - low) / (high - low) * cells as f64).floor().clamp(0.0, last) as usize;
    let (zero, tip) = (cell(0.0), cell(value));
    let (bar, shade) = (zero.min(tip)..=zero.max(tip), cell(value - sigma)..=cell(value + sigma));
    let sign = |at: usize| match at {
        at if at == zero => '\u{2502}',
        at if shade.contains(&at) => '\u{2592}',
        at if bar.contains(&at) => '\u{2588}',
        _ => '\u{b7}',
    };
    (0..cells).map(sign).collect()
}

fn gauge_table(live: &Live, width: u16) -> Table<'_> {
    // A cell of a residual's bar is one sigma, or two where there is no room: numbers are never cut.
    let (widths, per_cell, residuals) = match width {
        60.. => ([8, 13, 10, 6, 17], 1.0, "residual -8 .. 8"),
        _ => ([6, 9, 9, 6, 9], 2.0, "-8 .. 8"),
    };
    let counts = usize::from(widths[2]);
    let row = |gauge: &Gauge| {
        let used = gauge.state == "used";
        let colour = match gauge.residual_sigma.abs() {
            _ if !used => Color::Red,
            r if r < 4.0 => Color::Green,
            r if r < 8.0 => Color::Yellow,
            _ => Color::Red,
        };
        let residual =
            if used { format!("{:>6.2}", gauge.residual_sigma) } else { format!("{:>6}", "\u{2013}") };
        Row::new([
            Cell::from(gauge.name.clone()),
            Cell::from(if used && gauge.suspect { "suspect".to_owned() } else { gauge.state.clone() })
                .style(Style::new().fg(if used && !gauge.suspect { Color::Reset } else { Color::Red })),
            Cell::from(format!("{:>counts$.0}", gauge.counts)),
            Cell::from(residual),
            Cell::from(bar(if used { gauge.residual_sigma } else { 0.0 }, per_cell))
                .style(Style::new().fg(colour)),
        ])
    };
    let heads = [
        "gauge".to_owned(),
        "state".into(),
        format!("{:>counts$}", "counts"),
        " sigma".into(),
        residuals.into(),
    ];
    Table::new(live.gauges.iter().map(row), widths.map(Constraint::Length))
        .header(Row::new(heads).style(dim()))
        .block(Block::bordered().title("gauges"))
}

/// A residual as a bar from the middle cell, so many sigmas a cell; eight sigmas are its whole length.
fn bar(residual_sigma: f64, per_cell: f64) -> String {
    let cells = (residual_sigma.clamp(-8.0, 8.0) / per_cell).round() as i32;
    let most = (8.0 / per_cell) as i32;
    (-most..=most)
        .map(|at: i32| match at {
            0 => '\u{2502}',
            at if at.signum() == cells.signum() && at.abs() <= cells.abs() => '\u{2588}',
            _ => '\u{b7}',
        })
        .collect()
}

fn facts(status: &DaemonStatus) -> Vec<Line<'static>> {
    let total = |name: &str| status.totals.get(name).copied().unwrap_or(0);
    let milliseconds = |s: f64| format!("{:.2} ms", s * 1e3);
    let live = status.live.as_ref();
    let parity = live.and_then(|live| live.parity);
    let none = || "none".to_owned();
    let unknown = || "\u{2013}".to_owned();
    let rows = [
        ("published", format!("{:.0} Hz, {}", status.published_hz, status.mode)),
        ("age", live.map_or_else(unknown, |live| milliseconds(live.age_s))),
        ("latency p99", status.latency_p99_s.map_or_else(unknown, |s| format!("below {}", milliseconds(s)))),
        (
            "parity",
            parity.map_or_else(unknown, |p| format!("{:.1} of {:.0}, {} spare", p.chi2, p.limit, p.dof)),
        ),
        ("lost frames", total("lost_frames").to_string()),
        ("overruns", total("overruns").to_string()),
        (
            "tare",
            live.and_then(|live| live.tare).map_or_else(none, |tare| format!("{:.0} s ago", tare.age_s)),
        ),
        ("payload", live.and_then(|live| live.payload).map_or_else(none, |p| format!("{:.3} kg", p.mass_kg))),
        ("uptime", format!("{:.0} s", status.uptime_s)),
    ];
    let line = |(name, value)| Line::from(vec![Span::styled(format!("{name:<13}"), dim()), Span::raw(value)]);
    rows.into_iter().map(line).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use ratatui::Terminal;
    use ratatui::backend::TestBackend;
    use wrenchd::view::{Parity, Payload};

    fn status(k: u32, wrench: Option<[f64; 6]>) -> DaemonStatus {
        let gauge = |name: usize| Gauge {
            name: format!("s{}", name + 1),
            suspect: name == 4,
            state: if name == 2 { "saturated" } else { "used" }.into(),
            counts: 12_345.0 * name as f64,
            residual_sigma: name as f64 - 2.0,
            zero_shift_counts: 0.0,
        };
        let live = Live {
            sequence: k.into(),
            published_s: 1e9 + f64::from(k) * 0.05,
            age_s: 0.0012,
            latency_s: 0.0001,
            status: if wrench.is_some() { 2 } else { 1 },
            status_names: vec![if wrench.is_some() { "degraded" } else { "invalid" }.into()],
            reason: wrench.is_none().then(|| "fewer than six usable gauges".into()),
            wrench,
            sigma: wrench.map(|_| [0.02; 6]),
            covariance: None,
            singular_values_per_n: None,
            protection: wrench.map(|_| [Some(0.25), None, Some(1.0), Some(0.01), Some(0.02), Some(0.03)]),
            parity: wrench.map(|_| Parity { chi2: 1.5, dof: 1, limit: 65.0 }),
            gauges: (0..8).map(gauge).collect(),
            tare: None,
            payload: Some(Payload { mass_kg: 0.25, com_m: [0.0; 3] }),
        };
        DaemonStatus {
            version: "1".into(),
            config: "/etc/wrenchd/wrenchd.toml".into(),
            model: "m".into(),
            model_sha256: "0".repeat(64),
            mode: "event".into(),
            rate_hz: 1000.0,
            uptime_s: 77.0,
            published_hz: 998.0,
            frames_hz: 7000.0,
            latency_p99_s: Some(0.0005),
            totals: [("lost_frames".to_owned(), 3)].into(),
            live: Some(live),
        }
    }

    fn picture(width: u16, height: u16, wrenches: &[Option<[f64; 6]>]) -> String {
        let mut history = History::default();
        for (k, wrench) in wrenches.iter().enumerate() {
            let status = Some(Box::new(status(k as u32, *wrench)));
            history.add(Reply { ok: true, status, ..Reply::default() }).unwrap();
        }
        let mut terminal = Terminal::new(TestBackend::new(width, height)).unwrap();
        terminal.draw(|frame| draw(frame, &history)).unwrap();
        terminal.backend().to_string()
    }

    #[test]
    fn shows_wrench_gauges_parity_and_latency() {
        let sines: Vec<_> = (0..200).map(|k| Some([3.0 * (f64::from(k) * 0.1).sin(); 6])).collect();
        let text = picture(110, 36, &sines);
        for part in [
            "degraded",
            "Fx 2.60 \u{b1} 0.02 (0.25) N",
            "Fy 2.60 \u{b1} 0.02 (?) N",
            "Tz 2.603",
            "saturated",
            "suspect",
            "1.5 of 65, 1 spare",
            "998 Hz, event",
            "below 0.50 ms",
            "1.20 ms",
            "0.250 kg",
            "/etc/wrenchd",
        ] {
            assert!(text.contains(part), "{part}:\n{text}");
        }
        let dots = text.chars().filter(|c| ('\u{2801}'..='\u{28FF}').contains(c)).count();
        assert!(dots > 200, "six traces: {dots}\n{text}");
        assert!(text.contains("\u{2502}\u{2588}\u{2588}\u{2588}\u{b7}"), "a residual of 3 sigma:\n{text}");
    }

    #[test]
    fn a_bar_grows_from_zero_to_its_side_and_shades_its_deviation() {
        let bar = |value, sigma| wrench_bar((value, sigma), (-4.0, 6.0), 10).replace('\u{b7}', ".");
        assert_eq!(bar(3.5, 0.1), "....\u{2502}\u{2588}\u{2588}\u{2592}..");
        assert_eq!(bar(3.5, 1.2), "....\u{2502}\u{2588}\u{2592}\u{2592}\u{2592}.");
        assert_eq!(bar(-2.5, 0.1), ".\u{2592}\u{2588}\u{2588}\u{2502}.....");
        assert_eq!(bar(0.1, 0.2), "...\u{2592}\u{2502}.....", "zero has its mark");
        assert_eq!(
            bar(99.0, f64::INFINITY),
            "\u{2592}\u{2592}\u{2592}\u{2592}\u{2502}\u{2592}\u{2592}\u{2592}\u{2592}\u{2592}"
        );
        assert_eq!(bar(f64::NAN, f64::NAN).chars().count(), 10);
        assert_eq!(wrench_bar((1.0, 0.1), (-1.0, 1.0), 0), "");
    }

    #[test]
    fn a_small_terminal_shows_traces_bars_gauges_and_facts() {
        let wrench =
            |k: i32| [2.0, -1.0, 0.3, 0.2, -0.05, 0.0].map(|most| most * (f64::from(k) * 0.05).sin());
        let text = picture(80, 24, &(0..158).map(|k| Some(wrench(k))).collect::<Vec<_>>());
        let bars: Vec<&str> =
            text.lines().filter(|line| line.contains('\u{2592}') && line.contains('\u{2514}')).collect();
        assert_eq!(bars.len(), 2, "{text}");
        for (line, right) in bars.iter().zip([[true, false, true], [true, false, true]]) {
            for (bar, right) in line.split('\u{2514}').skip(1).zip(right) {
                let (left, behind) = bar.split_once('\u{2502}').unwrap();
                let long = |part: &str| part.contains('\u{2588}') || part.contains('\u{2592}');
                assert!(if right { long(behind) } else { long(left) && !long(behind) }, "{bar}:\n{text}");
            }
        }
        for part in
            ["s8     used          86415   5.00", "saturated", "payload      0.250 kg", "uptime", "q: quit"]
        {
            assert!(text.contains(part), "{part}:\n{text}");
        }
        let dots = text.chars().filter(|c| ('\u{2801}'..='\u{28FF}').contains(c)).count();
        assert!(dots > 60, "{dots}\n{text}");
    }

    #[test]
    fn without_a_wrench_there_is_a_reason_and_no_number() {
        let text = picture(110, 36, &[None]);
        assert!(text.contains("invalid") && text.contains("fewer than six usable gauges"), "{text}");
        assert!(
            text.contains("Fx \u{2013} N") && !text.chars().any(|c| ('\u{2801}'..='\u{28FF}').contains(&c)),
            "{text}"
        );
    }

    #[test]
    fn any_size_of_terminal_will_do_and_old_samples_go() {
        for (width, height) in [(1, 1), (20, 5), (80, 24), (300, 90)] {
            picture(width, height, &[Some([1.0; 6]), None]);
        }
        let mut history = History::default();
        for k in 0..2000 {
            let status = Some(Box::new(status(k, Some([0.0; 6]))));
            history.add(Reply { ok: true, status, ..Reply::default() }).unwrap();
        }
        assert!((395..=405).contains(&history.samples.len()), "20 s at 20 Hz: {}", history.samples.len());
        assert!(history.add(Reply::error("busy")).unwrap_err().to_string().contains("busy"));
    }
}
