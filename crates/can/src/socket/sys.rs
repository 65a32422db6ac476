//! The system calls; the only unsafe code of the crate

use std::io;
use std::mem::{MaybeUninit, size_of, zeroed};
use std::os::fd::{AsRawFd, OwnedFd};
use std::ptr::{from_mut, null_mut};
use std::time::Duration;

use socket2::{Domain, Protocol, SockRef, Socket, Type};
use socketcan::CanAddr;

use super::wire::{self, FD_MTU};
use crate::frame::{CanId, Frame};

/// Most frames a system call
pub(super) const BATCH: usize = 256;
/// As many as a wrench takes, and a few more
const FEW: usize = 8;
/// Room for a stamp (32 bytes with its header) and a drop count (24)
const CONTROL: usize = 64;

fn check(result: libc::c_int) -> io::Result<usize> {
    usize::try_from(result).map_err(|_| io::Error::last_os_error())
}

/// An interface by its name; none where there is none. Allocates nothing: the cycle asks for one that was deleted again and again.
pub(super) fn interface(name: &str) -> Option<CanAddr> {
    let mut text: [libc::c_char; libc::IFNAMSIZ] = [0; libc::IFNAMSIZ];
    if name.len() >= text.len() {
        return None;
    }
    text.iter_mut().zip(name.bytes()).for_each(|(to, byte)| *to = libc::c_char::from_ne_bytes([byte]));
    // SAFETY: `text` ends with a zero, for the name is shorter, and outlives the call, which only reads it.
    let index = unsafe { libc::if_nametoindex(text.as_ptr()) };
    (index != 0).then(|| CanAddr::new(index))
}

/// A raw CAN socket, not yet bound: options that say what arrives must be set before binding, which the socket types of
/// `socketcan` do not allow for. Each call on it says by itself whether it may wait.
pub(super) fn raw_socket() -> io::Result<OwnedFd> {
    let kind = Type::from(libc::SOCK_RAW | libc::SOCK_CLOEXEC);
    let socket = Socket::new_raw(Domain::from(libc::PF_CAN), kind, Some(Protocol::from(libc::CAN_RAW)))?;
    Ok(socket.into())
}

/// Binds a socket to an interface
pub(super) fn bind(socket: &OwnedFd, address: CanAddr) -> io::Result<()> {
    SockRef::from(socket).bind(&address.into_sock_addr())
}

fn set<T>(socket: &OwnedFd, level: libc::c_int, name: libc::c_int, values: &[T]) -> io::Result<()> {
    let len = size_of_val(values) as libc::socklen_t;
    // SAFETY: pointer and length describe `values`, which outlives the call; an empty slice is passed with length 0.
    check(unsafe { libc::setsockopt(socket.as_raw_fd(), level, name, values.as_ptr().cast(), len) }).map(drop)
}

/// Sets an on/off option
pub(super) fn enable(socket: &OwnedFd, level: libc::c_int, name: libc::c_int) -> io::Result<()> {
    set(socket, level, name, &[1 as libc::c_int])
}

/// Lets only these identifiers' data frames through; none of them: nothing at all
pub(super) fn set_filters(socket: &OwnedFd, ids: &[CanId]) -> io::Result<()> {
    let filters: Vec<libc::can_filter> = ids
        .iter()
        .map(|id| libc::can_filter {
            can_id: id.with_flag(),
            can_mask: libc::CAN_EFF_FLAG
                | libc::CAN_RTR_FLAG
                | if id.is_extended() { libc::CAN_EFF_MASK } else { libc::CAN_SFF_MASK },
        })
        .collect();
    set(socket, libc::SOL_CAN_RAW, libc::CAN_RAW_FILTER, &filters)
}

/// Lets every class of error frames through
pub(super) fn set_error_filter(socket: &OwnedFd) -> io::Result<()> {
    set(socket, libc::SOL_CAN_RAW, libc::CAN_RAW_ERR_FILTER, &[libc::CAN_ERR_MASK])
}

/// Asks for a receive buffer, beyond the system's limit where that is allowed; what the kernel gave
pub(super) fn set_receive_buffer(socket: &OwnedFd, bytes: usize) -> io::Result<usize> {
    // The kernel doubles what is asked for, to account for its own overhead.
    let asked = libc::c_int::try_from(bytes / 2).unwrap_or(libc::c_int::MAX / 2);
    if set(socket, libc::SOL_SOCKET, libc::SO_RCVBUFFORCE, &[asked]).is_err() {
        set(socket, libc::SOL_SOCKET, libc::SO_RCVBUF, &[asked])?;
    }
    let mut got: libc::c_int = 0;
    let mut len = size_of::<libc::c_int>() as libc::socklen_t;
    let (level, name) = (libc::SOL_SOCKET, libc::SO_RCVBUF);
    // SAFETY: pointer and length describe `got`, which outlives the call.
    check(unsafe { libc::getsockopt(socket.as_raw_fd(), level, name, from_mut(&mut got).cast(), &mut len) })?;
    Ok(got.max(0) as usize)
}

/// Limits how long a receiving call may wait; the kernel counts it in its own ticks
pub(super) fn set_patience(socket: &OwnedFd, patience: Duration) -> io::Result<()> {
    let limit = libc::timeval {
        tv_sec: libc::time_t::try_from(patience.as_secs()).unwrap_or(libc::time_t::MAX),
        tv_usec: patience.subsec_micros().into(),
    };
    set(socket, libc::SOL_SOCKET, libc::SO_RCVTIMEO, &[limit])
}

/// The kernel's tick: what it counts coarse times in
pub(super) fn tick() -> Duration {
    let mut tick = libc::timespec { tv_sec: 0, tv_nsec: 0 };
    // SAFETY: `tick` outlives the call, which only writes to it.
    unsafe { libc::clock_getres(libc::CLOCK_MONOTONIC_COARSE, &mut tick) };
    Duration::from_nanos(tick.tv_nsec.unsigned_abs()).max(Duration::from_millis(1))
}

/// Waits until one of the sockets has something, at most `timeout`; how many have
pub(super) fn wait(polled: &mut [libc::pollfd], timeout: Duration) -> io::Result<usize> {
    let limit = libc::timespec {
        tv_sec: libc::time_t::try_from(timeout.as_secs()).unwrap_or(libc::time_t::MAX),
        tv_nsec: timeout.subsec_nanos().into(),
    };
    // SAFETY: pointer and length describe `polled`, `limit` outlives the call, no signal mask is passed.
    check(unsafe { libc::ppoll(polled.as_mut_ptr(), polled.len() as libc::nfds_t, &limit, std::ptr::null()) })
}

/// `CLOCK_REALTIME` in ns since the Unix epoch
pub(super) fn realtime_ns() -> i64 {
    let mut now = libc::timespec { tv_sec: 0, tv_nsec: 0 };
    // SAFETY: `now` outlives the call, which only writes to it.
    unsafe { libc::clock_gettime(libc::CLOCK_REALTIME, &mut now) };
    now.tv_sec * 1_000_000_000 + now.tv_nsec
}

#[derive(Clone, Copy, Debug)]
#[repr(C, align(8))]
struct Slot {
    frame: [u8; FD_MTU],
    control: [u8; CONTROL],
}

/// Whether a receiving call waits for its first frame
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Wait {
    /// It takes what is there
    No,
    /// It waits as long as the socket's patience lasts
    Patiently,
}

/// Buffers for a batch of received frames; set up once, so that a call costs by what it brings
#[derive(Debug)]
pub(super) struct Receiver {
    slots: Vec<Slot>,
    /// Point to the slots
    vectors: Vec<libc::iovec>,
    /// Point to the vectors and slots
    headers: Vec<libc::mmsghdr>,
}

// SAFETY: the pointers in vectors and headers lead to the heap memory of this receiver's own vectors, which moves with it.
unsafe impl Send for Receiver {}

impl Receiver {
    pub(super) fn new() -> Self {
        let mut slots = vec![Slot { frame: [0; FD_MTU], control: [0; CONTROL] }; BATCH];
        let vector =
            |slot: &mut Slot| libc::iovec { iov_base: slot.frame.as_mut_ptr().cast(), iov_len: FD_MTU };
        let mut vectors: Vec<libc::iovec> = slots.iter_mut().map(vector).collect();
        let header = |(slot, vector): (&mut Slot, &mut libc::iovec)| {
            // SAFETY: all zeros is a valid mmsghdr: null pointers and integers only.
            let mut header = unsafe { zeroed::<libc::mmsghdr>() };
            header.msg_hdr.msg_iov = vector;
            header.msg_hdr.msg_iovlen = 1;
            header.msg_hdr.msg_control = slot.control.as_mut_ptr().cast();
            header.msg_hdr.msg_controllen = CONTROL as _;
            header
        };
        let headers = slots.iter_mut().zip(&mut vectors).map(header).collect();
        Self { slots, vectors, headers }
    }

    /// Receives what is there, at most `most` frames, and hands each with its control messages to `take`; how many
    pub(super) fn receive(
        &mut self,
        socket: &OwnedFd,
        most: usize,
        wait: Wait,
        mut take: impl FnMut(&[u8], &[u8]),
    ) -> io::Result<usize> {
        debug_assert_eq!(self.vectors.len(), self.headers.len());
        let count = most.min(self.headers.len()) as libc::c_uint;
        // Waiting is for the first frame only.
        let flags = if wait == Wait::No { libc::MSG_DONTWAIT } else { libc::MSG_WAITFORONE };
        // SAFETY: the headers, `count` of which there are at least, point to vectors and buffers of the lengths given, all of
        // which live as long as this receiver and are borrowed by nothing else.
        let got = check(unsafe {
            libc::recvmmsg(socket.as_raw_fd(), self.headers.as_mut_ptr(), count, flags, null_mut())
        })?;
        for (slot, header) in self.slots.iter().zip(&mut self.headers).take(got) {
            let frame = (header.msg_len as usize).min(FD_MTU);
            let control = header.msg_hdr.msg_controllen.min(CONTROL);
            take(&slot.frame[..frame], &slot.control[..control]);
            // All that a call changes of what it was given.
            header.msg_hdr.msg_controllen = CONTROL as _;
        }
        Ok(got)
    }
}

/// Offers at most [`BATCH`] frames; how many were taken. Never waits.
pub(super) fn send(socket: &OwnedFd, frames: &[Frame]) -> io::Result<usize> {
    // What a cycle sends finds room in a page or two of the stack.
    if frames.len() <= FEW { send_some::<FEW>(socket, frames) } else { send_some::<BATCH>(socket, frames) }
}

/// Offers at most `N` frames.
fn send_some<const N: usize>(socket: &OwnedFd, frames: &[Frame]) -> io::Result<usize> {
    let frames = &frames[..frames.len().min(N)];
    // Only as much of these as there are frames is ever written or read.
    let mut bytes = [const { MaybeUninit::<[u8; FD_MTU]>::uninit() }; N];
    let mut vectors = [const { MaybeUninit::<libc::iovec>::uninit() }; N];
    let mut headers = [const { MaybeUninit::<libc::mmsghdr>::uninit() }; N];
    let places = bytes.iter_mut().zip(&mut vectors).zip(&mut headers);
    for (frame, ((bytes, vector), header)) in frames.iter().zip(places) {
        let bytes = bytes.write([0; FD_MTU]);
        let len = wire::encode(frame, bytes);
        let vector = vector.write(libc::iovec { iov_base: bytes.as_mut_ptr().cast(), iov_len: len });
        // SAFETY: all zeros is a valid mmsghdr: null pointers and integers only.
        let header = header.write(unsafe { zeroed() });
        header.msg_hdr.msg_iov = vector;
        header.msg_hdr.msg_iovlen = 1;
    }
    let count = frames.len() as libc::c_uint;
    // SAFETY: the first `count` headers are written and point to vectors and buffers of the lengths given, all of which
    // outlive the call.
    check(unsafe {
        libc::sendmmsg(socket.as_raw_fd(), headers.as_mut_ptr().cast(), count, libc::MSG_DONTWAIT)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn interfaces_are_found_by_their_names() {
        assert!(interface("lo").is_some());
        for none in ["", "nocan7", "a_name_that_is_too_long_for_one"] {
            assert!(interface(none).is_none(), "{none}");
        }
    }
}
