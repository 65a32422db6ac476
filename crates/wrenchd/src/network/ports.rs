//! The sockets that clients come to. They outlive a reload where it leaves their address alone, so no client notices it.

use std::fs::{File, OpenOptions, Permissions, TryLockError};
use std::io;
use std::net::{SocketAddr, TcpListener, UdpSocket};
use std::os::unix::fs::{FileTypeExt, PermissionsExt};
use std::os::unix::net::UnixListener;
use std::path::{Path, PathBuf};

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

impl Ports {
    /// Begins an opening; [`Ports::keep_used`] or [`Ports::keep_old`] ends it.
    pub(crate) fn begin(&mut self) {
        self.opening += 1;
    }

    /// Closes what the last opening did not ask for.
    pub(crate) fn keep_used(&mut self) {
        self.kept.retain(|kept| kept.used_in == self.opening);
    }

    /// Closes what the last opening has opened.
    pub(crate) fn keep_old(&mut self) {
        self.kept.retain(|kept| kept.opened_in != self.opening);
    }

    /// A listener on a TCP address.
    pub(crate) fn tcp(&mut self, table: &'static str, address: SocketAddr) -> Result<TcpListener, PortError> {
        let open = || {
            let listener = TcpListener::bind(address)?;
            listener.set_nonblocking(true)?;
            Ok(Socket::Tcp(listener))
        };
        self.take(table, address.to_string(), open, |socket| match socket {
            Socket::Tcp(listener) => Some(listener.try_clone()),
            _ => None,
        })
    }

    /// A UDP socket on an address.
    pub(crate) fn udp(&mut self, table: &'static str, address: SocketAddr) -> Result<UdpSocket, PortError> {
        let open = || {
            let socket = UdpSocket::bind(address)?;
            socket.set_nonblocking(true)?;
            Ok(Socket::Udp(socket))
        };
        self.take(table, address.to_string(), open, |socket| match socket {
            Socket::Udp(socket) => Some(socket.try_clone()),
            _ => None,
        })
    }

    /// A listener on a socket in the file system.
    pub(crate) fn control(&mut self, table: &'static str, path: &Path) -> Result<UnixListener, PortError> {
        let open = || ControlSocket::open(path).map(Socket::Control);
        self.take(table, path.display().to_string(), open, |socket| match socket {
            Socket::Control(socket) => Some(socket.listener.try_clone()),
            _ => None,
        })
    }

    fn take<S>(
        &mut self,
        table: &'static str,
        address: String,
        open: impl FnOnce() -> io::Result<Socket>,
        part: impl Fn(&Socket) -> Option<io::Result<S>>,
    ) -> Result<S, PortError> {
        let opening = self.opening;
        let failed = |error: io::Error| {
            let taken = error.kind() == io::ErrorKind::AddrInUse;
            PortError { table, address: address.clone(), reason: reason(&error), taken }
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

fn reason(error: &io::Error) -> String {
    if error.get_ref().is_some() {
        return error.to_string(); // Ours: it says already what to do.
    }
    let remedy = match error.kind() {
        io::ErrorKind::AddrInUse => "another program has it: stop that, or set another address",
        io::ErrorKind::AddrNotAvailable => "no interface of this computer has that address",
        io::ErrorKind::PermissionDenied => {
            "this user may not: set another address, or run it as a service that may (ports below 1024 need \
             CAP_NET_BIND_SERVICE)"
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
        assert!(taken.starts_with(&format!("[c] {a}: ")) && taken.contains("another program"), "{taken}");
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
}
