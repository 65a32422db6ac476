//! A running daemon's control socket, from the client's side.

use std::io::{BufRead, BufReader, Write};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::time::Duration;

use rig::Config;
use rig::config::Control;
use wrenchd::control::{Reply, Request};

use crate::Error;

/// Longer than the daemon needs for anything: it answers a tare that got no snapshots after two seconds.
const PATIENCE: Duration = Duration::from_secs(15);

/// Which daemon is meant.
#[derive(clap::Args, Debug, Clone)]
pub struct Target {
    /// The daemon's control socket [default: the configuration's, else /run/wrenchd/control.sock]
    #[arg(long, value_name = "PATH")]
    pub socket: Option<PathBuf>,
    /// The daemon's configuration, for the path of its socket
    #[arg(long, value_name = "CONFIG", conflicts_with = "socket")]
    pub config: Option<PathBuf>,
}

/// A connection to a daemon.
#[derive(Debug)]
pub struct Daemon {
    path: PathBuf,
    read: BufReader<UnixStream>,
}

impl Target {
    fn path(&self) -> Result<PathBuf, Error> {
        match (&self.socket, &self.config) {
            (Some(socket), _) => Ok(socket.clone()),
            (None, None) => Ok(Control::default().socket),
            (None, Some(file)) => {
                Config::load(file)?.control.map(|control| control.socket).ok_or_else(|| {
                    let file = file.display();
                    Error::usage(format!(
                        "{file} has no [control] table: its daemon has no control socket; add one"
                    ))
                })
            }
        }
    }

    /// Connects.
    pub fn connect(&self) -> Result<Daemon, Error> {
        let path = self.path()?;
        let stream = UnixStream::connect(&path).map_err(|error| {
            use std::io::ErrorKind::{ConnectionRefused, NotFound, PermissionDenied};
            let remedy = match error.kind() {
                NotFound | ConnectionRefused => {
                    "is wrenchd running, and its [control] socket this one? Give --socket or --config"
                }
                PermissionDenied => "this user may not: join the group of the socket, or use sudo",
                _ => "give another --socket",
            };
            Error::usage(format!("{}: {error}; {remedy}", path.display()))
        })?;
        let set =
            stream.set_read_timeout(Some(PATIENCE)).and_then(|()| stream.set_write_timeout(Some(PATIENCE)));
        set.map_err(|error| broken(&path, &error))?;
        Ok(Daemon { path, read: BufReader::new(stream) })
    }

    /// One request and its answer; a refusal is an error's words inside the reply.
    pub fn ask(&self, request: &Request) -> Result<Reply, Error> {
        let mut daemon = self.connect()?;
        daemon.send(request)?;
        daemon.hear()
    }
}

impl Daemon {
    /// Sends a request.
    pub fn send(&mut self, request: &Request) -> Result<(), Error> {
        let mut line = serde_json::to_vec(request).map_err(|error| Error::Output(error.into()))?;
        line.push(b'\n');
        self.read.get_mut().write_all(&line).map_err(|error| broken(&self.path, &error))
    }

    /// The next answer.
    pub fn hear(&mut self) -> Result<Reply, Error> {
        let mut line = String::new();
        let length = self.read.read_line(&mut line).map_err(|error| broken(&self.path, &error))?;
        if length == 0 {
            return Err(Error::usage(format!("{}: the daemon has gone; see its log", self.path.display())));
        }
        serde_json::from_str(&line).map_err(|error| {
            let path = self.path.display();
            Error::usage(format!(
                "{path}: answers what this program does not understand ({error}); are both of one version?"
            ))
        })
    }
}

fn broken(path: &Path, error: &std::io::Error) -> Error {
    Error::usage(format!("{}: {error}; the daemon does not answer, see its log", path.display()))
}
