//! Metrics, health and the page as HTTP clients see them, bad clients included.

use std::io::{Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::time::{Duration, Instant};

use super::{Daemon, free_tcp, http_get, wait_for};

fn serving() -> (Daemon, SocketAddr) {
    let address = free_tcp();
    (Daemon::start(&format!("[publish.metrics]\nbind = \"{address}\"\n")), address)
}

/// All that is answered to these bytes.
fn exchange(address: SocketAddr, request: &[u8]) -> String {
    over(TcpStream::connect(address).unwrap(), request)
}

fn over(mut stream: TcpStream, request: &[u8]) -> String {
    stream.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
    let _ = stream.write_all(request);
    let mut text = Vec::new();
    let _ = stream.read_to_end(&mut text);
    String::from_utf8_lossy(&text).into_owned()
}

/// What is answered to a GET from 127.0.0.2.
fn from_another_host(address: SocketAddr) -> String {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_io().build().unwrap();
    let stream = runtime.block_on(async {
        let socket = tokio::net::TcpSocket::new_v4().unwrap();
        socket.bind("127.0.0.2:0".parse().unwrap()).unwrap();
        socket.connect(address).await.unwrap().into_std().unwrap()
    });
    stream.set_nonblocking(false).unwrap();
    over(stream, b"GET /health HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n")
}

fn get(address: SocketAddr, path: &str) -> (u16, String) {
    let text = http_get(address, path);
    let (head, body) = text.split_once("\r\n\r\n").unwrap_or_else(|| panic!("{text:?}"));
    (head.split(' ').nth(1).unwrap().parse().unwrap(), body.to_owned())
}

fn metric(text: &str, name: &str) -> f64 {
    let line = text.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(' '));
    line.unwrap_or_else(|| panic!("no {name} in\n{text}")).parse().unwrap()
}

#[test]
fn metrics_and_health_follow_the_daemon() {
    let (daemon, address) = serving();
    wait_for("health", || get(address, "/health").0 == 200);
    let health: serde_json::Value = serde_json::from_str(&get(address, "/health").1).unwrap();
    assert_eq!(
        (health["status"].as_str(), health["model_sha256"].as_str().map(str::len)),
        (Some("ok"), Some(64))
    );
    wait_for("the rate", || metric(&get(address, "/metrics").1, "wrenchd_published_hertz") > 200.0);
    let (code, text) = get(address, "/metrics");
    assert_eq!(
        (code, metric(&text, "wrenchd_healthy"), metric(&text, "wrenchd_parity_dof")),
        (200, 1.0, 2.0)
    );
    assert_eq!(metric(&text, "wrenchd_gauge_used{gauge=\"s3\",state=\"used\"}"), 1.0);
    assert_eq!(metric(&text, "wrenchd_status{bit=\"invalid\"}"), 0.0);
    let latencies = metric(&text, "wrenchd_latency_seconds_count");
    assert!(latencies > 200.0 && metric(&text, "wrenchd_latency_seconds_bucket{le=\"+Inf\"}") == latencies);
    let forces = ["fx", "fy", "fz"]
        .map(|axis| metric(&text, &format!("wrenchd_wrench{{axis=\"{axis}\",unit=\"N\"}}")));
    let force_n = forces.iter().map(|f| f * f).sum::<f64>().sqrt();
    assert!((force_n / (0.4 * 9.80665) - 1.0).abs() < 0.1, "{force_n}");
    // Every family has its help and type before its samples, once.
    for line in text.lines().filter(|line| !line.starts_with('#')) {
        let name = line.split(['{', ' ']).next().unwrap();
        let family =
            ["_bucket", "_sum", "_count"].iter().find_map(|end| name.strip_suffix(end)).unwrap_or(name);
        assert_eq!(text.matches(&format!("# TYPE {family} ")).count(), 1, "{line}");
    }
    daemon.silence(true);
    wait_for("the end of health", || get(address, "/health").0 == 503);
    let health: serde_json::Value = serde_json::from_str(&get(address, "/health").1).unwrap();
    assert!(health["reason"].as_str().unwrap().contains("stale_after_s"), "{health}");
    let (_, text) = get(address, "/metrics");
    assert_eq!(
        (metric(&text, "wrenchd_healthy"), metric(&text, "wrenchd_status{bit=\"invalid\"}")),
        (0.0, 1.0)
    );
    assert!(!text.contains("wrenchd_wrench{"), "a stale wrench is none");
}

/// By the parser of Prometheus' own Python client.
#[test]
fn prometheus_reads_the_metrics() {
    let (daemon, address) = serving();
    wait_for("health", || get(address, "/health").0 == 200);
    let page = daemon.path("metrics.txt");
    std::fs::write(&page, get(address, "/metrics").1).unwrap();
    let mut command = wrenchd_tests::python::script("metrics.py").unwrap();
    let said = wrenchd_tests::process::run(command.arg(&page), Duration::from_secs(60)).unwrap().stdout();
    for line in [
        "family wrenchd_frames counter",
        "family wrenchd_latency_seconds histogram",
        "family wrenchd_wrench gauge",
        "sample wrenchd_healthy - 1.0",
        "sample wrenchd_gauge_used gauge=s3,state=used 1.0",
        "sample wrenchd_gauge_suspect gauge=s3 0.0",
        "sample wrenchd_parity_dof - 2.0",
    ] {
        assert!(said.lines().any(|said| said == line), "{line}\n{said}");
    }
    let levels: Vec<f64> = said
        .lines()
        .filter_map(|line| {
            line.strip_prefix("sample wrenchd_wrench_protection axis=")?.rsplit_once(' ')?.1.parse().ok()
        })
        .collect();
    assert!(levels.len() == 6 && levels.iter().all(|level| *level > 0.0 && *level < 100.0), "{levels:?}");
}

#[test]
fn the_page_needs_nothing_from_elsewhere() {
    let (_daemon, address) = serving();
    let (code, page) = get(address, "/");
    assert!(code == 200 && page.starts_with("<!DOCTYPE html>"));
    for elsewhere in ["http://", "https://", "src=", "@import", "url("] {
        assert!(!page.contains(elsewhere), "{elsewhere}");
    }
    let status: crate::view::DaemonStatus = serde_json::from_str(&get(address, "/status.json").1).unwrap();
    assert_eq!(status.mode, "event");
    assert_eq!(get(address, "/etc/passwd").0, 404);
}

#[test]
fn bad_clients_are_cut_off_and_others_served() {
    let (_daemon, address) = serving();
    let post = exchange(
        address,
        b"POST /metrics HTTP/1.1\r\nHost: x\r\nContent-Length: 0\r\nConnection: close\r\n\r\n",
    );
    assert!(post.starts_with("HTTP/1.1 405 ") && post.to_lowercase().contains("allow: get, head"), "{post}");
    assert!(exchange(address, b"\x00\xff nonsense\r\n\r\n").starts_with("HTTP/1.1 400 "));
    let huge = [b"GET / HTTP/1.1\r\nA: ".as_slice(), &[b'x'; 100_000], b"\r\n\r\n"].concat();
    let answer = exchange(address, &huge);
    assert!(answer.is_empty() || answer.starts_with("HTTP/1.1 4"), "{answer}");
    // Connections that say nothing fill all places of their host for as long as a request may take, no longer.
    let silent: Vec<TcpStream> = (0..40).map(|_| TcpStream::connect(address).unwrap()).collect();
    let begun = Instant::now();
    assert!(from_another_host(address).starts_with("HTTP/1.1 ") && begun.elapsed() < Duration::from_secs(4));
    let served = || {
        exchange(address, b"GET /health HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n")
            .starts_with("HTTP/1.1 ")
    };
    wait_for("a place", served);
    drop(silent);
}
