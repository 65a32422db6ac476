//! What comes over sockets.

use std::net::SocketAddr;
use std::sync::Arc;
use std::time::{Duration, Instant};

use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::runtime::{Builder, Runtime};
use wrenchd::control::{LINE_BYTES, MOST_PAYLOAD_KG, MOST_STREAM_HZ, Reply, Request};
use wrenchd::network::http::{Answer, attend};
use wrenchd::output::rdt;

/// Datagrams of 9 bytes (whose, and 8 of request; the last may be shorter): records go only to who asked last and was let,
/// never more than asked for, and nobody takes a stream from another host within its lease.
pub(crate) fn rdt(data: &[u8]) -> bool {
    let stream = rdt::Stream::default();
    let mut grants = rdt::Grants::new(&stream);
    let begun = Instant::now();
    let (mut granted, mut accepted, mut at_s): (Option<(SocketAddr, u64)>, bool, u64) = (None, false, 0);
    for datagram in data.chunks(9) {
        let (who, bytes) = (datagram[0], &datagram[1..]);
        let Some(request) = rdt::Request::parse(bytes) else { continue };
        accepted = true;
        at_s += u64::from(who >> 4);
        let from = SocketAddr::from(([10, 0, 0, who & 3], 1000 + u16::from(who >> 2 & 3)));
        let live = granted.filter(|(_, left)| *left > 0);
        match (grants.take(request, from, begun + Duration::from_secs(at_s)), request) {
            (Ok(()), rdt::Request::Stop) => granted = None,
            (Ok(()), rdt::Request::Stream(count)) => {
                granted = Some((from, count.map_or(u64::MAX, u64::from)));
            }
            (Ok(()), _) => {}
            (Err(holder), _) => {
                assert!(live.is_some_and(|(to, _)| to.ip() == holder && holder != from.ip()), "{holder}");
            }
        }
        for _ in 0..who & 7 {
            let next = stream.next_record();
            assert_eq!(next.map(|(to, _)| to), granted.filter(|(_, left)| *left > 0).map(|(to, _)| to));
            granted = granted.map(|(to, left)| (to, left.saturating_sub(1)));
        }
    }
    accepted
}

thread_local! {
    static RUNTIME: Runtime = Builder::new_current_thread().enable_time().build().expect("a runtime");
}

/// A connection on which these bytes come: an answer in HTTP or none, never an error of the server's own.
pub(crate) fn http(data: &[u8]) -> bool {
    let answer = RUNTIME.with(|runtime| runtime.block_on(exchange(data)));
    if answer.is_empty() {
        return false;
    }
    let answer = String::from_utf8_lossy(&answer);
    assert!(answer.starts_with("HTTP/1."), "{answer}");
    let code = answer.get(9..12).and_then(|code| code.parse::<u16>().ok()).unwrap_or_default();
    assert!((200..500).contains(&code), "{answer}");
    code == 200
}

async fn exchange(data: &[u8]) -> Vec<u8> {
    // Room for all that is asked and answered: neither side waits for the other.
    let (mut client, server) = tokio::io::duplex(1 << 24);
    client.write_all(data).await.expect("there is room");
    client.shutdown().await.expect("a pipe");
    let answerer = Arc::new(|path: &str| {
        assert!(path.starts_with('/') || path == "*" || path.is_empty(), "{path:?}");
        Answer::ok("text/plain", path.to_owned())
    });
    attend(server, answerer).await;
    let mut answer = Vec::new();
    client.read_to_end(&mut answer).await.expect("a pipe");
    answer
}

/// Lines on the control socket: what is accepted is within its limits and comes back the same; a reply is read without harm.
pub(crate) fn control(data: &[u8]) -> bool {
    let mut accepted = false;
    for line in data.split(|byte| *byte == b'\n').map(|line| &line[..line.len().min(LINE_BYTES)]) {
        if let Ok(reply) = serde_json::from_slice::<Reply>(line) {
            assert!(serde_json::to_vec(&reply).is_ok());
        }
        let request = match Request::parse(line) {
            Ok(request) => request,
            Err(error) => {
                assert!(!error.is_empty() && error.len() < 2 * LINE_BYTES, "{error}");
                continue;
            }
        };
        accepted = true;
        match &request {
            Request::Stream { rate_hz } => assert!(*rate_hz > 0.0 && *rate_hz <= MOST_STREAM_HZ),
            Request::Payload { mass, com } => {
                assert!((0.0..=MOST_PAYLOAD_KG).contains(mass) && com.iter().all(|x| x.abs() <= 10.0));
            }
            _ => {}
        }
        let text = serde_json::to_vec(&request).expect("a request is JSON");
        assert_eq!(Request::parse(&text), Ok(request));
    }
    accepted
}
