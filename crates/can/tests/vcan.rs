//! The socket source and sender on real interfaces: needs `vcan0` and `vcan1` (mtu 72, up) and the right to delete links
//!
//! So `cargo test` builds it only where it is asked for by name, and the whole-program tests run it inside their machine.
#![allow(clippy::unwrap_used, clippy::panic)] // a test may
#![cfg(target_os = "linux")]

use std::process::Command;
use std::time::{Duration, Instant, SystemTime};

use wrenchd_can::frame::{CanId, Flags, Frame, Stamped};
use wrenchd_can::socket::{SocketOptions, SocketSender, SocketSource};
use wrenchd_can::source::{Batch, Event, Poll, Source};

const TIMEOUT: Duration = Duration::from_secs(2);

fn ip(arguments: &str) {
    assert!(Command::new("ip").args(arguments.split(' ')).status().unwrap().success(), "ip {arguments}");
}

/// All events until `enough` says so
fn collect(source: &mut SocketSource, enough: impl Fn(&[Event]) -> bool) -> Vec<Event> {
    let mut batch = Batch::new(64);
    let mut all = Vec::new();
    let begun = Instant::now();
    while !enough(&all) && begun.elapsed() < TIMEOUT {
        if source.poll(&mut batch, Duration::from_millis(50)).unwrap() == Poll::Ready {
            all.extend_from_slice(batch.events());
        }
    }
    all
}

fn frames(events: &[Event]) -> Vec<Stamped> {
    events.iter().filter_map(|event| event.stamped().copied()).collect()
}

fn id(number: u32) -> CanId {
    CanId::standard(number).unwrap()
}

#[test]
fn every_kind_of_frame_from_two_interfaces_with_kernel_stamps() {
    let options = SocketOptions::default();
    let mut source = SocketSource::open(&[("vcan0", options.clone()), ("vcan1", options)]).unwrap();
    println!("receive buffer: {} bytes", source.receive_buffer());
    let sent = [
        Frame::classical(id(0x123), &[1, 2, 3]),
        Frame::classical(CanId::extended(0x123).unwrap(), &[]),
        Frame::fd(id(0x124), 1, &[9; 64]),
        Frame::remote(id(0x125), 4),
    ]
    .map(Option::unwrap);
    let before_ns = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap().as_nanos() as i64;
    for name in ["vcan0", "vcan1"] {
        assert_eq!(SocketSender::open(name).unwrap().send(&sent), 4);
    }
    let received = frames(&collect(&mut source, |events| events.len() >= 8));
    assert_eq!(source.unstamped(), 0);
    for interface in [0, 1] {
        let of: Vec<_> = received.iter().filter(|s| s.interface == interface).collect();
        assert_eq!(of.len(), 4);
        for (got, want) in of.iter().zip(&sent) {
            assert_eq!((got.frame.id(), got.frame.data()), (want.id(), want.data()));
            assert_eq!(got.frame.flags().has(Flags::FD), want.flags().has(Flags::FD));
            assert!((got.stamp_ns - before_ns).abs() < 5_000_000_000);
        }
        assert!(of.windows(2).all(|pair| pair[0].stamp_ns <= pair[1].stamp_ns));
    }
}

#[test]
fn filters_let_through_only_what_is_wanted() {
    let options = SocketOptions {
        filters: Some(vec![id(0x101), CanId::extended(0x102).unwrap()]),
        ..Default::default()
    };
    let mut source = SocketSource::open(&[("vcan0", options)]).unwrap();
    let all =
        [id(0x100), id(0x101), id(0x102), CanId::extended(0x101).unwrap(), CanId::extended(0x102).unwrap()];
    let all = all.map(|id| Frame::classical(id, &[0]).unwrap());
    SocketSender::open("vcan0").unwrap().send(&all);
    let received: Vec<_> =
        frames(&collect(&mut source, |e| e.len() >= 3)).iter().map(|s| s.frame.id()).collect();
    assert_eq!(received, [id(0x101), CanId::extended(0x102).unwrap()]);
}

#[test]
fn what_the_kernel_drops_is_counted_exactly() {
    let options = SocketOptions { receive_buffer: 16 * 1024, ..Default::default() };
    let mut source = SocketSource::open(&[("vcan0", options)]).unwrap();
    let mut sender = SocketSender::open("vcan0").unwrap();
    let many: Vec<_> = (0..1000u32).map(|n| Frame::classical(id(1), &n.to_le_bytes()).unwrap()).collect();
    assert_eq!(sender.send(&many), 1000);
    let mut events = collect(&mut source, |_| false);
    // The count comes with the next frame after the overflow.
    sender.send(&[Frame::classical(id(2), &[]).unwrap()]);
    events.extend(collect(&mut source, |events| events.len() >= 2));
    let dropped: u32 =
        events.iter().map(|e| if let Event::Dropped { count, .. } = e { *count } else { 0 }).sum();
    assert!(dropped > 0);
    assert_eq!(frames(&events).len() + dropped as usize, 1001);
}

#[test]
fn down_up_deleted_and_added_again() {
    let mut source = SocketSource::open(&[("vcan1", SocketOptions::default())]).unwrap();
    let mut sender = SocketSender::open("vcan1").unwrap();
    let frame = [Frame::classical(id(5), &[5]).unwrap()];
    ip("link set vcan1 down");
    assert_eq!(collect(&mut source, |e| !e.is_empty()), [Event::Down { interface: 0 }]);
    assert_eq!(sender.send(&frame), 0);
    assert_eq!(sender.counts().down, 1);
    ip("link set vcan1 up");
    assert_eq!(sender.send(&frame), 1);
    let events = collect(&mut source, |e| e.len() >= 2);
    assert_eq!(events[0], Event::Up { interface: 0 });
    assert_eq!(frames(&events).len(), 1);
    ip("link delete vcan1");
    assert_eq!(collect(&mut source, |e| !e.is_empty()), [Event::Down { interface: 0 }]);
    assert_eq!(sender.send(&frame), 0);
    ip("link add vcan1 mtu 72 type vcan");
    ip("link set vcan1 up");
    let events = collect(&mut source, |e| e.contains(&Event::Up { interface: 0 }));
    assert!(events.contains(&Event::Up { interface: 0 }), "{events:?}");
    std::thread::sleep(Duration::from_millis(300));
    assert_eq!(sender.send(&frame), 1);
    assert_eq!(frames(&collect(&mut source, |e| !e.is_empty())).len(), 1);
}
