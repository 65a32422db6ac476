//! Faults that a gauge's own frames tell of: it is left out within 50 ms, and used again when it has proved itself.
//!
//! The gauge's own times are measured: from the first frame with the fault to the frame after which the gauge is not used, and from the first
//! frame without it to the one after which it is. Every gauge, at the usual rates, holding and swinging.

use can::frame::Stamped;
use rig::Rig;
use rig::config::PublishMode;
use rig::cycle::{Cycle, GaugeState};
use sim::Simulator;

use crate::common::{model, rig, truth};
use crate::gauge::{change, message};
use crate::grid::{BEGIN_NS, END_NS, simulator};
use crate::isolation::is_wrong;

const OUT_NS: i64 = 50_000_000;
/// A gauge that the others contradicted, too, agrees with them for a second before it is believed.
const BACK_NS: i64 = 1_100_000_000;
const CONDITIONS: [(f64, bool); 5] =
    [(125.0, false), (125.0, true), (250.0, true), (1000.0, false), (1000.0, true)];
/// Bytes of a gauge's frame: its counter, and the flags of its two gauges.
const COUNTER: usize = 6;
const FLAGS: usize = 7;

/// What a gauge's frame comes to; `false` takes it away. Arguments: the frame, the gauge, the last frame before the fault.
type Fault = fn(&mut Stamped, usize, &Stamped) -> bool;

const FAULTS: [(&str, Fault); 6] = [
    ("stuck at its last reading", |frame, gauge, before| {
        let (mut before, mut counts) = (*before, 0.0);
        change(&mut before, gauge, |last| {
            counts = last;
            last
        });
        change(frame, gauge, |_| counts);
        true
    }),
    ("stuck elsewhere", |frame, gauge, _| {
        change(frame, gauge, |_| 12_345.0);
        true
    }),
    ("silent", |_, _, _| false),
    ("flagged", |frame, gauge, _| {
        frame.frame.data_mut()[FLAGS] |= 1 << (gauge % 2);
        true
    }),
    ("its counter stands", |frame, _, before| {
        frame.frame.data_mut()[COUNTER] = before.frame.data()[COUNTER];
        true
    }),
    ("out of range", |frame, gauge, _| {
        change(frame, gauge, |_| f64::INFINITY);
        true
    }),
];

/// What became of a gauge.
#[derive(Debug, Default)]
struct Outcome {
    out_ns: Option<i64>,
    back_ns: Option<i64>,
    /// Frames after which it was used although it was left out and the fault went on, or was not used before the fault or after it was taken back.
    astray: u32,
    wrong: u32,
}

fn run(rig: &Rig, frames: &[Stamped], world: &mut Simulator, gauge: usize, fault: Fault) -> Outcome {
    let mut cycle = Cycle::new(rig, &model(rig, &truth(rig))).unwrap();
    let mut outcome = Outcome::default();
    let (mut before, mut begun_ns, mut ended_ns) = (None, None, None);
    for frame in frames {
        let (mut frame, at_ns) = (*frame, frame.stamp_ns - sim::START_NS);
        if frame.frame.id().number() == message(gauge) {
            if !(BEGIN_NS..END_NS).contains(&at_ns) {
                before = Some(frame);
            } else if !fault(&mut frame, gauge, before.as_ref().unwrap()) {
                begun_ns.get_or_insert(at_ns);
                continue;
            } else {
                begun_ns.get_or_insert(at_ns);
            }
            if at_ns >= END_NS {
                ended_ns.get_or_insert(at_ns);
            }
        }
        cycle.push(&frame, |estimate| outcome.wrong += u32::from(is_wrong(estimate, world)));
        let used = cycle.stage().gauge_states()[gauge] == GaugeState::Used;
        match (begun_ns, ended_ns) {
            // The first rounds are being learned.
            (None, _) => outcome.astray += u32::from(!used && at_ns > BEGIN_NS / 2),
            (Some(begun_ns), None) if !used => _ = outcome.out_ns.get_or_insert(at_ns - begun_ns),
            (Some(_), None) => outcome.astray += u32::from(outcome.out_ns.is_some()),
            (Some(_), Some(ended_ns)) if used => _ = outcome.back_ns.get_or_insert(at_ns - ended_ns),
            (Some(_), Some(_)) => outcome.astray += u32::from(outcome.back_ns.is_some()),
        }
    }
    outcome
}

#[test]
fn a_fault_with_evidence_of_its_own_is_left_out_within_50_ms_and_taken_back() {
    let rig = rig(PublishMode::Event);
    let mut late = Vec::new();
    for (rate_hz, moves) in CONDITIONS {
        let frames: Vec<Stamped> = simulator(&rig, rate_hz, moves).collect();
        let mut world = simulator(&rig, rate_hz, moves);
        for (name, fault) in FAULTS {
            let (mut out_ns, mut back_ns) = (0, 0);
            for gauge in 0..8 {
                let outcome = run(&rig, &frames, &mut world, gauge, fault);
                let out = outcome.out_ns.is_some_and(|ns| ns <= OUT_NS);
                let back = outcome.back_ns.is_some_and(|ns| ns <= BACK_NS);
                if !(out && back && outcome.astray == 0 && outcome.wrong == 0) {
                    late.push(format!("{rate_hz} Hz, moves {moves}, s{} {name}: {outcome:?}", gauge + 1));
                }
                out_ns = out_ns.max(outcome.out_ns.unwrap_or(i64::MAX));
                back_ns = back_ns.max(outcome.back_ns.unwrap_or(i64::MAX));
            }
            let ms = |ns: i64| ns as f64 * 1e-6;
            let what = if moves { "swinging" } else { "holding" };
            println!("{rate_hz} Hz, {what}, {name}: out {:.1} ms, back {:.1} ms", ms(out_ns), ms(back_ns));
        }
    }
    assert!(late.is_empty(), "{}", late.join("\n"));
}
