//! Hears requests and obeys those of allowed hosts.

use std::net::{SocketAddr, UdpSocket};
use std::sync::Arc;
use std::time::{Duration, Instant};

use rig::config::Network;
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

use super::record::Request;
use super::stream::Grants;
use crate::command::Order;
use crate::network::{Server, Shared};

/// Longer datagrams are no requests.
const LONGEST_BYTES: usize = 64;
/// One line of each kind is logged in so long: who sends requests can send many.
const LOG_PERIOD: Duration = Duration::from_secs(10);

/// Serves requests on a socket, from these networks.
pub(super) fn serve(socket: UdpSocket, allow: Vec<Network>, shared: Shared) -> Server {
    Box::pin(async move {
        let socket = match tokio::net::UdpSocket::from_std(socket) {
            Ok(socket) => socket,
            Err(error) => return tracing::error!("RDT requests are not served: {error}"),
        };
        let stream = shared.rdt.clone();
        let mut grants = Grants::new(&stream);
        let mut data = [0; LONGEST_BYTES];
        // A tare takes half a second; what is asked meanwhile is not kept for later, however much it is.
        let taring = Arc::new(Semaphore::new(1));
        let (mut foreign, mut refused) = (Quiet::default(), Quiet::default());
        loop {
            let (length, from) = match socket.recv_from(&mut data).await {
                Ok(received) => received,
                // What an unreachable client sent back; the next request may be another's.
                Err(error) => {
                    tracing::debug!("RDT request: {error}");
                    continue;
                }
            };
            if !allow.iter().any(|network| network.contains(from.ip())) {
                foreign.say(|| {
                    tracing::warn!("RDT request from {from} is outside [publish.rdt] allow: not answered")
                });
                continue;
            }
            let Some(request) = Request::parse(&data[..length]) else { continue };
            if let Err(holder) = grants.take(request, from, Instant::now()) {
                refused.say(|| tracing::warn!("RDT request from {from} refused: {holder} holds the stream"));
                continue;
            }
            if request == Request::Bias
                && let Ok(place) = taring.clone().try_acquire_owned()
            {
                tokio::spawn(bias(shared.clone(), from, place));
            }
        }
    })
}

/// Tares; the protocol has no answer, so what became of it is logged.
async fn bias(shared: Shared, from: SocketAddr, _place: OwnedSemaphorePermit) {
    match shared.desk.order(Order::Tare).await {
        Ok(_) => tracing::info!("tared for {from}"),
        Err(error) => tracing::warn!("RDT bias from {from}: {error}"),
    }
}

/// Says something now and then only.
#[derive(Default)]
struct Quiet(Option<Instant>);

impl Quiet {
    fn say(&mut self, line: impl Fn()) {
        if self.0.is_none_or(|said| said.elapsed() > LOG_PERIOD) {
            self.0 = Some(Instant::now());
            line();
        }
    }
}
