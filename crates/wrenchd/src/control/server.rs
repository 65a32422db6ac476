//! Serves the control socket.

use std::os::unix::net::UnixListener;
use std::sync::Arc;
use std::time::Duration;

use model::spatial::RigidBody;
use nalgebra::{Matrix3, Vector3};
use rig::Config;
use tokio::io::{AsyncBufReadExt, AsyncReadExt, AsyncWriteExt, BufReader};
use tokio::net::UnixStream;
use tokio::net::unix::{OwnedReadHalf, OwnedWriteHalf};
use tokio::sync::Semaphore;
use tokio::time::{MissedTickBehavior, interval, timeout};

use super::{LINE_BYTES, Record, Reply, Request};
use crate::command::{Done, Order};
use crate::network::ports::{PortError, Ports};
use crate::network::{Server, Shared};
use crate::output::Opened;
use crate::view::Payload;

/// Connections at a time; who comes beyond them is told so.
const CONNECTIONS: usize = 16;
/// A connection that asks nothing for so long is closed.
const IDLE_LIMIT: Duration = Duration::from_secs(600);
/// How often new records are looked for.
const RECORDS_PERIOD: Duration = Duration::from_millis(1);
/// A client that does not read an answer for so long is cut off.
const WRITE_LIMIT: Duration = Duration::from_secs(2);

/// Opens the socket if it is configured. Where the system does not let this user make it, the daemon runs without: the wrench
/// does not need it. A socket that another daemon serves is refused: two daemons on one arm are a mistake.
pub(crate) fn open(config: &Config, shared: &Shared, ports: &mut Ports) -> Result<Opened, PortError> {
    let Some(control) = &config.control else { return Ok(Opened::default()) };
    let listener = match ports.control("[control] socket", &control.socket) {
        Ok(listener) => listener,
        Err(error) if error.is_taken() => return Err(error),
        Err(error) => {
            tracing::warn!("{error}; running without it: no status, tare, payload or reload by wrenchctl");
            return Ok(Opened::default());
        }
    };
    Ok(Opened { output: None, servers: vec![serve(listener, shared.clone())] })
}

fn serve(listener: UnixListener, shared: Shared) -> Server {
    Box::pin(async move {
        let listener = match tokio::net::UnixListener::from_std(listener) {
            Ok(listener) => listener,
            Err(error) => return tracing::error!("the control socket is not served: {error}"),
        };
        let places = Arc::new(Semaphore::new(CONNECTIONS));
        loop {
            let Ok((stream, _)) = listener.accept().await else {
                tokio::time::sleep(Duration::from_millis(100)).await;
                continue;
            };
            let (place, shared) = (places.clone().try_acquire_owned(), shared.clone());
            tokio::spawn(async move {
                // A client's faults are its own: they end its connection, nothing else.
                let _ = match place {
                    Ok(_place) => attend(stream, &shared).await,
                    Err(_) => {
                        let busy =
                            Reply::error(format!("{CONNECTIONS} clients are connected; try again later"));
                        answer(&mut stream.into_split().1, &busy).await
                    }
                };
            });
        }
    })
}

/// Serves one client to its end.
async fn attend(stream: UnixStream, shared: &Shared) -> std::io::Result<()> {
    let (read, mut write) = stream.into_split();
    let mut read = BufReader::with_capacity(LINE_BYTES, read);
    let mut line = Vec::with_capacity(LINE_BYTES);
    loop {
        line.clear();
        let room = LINE_BYTES as u64 + 1;
        let length = match timeout(IDLE_LIMIT, (&mut read).take(room).read_until(b'\n', &mut line)).await {
            Ok(length) => length?,
            Err(_) => return Ok(()),
        };
        if length == 0 {
            return Ok(());
        }
        if length > LINE_BYTES {
            let error = Reply::error(format!("a line of more than {LINE_BYTES} bytes is no request"));
            return answer(&mut write, &error).await;
        }
        match Request::parse(&line) {
            Err(error) => answer(&mut write, &Reply::error(error)).await?,
            Ok(Request::Stream { rate_hz }) => return stream_to(write, read, rate_hz, shared).await,
            Ok(Request::Records {}) => return pass_on(write, read, shared).await,
            Ok(request) => answer(&mut write, &obey(request, shared).await).await?,
        }
    }
}

async fn obey(request: Request, shared: &Shared) -> Reply {
    match request {
        Request::Status {} | Request::Stream { .. } | Request::Records {} => status(shared),
        Request::Tare {} => order(Order::Tare, shared).await,
        Request::Untare {} => order(Order::Untare, shared).await,
        Request::Payload { mass, com } => {
            let body = RigidBody::from_com(mass, Vector3::from(com), Matrix3::zeros());
            order(Order::Payload(body), shared).await
        }
        Request::Reload {} => shared.reload().await.map_or_else(Reply::error, Reply::done),
    }
}

fn status(shared: &Shared) -> Reply {
    Reply { ok: true, status: Some(Box::new(shared.status())), ..Reply::default() }
}

/// Gives an order; the answer says what was done and shows tare and payload as they are then.
async fn order(order: Order, shared: &Shared) -> Reply {
    let words = match shared.desk.order(order).await {
        Err(error) => return Reply::error(error.to_string()),
        Ok(Done::Tared(tared)) => {
            let mut words = format!("tared over {} instants", tared.instants);
            if tared.left_out > 0 {
                words += &format!(
                    "; {} gauges had too few readings and are left out until untare",
                    tared.left_out
                );
            }
            words
        }
        Ok(Done::Obeyed) => match (order, Payload::of(&shared.robot.borrow().board)) {
            (Order::Payload(_), Some(Payload { mass_kg, com_m: [x, y, z] })) => {
                format!("{mass_kg} kg at {x:.4} {y:.4} {z:.4} m in the tip frame is subtracted")
            }
            (Order::Payload(_), None) => "no payload is subtracted".to_owned(),
            _ => "no tare is applied".to_owned(),
        },
    };
    tracing::info!("control: {words}");
    Reply { live: shared.live().map(Box::new), ..Reply::done(words) }
}

/// Sends the newest state at a rate until the client goes. A slow client misses what it has no time for; one that does not
/// read at all is cut off.
async fn stream_to(
    mut write: OwnedWriteHalf,
    mut read: BufReader<OwnedReadHalf>,
    rate_hz: f64,
    shared: &Shared,
) -> std::io::Result<()> {
    let mut period = interval(Duration::from_secs_f64(1.0 / rate_hz));
    period.set_missed_tick_behavior(MissedTickBehavior::Skip);
    let mut said = [0; 64];
    loop {
        tokio::select! {
            _ = period.tick() => answer(&mut write, &status(shared)).await?,
            // Whatever it says is passed over; its end ends the stream.
            length = read.read(&mut said) => if length? == 0 {
                return Ok(());
            },
        }
    }
}

/// Sends every record as it is published until the client goes; one that is too slow misses some, one that does not read at all is cut off.
async fn pass_on(
    mut write: OwnedWriteHalf,
    mut read: BufReader<OwnedReadHalf>,
    shared: &Shared,
) -> std::io::Result<()> {
    let mut reader = shared.feed.reader();
    let mut period = interval(RECORDS_PERIOD);
    period.set_missed_tick_behavior(MissedTickBehavior::Skip);
    let mut lines = Vec::with_capacity(LINE_BYTES);
    let mut said = [0; 64];
    loop {
        tokio::select! {
            _ = period.tick() => {
                lines.clear();
                while let Some(record) = reader.next_record() {
                    serde_json::to_writer(&mut lines, &Record::from(&record))?;
                    lines.push(b'\n');
                }
                if !lines.is_empty() {
                    timeout(WRITE_LIMIT, write.write_all(&lines)).await.map_err(|_| std::io::ErrorKind::TimedOut)??;
                }
            }
            length = read.read(&mut said) => if length? == 0 {
                return Ok(());
            },
        }
    }
}

async fn answer(write: &mut OwnedWriteHalf, reply: &Reply) -> std::io::Result<()> {
    let mut line = serde_json::to_vec(reply)?;
    line.push(b'\n');
    timeout(WRITE_LIMIT, write.write_all(&line)).await.map_err(|_| std::io::ErrorKind::TimedOut)?
}
