//! From the last frame of a round to the wrench: the daemon in event mode, each peer in turns with it or by itself.

use std::process::Command;
use std::time::{Duration, Instant, SystemTime};

use can::frame::Frame;
use can::socket::SocketSender;
use socketcan::{CanSocket, Socket, SocketOptions};
use wrenchd_tests::candump::ROUND;
use wrenchd_tests::guest::Guest;
use wrenchd_tests::process::Program;
use wrenchd_tests::{Check, Failure, ensure};

const PERIOD: Duration = Duration::from_millis(8);
/// Rounds before the daemon's rhythm and all caches are settled.
const SETTLING: usize = 100;
const STEP: Duration = Duration::from_secs(120);
/// An answer's frames that are the wrench itself.
const WRENCH_FRAMES: usize = 2;
/// Where frames come in and answers go out, one pair for each program that runs at a time.
pub(crate) const LINKS: [[&str; 2]; 2] = [["vcan0", "vcan1"], ["vcan2", "vcan3"]];

/// The identifier that an answer follows.
pub(crate) fn last_of_a_round() -> &'static str {
    ROUND[ROUND.len() - 1]
}

/// How long an answer took, the middle of all rounds.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Took {
    /// From the kernel's stamp of the last frame in to its stamp of the answer's second frame out, us: force and torque.
    pub(crate) out_us: f64,
    /// The same to the answer's last frame: what tells of the wrench's quality, too.
    pub(crate) all_us: f64,
    /// From before the call that sends the last frame until the answer's first frame is read, us.
    pub(crate) seen_us: f64,
}

/// Has each of these programs (with its number of frames an answer) answer these rounds, in turns so close that whatever else the
/// computer does meets all of them.
pub(crate) fn in_turns<const N: usize>(
    guest: &Guest,
    programs: [(Command, usize); N],
    rounds: &[Vec<Frame>],
) -> Check<[Took; N]> {
    let mut lanes = Vec::with_capacity(N);
    for ((mut command, frames), links) in programs.into_iter().zip(LINKS) {
        lanes.push(Lane::open(guest, &mut command, frames, links)?);
    }
    let mut due = Instant::now();
    for (number, round) in rounds.iter().enumerate() {
        for lane in &mut lanes {
            due += PERIOD / N as u32;
            std::thread::sleep(due.saturating_duration_since(Instant::now()));
            let took = lane.answer(round)?;
            lane.took.extend(took.filter(|_| number >= SETTLING));
        }
    }
    let ended = lanes.into_iter().map(|lane| lane.end(rounds.len())).collect::<Check<Vec<Took>>>()?;
    ended.try_into().map_err(|_| Failure::new("as many programs as links"))
}

/// A program that answers, and the links that it does so on.
struct Lane {
    program: Program,
    frames: usize,
    sender: SocketSender,
    /// The last frame of each round as it comes in.
    near: CanSocket,
    /// The answers.
    far: CanSocket,
    took: Vec<Took>,
}

impl Lane {
    fn open(guest: &Guest, command: &mut Command, frames: usize, [near, far]: [&str; 2]) -> Check<Self> {
        let program = guest.start_listening(command, near)?;
        let sender = SocketSender::open(near)?;
        let [near, far] = [CanSocket::open(near)?, CanSocket::open(far)?];
        near.set_filters(&[(u32::from_str_radix(last_of_a_round(), 16)?, 0x7FF)])?;
        for socket in [&near, &far] {
            socket.set_recv_timestamp(true)?;
            socket.set_read_timeout(PERIOD * 4)?;
        }
        Ok(Self { program, frames, sender, near, far, took: Vec::new() })
    }

    /// Sends a round and takes the answer; none where there was none.
    fn answer(&mut self, round: &[Frame]) -> Check<Option<Took>> {
        for socket in [&self.near, &self.far] {
            // What was published in between (the daemon tells of silence) is no answer.
            socket.set_nonblocking(true)?;
            while socket.read_frame().is_ok() {}
            socket.set_nonblocking(false)?;
        }
        let (last, others) = round.split_last().ok_or_else(|| Failure::new("a round without frames"))?;
        self.sender.send(others);
        let begun = Instant::now();
        self.sender.send(std::slice::from_ref(last));
        let first = self.far.read_frame_with_timestamp();
        let seen = begun.elapsed();
        let Ok((_, mut all)) = first else { return Ok(None) };
        let mut out = all;
        for frame in 1..self.frames {
            let Ok((_, stamp)) = self.far.read_frame_with_timestamp() else { return Ok(None) };
            all = stamp;
            if frame < WRENCH_FRAMES {
                out = stamp;
            }
        }
        let (_, arrived) = self.near.read_frame_with_timestamp()?;
        let micros = |time: Duration| time.as_secs_f64() * 1e6;
        let since = |stamp: SystemTime| micros(stamp.duration_since(arrived).unwrap_or_default());
        Ok(Some(Took { out_us: since(out), all_us: since(all), seen_us: micros(seen) }))
    }

    fn end(self, rounds: usize) -> Check<Took> {
        self.program.stop(STEP)?;
        let answered = self.took.len();
        ensure!(2 * answered > rounds, "{answered} of {rounds} rounds were answered");
        let middle = |value: fn(&Took) -> f64| {
            let mut values: Vec<f64> = self.took.iter().map(value).collect();
            values.sort_by(f64::total_cmp);
            values[answered / 2]
        };
        Ok(Took {
            out_us: middle(|took| took.out_us),
            all_us: middle(|took| took.all_us),
            seen_us: middle(|took| took.seen_us),
        })
    }
}
