//! Sending batches of frames without ever waiting: what the queue has no room for is dropped and counted

use std::os::fd::OwnedFd;
use std::time::Instant;

use super::{NO_CAN, RETRY, bind_error, sys};

use crate::error::{Error, Result};
use crate::frame::Frame;

/// What became of the frames
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub struct SendCounts {
    /// Taken by the interface's queue
    pub sent: u64,
    /// Dropped because the queue was full (`ENOBUFS`; normal on a busy bus with a short `txqueuelen`)
    pub full: u64,
    /// Dropped because the interface was down or away
    pub down: u64,
    /// Refused by the interface, such as FD frames on one that is set to classical CAN
    pub refused: u64,
}

/// Sends frames on one interface
#[derive(Debug)]
pub struct SocketSender {
    name: String,
    socket: Option<OwnedFd>,
    retry_at: Instant,
    counts: SendCounts,
}

impl SocketSender {
    /// Opens an interface for sending; it must exist
    pub fn open(name: &str) -> Result<Self> {
        let socket = open(name)?;
        Ok(Self {
            name: name.into(),
            socket: Some(socket),
            retry_at: Instant::now(),
            counts: SendCounts::default(),
        })
    }

    /// What became of all frames so far
    pub fn counts(&self) -> SendCounts {
        self.counts
    }

    /// Offers frames in order, as many a system call as one takes (256); the number that was taken. Never waits, never tries again.
    pub fn send(&mut self, frames: &[Frame]) -> usize {
        let mut taken = 0;
        for chunk in frames.chunks(sys::BATCH) {
            let sent = self.send_chunk(chunk);
            taken += sent;
            if sent < chunk.len() {
                break;
            }
        }
        self.counts.sent += taken as u64;
        taken
    }

    fn send_chunk(&mut self, frames: &[Frame]) -> usize {
        if self.socket.is_none() && Instant::now() >= self.retry_at {
            self.retry_at = Instant::now() + RETRY;
            // Asked for first: the error that says that there is none would be allocated.
            self.socket = sys::interface(&self.name).and_then(|_| open(&self.name).ok());
        }
        let Some(socket) = &self.socket else {
            self.counts.down += frames.len() as u64;
            return 0;
        };
        let (sent, error) = match sys::send(socket, frames) {
            Ok(sent) => (sent, None),
            Err(error) => (0, error.raw_os_error()),
        };
        let lost = (frames.len() - sent) as u64;
        match error {
            Some(libc::ENODEV | libc::ENXIO) => {
                self.socket = None;
                self.counts.down += lost;
            }
            Some(libc::ENETDOWN) => self.counts.down += lost,
            // After a part was taken the kernel does not say why the rest was not: a full queue.
            None | Some(libc::ENOBUFS | libc::EAGAIN | libc::EINTR) => self.counts.full += lost,
            Some(_) => self.counts.refused += lost,
        }
        sent
    }
}

fn open(name: &str) -> Result<OwnedFd> {
    let address = sys::interface(name).ok_or_else(|| Error::NoInterface { interface: name.into() })?;
    let fault = |what, hint| move |source| Error::Socket { interface: name.into(), what, source, hint };
    let socket = sys::raw_socket().map_err(fault("opening a CAN socket", Some(NO_CAN)))?;
    // It only sends: no frame is to be queued for it.
    sys::set_filters(&socket, &[]).map_err(fault("setting filters", None))?;
    sys::enable(&socket, libc::SOL_CAN_RAW, libc::CAN_RAW_FD_FRAMES)
        .map_err(fault("enabling CAN FD", None))?;
    sys::bind(&socket, address).map_err(|source| bind_error(name, source))?;
    Ok(socket)
}
