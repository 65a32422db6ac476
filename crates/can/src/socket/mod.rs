//! SocketCAN: frames with kernel stamps from several interfaces, and a sender that never waits
//!
//! Options are set before the socket is bound, so that no frame comes unfiltered or without a stamp. An interface that
//! goes down keeps its socket; one that is deleted gets a new socket as soon as one of its name exists again.

mod cmsg;
mod send;
#[allow(unsafe_code)]
mod sys;
mod wire;

use std::os::fd::{AsRawFd, OwnedFd};
use std::time::{Duration, Instant};

pub use send::{SendCounts, SocketSender};

use crate::error::{Error, Result};
use crate::frame::{CanId, Stamped};
use crate::source::{Batch, Event, Poll, Source};
use sys::{BATCH, Receiver, Wait};

/// How often a deleted interface is looked for
const RETRY: Duration = Duration::from_millis(250);

/// How long a call that receives waits by itself: boards that send 100 times a second and more are waited for in it
const PATIENCE: Duration = Duration::from_millis(10);

/// How an interface is listened to
#[derive(Clone, PartialEq, Debug)]
pub struct SocketOptions {
    /// Identifiers to let through; `None`: all. More than 512 are more than the kernel filters, and let all through.
    pub filters: Option<Vec<CanId>>,
    /// Also receive CAN FD frames
    pub fd: bool,
    /// Also receive error frames
    pub error_frames: bool,
    /// Size asked for the receive buffer in bytes of kernel memory, some 770 a frame
    pub receive_buffer: usize,
}

impl Default for SocketOptions {
    /// Everything, with room for some 40,000 frames: seconds of a busy bus
    fn default() -> Self {
        Self { filters: None, fd: true, error_frames: true, receive_buffer: 32 * 1024 * 1024 }
    }
}

/// One interface that is listened to
#[derive(Debug)]
struct Port {
    name: String,
    options: SocketOptions,
    socket: Option<OwnedFd>,
    down: bool,
    /// Kernel's total of dropped frames that was told
    drops: u32,
    retry_at: Instant,
}

/// Frames from one or more CAN interfaces; their indices are the order they were given in
///
/// A poll of a single interface waits in the call that takes the frame, which spares every frame a system call; the kernel counts
/// that time in its ticks, so that such a poll may take a tick longer than asked for.
#[derive(Debug)]
pub struct SocketSource {
    ports: Vec<Port>,
    receiver: Receiver,
    polled: Vec<libc::pollfd>,
    tick: Duration,
    next: usize,
    receive_buffer: usize,
    unstamped: u64,
}

impl SocketSource {
    /// Opens every interface; each must exist, none has to be up
    pub fn open(interfaces: &[(&str, SocketOptions)]) -> Result<Self> {
        let mut ports = Vec::with_capacity(interfaces.len());
        let mut receive_buffer = usize::MAX;
        for (name, options) in interfaces.iter().take(255) {
            let (socket, size) = open_receiver(name, options)?;
            receive_buffer = receive_buffer.min(size);
            ports.push(Port {
                name: (*name).to_string(),
                options: options.clone(),
                socket: Some(socket),
                down: false,
                drops: 0,
                retry_at: Instant::now(),
            });
        }
        let polled = vec![libc::pollfd { fd: -1, events: libc::POLLIN, revents: 0 }; ports.len()];
        Ok(Self {
            ports,
            receiver: Receiver::new(),
            polled,
            tick: sys::tick(),
            next: 0,
            receive_buffer,
            unstamped: 0,
        })
    }

    /// Smallest receive buffer that the kernel gave, in bytes of kernel memory; less than asked for where
    /// `net.core.rmem_max` limits it and the process lacks `CAP_NET_ADMIN`
    pub fn receive_buffer(&self) -> usize {
        self.receive_buffer
    }

    /// Frames that came without a kernel stamp and were stamped on arrival here
    pub fn unstamped(&self) -> u64 {
        self.unstamped
    }

    /// Looks for interfaces that were deleted
    fn reopen(&mut self, batch: &mut Batch) {
        for (index, port) in self.ports.iter_mut().enumerate() {
            if port.socket.is_some() || batch.room() == 0 {
                continue;
            }
            let now = Instant::now();
            if now < port.retry_at {
                continue;
            }
            port.retry_at = now + RETRY;
            // Asked for first: the error that says that there is none would be allocated.
            if sys::interface(&port.name).is_some()
                && let Ok((socket, _)) = open_receiver(&port.name, &port.options)
            {
                port.socket = Some(socket);
                port.drops = 0;
                port.down = false;
                batch.push(Event::Up { interface: index as u8 });
            }
        }
    }

    /// Waits until an interface has something, and notes which have; whether any has
    fn wait(&mut self, timeout: Duration) -> Result<bool> {
        let mut limit = timeout;
        for (polled, port) in self.polled.iter_mut().zip(&self.ports) {
            polled.fd = port.socket.as_ref().map_or(-1, AsRawFd::as_raw_fd);
            polled.revents = 0;
            if port.socket.is_none() {
                limit = limit.min(RETRY);
            }
        }
        match sys::wait(&mut self.polled, limit) {
            Ok(ready) => Ok(ready > 0),
            Err(error) if error.kind() == std::io::ErrorKind::Interrupted => Ok(false),
            Err(source) => {
                Err(Error::Socket { interface: self.names(), what: "waiting for frames", source, hint: None })
            }
        }
    }

    fn names(&self) -> String {
        self.ports.iter().map(|port| port.name.as_str()).collect::<Vec<_>>().join(", ")
    }

    /// One batch of one interface
    fn receive(&mut self, index: usize, batch: &mut Batch, wait: Wait) -> Result<()> {
        let Self { ports, receiver, unstamped, .. } = self;
        let port = &mut ports[index];
        let interface = index as u8;
        let Some(socket) = &port.socket else { return Ok(()) };
        // Each frame may bring a drop count, and the interface may come up.
        let most = (batch.room().saturating_sub(1) / 2).min(BATCH);
        if most == 0 {
            return Ok(());
        }
        let (down, drops) = (&mut port.down, &mut port.drops);
        let got = receiver.receive(socket, most, wait, |bytes, control| {
            if std::mem::take(down) {
                batch.push(Event::Up { interface });
            }
            let control = cmsg::parse(control);
            if let Some(total) = control.drops.filter(|total| total != drops) {
                batch.push(Event::Dropped { interface, count: total.wrapping_sub(*drops) });
                *drops = total;
            }
            let stamp_ns = control.stamp_ns.unwrap_or_else(|| {
                *unstamped += 1;
                sys::realtime_ns()
            });
            if let Some(frame) = wire::decode(bytes) {
                batch.push(Event::received(Stamped { stamp_ns, interface, frame }));
            }
        });
        got.map(drop).or_else(|error| port.failed(error, interface, batch))
    }

    /// Waits for the first frame in the call that takes it, where there is a single interface and time enough; how much of the
    /// time is left
    fn receive_patiently(&mut self, batch: &mut Batch, timeout: Duration) -> Result<Duration> {
        if self.ports.len() != 1 || self.ports[0].socket.is_none() || timeout < PATIENCE {
            return Ok(timeout);
        }
        self.receive(0, batch, Wait::Patiently)?;
        Ok(timeout.saturating_sub(PATIENCE + self.tick))
    }

    /// One batch of each interface that may have something
    fn receive_all(&mut self, batch: &mut Batch, polled: bool) -> Result<()> {
        let ports = self.ports.len();
        for turn in 0..ports {
            let index = (self.next + turn) % ports;
            if !polled || self.polled[index].revents != 0 {
                self.receive(index, batch, Wait::No)?;
            }
        }
        // A busy interface must not starve the others where the batch is small.
        self.next = if ports > 0 { (self.next + 1) % ports } else { 0 };
        Ok(())
    }
}

impl Port {
    /// Down and away are told; anything else is final
    fn failed(&mut self, error: std::io::Error, interface: u8, batch: &mut Batch) -> Result<()> {
        match error.raw_os_error() {
            Some(libc::EAGAIN | libc::EINTR) => return Ok(()),
            Some(libc::ENETDOWN) => {}
            Some(libc::ENODEV | libc::ENXIO | libc::EBADF) => {
                self.socket = None;
                self.retry_at = Instant::now() + RETRY;
            }
            _ => {
                let interface = self.name.clone();
                return Err(Error::Socket { interface, what: "receiving frames", source: error, hint: None });
            }
        }
        if !self.down {
            self.down = true;
            batch.push(Event::Down { interface });
        }
        Ok(())
    }
}

impl Source for SocketSource {
    fn poll(&mut self, batch: &mut Batch, timeout: Duration) -> Result<Poll> {
        batch.clear();
        self.reopen(batch);
        if !batch.is_empty() || timeout.is_zero() {
            self.receive_all(batch, false)?;
        } else {
            let left = self.receive_patiently(batch, timeout)?;
            if batch.is_empty() {
                if self.wait(left)? {
                    self.receive_all(batch, true)?;
                } else {
                    self.reopen(batch);
                }
            }
        }
        Ok(if batch.is_empty() { Poll::Idle } else { Poll::Ready })
    }
}

/// A socket with all its options, bound; and the receive buffer that it got
fn open_receiver(name: &str, options: &SocketOptions) -> Result<(OwnedFd, usize)> {
    let address = sys::interface(name).ok_or_else(|| Error::NoInterface { interface: name.into() })?;
    let fault = |what, hint| move |source| Error::Socket { interface: name.into(), what, source, hint };
    let socket = sys::raw_socket().map_err(fault("opening a CAN socket", Some(NO_CAN)))?;
    match &options.filters {
        Some(ids) if ids.len() <= libc::CAN_RAW_FILTER_MAX as usize => {
            sys::set_filters(&socket, ids).map_err(fault("setting filters", None))?;
        }
        _ => {}
    }
    if options.fd {
        sys::enable(&socket, libc::SOL_CAN_RAW, libc::CAN_RAW_FD_FRAMES)
            .map_err(fault("enabling CAN FD", None))?;
    }
    if options.error_frames {
        sys::set_error_filter(&socket).map_err(fault("asking for error frames", None))?;
    }
    sys::enable(&socket, libc::SOL_SOCKET, libc::SO_TIMESTAMPNS).map_err(fault("asking for stamps", None))?;
    sys::enable(&socket, libc::SOL_SOCKET, libc::SO_RXQ_OVFL)
        .map_err(fault("asking for drop counts", None))?;
    sys::set_patience(&socket, PATIENCE).map_err(fault("limiting its waiting", None))?;
    let size =
        sys::set_receive_buffer(&socket, options.receive_buffer).map_err(fault("sizing its buffer", None))?;
    sys::bind(&socket, address).map_err(|source| bind_error(name, source))?;
    Ok((socket, size))
}

const NO_CAN: &str = "does this kernel have CAN? try `modprobe can_raw`";

fn bind_error(name: &str, source: std::io::Error) -> Error {
    match source.raw_os_error() {
        Some(libc::ENODEV) => {
            let hint =
                Some("it is no CAN interface, or went away just now; `ip link show type can` lists them");
            Error::Socket { interface: name.into(), what: "binding", source, hint }
        }
        _ => Error::Socket { interface: name.into(), what: "binding", source, hint: None },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_missing_interface_is_named_with_what_to_do() {
        let error = SocketSource::open(&[("nocan7", SocketOptions::default())]).unwrap_err();
        assert!(matches!(&error, Error::NoInterface { interface } if interface == "nocan7"));
        assert!(error.to_string().contains("ip link add dev nocan7 type vcan"), "{error}");
        let long = "an-interface-name-beyond-fifteen";
        assert!(matches!(
            SocketSource::open(&[(long, SocketOptions::default())]),
            Err(Error::NoInterface { .. })
        ));
        assert!(matches!(SocketSender::open("nocan7"), Err(Error::NoInterface { .. })));
    }
}
