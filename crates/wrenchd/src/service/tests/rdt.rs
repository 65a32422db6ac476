//! RDT byte by byte, as a client that knows nothing of this project would speak it.

use std::net::{SocketAddr, UdpSocket};
use std::time::Duration;

use super::{Daemon, RATE_HZ, free_tcp, free_udp, wait_for};

/// A record taken apart.
#[derive(Clone, Copy, Debug)]
struct Record {
    number: u32,
    sample: u32,
    status: u32,
    counts: [i32; 6],
}

struct Client(UdpSocket);

impl Client {
    fn new(server: SocketAddr) -> Self {
        Self::at("127.0.0.1:0", server)
    }

    fn at(own: &str, server: SocketAddr) -> Self {
        let socket = UdpSocket::bind(own).unwrap();
        socket.connect(server).unwrap();
        socket.set_read_timeout(Some(Duration::from_secs(1))).unwrap();
        Self(socket)
    }

    fn ask(&self, command: u8, count: u8) {
        self.0.send(&[0x12, 0x34, 0, command, 0, 0, 0, count]).unwrap();
    }

    fn hear(&self) -> Option<Record> {
        let mut data = [0; 100];
        let length = self.0.recv(&mut data).ok()?;
        assert_eq!(length, 36);
        let word = |k: usize| [data[4 * k], data[4 * k + 1], data[4 * k + 2], data[4 * k + 3]];
        let [number, sample, status] = [0, 1, 2].map(|k| u32::from_be_bytes(word(k)));
        Some(Record {
            number,
            sample,
            status,
            counts: std::array::from_fn(|k| i32::from_be_bytes(word(3 + k))),
        })
    }

    /// All that comes until it is silent, at most so many.
    fn all(&self, most: usize) -> Vec<Record> {
        std::iter::from_fn(|| self.hear()).take(most).collect()
    }
}

fn force_n(record: &Record) -> f64 {
    record.counts[..3].iter().map(|c| (f64::from(*c) * 1e-6).powi(2)).sum::<f64>().sqrt()
}

struct Served {
    daemon: Daemon,
    rdt: SocketAddr,
    http: SocketAddr,
}

fn serving(more: &str) -> Served {
    let (rdt, http) = (free_udp(), free_tcp());
    let daemon = Daemon::start(&format!("[publish.rdt]\nbind = \"{rdt}\"\nhttp = \"{http}\"\n{more}"));
    let client = Client::new(rdt);
    wait_for("a valid record", || {
        client.ask(2, 1);
        client.hear().is_some_and(|record| record.status == 0)
    });
    Served { daemon, rdt, http }
}

#[test]
fn streams_polls_counts_and_stops() {
    let Served { rdt, daemon: _daemon, .. } = serving("");
    let client = Client::new(rdt);
    client.ask(2, 0);
    let records = client.all(100);
    assert!(
        records.iter().enumerate().all(|(k, r)| r.number == k as u32 + 1 && r.status == 0),
        "{records:?}"
    );
    assert!(
        records.windows(2).all(|pair| pair[1].sample == pair[0].sample + 1),
        "each record is a new sample"
    );
    assert!((force_n(&records[99]) / (0.4 * 9.80665) - 1.0).abs() < 0.1, "{:?}", records[99]);
    client.ask(0, 0);
    assert!(client.all(1000).len() < 100);
    assert!(client.hear().is_none(), "stopped");
    client.ask(2, 7);
    let counted = client.all(100);
    assert_eq!(counted.iter().map(|r| r.number).collect::<Vec<_>>(), [1, 2, 3, 4, 5, 6, 7]);
    assert!(counted[0].sample > records[99].sample, "samples count on");
    for _ in 0..20 {
        client.ask(2, 1);
        assert_eq!(client.hear().unwrap().number, 1);
    }
    // A new request replaces the old, and goes to where it came from.
    client.ask(2, 0);
    assert!(client.hear().is_some());
    let other = Client::new(rdt);
    other.ask(2, 0);
    assert_eq!(other.hear().unwrap().number, 1);
    client.all(1000);
    assert!(client.hear().is_none() && other.hear().is_some());
    for nonsense in [&b"\x12\x34\0\x02\0\0\0"[..], b"", b"\x12\x34\0\x07\0\0\0\0", &[0x12; 500]] {
        client.0.send(nonsense).unwrap();
    }
    assert!(other.hear().is_some() && client.hear().is_none());
}

#[test]
fn a_bias_tares_while_the_stream_goes_on() {
    let Served { rdt, daemon: _daemon, .. } = serving("");
    let client = Client::new(rdt);
    client.ask(2, 0);
    client.hear().unwrap();
    client.ask(0x41, 0);
    client.ask(0x42, 0);
    let records = client.all(RATE_HZ as usize * 2);
    assert_eq!(records.len(), RATE_HZ as usize * 2);
    assert!(records.windows(2).all(|pair| pair[1].number == pair[0].number + 1), "no gap");
    let (first, last) = (force_n(&records[0]), force_n(&records[records.len() - 1]));
    assert!(first > 3.0 && last < 0.2, "{first} N, then {last} N");
}

#[test]
fn who_does_not_hold_the_stream_does_not_tare_it() {
    let Served { rdt, daemon: _daemon, .. } = serving("allow = [\"127.0.0.1\", \"127.0.0.2\"]\n");
    let (holder, other) = (Client::new(rdt), Client::at("127.0.0.2:0", rdt));
    holder.ask(2, 0);
    holder.hear().unwrap();
    other.ask(0x42, 0);
    let records = holder.all(RATE_HZ as usize * 2);
    assert!(records.len() == RATE_HZ as usize * 2 && records.iter().all(|record| force_n(record) > 3.0));
    holder.ask(0, 0);
    holder.all(1000);
    other.ask(0x42, 0);
    wait_for("a tare", || {
        other.ask(2, 1);
        other.hear().is_some_and(|record| force_n(&record) < 0.2)
    });
}

/// Whoever sends biases can send many: those asked during a tare are not kept for later.
#[test]
fn a_flood_of_biases_leaves_nothing_behind() {
    let Served { rdt, daemon, .. } = serving("");
    let client = Client::new(rdt);
    client.ask(2, 0);
    (0..2000).for_each(|_| client.ask(0x42, 0));
    wait_for("a tare", || client.hear().is_some_and(|record| force_n(&record) < 0.2));
    // The flood has ended: what is untared now stays so, whoever waits.
    let answer = super::control_line(&daemon, r#"{"command":"untare"}"#);
    assert!(answer.contains("\"ok\":true"), "{answer}");
    wait_for("the load again", || client.hear().is_some_and(|record| force_n(&record) > 3.0));
    let after = client.all(RATE_HZ as usize * 3);
    assert!(after.iter().all(|record| force_n(record) > 3.0), "tared again by itself");
}

#[test]
fn without_a_wrench_the_last_counts_come_with_the_one_status() {
    let Served { daemon, rdt, .. } = serving("");
    let client = Client::new(rdt);
    client.ask(2, 0);
    client.hear().unwrap();
    daemon.silence(true);
    let records = client.all(100);
    let invalid: Vec<&Record> = records.iter().filter(|record| record.status != 0).collect();
    assert!(invalid.len() >= 10, "silence is told too");
    assert!(invalid.iter().all(|r| r.status == 0x8000_0000 && force_n(r) > 3.0), "{:?}", invalid[0]);
    assert!(records.windows(2).all(|pair| pair[1].sample != pair[0].sample));
}

#[test]
fn only_allowed_hosts_are_answered_and_the_holder_keeps_its_stream() {
    let Served { rdt, http, daemon: _daemon } = serving("allow = [\"127.0.0.1\", \"127.0.0.2\"]\n");
    let (holder, second, foreign) =
        (Client::at("127.0.0.1:0", rdt), Client::at("127.0.0.2:0", rdt), Client::at("127.0.0.3:0", rdt));
    foreign.ask(2, 1);
    assert!(foreign.hear().is_none());
    second.ask(2, 1);
    assert!(second.hear().is_some());
    holder.ask(2, 0);
    assert!(holder.hear().is_some());
    for client in [&second, &foreign] {
        client.ask(2, 0);
        client.ask(0, 0);
        assert!(client.hear().is_none());
    }
    assert!(holder.all(200).len() == 200, "undisturbed");
    let answer = super::http_get(http, "/netftapi2.xml");
    assert!(
        answer.starts_with("HTTP/1.1 200 ") && answer.contains("<runstat>0x00000000</runstat>"),
        "{answer}"
    );
    assert!(answer.contains("text/xml") && answer.contains("<netft>") && !answer.contains("DOCTYPE"));
    assert!(super::http_get(http, "/").starts_with("HTTP/1.1 404 "));
}

#[test]
fn the_description_has_the_newest_counts_and_the_address_that_was_asked() {
    let (rdt, http) = (free_udp().port(), free_tcp().port());
    let _daemon =
        Daemon::start(&format!("[publish.rdt]\nbind = \"0.0.0.0:{rdt}\"\nhttp = \"0.0.0.0:{http}\"\n"));
    let description = || super::http_get(SocketAddr::from(([127, 0, 0, 7], http)), "/netftapi2.xml");
    wait_for("a wrench", || description().contains("<runstat>0x00000000</runstat>"));
    let text = description();
    assert!(text.contains("<netip>127.0.0.7</netip>"), "{text}");
    let (_, counts) = text.split_once("<runft>").unwrap();
    let counts: Vec<f64> =
        counts.split_once('<').unwrap().0.split(';').map(|count| count.parse().unwrap()).collect();
    let force_n = counts[..3].iter().map(|count| (count * 1e-6).powi(2)).sum::<f64>().sqrt();
    assert!(counts.len() == 6 && (force_n / (0.4 * 9.80665) - 1.0).abs() < 0.1, "{text}");
}

#[test]
fn a_reload_does_not_end_the_stream() {
    let Served { daemon, rdt, .. } = serving("allow = [\"127.0.0.1\", \"127.0.0.2\"]\n");
    let (client, other) = (Client::new(rdt), Client::at("127.0.0.2:0", rdt));
    client.ask(2, 0);
    client.hear().unwrap();
    super::control_line(&daemon, r#"{"command":"reload"}"#);
    other.ask(2, 0);
    let records = client.all(300);
    assert!(records.len() == 300 && records.windows(2).all(|pair| pair[1].number == pair[0].number + 1));
    assert!(records.windows(2).all(|pair| pair[1].sample == pair[0].sample + 1));
    client.ask(0, 0);
    client.all(1000);
    assert!(client.hear().is_none(), "requests are heard after it too");
}
