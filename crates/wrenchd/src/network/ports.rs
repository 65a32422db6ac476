//! The sockets that clients come to. They outlive a reload where it leaves their address alone, so no client notices it.

use std::fs::{File, OpenOptions, Permissions, TryLockError};
use std::io;
use std::net::{SocketAddr, TcpListener, UdpSocket};
use std::os::fd::OwnedFd;
use std::os::unix::fs::{FileTypeExt, PermissionsExt};
use std::os::unix::net::UnixListener;
use std::path::{Path, PathBuf};

use super::inherited::Inherited;

/// Owner and group may give orders, nobody else may even look.
const SOCKET_MODE: u32 = 0o660;

/// Why an address cannot be served: table, address, reason, what to do.
#[derive(Debug, thiserror::Error)]
#[error("{table} {address}: {reason}")]
pub struct PortError {
    table: &'static str,
    address: String,
    reason: String,
    taken: bool,
}

impl PortError {
    /// Whether somebody else has the address: another program, or a file that is not ours to remove.
    pub(crate) fn is_taken(&self) -> bool {
        self.taken
    }
}

/// All sockets that are open.
#[derive(Debug, Default)]
pub(crate) struct Ports {
    kept: Vec<Kept>,
    /// What the service manager has opened for the daemon. It stays open whatever is asked for: the manager's own copy does, too.
    inherited: Vec<Inherited>,
    /// Number of the opening that runs, or ran last.
    opening: u64,
}

#[derive(Debug)]
struct Kept {
    table: &'static str,
    address: String,
    socket: Socket,
    opened_in: u64,
    used_in: u64,
}

#[derive(Debug)]
enum Socket {
    Tcp(TcpListener),
    Udp(UdpSocket),
    Control(ControlSocket),
}

impl Socket {
    /// Where clients find it, unless it is in the file system.
    fn address(&self) -> Option<SocketAddr> {
        match self {
            Self::Tcp(listener) => listener.local_addr().ok(),
            Self::Udp(socket) => socket.local_addr().ok(),
            Self::Control(_) => None,
        }
    }
}

impl Ports {
    /// With what the service manager has opened: whoever asks for the address of one of them gets that.
    pub(crate) fn new(inherited: Vec<OwnedFd>) -> Self {
        Self { inherited: inherited.into_iter().filter_map(Inherited::new).collect(), ..Self::default() }
    }

    /// Begins an opening; [`Ports::keep_used`] or [`Ports::keep_old`] ends it.
    pub(crate) fn begin(&mut self) {
        self.opening += 1;
    }

    /// Closes what the last opening did not ask for.
    pub(crate) fn keep_used(&mut self) {
        self.kept.retain(|kept| kept.used_in == self.opening);
        for address in self.inherited.iter().map(Inherited::address) {
            if !self.kept.iter().any(|kept| kept.socket.address() == Some(address)) {
                tracing::warn!(
                    "the service manager has opened {address} for the daemon, but no table of the configuration has exactly that \
                     address: nobody answers there"
                );
            }
        }
    }

    /// Closes what the last opening has opened.
    pub(crate) fn keep_old(&mut self) {
        self.kept.retain(|kept| kept.opened_in != self.opening);
    }

    /// A listener on a TCP address.
    pub(crate) fn tcp(&mut self, table: &'static str, address: SocketAddr) -> Result<TcpListener, PortError> {
        let inherited = self.inherited.iter().find_map(|socket| socket.tcp(address));
        let open = || {
            let listener = inherited.unwrap_or_else(|| TcpListener::bind(address))?;
            listener.set_nonblocking(true)?;
            Ok(Socket::Tcp(listener))
        };
        let own = self.own_holder(address, |socket| matches!(socket, Socket::Tcp(_)));
        self.take(table, address.to_string(), own, open, |socket| match socket {
            Socket::Tcp(listener) => Some(listener.try_clone()),
            _ => None,
        })
    }

    /// A UDP socket on an address.
    pub(crate) fn udp(&mut self, table: &'static str, address: SocketAddr) -> Result<UdpSocket, PortError> {
        let inherited = self.inherited.iter().find_map(|socket| socket.udp(address));
        let open = || {
            let socket = inherited.unwrap_or_else(|| UdpSocket::bind(address))?;
            socket.set_nonblocking(true)?;
            Ok(Socket::Udp(socket))
        };
        let own = self.own_holder(address, |socket| matches!(socket, Socket::Udp(_)));
        self.take(table, address.to_string(), own, open, |socket| match socket {
            Socket::Udp(socket) => Some(socket.try_clone()),
            _ => None,
        })
    }

    /// A listener on a socket in the file system.
    pub(crate) fn control(&mut self, table: &'static str, path: &Path) -> Result<UnixListener, PortError> {
        let open = || ControlSocket::open(path).map(Socket::Control);
        self.take(table, path.display().to_string(), None, open, |socket| match socket {
            Socket::Control(socket) => Some(socket.listener.try_clone()),
            _ => None,
        })
    }

    /// Which of this daemon's own sockets of a kind keeps an address from being opened, and what to do.
    fn own_holder(&self, address: SocketAddr, same_kind: impl Fn(&Socket) -> bool) -> Option<String> {
        let holds = |kept: &&Kept| {
            same_kind(&kept.socket) && kept.socket.address().is_some_and(|own| meet(own, address))
        };
        let Some(Kept { table, address, used_in, .. }) = self.kept.iter().find(holds) else {
            let manager = self.inherited.iter().map(Inherited::address).find(|own| meet(*own, address))?;
            return Some(format!(
                "the service manager has opened {manager} for this daemon: set exactly that address"
            ));
        };
        Some(match *used_in == self.opening {
            true => format!("{table} {address} of the same configuration has it: set another address"),
            false => format!(
                "this daemon itself has it, as {table} {address} of the configuration that runs: restart the daemon \
                 instead of reloading"
            ),
        })
    }

    fn take<S>(
        &mut self,
        table: &'static str,
        address: String,
        own_holder: Option<String>,
        open: impl FnOnce() -> io::Result<Socket>,
        part: impl Fn(&Socket) -> Option<io::Result<S>>,
    ) -> Result<S, PortError> {
        let opening = self.opening;
        let failed = |error: io::Error| {
            let taken = error.kind() == io::ErrorKind::AddrInUse;
            PortError {
                table,
                address: address.clone(),
                reason: reason(&error, own_holder.as_deref()),
                taken,
            }
        };
        let known = self.kept.iter_mut().find(|kept| (kept.table, &kept.address) == (table, &address));
        if let Some(kept) = known
            && let Some(taken) = part(&kept.socket)
        {
            kept.used_in = opening;
            return taken.map_err(failed);
        }
        let socket = open().map_err(failed)?;
        let taken =
            part(&socket).unwrap_or_else(|| Err(io::ErrorKind::Unsupported.into())).map_err(failed)?;
        tracing::info!("{table} {address} is open");
        self.kept.push(Kept { table, address, socket, opened_in: opening, used_in: opening });
        Ok(taken)
    }
}

/// Whether a socket on the one address keeps another from the other, both of the same protocol.
fn meet(a: SocketAddr, b: SocketAddr) -> bool {
    let same =
        a.is_ipv4() == b.is_ipv4() && (a.ip() == b.ip() || [a, b].iter().any(|x| x.ip().is_unspecified()));
    // [::] is usually for IPv4, too.
    let both = [a, b].iter().any(|x| x.is_ipv6() && x.ip().is_unspecified());
    a.port() == b.port() && (same || both)
}

fn reason(error: &io::Error, own_holder: Option<&str>) -> String {
    if error.get_ref().is_some() {
        return error.to_string(); // Ours: it says already what to do.
    }
    let remedy = match (error.kind(), own_holder) {
        (io::ErrorKind::AddrInUse, Some(own)) => own,
        (io::ErrorKind::AddrInUse, None) => "another program has it: stop that, or set another address",
        (io::ErrorKind::AddrNotAvailable, _) => "no interface of this computer has that address",
        (io::ErrorKind::PermissionDenied, _) => {
            "this user may not: set another address, or have the service manager open it (a port below 1024: \
             systemd/wrenchd-netft.socket is an example)"
        }
        _ => return error.to_string(),
    };
    format!("{error}; {remedy}")
}

/// The control socket's file, which belongs to one daemon at a time.
#[derive(Debug)]
struct ControlSocket {
    listener: UnixListener,
    path: PathBuf,
    /// Held as long as the daemon lives, by the kernel's account: it cannot be stale.
    _lock: File,
}

impl ControlSocket {
    fn open(path: &Path) -> io::Result<Self> {
        if let Some(folder) =
            path.parent().filter(|folder| !folder.as_os_str().is_empty() && !folder.exists())
        {
            std::fs::create_dir(folder).map_err(|error| {
                let folder = folder.display();
                io::Error::other(format!(
                    "the folder {folder} does not exist and cannot be made ({error}); make it for this user, or set \
                     another socket"
                ))
            })?;
        }
        let lock = lock(path)?;
        match std::fs::symlink_metadata(path) {
            Ok(file) if file.file_type().is_socket() => std::fs::remove_file(path)?,
            Ok(_) => {
                return Err(io::Error::new(
                    io::ErrorKind::AddrInUse,
                    "there is a file of that name that is no socket; set another name",
                ));
            }
            Err(_) => {}
        }
        let listener = UnixListener::bind(path)?;
        std::fs::set_permissions(path, Permissions::from_mode(SOCKET_MODE))?;
        listener.set_nonblocking(true)?;
        Ok(Self { listener, path: path.to_owned(), _lock: lock })
    }
}

impl Drop for ControlSocket {
    fn drop(&mut self) {
        // Best effort: the next daemon removes what is left.
        let _ = std::fs::remove_file(&self.path);
    }
}

fn lock(path: &Path) -> io::Result<File> {
    let mut name = path.as_os_str().to_owned();
    name.push(".lock");
    let lock = OpenOptions::new().create(true).truncate(false).write(true).open(PathBuf::from(name))?;
    match lock.try_lock() {
        Ok(()) => Ok(lock),
        Err(TryLockError::WouldBlock) => Err(io::Error::new(
            io::ErrorKind::AddrInUse,
            "another wrenchd serves it; stop that one, or give each a socket of its own",
        )),
        Err(TryLockError::Error(error)) => Err(error),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Read;
    use std::os::unix::net::UnixStream;

    #[test]
    fn a_control_socket_has_one_owner_and_leaves_nothing_stale() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run/control.sock");
        let mut first = Ports::default();
        let listener = first.control("[control]", &path).unwrap();
        assert_eq!(std::fs::metadata(&path).unwrap().permissions().mode() & 0o777, SOCKET_MODE);
        let second = Ports::default().control("[control]", &path).unwrap_err();
        assert!(second.is_taken());
        let second = second.to_string();
        assert!(second.contains("another wrenchd serves it") && second.contains("control.sock"), "{second}");
        assert!(UnixStream::connect(&path).is_ok(), "the first is untouched");
        drop((listener, first));
        assert!(!path.exists());
        // A daemon that was killed leaves its socket.
        drop(UnixListener::bind(&path).unwrap());
        assert!(path.exists() && UnixStream::connect(&path).is_err());
        assert!(Ports::default().control("[control]", &path).is_ok());
        std::fs::write(&path, "precious").unwrap();
        let error = Ports::default().control("[control]", &path).unwrap_err();
        assert!(error.is_taken() && error.to_string().contains("no socket"), "{error}");
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "precious");
        let nowhere = Ports::default().control("[control]", Path::new("/proc/no/such/control.sock"));
        let error = nowhere.unwrap_err();
        assert!(!error.is_taken() && error.to_string().contains("/proc/no/such"), "{error}");
    }

    #[test]
    fn an_address_survives_a_reload_that_asks_for_it_and_a_failed_one_changes_nothing() {
        let free = || TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
        let (a, b) = (free(), free());
        let mut ports = Ports::default();
        ports.begin();
        drop(ports.tcp("[a]", a).unwrap());
        ports.keep_used();
        let mut waiting = std::net::TcpStream::connect(a).unwrap();
        ports.begin();
        ports.tcp("[b]", b).unwrap();
        let again = ports.tcp("[a]", a).unwrap();
        let taken = ports.tcp("[c]", a).unwrap_err().to_string();
        assert!(taken.starts_with(&format!("[c] {a}: ")) && taken.contains("[a]"), "{taken}");
        ports.keep_old();
        assert!(TcpListener::bind(b).is_ok(), "the new one is closed again");
        again.set_nonblocking(false).unwrap();
        drop(again.accept().unwrap());
        assert_eq!(waiting.read(&mut [0]).unwrap(), 0, "a client that waited meanwhile was served");
        drop(again);
        ports.begin();
        ports.keep_used();
        assert!(TcpListener::bind(a).is_ok());
    }

    #[test]
    fn what_the_service_manager_has_opened_is_taken_and_stays() {
        let (tcp, udp) = (TcpListener::bind("127.0.0.1:0").unwrap(), UdpSocket::bind("127.0.0.1:0").unwrap());
        let (a, b) = (tcp.local_addr().unwrap(), udp.local_addr().unwrap());
        let mut ports = Ports::new(vec![tcp.into(), udp.into()]);
        ports.begin();
        let listener = ports.tcp("[a]", a).unwrap();
        let socket = ports.udp("[b]", b).unwrap();
        ports.keep_used();
        let client = std::net::TcpStream::connect(a).unwrap();
        listener.set_nonblocking(false).unwrap();
        assert_eq!(listener.accept().unwrap().1, client.local_addr().unwrap());
        UdpSocket::bind("127.0.0.1:0").unwrap().send_to(b"x", b).unwrap();
        socket.set_nonblocking(false).unwrap();
        assert_eq!(socket.recv(&mut [0; 9]).unwrap(), 1);
        // A reload that does not ask for it, and one that does again.
        drop((listener, socket));
        ports.begin();
        ports.keep_used();
        assert!(TcpListener::bind(a).is_err());
        let everywhere =
            ports.tcp("[a]", SocketAddr::from(([0, 0, 0, 0], a.port()))).unwrap_err().to_string();
        assert!(everywhere.contains(&format!("the service manager has opened {a}")), "{everywhere}");
        ports.begin();
        assert_eq!(ports.tcp("[a]", a).unwrap().local_addr().unwrap(), a);
    }

    #[test]
    fn who_has_an_address_is_told_from_another_program() {
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        let (own, port) = (socket.local_addr().unwrap(), socket.local_addr().unwrap().port());
        drop(socket);
        let mut ports = Ports::default();
        ports.begin();
        ports.udp("[a]", own).unwrap();
        ports.keep_used();
        ports.begin();
        for everywhere in ["0.0.0.0", "[::]"] {
            let Ok(wanted) = format!("{everywhere}:{port}").parse() else { panic!("{everywhere}") };
            let Err(refused) = ports.udp("[a]", wanted) else { continue };
            let refused = refused.to_string();
            assert!(refused.contains("this daemon itself") && refused.contains("restart"), "{refused}");
            assert!(refused.contains(&own.to_string()), "{refused}");
        }
        assert!(ports.udp("[a]", SocketAddr::from(([0, 0, 0, 0], port))).is_err());
        ports.keep_old();
        let other = Ports::default().udp("[a]", own).unwrap_err();
        assert!(other.is_taken() && other.to_string().contains("another program"), "{other}");
        let meets = |a: &str, b: &str| meet(a.parse().unwrap(), b.parse().unwrap());
        assert!(
            meets("0.0.0.0:1", "127.0.0.1:1") && meets("[::]:1", "10.0.0.1:1") && meets("[::1]:1", "[::]:1")
        );
        assert!(!meets("127.0.0.2:1", "127.0.0.1:1") && !meets("0.0.0.0:1", "0.0.0.0:2"));
        assert!(!meets("0.0.0.0:1", "[::1]:1"));
    }
}
