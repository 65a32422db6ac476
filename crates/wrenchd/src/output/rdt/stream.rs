//! Who gets records: written by the task that hears requests, followed by the cycle, without either waiting.

use std::net::{IpAddr, Ipv6Addr, SocketAddr, SocketAddrV6};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use super::record::Request;
use crate::seqlock::Words;

/// How long after its last request a host keeps the stream against other hosts. Its own programs replace each other at once,
/// as with the original box.
pub(super) const LEASE: Duration = Duration::from_secs(10);

/// The stream of records. It outlives a reload.
#[derive(Debug, Default)]
pub struct Stream {
    /// The newest request: address (2 words), scope and port, records wanted.
    request: Words<4>,
    /// Records sent for that request: its number in the upper half, how many in the lower. Written by the cycle alone.
    sent: AtomicU64,
    /// The host that holds the stream, and until when against others. The cycle does not look here.
    holder: Mutex<Option<(IpAddr, Instant)>>,
}

/// Wanted without end.
const ENDLESS: u64 = u64::MAX;

/// The end at which requests are taken in: there is one.
#[derive(Debug)]
pub struct Grants<'a> {
    stream: &'a Stream,
}

impl Stream {
    /// Where the next record goes, if anywhere, with its number since the stream's start (1 and on); counts it as sent. For the
    /// cycle: no wait, no allocation.
    pub fn next_record(&self) -> Option<(SocketAddr, u32)> {
        let (request, [high, low, port, wanted]) = self.request.read()?;
        let sent = self.sent(request);
        if u64::from(sent) >= wanted && wanted != ENDLESS {
            return None;
        }
        // A stream without end counts on from 1 after 2^32 records.
        let number = sent.checked_add(1).unwrap_or(1);
        self.sent.store(request << 32 | u64::from(number), Ordering::Relaxed);
        let address = Ipv6Addr::from_bits(u128::from(high) << 64 | u128::from(low));
        let (scope, port) = ((port >> 16) as u32, port as u16);
        let to = match address.to_canonical() {
            IpAddr::V4(address) => SocketAddr::new(address.into(), port),
            IpAddr::V6(address) => SocketAddrV6::new(address, port, 0, scope).into(),
        };
        Some((to, number))
    }

    /// Records sent so far for a request.
    fn sent(&self, request: u64) -> u32 {
        let sent = self.sent.load(Ordering::Relaxed);
        if sent >> 32 == request & 0xFFFF_FFFF { sent as u32 } else { 0 }
    }

    /// Whether records are still due to somebody.
    fn is_live(&self) -> bool {
        self.request
            .read()
            .is_some_and(|(request, words)| words[3] == ENDLESS || u64::from(self.sent(request)) < words[3])
    }
}

impl<'a> Grants<'a> {
    /// For the only task that takes in requests. A stream from before (a reload) goes on, and stays its holder's.
    pub fn new(stream: &'a Stream) -> Self {
        Self { stream }
    }

    /// Starts or ends the stream as asked, or lets a bias pass; the host that holds the stream if that is another one. After its lease
    /// another may take the stream over, but neither stop it nor shift the zeros beneath it.
    pub fn take(&mut self, request: Request, from: SocketAddr, now: Instant) -> Result<(), IpAddr> {
        let mut held = self.stream.holder.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((holder, until)) = *held
            && request != Request::ResetLatch
            && holder != from.ip()
            && self.stream.is_live()
            && (now < until || matches!(request, Request::Stop | Request::Bias))
        {
            return Err(holder);
        }
        let wanted = match request {
            Request::Stop => 0,
            Request::Stream(None) => ENDLESS,
            Request::Stream(Some(count)) => count.into(),
            Request::ResetLatch | Request::Bias => return Ok(()),
        };
        *held = Some((from.ip(), now + LEASE));
        let (bits, scope) = match from {
            SocketAddr::V4(from) => (from.ip().to_ipv6_mapped().to_bits(), 0),
            SocketAddr::V6(from) => (from.ip().to_bits(), from.scope_id()),
        };
        let port = u64::from(scope) << 16 | u64::from(from.port());
        let words = [(bits >> 64) as u64, bits as u64, port, wanted];
        self.stream.request.write(self.stream.request.number() + 1, words);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sent(stream: &Stream, most: usize) -> Vec<(String, u32)> {
        let next = || stream.next_record().map(|(to, number)| (to.to_string(), number));
        std::iter::from_fn(next).take(most).collect()
    }

    #[test]
    fn a_count_ends_a_new_request_replaces_and_a_stop_stops() {
        let stream = Stream::default();
        let mut grants = Grants::new(&stream);
        let (a, b): (SocketAddr, SocketAddr) = ("10.0.0.1:5".parse().unwrap(), "10.0.0.1:6".parse().unwrap());
        let now = Instant::now();
        assert_eq!(sent(&stream, 9), []);
        grants.take(Request::Stream(Some(2)), a, now).unwrap();
        assert_eq!(sent(&stream, 9), [("10.0.0.1:5".into(), 1), ("10.0.0.1:5".into(), 2)]);
        grants.take(Request::Stream(None), a, now).unwrap();
        assert_eq!(sent(&stream, 3).last().unwrap().1, 3);
        grants.take(Request::Stream(Some(1)), b, now).unwrap();
        assert_eq!(sent(&stream, 9), [("10.0.0.1:6".into(), 1)]);
        let v6: SocketAddr = "[fe80::7%3]:70".parse().unwrap();
        grants.take(Request::Stream(None), v6, now).unwrap();
        assert_eq!(sent(&stream, 1), [("[fe80::7%3]:70".into(), 1)]);
        grants.take(Request::Bias, v6, now).unwrap();
        assert_eq!(sent(&stream, 1)[0].1, 2, "goes on through a bias");
        grants.take(Request::Stop, v6, now).unwrap();
        assert_eq!(sent(&stream, 9), []);
    }

    #[test]
    fn a_host_holds_a_live_stream_for_its_lease() {
        let stream = Stream::default();
        let mut grants = Grants::new(&stream);
        let (robot, other): (SocketAddr, SocketAddr) =
            ("10.0.0.1:5".parse().unwrap(), "10.0.0.2:5".parse().unwrap());
        let begun = Instant::now();
        grants.take(Request::Stream(None), robot, begun).unwrap();
        let soon = begun + LEASE / 2;
        assert_eq!(grants.take(Request::Stream(None), other, soon), Err(robot.ip()));
        assert_eq!(sent(&stream, 1)[0].0, "10.0.0.1:5");
        grants.take(Request::Stream(None), robot, soon).unwrap();
        assert_eq!(grants.take(Request::Stream(None), other, begun + LEASE), Err(robot.ip()), "renewed");
        assert_eq!(grants.take(Request::Stop, other, begun + 2 * LEASE), Err(robot.ip()));
        grants.take(Request::Stream(Some(1)), other, begun + 2 * LEASE).unwrap();
        assert_eq!(sent(&stream, 9), [("10.0.0.2:5".into(), 1)]);
        grants.take(Request::Stream(None), robot, begun + 2 * LEASE).unwrap();
        assert_eq!(sent(&stream, 1)[0].0, "10.0.0.1:5", "an ended stream belongs to nobody");
    }

    #[test]
    fn the_holder_keeps_its_lease_through_a_reload() {
        let stream = Stream::default();
        let (robot, other): (SocketAddr, SocketAddr) =
            ("10.0.0.1:5".parse().unwrap(), "10.0.0.2:5".parse().unwrap());
        let begun = Instant::now();
        Grants::new(&stream).take(Request::Stream(None), robot, begun).unwrap();
        let mut after = Grants::new(&stream);
        for request in [Request::Stream(None), Request::Stop, Request::Bias] {
            assert_eq!(after.take(request, other, begun + LEASE / 2), Err(robot.ip()), "{request:?}");
        }
        assert_eq!(sent(&stream, 1)[0].0, "10.0.0.1:5");
        after.take(Request::Stream(None), other, begun + LEASE).unwrap();
    }

    #[test]
    fn only_the_holder_of_a_live_stream_shifts_its_zeros() {
        let stream = Stream::default();
        let mut grants = Grants::new(&stream);
        let (robot, other): (SocketAddr, SocketAddr) =
            ("10.0.0.1:5".parse().unwrap(), "10.0.0.2:5".parse().unwrap());
        let begun = Instant::now();
        grants.take(Request::Bias, other, begun).unwrap();
        grants.take(Request::Stream(None), robot, begun).unwrap();
        for later in [Duration::ZERO, LEASE / 2, 2 * LEASE] {
            assert_eq!(grants.take(Request::Bias, other, begun + later), Err(robot.ip()), "{later:?}");
            grants.take(Request::ResetLatch, other, begun + later).unwrap();
            grants.take(Request::Bias, robot, begun + later).unwrap();
        }
        grants.take(Request::Stop, robot, begun).unwrap();
        grants.take(Request::Bias, other, begun).unwrap();
    }

    #[test]
    fn a_stream_without_end_counts_on_after_the_largest_number() {
        let stream = Stream::default();
        Grants::new(&stream)
            .take(Request::Stream(None), "10.0.0.1:5".parse().unwrap(), Instant::now())
            .unwrap();
        stream.sent.store(1 << 32 | u64::from(u32::MAX - 1), Ordering::Relaxed);
        let numbers: Vec<u32> = sent(&stream, 3).into_iter().map(|(_, number)| number).collect();
        assert_eq!(numbers, [u32::MAX, 1, 2]);
    }
}
