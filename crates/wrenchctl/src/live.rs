//! CAN interfaces of this machine, and a person's Ctrl-C.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use can::source::Source;

use crate::Error;

/// Frames from interfaces, everything that they carry, error frames and CAN FD included.
#[cfg(target_os = "linux")]
pub fn open<S: AsRef<str>>(interfaces: &[S]) -> Result<Box<dyn Source>, Error> {
    use can::socket::{SocketOptions, SocketSource};
    let interfaces: Vec<_> =
        interfaces.iter().map(|name| (name.as_ref(), SocketOptions::default())).collect();
    Ok(Box::new(SocketSource::open(&interfaces)?))
}

/// Frames from interfaces: not on this system.
#[cfg(not(target_os = "linux"))]
pub fn open<S: AsRef<str>>(_interfaces: &[S]) -> Result<Box<dyn Source>, Error> {
    Err(Error::usage("live CAN interfaces need Linux (SocketCAN); give a log instead"))
}

/// A flag that Ctrl-C and a request to terminate raise; a second Ctrl-C ends the program at once.
pub fn interrupted() -> Arc<AtomicBool> {
    use signal_hook::consts::{SIGINT, SIGTERM};
    let flag = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM] {
        // Registered in this order the first signal finds the flag down and only raises it.
        let _ = signal_hook::flag::register_conditional_shutdown(signal, 130, flag.clone());
        let _ = signal_hook::flag::register(signal, flag.clone());
    }
    flag
}

/// Sends frames on one interface, waiting where its queue is full.
#[cfg(target_os = "linux")]
#[derive(Debug)]
pub struct Sender {
    socket: can::socket::SocketSender,
    interface: String,
    /// Times that the queue was full and was waited for.
    pub waits: u64,
}

#[cfg(target_os = "linux")]
impl Sender {
    /// How long a full queue is waited for at a time.
    const WAIT: std::time::Duration = std::time::Duration::from_micros(200);

    /// A queue that stays full for so many waits in a row (2 s) belongs to a bus that nobody answers on.
    const PATIENCE: u32 = 10_000;

    /// Opens an interface, which must exist.
    pub fn open(interface: &str) -> Result<Self, Error> {
        let socket = can::socket::SocketSender::open(interface)?;
        Ok(Self { socket, interface: interface.to_owned(), waits: 0 })
    }

    /// Sends all frames, in order.
    pub fn send(&mut self, frames: &[can::frame::Frame]) -> Result<(), Error> {
        let mut at = 0;
        let mut in_a_row = 0;
        while at < frames.len() {
            let before = self.socket.counts();
            let sent = self.socket.send(&frames[at..]);
            at += sent;
            if at == frames.len() {
                break;
            }
            let after = self.socket.counts();
            let interface = &self.interface;
            if after.down > before.down {
                return Err(Error::usage(format!(
                    "{interface} is down or gone; `ip link set up {interface}`, then start again"
                )));
            }
            if after.refused > before.refused {
                let frame = &frames[at];
                return Err(Error::usage(format!(
                    "{interface} refuses frame {} with {} bytes; CAN FD frames need an interface with `mtu 72` and `fd on`",
                    frame.id(),
                    frame.len()
                )));
            }
            in_a_row = if sent == 0 { in_a_row + 1 } else { 0 };
            if in_a_row >= Self::PATIENCE {
                return Err(Error::usage(format!(
                    "{interface} takes no frame for 2 s; is another node on the bus to acknowledge, and the bit rate right?"
                )));
            }
            self.waits += 1;
            std::thread::sleep(Self::WAIT);
        }
        Ok(())
    }
}

/// Sends frames on an interface: not on this system.
#[cfg(not(target_os = "linux"))]
#[derive(Debug)]
pub struct Sender {
    /// Times that the queue was full and was waited for.
    pub waits: u64,
}

#[cfg(not(target_os = "linux"))]
impl Sender {
    /// Not on this system.
    pub fn open(_interface: &str) -> Result<Self, Error> {
        Err(Error::usage("CAN interfaces need Linux (SocketCAN)"))
    }

    /// Never called: there is no sender.
    pub fn send(&mut self, _frames: &[can::frame::Frame]) -> Result<(), Error> {
        Err(Error::usage("CAN interfaces need Linux (SocketCAN)"))
    }
}
