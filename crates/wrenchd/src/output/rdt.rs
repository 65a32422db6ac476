//! Net F/T records (RDT) over UDP, with their XML description over HTTP, as ATI's Net F/T box serves them, so that its clients
//! work unchanged.
//!
//! Requests come to a task outside the cycle, which writes the newest one into a [`Stream`]; the cycle looks there before each
//! record and sends the record itself, in one call that does not wait. Field layout: ATI Industrial Automation,
//! "Net F/T User Manual" (9610-05-1022), section "UDP Interface Using RDT"; all numbers big-endian.
//!
//! The protocol has no authentication: requests from outside `allow` are not answered at all, and while one host
//! holds the stream another has to wait for the end of its lease.

mod description;
mod record;
mod requests;
mod stream;

use std::net::UdpSocket;
use std::sync::Arc;

use rig::Config;

use super::{Opened, Output, OutputCounts};
use crate::network::Shared;
use crate::network::ports::{PortError, Ports};
use crate::published::Dispatch;
use record::Recorder;
pub use record::Request;
pub use stream::{Grants, Stream};

const TABLE: &str = "[publish.rdt]";

/// Sends records to whoever asked for them.
#[derive(Debug)]
struct RdtOutput {
    socket: UdpSocket,
    stream: Arc<Stream>,
    recorder: Recorder,
    counts: OutputCounts,
}

pub(super) fn open(config: &Config, shared: &Shared, ports: &mut Ports) -> Result<Opened, PortError> {
    let Some(rdt) = &config.publish.rdt else { return Ok(Opened::default()) };
    let socket = ports.udp(TABLE, rdt.bind)?;
    let listener = ports.tcp(TABLE, rdt.http)?;
    let requests = ports.udp(TABLE, rdt.bind)?;
    let output = RdtOutput {
        socket,
        stream: shared.rdt.clone(),
        recorder: Recorder::new(rdt),
        counts: OutputCounts::default(),
    };
    let description = description::serve(listener, config, rdt, shared);
    let server = requests::serve(requests, rdt.allow.clone(), shared.clone());
    Ok(Opened { output: Some(Box::new(output)), servers: vec![description, server] })
}

impl Output for RdtOutput {
    fn publish(&mut self, record: &Dispatch) {
        self.recorder.note(record);
        let Some((to, number)) = self.stream.next_record() else { return };
        let data = self.recorder.record(number, record);
        match self.socket.send_to(&data, to) {
            Ok(_) => self.counts.sent += 1,
            Err(_) => self.counts.dropped += 1,
        }
    }

    fn counts(&self) -> OutputCounts {
        self.counts
    }
}
