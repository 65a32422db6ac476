use super::*;
use crate::dbc::Dbc;
use crate::frame::{CanId, Frame};

mod astray;
mod stalls;

const MS: i64 = 1_000_000;
const START: i64 = 1_790_000_000_000_000_000;

/// Two gauges with counters on 0x101 and 0x102, one joint each on 0x201 and 0x202, temperatures on 0x301
const DBC: &str = r#"VERSION ""
BS_:
BU_: X
BO_ 257 G1: 8 X
 SG_ C : 0|24@1- (1,0) [0|0] "counts" X
 SG_ N : 48|8@1+ (1,0) [0|0] "" X
 SG_ S : 56|1@1+ (1,0) [0|0] "" X
BO_ 258 G2: 8 X
 SG_ C : 0|24@1- (1,0) [0|0] "counts" X
 SG_ N : 48|8@1+ (1,0) [0|0] "" X
BO_ 513 J1: 4 X
 SG_ Q : 0|32@1- (1E-6,0) [0|0] "rad" X
BO_ 514 J2: 4 X
 SG_ Q : 0|32@1- (1E-6,0) [0|0] "rad" X
BO_ 769 T: 1 X
 SG_ T : 0|8@1+ (0.25,0) [0|0] "degC" X
"#;

fn layout() -> Layout {
    let dbc = Dbc::parse(DBC, "test.dbc").unwrap();
    let bind = |name: &str| SignalBinding { spec: dbc.signal(name).unwrap(), interface: 0, to_si: 1.0 };
    let gauge = |message: &str, saturated: bool| GaugeBinding {
        name: message.into(),
        counts: bind(&format!("{message}.C")),
        saturated: saturated.then(|| bind("G1.S")),
        sequence: Some(bind(&format!("{message}.N"))),
        temperature: saturated.then(|| bind("T.T")),
        delay_ns: None,
    };
    let joint = |message: &str| JointBinding {
        name: message.into(),
        position: bind(&format!("{message}.Q")),
        velocity: None,
        delay_ns: None,
    };
    Layout {
        gauges: vec![gauge("G1", true), gauge("G2", false)],
        joints: vec![joint("J1"), joint("J2")],
        stale_after_ns: 20 * MS,
        temperature_stale_after_ns: 5_000 * MS,
    }
}

fn raw(id: u32, stamp_ns: i64, data: &[u8]) -> Stamped {
    Stamped { stamp_ns, interface: 0, frame: Frame::classical(CanId::standard(id).unwrap(), data).unwrap() }
}

fn gauge(id: u32, stamp_ns: i64, counts: i32, sequence: u64) -> Stamped {
    let c = counts.to_le_bytes();
    raw(id, stamp_ns, &[c[0], c[1], c[2], 0, 0, 0, sequence as u8, 0])
}

fn joint(id: u32, stamp_ns: i64, micro: i32) -> Stamped {
    raw(id, stamp_ns, &micro.to_le_bytes())
}

/// Cycle `k` of 8 ms: joints first, 0.2 ms apart; values tell the cycle
fn cycle(k: i64) -> [Stamped; 4] {
    let t = START + 8 * MS * k;
    [
        joint(0x201, t, k as i32),
        joint(0x202, t + MS / 5, 1000 + k as i32),
        gauge(0x101, t + 2 * MS / 5, 10 * k as i32, k as u64),
        gauge(0x102, t + 3 * MS / 5, -10 * k as i32, k as u64),
    ]
}

fn run(frames: impl IntoIterator<Item = Stamped>) -> (Vec<Snapshot>, Assembler) {
    let mut assembler = Assembler::new(&layout()).unwrap();
    let mut all = Vec::new();
    for frame in frames {
        all.extend_from_slice(assembler.push(&frame));
    }
    (all, assembler)
}

/// The cycle that each present value tells, in the order G1 G2 J1 J2
fn cycles_of(snapshot: &Snapshot) -> [Option<i64>; 4] {
    let value = |signal: &Signal| signal.ok().map(|reading| reading.value);
    [
        value(&snapshot.gauges[0]).map(|v| (v / 10.0).round() as i64),
        value(&snapshot.gauges[1]).map(|v| (v / -10.0).round() as i64),
        value(&snapshot.joints[0].position).map(|v| (v * 1e6).round() as i64),
        value(&snapshot.joints[1].position).map(|v| (v * 1e6).round() as i64 - 1000),
    ]
}

#[test]
fn whole_rounds_at_the_first_gauge_frame() {
    let (all, assembler) = run((0..5).flat_map(cycle));
    assert_eq!(all.len(), 5);
    for (k, snapshot) in all.iter().enumerate() {
        let k = k as i64;
        assert!(snapshot.complete);
        assert_eq!(snapshot.instant_ns, START + 8 * MS * k + 2 * MS / 5);
        assert_eq!(cycles_of(snapshot), [Some(k); 4]);
        assert_eq!(snapshot.gauges[1].unwrap().age_ns, 0, "synchronised boards");
        assert_eq!(snapshot.temperatures, [Err(Absence::NeverSeen), Err(Absence::NotConfigured)]);
    }
    assert_eq!(assembler.counts().complete_rounds, 5);
}

#[test]
fn delays_of_their_own() {
    let mut layout = layout();
    layout.gauges[1].delay_ns = Some(MS);
    layout.joints[0].delay_ns = Some(2 * MS);
    let mut assembler = Assembler::new(&layout).unwrap();
    let snapshot = cycle(0).iter().filter_map(|f| assembler.push(f).first().cloned()).next().unwrap();
    assert_eq!(snapshot.instant_ns, START + 3 * MS / 5 - MS);
    assert_eq!(snapshot.gauges[0].unwrap().age_ns, 0);
    assert_eq!(snapshot.joints[0].position.unwrap().at_ns, START - 2 * MS);
    assert_eq!(snapshot.joints[0].position.unwrap().age_ns, 3 * MS / 5 - MS + 2 * MS);
}

#[test]
fn one_lost_frame_costs_one_reading_wherever_it_is() {
    for lost in 0..4 {
        let frames = (0..12).flat_map(|k| cycle(k).into_iter().enumerate().map(move |(i, f)| (k, i, f)));
        let (all, assembler) =
            run(frames.filter(|(k, i, _)| (*k, *i) != (6, lost)).map(|(_, _, frame)| frame));
        assert_eq!(all.len(), 12, "lost {lost}");
        for (k, snapshot) in all.iter().enumerate() {
            let mut expected = [Some(k as i64); 4];
            if k == 6 {
                expected[[2, 3, 0, 1][lost]] = None;
                assert!(!snapshot.complete);
            }
            assert_eq!(cycles_of(snapshot), expected, "lost {lost}, cycle {k}");
        }
        assert_eq!(assembler.counts().missed, 1);
    }
}

#[test]
fn lost_frames_around_a_border_do_not_mix_cycles() {
    // All but the first frame of cycle 6, and the first of cycle 7.
    let frames = (0..12).flat_map(|k| {
        cycle(k)
            .into_iter()
            .enumerate()
            .filter(move |(i, _)| !(k == 6 && *i > 0 || k == 7 && *i == 0))
            .map(|(_, f)| f)
    });
    let (all, _) = run(frames);
    // What is left of cycle 6 has no gauge: the counters say that a cycle is missing, and the pause where.
    assert_eq!(cycles_of(&all[5]), [Some(5); 4]);
    assert_eq!((cycles_of(&all[6]), all[6].cycles), ([Some(7), Some(7), None, Some(7)], Some(2)));
    assert_eq!((cycles_of(&all[7]), all[7].cycles), ([Some(8); 4], Some(1)));
}

#[test]
fn a_log_that_begins_within_a_cycle_finds_the_cycles() {
    for skip in 1..4 {
        let (all, assembler) = run((0..10).flat_map(cycle).skip(skip));
        let last = all.last().unwrap();
        assert_eq!(cycles_of(last), [Some(9); 4], "skip {skip}");
        for snapshot in &all {
            let seen: Vec<_> = cycles_of(snapshot).into_iter().flatten().collect();
            assert!(seen.iter().all(|k| *k == seen[0]), "skip {skip}: {:?}", cycles_of(snapshot));
        }
        assert!(all.len() >= 8, "skip {skip}: {} {:?}", all.len(), assembler.counts());
    }
}

#[test]
fn half_rate_messages_are_held_for_their_usual_gap() {
    // J2 in even cycles only.
    let frames =
        (0..20).flat_map(|k| cycle(k).into_iter().enumerate().filter(move |(i, _)| *i != 1 || k % 2 == 0));
    let (all, _) = run(frames.map(|(_, frame)| frame));
    assert_eq!(all.len(), 20);
    for (k, snapshot) in all.iter().enumerate().skip(3) {
        let k = k as i64;
        assert_eq!(cycles_of(snapshot), [Some(k), Some(k), Some(k), Some(k / 2 * 2)], "cycle {k}");
        // The frame that completes it is the cycle's own last one: no round waits for the next.
        assert_eq!(snapshot.last_stamp_ns, START + 8 * MS * k + 3 * MS / 5);
        assert_eq!(snapshot.joints[1].position.unwrap().age_ns, 8 * MS * (k % 2));
    }
}

#[test]
fn a_half_rate_gauge_is_held_although_its_counter_lags() {
    // G2 in even cycles only, its counter counting its own frames.
    let frames = (0..40).flat_map(|k| {
        let mut frames = cycle(k).to_vec();
        if k % 2 == 0 {
            frames[3].frame.data_mut()[6] = (k / 2) as u8;
        } else {
            frames.pop();
        }
        frames
    });
    let (all, assembler) = run(frames);
    assert_eq!(all.len(), 40, "{:?}", assembler.counts());
    for (k, snapshot) in all.iter().enumerate().skip(3) {
        let k = k as i64;
        assert_eq!(cycles_of(snapshot), [Some(k), Some(k / 2 * 2), Some(k), Some(k)], "cycle {k}");
        assert!(snapshot.cycles.is_none_or(|cycles| cycles == 1));
    }
}

#[test]
fn a_lost_half_rate_frame_is_missed_until_the_next() {
    let frames = (0..20)
        .flat_map(|k| {
            cycle(k).into_iter().enumerate().filter(move |(i, _)| *i != 1 || (k % 2 == 0 && k != 10))
        })
        .map(|(_, frame)| frame);
    let (all, _) = run(frames);
    let of_j2: Vec<_> = all[8..14]
        .iter()
        .map(|s| s.joints[1].position.map(|r| (r.value * 1e6).round() as i64 - 1000))
        .collect();
    assert_eq!(of_j2, [Ok(8), Ok(8), Err(Absence::Missed), Err(Absence::Stale), Ok(12), Ok(12)]);
    assert_eq!(all.len(), 20);
}

#[test]
fn a_dead_board_is_not_waited_for_and_comes_back() {
    // G2, the last frame of the cycle, silent from cycle 5 to 14.
    let frames = (0..20).flat_map(|k| {
        cycle(k).into_iter().enumerate().filter(move |(i, _)| *i != 3 || !(5..15).contains(&k))
    });
    let (all, assembler) = run(frames.map(|(_, frame)| frame));
    assert_eq!(all.len(), 20);
    for (k, snapshot) in all.iter().enumerate() {
        let k = k as i64;
        let [g1, g2, j1, j2] = cycles_of(snapshot);
        assert_eq!((g1, j1, j2), (Some(k), Some(k), Some(k)));
        if (9..15).contains(&k) {
            assert_eq!(snapshot.last_stamp_ns, START + 8 * MS * k + 2 * MS / 5, "no waiting in cycle {k}");
            assert_eq!(snapshot.gauges[1], Err(Absence::Stale));
        }
        if !(5..=15).contains(&k) {
            assert_eq!(g2, Some(k));
        }
    }
    assert_eq!(assembler.counts().missed, 3);
    assert_eq!(assembler.sequence_counts().missing, 10);
}

#[test]
fn duplicates_neither_end_a_round_nor_count() {
    let (all, assembler) = run((0..10)
        .flat_map(cycle)
        .flat_map(|frame| [frame, Stamped { stamp_ns: frame.stamp_ns + MS / 10, ..frame }]));
    assert_eq!(all.len(), 10);
    assert!(all.iter().enumerate().all(|(k, s)| cycles_of(s) == [Some(k as i64); 4]));
    assert_eq!((assembler.counts().repeated, assembler.counts().duplicates), (20, 20));
}

#[test]
fn a_board_that_stands_still_is_repeated() {
    let frames = (0..10).flat_map(cycle).map(|frame| {
        let stands = frame.frame.id().number() == 0x102 && frame.stamp_ns > START + 36 * MS;
        if stands { Stamped { stamp_ns: frame.stamp_ns, ..cycle(4)[3] } } else { frame }
    });
    let (all, _) = run(frames);
    assert!(all[4].complete);
    assert!(all[5..9].iter().all(|s| s.gauges[1] == Err(Absence::Repeated) && s.gauges[0].is_ok()));
}

#[test]
fn reordering_across_rounds_costs_at_most_what_came_too_late() {
    let mut frames: Vec<_> = (0..12).flat_map(cycle).collect();
    let overtaken = frames.remove(4 * 5 + 2); // G1 of cycle 5, comes after that of cycle 6
    frames.insert(4 * 6 + 2, overtaken);
    let (all, assembler) = run(frames);
    assert_eq!(assembler.counts().late, 1);
    assert_eq!(all.len(), 12);
    assert_eq!(cycles_of(&all[5]), [None, Some(5), Some(5), Some(5)]);
    assert!(all.iter().enumerate().all(|(k, s)| k == 5 || cycles_of(s) == [Some(k as i64); 4]));
}

#[test]
fn a_frame_behind_the_next_cycles_first_is_not_taken_for_that_cycle() {
    let mut frames: Vec<_> = (0..12).flat_map(cycle).collect();
    let overtaken = frames.remove(4 * 5 + 3); // G2 of cycle 5, comes after J1 of cycle 6
    frames.insert(4 * 6, overtaken);
    let (all, assembler) = run(frames);
    assert_eq!(assembler.counts().after_round, 1);
    assert_eq!(all.len(), 12);
    assert_eq!(cycles_of(&all[5]), [Some(5), None, Some(5), Some(5)]);
    assert!(all.iter().enumerate().all(|(k, s)| k == 5 || cycles_of(s) == [Some(k as i64); 4]));
}

#[test]
fn wrong_lengths_are_named_and_never_decoded() {
    let frames = (0..6).flat_map(cycle).map(|frame| {
        let short = frame.frame.id().number() == 0x101
            && (START + 24 * MS..START + 32 * MS).contains(&frame.stamp_ns);
        if short { raw(0x101, frame.stamp_ns, &[1, 2, 3]) } else { frame }
    });
    let (all, assembler) = run(frames);
    assert_eq!(all[3].gauges[0], Err(Absence::WrongLength));
    assert!(all[2].complete && all[4].complete);
    assert_eq!(assembler.counts().wrong_length, 1);
}

#[test]
fn saturation_remote_requests_and_errors() {
    let mut frames: Vec<_> = (0..3).flat_map(cycle).collect();
    frames[4 + 2].frame.data_mut()[7] = 1;
    let id = CanId::standard(0x101).unwrap();
    for frame in [Frame::remote(id, 8), Frame::error(0x101, &[0; 8])] {
        frames.insert(5, Stamped { stamp_ns: START + 8 * MS, interface: 0, frame: frame.unwrap() });
    }
    frames.insert(5, Stamped { interface: 1, ..frames[0] });
    let (all, assembler) = run(frames);
    assert_eq!(all[1].gauges[0], Err(Absence::Saturated));
    assert!(all[0].complete && all[2].complete && all.len() == 3);
    assert_eq!(assembler.counts().unbound, 3);
}

#[test]
fn temperatures_are_held_until_stale_and_never_waited_for() {
    let mut layout = layout();
    layout.temperature_stale_after_ns = 30 * MS;
    let mut assembler = Assembler::new(&layout).unwrap();
    let mut all = Vec::new();
    for k in 0..8 {
        let temperature = (k == 1).then(|| raw(0x301, START + 8 * MS + MS, &[100]));
        for frame in cycle(k).into_iter().chain(temperature) {
            all.extend_from_slice(assembler.push(&frame));
        }
    }
    let seen: Vec<_> = all.iter().map(|s| s.temperatures[0].map(|t| t.value)).collect();
    let (never, stale) = (Err(Absence::NeverSeen), Err(Absence::Stale));
    assert_eq!(seen, [never, never, Ok(25.0), Ok(25.0), Ok(25.0), stale, stale, stale]);
}

#[test]
fn a_clock_that_steps_does_not_lock_it_up() {
    for step_ns in [-3_600_000 * MS, 3_600_000 * MS, -50 * MS] {
        let frames = (0..30).flat_map(cycle).map(|mut frame| {
            if frame.stamp_ns >= START + 10 * 8 * MS + 2 * MS / 5 {
                frame.stamp_ns += step_ns;
            }
            frame
        });
        let (all, assembler) = run(frames);
        assert!(all.len() >= 20, "{step_ns}: {} {:?}", all.len(), assembler.counts());
        for (snapshot, k) in all.iter().rev().zip((0..30).rev()).take(10) {
            assert_eq!(cycles_of(snapshot), [Some(k); 4], "step {step_ns}");
        }
    }
}

#[test]
fn a_sequence_of_another_message_is_refused() {
    let mut layout = layout();
    layout.gauges[0].sequence = layout.gauges[1].sequence.clone();
    let message = Assembler::new(&layout).unwrap_err().to_string();
    assert!(message.contains("G2.N") && message.contains("G1.C"), "{message}");
}

#[test]
fn bursts_of_an_adapter_do_not_tear_rounds_apart() {
    // Stamps as a USB adapter gives them: all frames of some 11 ms at once.
    let frames = (0..60).flat_map(cycle).map(|mut frame| {
        let since = frame.stamp_ns - START;
        frame.stamp_ns = START + (since / (11 * MS) + 1) * 11 * MS + since % (11 * MS) / 100;
        frame
    });
    let (all, assembler) = run(frames);
    let whole = all.iter().filter(|s| s.complete).count();
    assert!(whole >= 54, "{whole} of {} {:?}", all.len(), assembler.counts());
}

#[test]
fn boards_whose_clocks_drift_past_each_other_keep_being_read() {
    // G2's board runs 1 % slower, then 1 % faster: it drifts through a whole cycle every 100.
    for drift_ns in [MS * 8 / 100, -MS * 8 / 100] {
        let mut frames: Vec<_> = (0..500).flat_map(cycle).collect();
        for frame in frames.iter_mut().filter(|f| f.frame.id().number() == 0x102) {
            frame.stamp_ns += (frame.stamp_ns - START) / (8 * MS) * drift_ns;
        }
        frames.sort_by_key(|frame| frame.stamp_ns);
        let last_ns = START + 8 * MS * 500;
        let (all, assembler) = run(frames.into_iter().filter(|f| f.stamp_ns < last_ns));
        let whole = all.iter().filter(|s| s.complete).count();
        assert!(whole >= 450, "{drift_ns}: {whole} of {} {:?}", all.len(), assembler.counts());
    }
}

#[test]
fn a_start_that_teaches_a_wrong_phase_is_unlearned() {
    // Only J1 of cycle 0, then nothing until J2 of cycle 1: J2 seems to come a whole cycle later than it does.
    let frames =
        (0..60).flat_map(cycle).enumerate().filter(|(n, _)| !(1..5).contains(n)).map(|(_, frame)| frame);
    let (all, assembler) = run(frames);
    for (snapshot, k) in all.iter().rev().zip((0..60).rev()).take(40) {
        assert_eq!(cycles_of(snapshot), [Some(k); 4], "{:?}", assembler.counts());
    }
}
