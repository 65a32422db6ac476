//! The daemon, through its control socket.

use std::io::{BufRead, BufReader, Write};
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::time::Duration;

use serde::de::DeserializeOwned;
use wrenchd::control::Request;

/// A daemon that says nothing for so long is not there: it publishes records, good or bad, many times a second.
const SILENCE: Duration = Duration::from_secs(3);

/// Asks for something that goes on, and hands on each line as it comes; ends when the daemon does, or when `hear` says so.
pub(crate) fn listen<T: DeserializeOwned>(
    socket: &Path,
    request: &Request,
    mut hear: impl FnMut(T) -> bool,
) -> std::io::Result<()> {
    let mut stream = UnixStream::connect(socket)?;
    stream.set_read_timeout(Some(SILENCE))?;
    stream.set_write_timeout(Some(SILENCE))?;
    let mut line = serde_json::to_vec(request)?;
    line.push(b'\n');
    stream.write_all(&line)?;
    let mut read = BufReader::new(stream);
    let mut line = String::new();
    loop {
        line.clear();
        if read.read_line(&mut line)? == 0 {
            return Ok(());
        }
        if !hear(serde_json::from_str(&line)?) {
            return Ok(());
        }
    }
}
