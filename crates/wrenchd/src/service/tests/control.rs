//! The control socket as a client sees it, a good one and bad ones.

use std::io::{BufRead, BufReader, Read, Write};
use std::os::unix::net::UnixStream;
use std::time::{Duration, Instant};

use can::channel::channel;

use super::{Daemon, LOAD, files, started, wait_for};
use crate::control::{Record, Reply};
use crate::service::load::Loaded;
use crate::service::start;
use crate::view::Live;
use rig::Status;

struct Client {
    read: BufReader<UnixStream>,
    write: UnixStream,
}

impl Client {
    fn new(daemon: &Daemon) -> Self {
        let write = UnixStream::connect(daemon.path("control.sock")).unwrap();
        write.set_read_timeout(Some(Duration::from_secs(10))).unwrap();
        Self { read: BufReader::new(write.try_clone().unwrap()), write }
    }

    fn ask(&mut self, line: &str) -> Reply {
        self.write.write_all(format!("{line}\n").as_bytes()).unwrap();
        self.hear()
    }

    fn hear(&mut self) -> Reply {
        let mut line = String::new();
        self.read.read_line(&mut line).unwrap();
        serde_json::from_str(&line).unwrap_or_else(|error| panic!("{error}: {line:?}"))
    }

    fn live(&mut self) -> Live {
        self.ask(r#"{"command":"status"}"#).status.unwrap().live.unwrap()
    }

    fn force_n(&mut self) -> f64 {
        let wrench = self.live().wrench.unwrap();
        wrench[..3].iter().map(|f| f * f).sum::<f64>().sqrt()
    }

    fn wait_for_wrench(&mut self) {
        wait_for("a wrench", || {
            self.ask(r#"{"command":"status"}"#).status.unwrap().live.is_some_and(|l| l.wrench.is_some())
        });
    }
}

#[test]
fn every_record_is_passed_on() {
    let daemon = Daemon::start("");
    let mut client = Client::new(&daemon);
    client.wait_for_wrench();
    client.write.write_all(b"{\"command\":\"records\"}\n").unwrap();
    let mut last: Option<Record> = None;
    for _ in 0..200 {
        let mut line = String::new();
        client.read.read_line(&mut line).unwrap();
        let record: Record = serde_json::from_str(&line).unwrap();
        if let Some(last) = &last {
            assert_eq!(record.sequence, last.sequence + 1);
            assert!(record.instant_ns >= last.instant_ns);
        }
        assert_eq!(record.wrench.is_some(), record.reason.is_none() && record.status & 1 == 0, "{record:?}");
        last = Some(record);
    }
    daemon.silence(true);
    let mut reason = None;
    while reason.is_none() {
        let mut line = String::new();
        client.read.read_line(&mut line).unwrap();
        reason = serde_json::from_str::<Record>(&line).unwrap().reason;
    }
    assert!(reason.unwrap().contains("stale_after_s"));
}

#[test]
fn tare_payload_and_their_undo_over_the_socket() {
    let daemon = Daemon::start("");
    let mut client = Client::new(&daemon);
    client.wait_for_wrench();
    let weight_n = LOAD.0 * 9.80665;
    assert!((client.force_n() / weight_n - 1.0).abs() < 0.1);
    let status = client.ask(r#"{"command":"status"}"#).status.unwrap();
    assert_eq!((status.mode.as_str(), status.live.as_ref().unwrap().gauges.len()), ("event", 8));
    assert!(
        status.config.ends_with("arm.toml") && status.model_sha256.len() == 64 && status.totals["frames"] > 0
    );
    let live = status.live.unwrap();
    let (sigma, covariance, seen) =
        (live.sigma.unwrap(), live.covariance.unwrap(), live.singular_values_per_n.unwrap());
    for (k, j) in (0..6).flat_map(|k| (0..6).map(move |j| (k, j))) {
        let (own, other) = (covariance[k][j], covariance[j][k]);
        assert!(own == other && own.abs() <= sigma[k] * sigma[j] * (1.0 + 1e-9), "{covariance:?}");
    }
    assert!((covariance[4][4].sqrt() / sigma[4] - 1.0).abs() < 1e-9 && covariance[0][4] != 0.0);
    assert!(seen[5] > 0.0 && seen.windows(2).all(|pair| pair[0] >= pair[1]), "{seen:?}");
    assert!(live.gauges.iter().all(|gauge| gauge.state == "used" && gauge.counts != 0.0));

    let declared = client.ask(r#"{"command":"payload","mass":0.4,"com":[0.01,0,0.05]}"#);
    let payload = declared.live.unwrap().payload.unwrap();
    assert!(declared.ok && payload.mass_kg == 0.4 && (payload.com_m[2] - 0.05).abs() < 1e-12, "{payload:?}");
    wait_for("the payload to be subtracted", || client.force_n() < 0.2);
    assert_eq!(client.ask(r#"{"command":"payload","mass":0}"#).live.unwrap().payload, None);
    wait_for("the weight to be felt again", || client.force_n() > 0.9 * weight_n);

    let begun = Instant::now();
    let tared = client.ask(r#"{"command":"tare"}"#);
    assert!(tared.ok && begun.elapsed() > Duration::from_millis(500), "{tared:?}");
    let tare = tared.live.unwrap().tare.unwrap();
    assert!((0.0..60.0).contains(&tare.age_s) && tare.taken_s > 1.6e9);
    wait_for("the tare to show", || client.live().status & Status::TARED.bits() != 0);
    assert!(client.force_n() < 0.2, "{}", client.force_n());
    assert!(client.live().gauges.iter().any(|gauge| gauge.zero_shift_counts.abs() > 1e3));
    assert!(client.ask(r#"{"command":"untare"}"#).ok);
    wait_for("the weight to be felt once more", || client.force_n() > 0.9 * weight_n);
    let live = client.live();
    assert!(live.tare.is_none() && live.status & Status::TARED.bits() == 0);

    daemon.silence(true);
    wait_for("silence", || client.live().reason.is_some());
    let refused = client.ask(r#"{"command":"tare"}"#).error.unwrap();
    assert!(refused.contains("not tared") && refused.contains("is the bus alive?"), "{refused}");
}

#[test]
fn bad_lines_get_one_clear_answer_and_hurt_nobody() {
    let daemon = Daemon::start("");
    let mut good = Client::new(&daemon);
    good.wait_for_wrench();
    let mut bad = Client::new(&daemon);
    for (line, part) in [
        ("", "not a request"),
        ("{\"command\":\"fly\"}", "fly"),
        ("\u{1}\u{2}", "status, stream, tare"),
        // A period that no clock can hold.
        ("{\"command\":\"stream\",\"rate_hz\":1e-300}", "rate_hz"),
    ] {
        let reply = bad.ask(line);
        assert!(!reply.ok && reply.error.as_ref().unwrap().contains(part), "{line:?}: {reply:?}");
    }
    assert!(bad.ask(r#"{"command":"status"}"#).ok, "it may go on");
    // A line without end is cut off; so are clients that never read, and too many of them.
    let mut flood = Client::new(&daemon);
    let _ = flood.write.write_all(&[b'x'; 100_000]);
    assert!(flood.hear().error.unwrap().contains("4096 bytes"));
    assert!(matches!(flood.read.read(&mut [0; 10]), Ok(0) | Err(_)));
    let deaf: Vec<Client> = (0..20).map(|_| Client::new(&daemon)).collect();
    for client in &deaf {
        let _ = (&client.write).write_all(b"{\"command\":\"stream\",\"rate_hz\":200}\n");
    }
    let before = good.live().sequence;
    std::thread::sleep(Duration::from_millis(1000));
    let status = good.ask(r#"{"command":"status"}"#).status.unwrap();
    let passed = status.live.unwrap().sequence - before;
    assert!(passed > 50, "{passed} instants in a second of 250");
    let mut turned_away = deaf.into_iter().last().unwrap();
    assert!(turned_away.hear().error.unwrap().contains("clients are connected"));
}

#[test]
fn a_stream_goes_on_and_a_reload_answers() {
    let daemon = Daemon::start("");
    let (mut client, mut other) = (Client::new(&daemon), Client::new(&daemon));
    client.wait_for_wrench();
    let first = other.ask(r#"{"command":"stream","rate_hz":50}"#).status.unwrap().live.unwrap().sequence;
    let begun = Instant::now();
    let last = (0..50).map(|_| other.hear().status.unwrap().live.unwrap().sequence).last().unwrap();
    assert!(begun.elapsed().as_secs_f64() > 0.8 && last > first, "50 of 50 a second, {first} to {last}");
    let done = client.ask(r#"{"command":"reload"}"#);
    assert!(done.ok && done.done.unwrap().contains("model_sha256="));
    std::fs::write(daemon.path("model.toml"), "nonsense").unwrap();
    let error = client.ask(r#"{"command":"reload"}"#).error.unwrap();
    assert!(error.contains("model.toml") && error.contains("go on"), "{error}");
    assert!(other.hear().ok, "the stream outlives a reload");
    client.wait_for_wrench();
}

#[test]
fn a_socket_that_cannot_be_made_is_no_reason_to_stop_and_one_that_is_served_is() {
    let folder = tempfile::tempdir().unwrap();
    let options = files(folder.path(), "");
    let (first, _bus) = started(&options);
    assert!(folder.path().join("control.sock").exists());
    let (_other_bus, source) = channel(16);
    let loaded = Loaded::load(&options).unwrap();
    let second = start(&options, loaded, |_, _| Ok((Box::new(source), None)));
    let refused = second.err().unwrap().to_string();
    assert!(refused.contains("another wrenchd serves it"), "{refused}");
    first.runner.stop().unwrap();

    let text = std::fs::read_to_string(&options.config).unwrap();
    let socket = folder.path().join("control.sock").display().to_string();
    assert!(text.contains(&socket));
    std::fs::write(&options.config, text.replace(&socket, "/proc/no/control.sock")).unwrap();
    let (without, _bus) = started(&options);
    assert!(!without.runner.has_ended(), "the cycle runs without it");
    without.runner.stop().unwrap();
}
