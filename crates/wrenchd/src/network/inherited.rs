//! Sockets that the service manager has opened for the daemon (socket activation): it may have addresses that the daemon's user may not.

use std::io;
use std::net::{SocketAddr, TcpListener, UdpSocket};
use std::os::fd::{AsRawFd, FromRawFd, OwnedFd};
use std::sync::atomic::{AtomicBool, Ordering};

/// One of them.
#[derive(Debug)]
pub(super) enum Inherited {
    Tcp(SocketAddr, TcpListener),
    Udp(SocketAddr, UdpSocket),
}

/// All that this process was started with, the first time it is called; nothing without a service manager.
pub(crate) fn descriptors() -> Vec<OwnedFd> {
    static TAKEN: AtomicBool = AtomicBool::new(false);
    if TAKEN.swap(true, Ordering::Relaxed) {
        return Vec::new();
    }
    match sd_notify::listen_fds() {
        // SAFETY: LISTEN_PID names this process, so these are open and meant for it, nothing in it has opened them, and they are
        // taken once.
        Ok(numbers) => numbers.map(|number| unsafe { OwnedFd::from_raw_fd(number) }).collect(),
        Err(error) => {
            tracing::warn!("the service manager's sockets cannot be taken: {error}");
            Vec::new()
        }
    }
}

impl Inherited {
    /// The socket behind a descriptor, if clients can come to it over TCP or UDP.
    pub(super) fn new(descriptor: OwnedFd) -> Option<Self> {
        let option = |name| option(&descriptor, name);
        let (kind, listens) = (option(libc::SO_TYPE).ok()?, option(libc::SO_ACCEPTCONN).ok()?);
        match (kind, listens) {
            (libc::SOCK_STREAM, 1) => {
                let listener = TcpListener::from(descriptor);
                Some(Self::Tcp(listener.local_addr().ok()?, listener))
            }
            (libc::SOCK_DGRAM, _) => {
                let socket = UdpSocket::from(descriptor);
                Some(Self::Udp(socket.local_addr().ok()?, socket))
            }
            _ => None,
        }
    }

    pub(super) fn address(&self) -> SocketAddr {
        match self {
            Self::Tcp(address, _) | Self::Udp(address, _) => *address,
        }
    }

    /// The listener, if it is one on this very address.
    pub(super) fn tcp(&self, wanted: SocketAddr) -> Option<io::Result<TcpListener>> {
        match self {
            Self::Tcp(address, listener) if *address == wanted => Some(listener.try_clone()),
            _ => None,
        }
    }

    /// The socket, if it is one of UDP on this very address.
    pub(super) fn udp(&self, wanted: SocketAddr) -> Option<io::Result<UdpSocket>> {
        match self {
            Self::Udp(address, socket) if *address == wanted => Some(socket.try_clone()),
            _ => None,
        }
    }
}

/// An option of a socket that is a number.
fn option(descriptor: &OwnedFd, name: libc::c_int) -> io::Result<libc::c_int> {
    let mut value: libc::c_int = 0;
    let mut length = size_of::<libc::c_int>() as libc::socklen_t;
    // SAFETY: the descriptor is open, and value and length are as large as they say.
    let done = unsafe {
        libc::getsockopt(
            descriptor.as_raw_fd(),
            libc::SOL_SOCKET,
            name,
            (&raw mut value).cast(),
            &raw mut length,
        )
    };
    if done == 0 { Ok(value) } else { Err(io::Error::last_os_error()) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::net::{UnixListener, UnixStream};
    use std::process::{Command, Stdio};

    #[test]
    fn only_sockets_that_clients_can_come_to_are_taken() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        let connected = std::net::TcpStream::connect(address).unwrap();
        let udp = UdpSocket::bind("[::1]:0").or_else(|_| UdpSocket::bind("127.0.0.1:0")).unwrap();
        let udp_address = udp.local_addr().unwrap();
        let inherited = Inherited::new(listener.into()).unwrap();
        assert!(inherited.tcp(address).is_some() && inherited.udp(address).is_none());
        assert!(inherited.tcp(([127, 0, 0, 2], address.port()).into()).is_none());
        let inherited = Inherited::new(udp.into()).unwrap();
        assert!(inherited.udp(udp_address).is_some() && inherited.tcp(udp_address).is_none());
        assert!(Inherited::new(connected.into()).is_none(), "somebody's connection");
        assert!(Inherited::new(std::fs::File::open("/dev/null").unwrap().into()).is_none());
        assert!(Inherited::new(UnixStream::pair().unwrap().0.into()).is_none());
        let folder = tempfile::tempdir().unwrap();
        assert!(Inherited::new(UnixListener::bind(folder.path().join("s")).unwrap().into()).is_none());
    }

    /// Run by the next test in a process of its own, with one socket; by itself it has none.
    #[test]
    fn in_a_process_that_was_handed_one() {
        let Ok(address) = std::env::var("WRENCHD_TEST_INHERITED") else { return };
        let address: SocketAddr = address.parse().unwrap();
        let mut ports = super::super::ports::Ports::new(descriptors());
        assert!(descriptors().is_empty(), "they are taken once");
        ports.begin();
        let listener = ports.tcp("[a]", address).unwrap();
        ports.keep_used();
        assert_eq!(listener.local_addr().unwrap(), address);
    }

    #[test]
    fn the_service_managers_sockets_are_found_by_the_protocol() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        let child = |script: &str| {
            Command::new("sh")
                .args(["-c", &format!("exec 3<&0 </dev/null; {script} exec \"$0\" \"$@\"")])
                .arg(std::env::current_exe().unwrap())
                .args(["--exact", "network::inherited::tests::in_a_process_that_was_handed_one"])
                .env("WRENCHD_TEST_INHERITED", address.to_string())
                .stdin(Stdio::from(OwnedFd::from(listener.try_clone().unwrap())))
                .output()
                .unwrap()
        };
        let output = child("export LISTEN_PID=$$ LISTEN_FDS=1;");
        let said = String::from_utf8_lossy(&output.stdout);
        assert!(output.status.success() && said.contains("1 passed"), "{said}");
        // Another process' sockets are none of ours.
        assert!(!child("export LISTEN_PID=1 LISTEN_FDS=1;").status.success());
    }
}
