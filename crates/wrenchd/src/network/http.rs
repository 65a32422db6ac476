//! Small answers over HTTP to clients that are not trusted: few connections, short requests, little time.

use std::collections::HashMap;
use std::net::{IpAddr, TcpListener};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use http_body_util::Full;
use hyper::body::{Bytes, Incoming};
use hyper::header::{ALLOW, CACHE_CONTROL, CONTENT_TYPE, HeaderValue, X_CONTENT_TYPE_OPTIONS};
use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper::{Method, Request, Response, StatusCode};
use hyper_util::rt::{TokioIo, TokioTimer};
use tokio::io::{AsyncRead, AsyncWrite};

use super::Server;

/// Connections at a time; who comes beyond them is turned away.
const CONNECTIONS: usize = 32;
/// Of these, for one address: no host takes the others' places.
const CONNECTIONS_OF_ONE: usize = 8;
/// Longest head of a request, bytes.
const HEAD_BYTES: usize = 8192;
/// How long a request may take to arrive.
const HEAD_LIMIT: Duration = Duration::from_secs(5);
/// How long a connection may last: a client that reads slowly, or asks on and on, has to come again.
const CONNECTION_LIMIT: Duration = Duration::from_secs(30);

/// One answer.
#[derive(Clone, Debug)]
pub struct Answer {
    pub(crate) status: StatusCode,
    pub(crate) content_type: &'static str,
    pub(crate) body: Bytes,
}

impl Answer {
    /// 200 with a body.
    pub fn ok(content_type: &'static str, body: impl Into<Bytes>) -> Self {
        Self { status: StatusCode::OK, content_type, body: body.into() }
    }

    /// A status with a line of text.
    pub fn text(status: StatusCode, line: &str) -> Self {
        Self { status, content_type: "text/plain; charset=utf-8", body: format!("{line}\n").into() }
    }
}

/// Answers a path.
pub type Answerer = Arc<dyn Fn(&str) -> Answer + Send + Sync>;

/// Who has how many connections.
#[derive(Debug, Default)]
struct Places(Mutex<HashMap<IpAddr, usize>>);

/// A connection's place until it is dropped.
#[derive(Debug)]
struct Place {
    places: Arc<Places>,
    host: IpAddr,
}

impl Places {
    /// A place for one more connection of a host, if there is one.
    fn take(places: &Arc<Self>, host: IpAddr) -> Option<Place> {
        let mut taken = places.taken();
        let own = taken.get(&host).copied().unwrap_or(0);
        if own >= CONNECTIONS_OF_ONE || taken.values().sum::<usize>() >= CONNECTIONS {
            return None;
        }
        taken.insert(host, own + 1);
        Some(Place { places: places.clone(), host })
    }

    fn taken(&self) -> MutexGuard<'_, HashMap<IpAddr, usize>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        let mut taken = self.places.taken();
        match taken.get_mut(&self.host) {
            Some(own) if *own > 1 => *own -= 1,
            _ => drop(taken.remove(&self.host)),
        }
    }
}

/// Serves GET and HEAD on a listener, to the addresses that `allow` accepts; an answer may depend on the address that was asked.
pub(crate) fn serve(
    listener: TcpListener,
    allow: impl Fn(IpAddr) -> bool + Send + 'static,
    answerer: impl Fn(&str, IpAddr) -> Answer + Send + Sync + 'static,
) -> Server {
    Box::pin(async move {
        let listener = match tokio::net::TcpListener::from_std(listener) {
            Ok(listener) => listener,
            Err(error) => return tracing::error!("HTTP is not served: {error}"),
        };
        let answerer = Arc::new(answerer);
        let places = Arc::<Places>::default();
        loop {
            let (stream, peer) = match listener.accept().await {
                Ok(accepted) => accepted,
                // Out of descriptors or a connection that died in the queue: both pass.
                Err(error) => {
                    tracing::debug!("HTTP connection: {error}");
                    tokio::time::sleep(Duration::from_millis(100)).await;
                    continue;
                }
            };
            if !allow(peer.ip()) {
                continue;
            }
            let Some(place) = Places::take(&places, peer.ip()) else { continue };
            let Ok(asked) = stream.local_addr() else { continue };
            let answerer = answerer.clone();
            let answerer: Answerer = Arc::new(move |path| answerer(path, asked.ip().to_canonical()));
            tokio::spawn(async move {
                attend(stream, answerer).await;
                drop(place);
            });
        }
    })
}

/// Serves one connection to its end, of whatever kind it is.
pub async fn attend(stream: impl AsyncRead + AsyncWrite + Unpin, answerer: Answerer) {
    let service = service_fn(move |request| {
        let response = respond(&request, &answerer);
        async move { Ok::<_, std::convert::Infallible>(response) }
    });
    let connection = http1::Builder::new()
        .timer(TokioTimer::new())
        // A client that has said all and shuts its side down still gets its answer.
        .half_close(true)
        .header_read_timeout(HEAD_LIMIT)
        .max_buf_size(HEAD_BYTES)
        .serve_connection(TokioIo::new(stream), service);
    // A client's faults are its own: they end its connection, nothing else.
    let _ = tokio::time::timeout(CONNECTION_LIMIT, connection).await;
}

fn respond(request: &Request<Incoming>, answerer: &Answerer) -> Response<Full<Bytes>> {
    let readable = [Method::GET, Method::HEAD].contains(request.method());
    let answer = match readable {
        true => answerer(request.uri().path()),
        false => Answer::text(StatusCode::METHOD_NOT_ALLOWED, "this is read-only: GET or HEAD"),
    };
    let mut response = Response::new(Full::new(answer.body));
    *response.status_mut() = answer.status;
    let headers = response.headers_mut();
    headers.insert(CONTENT_TYPE, HeaderValue::from_static(answer.content_type));
    headers.insert(CACHE_CONTROL, HeaderValue::from_static("no-store"));
    headers.insert(X_CONTENT_TYPE_OPTIONS, HeaderValue::from_static("nosniff"));
    if !readable {
        headers.insert(ALLOW, HeaderValue::from_static("GET, HEAD"));
    }
    response
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_host_has_some_of_the_places_and_all_hosts_have_all() {
        let places = Arc::<Places>::default();
        let host = |last: u8| IpAddr::from([10, 0, 0, last]);
        let of_one: Vec<Place> = std::iter::from_fn(|| Places::take(&places, host(1))).collect();
        assert_eq!(of_one.len(), CONNECTIONS_OF_ONE);
        let of_others: Vec<Place> =
            (2..=255).flat_map(|last| [0, 1].map(|_| Places::take(&places, host(last)))).flatten().collect();
        assert_eq!(of_one.len() + of_others.len(), CONNECTIONS);
        drop(of_one);
        assert!(Places::take(&places, host(1)).is_some());
        drop(of_others);
        assert!(places.taken().is_empty(), "nothing is remembered of who has gone");
    }
}
