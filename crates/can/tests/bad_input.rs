//! Every bad input has one clear error, or is counted and told
#![allow(clippy::unwrap_used, clippy::panic)] // a test may

use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Duration;

use wrenchd_can::Error;
use wrenchd_can::candump::{Interfaces, LineFault, LogEvent, LogReader, LogWriter, StampDigits};
use wrenchd_can::dbc::Dbc;
use wrenchd_can::fault::{FaultInjector, Faults};
use wrenchd_can::frame::{CanId, Frame, Stamped};
use wrenchd_can::replay::{Clock, Pace, Replay};
use wrenchd_can::source::{Batch, Event, Poll, Source};

fn recorded() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/recorded.log")
}

fn read_all(path: &Path) -> Result<(Vec<LogEvent>, LogReader), Error> {
    let mut reader = LogReader::open(path, Interfaces::fixed(&["can0"]))?;
    let mut events = Vec::new();
    while let Some(event) = reader.next_event()? {
        events.push(event);
    }
    Ok((events, reader))
}

fn copy_as(folder: &Path, name: &str) -> PathBuf {
    let path = folder.join(name);
    let mut writer = LogWriter::create(&path, &["can0"], StampDigits::Micros).unwrap();
    for event in read_all(&recorded()).unwrap().0 {
        let LogEvent::Frame(stamped) = event else { panic!("{event:?}") };
        writer.frame(&stamped).unwrap();
    }
    assert!(!path.exists(), "nothing under its name before it is whole");
    writer.finish().unwrap();
    path
}

#[test]
fn every_compression_is_told_by_content() {
    let folder = tempfile::tempdir().unwrap();
    let original = std::fs::read(recorded()).unwrap();
    assert_eq!(std::fs::read(copy_as(folder.path(), "a.log")).unwrap(), original);
    for name in ["a.log.gz", "a.log.zst"] {
        let path = copy_as(folder.path(), name);
        assert!(std::fs::metadata(&path).unwrap().len() < original.len() as u64 / 2);
        let renamed = folder.path().join("misnamed.log");
        std::fs::rename(&path, &renamed).unwrap();
        assert_eq!(read_all(&renamed).unwrap().0, read_all(&recorded()).unwrap().0);
    }
}

#[test]
fn cut_or_damaged_compression_names_file_and_place() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["a.log.gz", "a.log.zst"] {
        let path = copy_as(folder.path(), name);
        let whole = std::fs::read(&path).unwrap();
        std::fs::write(&path, &whole[..whole.len() * 2 / 3]).unwrap();
        let error = read_all(&path).unwrap_err();
        assert!(matches!(error, Error::Truncated { .. }), "{error:?}");
        assert!(error.to_string().contains(name), "{error}");
        // The same behind a replay: first all that is whole, then the error.
        let reader = LogReader::open(&path, Interfaces::learned()).unwrap();
        let mut replay = Replay::new(reader, Pace::Max, Wall::default());
        let mut batch = Batch::new(64);
        let failed = loop {
            match replay.poll(&mut batch, Duration::ZERO) {
                Ok(Poll::End) => panic!("a cut log must not end quietly"),
                Ok(_) => {}
                Err(error) => break error,
            }
        };
        assert!(matches!(failed, Error::Truncated { .. }));
        let mut damaged = whole.clone();
        damaged[whole.len() / 2] ^= 0xFF;
        damaged[whole.len() / 2 + 1] ^= 0xFF;
        std::fs::write(&path, &damaged).unwrap();
        assert!(matches!(read_all(&path), Err(Error::Truncated { .. })));
    }
}

#[test]
fn malformed_lines_are_told_and_passed_over() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("odd.log");
    let mut text = b"# remark\n\n(1.000000) can0 123#00\n(1.0000\n(2.0) can9 123#00\nDROPCOUNT: dropped 3 CAN frames on 'can0' socket (total drops 3)\n".to_vec();
    text.extend(vec![b'x'; 600_000]);
    text.extend(b"\n\xFF\xFE\n(3.000000) can0 20000040#0000000000000000\n(4.0) can0 123##2");
    std::fs::write(&path, text).unwrap();
    let (events, reader) = read_all(&path).unwrap();
    let faults: Vec<_> = events
        .iter()
        .filter_map(|e| match e {
            LogEvent::Malformed { line, fault } => Some((*line, *fault)),
            _ => None,
        })
        .collect();
    assert_eq!(faults, [(4, LineFault::Stamp), (7, LineFault::TooLong), (8, LineFault::Stamp)]);
    assert!(events.contains(&LogEvent::Dropped { interface: 0, count: 3 }));
    let counts = reader.counts();
    assert_eq!(
        (counts.lines, counts.frames, counts.foreign, counts.dropped, counts.malformed),
        (10, 3, 1, 3, 3)
    );
    let event = Event::from(events[events.len() - 2]);
    assert!(matches!(event, Event::BusError { error, .. } if error.is_bus_off()), "{event:?}");
}

#[test]
fn missing_files_and_folders() {
    let error = read_all(Path::new("no/such.log")).unwrap_err().to_string();
    assert!(error.contains("no/such.log"), "{error}");
    assert!(read_all(Path::new("/tmp")).unwrap_err().to_string().contains("directory"));
    assert!(Dbc::read(Path::new("no/such.dbc")).unwrap_err().to_string().contains("no/such.dbc"));
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_leaves_nothing() {
    let mut writer = LogWriter::create(Path::new("/dev/full"), &["can0"], StampDigits::Micros).unwrap();
    let frame = Frame::classical(CanId::standard(1).unwrap(), &[0; 8]).unwrap();
    let mut written = Ok(());
    for stamp_ns in 0..10_000 {
        written = writer.frame(&Stamped { stamp_ns, interface: 0, frame });
        if written.is_err() {
            break;
        }
    }
    let error = written.unwrap_err().to_string();
    assert!(error.contains("/dev/full") && error.contains("No space left"), "{error}");
}

fn dbc_fault(change: (&str, &str)) -> String {
    let text = "VERSION \"\"\nBS_:\nBU_: X\nBO_ 100 A: 8 X\n SG_ One : 0|8@1+ (1,0) [0|0] \"\" X\n SG_ Two : 8|8@1+ (1,0) [0|0] \"\" X\nBO_ 101 B: 8 X\n SG_ One : 0|8@1+ (1,0) [0|0] \"\" X\n";
    assert!(Dbc::parse(text, "t.dbc").is_ok());
    assert!(text.contains(change.0));
    Dbc::parse(&text.replacen(change.0, change.1, 1), "t.dbc")
        .map(|_| String::new())
        .unwrap_or_else(|e| e.to_string())
}

#[test]
fn every_impossible_dbc_says_where_and_what() {
    for (change, expected) in [
        (("BO_ 101 B", "BO_ 100 B"), "message B: identifier 064 is also that of A"),
        (("BO_ 101 B", "BO_ 101 A"), "message A: defined twice"),
        (("BO_ 101 B", "BO_ 65636 B"), "t.dbc:7: not a DBC: identifier 65636"),
        (("BO_ 101 B", "BO_ 2048 B"), "t.dbc:7: not a DBC: identifier 2048"),
        (("SG_ Two", "SG_ One"), "signal A.One: defined twice"),
        (("A: 8", "A: 65"), "message A: 65 bytes"),
        (("8|8@1+", "60|8@1+"), "signal A.Two: 8 bits from start bit 60 leave the 8 bytes"),
        (("8|8@1+", "8|0@1+"), "signal A.Two: 0 bits"),
        (("8|8@1+", "8|65@1+"), "signal A.Two: 65 bits"),
        (("8|8@1+", "999999999999|8@1+"), "signal A.Two: 8 bits from start bit 999999999999"),
        (("Two : 8|8@1+ (1", "Two : 8|8@1+ (0"), "signal A.Two: scale 0"),
        (("Two : 8|8@1+ (1", "Two : 8|8@1+ (1e999"), "signal A.Two: scale inf"),
        (("Two :", "Two m1 :"), "signal A.Two: multiplexed, but its message has no selector"),
        (("SG_ Two :", "SG_ Two"), "t.dbc:"),
        (("8|8@1+", "-8|8@1+"), "t.dbc:"),
        (("BO_ 101", "nonsense"), "t.dbc:7: not a DBC"),
    ] {
        let message = dbc_fault(change);
        assert!(message.contains(expected), "{change:?}: {message:?}");
    }
    let text = "BO_ 100 A: 8 X\n SG_ One : 0|8@1- (1,0) [0|0] \"\" X\nSIG_VALTYPE_ 100 One : 1;\n";
    assert!(Dbc::parse(text, "t.dbc").unwrap_err().to_string().contains("float of 32 bits"));
    for junk in ["\u{0}\u{0}", "BO_", "BO_ 1", "{\"json\": 1}", "BO_ 99999999999999999999 A: 8 X"] {
        assert!(Dbc::parse(junk, "t.dbc").is_err(), "{junk:?}");
    }
}

#[test]
fn an_unknown_signal_gets_the_nearest_name() {
    let dbc = Dbc::read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/arm.dbc")).unwrap();
    for (asked, nearest) in [
        ("Strain12.Count1", "Strain12.Counts1"),
        ("Counts7", "Strain78.Counts7"),
        ("strain12.counts2", "Strain12."),
    ] {
        let message = dbc.signal(asked).unwrap_err().to_string();
        assert!(message.contains(asked) && message.contains(nearest), "{message}");
    }
    assert!(dbc.signal("Completely.Different").unwrap_err().to_string().contains("Message.Signal"));
}

/// A clock that a test turns
#[derive(Default)]
struct Wall {
    now_ns: i64,
    slept: Vec<i64>,
}

impl Clock for Wall {
    fn now_ns(&mut self) -> i64 {
        self.now_ns
    }

    fn sleep_until_ns(&mut self, until_ns: i64) {
        self.slept.push(until_ns - self.now_ns);
        self.now_ns = until_ns;
    }
}

#[test]
fn a_replay_keeps_its_own_time() {
    let mut file = tempfile::NamedTempFile::new().unwrap();
    for stamp in ["10.000000", "10.001000", "10.000500", "10.009000"] {
        writeln!(file, "({stamp}) can0 123#00").unwrap();
    }
    for (speed, ends_ns) in [(1.0, 9_000_000), (2.0, 4_500_000)] {
        let reader = LogReader::open(file.path(), Interfaces::learned()).unwrap();
        let mut replay = Replay::new(reader, Pace::Speed(speed), Wall { now_ns: 77, slept: Vec::new() });
        let mut batch = Batch::new(64);
        let (mut frames, mut idle) = (0, 0);
        loop {
            match replay.poll(&mut batch, Duration::from_millis(3)).unwrap() {
                Poll::Ready => frames += batch.events().len(),
                Poll::Idle => idle += 1,
                Poll::End => break,
            }
        }
        assert_eq!(frames, 4);
        assert_eq!(idle, if speed == 1.0 { 2 } else { 1 });
        let reader = LogReader::open(file.path(), Interfaces::learned()).unwrap();
        let mut one = Replay::new(reader, Pace::Speed(speed), Wall::default());
        while one.poll(&mut batch, Duration::from_secs(60)).unwrap() != Poll::End {}
        assert_eq!(one.clock().slept.iter().sum::<i64>(), ends_ns);
    }
}

#[test]
fn faults_are_the_same_for_the_same_seed() {
    let faults = Faults {
        drop: 0.05,
        burst: 0.005,
        burst_frames: 5,
        duplicate: 0.05,
        reorder: 0.05,
        reorder_frames: 3,
        corrupt: 0.05,
        shorten: 0.05,
        delay: 0.05,
        delay_ns: 3_000_000,
        stuck: 0.01,
        stuck_frames: 4,
        foreign: 0.05,
    };
    let run = |faults, seed, capacity| {
        let reader = LogReader::open(&recorded(), Interfaces::learned()).unwrap();
        let mut source = FaultInjector::new(Replay::new(reader, Pace::Max, Wall::default()), faults, seed);
        let mut batch = Batch::new(capacity);
        let mut events = Vec::new();
        while source.poll(&mut batch, Duration::ZERO).unwrap() != Poll::End {
            events.extend_from_slice(batch.events());
        }
        (events, source.counts())
    };
    let (events, counts) = run(faults, 7, 64);
    assert_eq!((events.clone(), counts), run(faults, 7, 9), "whatever the batch");
    assert_ne!(events, run(faults, 8, 64).0);
    let c = counts;
    for count in
        [c.dropped, c.duplicated, c.reordered, c.corrupted, c.shortened, c.delayed, c.stuck, c.foreign]
    {
        assert!(count > 0, "{c:?}");
    }
    assert_eq!(events.len() as u64, c.frames - c.dropped + c.duplicated + c.foreign);
    let untouched = run(Faults::default(), 7, 64).0;
    let original: Vec<Event> = read_all(&recorded()).unwrap().0.into_iter().map(Event::from).collect();
    assert_eq!(untouched, original);
}
