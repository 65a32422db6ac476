//! `wrenchctl monitor`: a running daemon's wrench, gauges and health in the terminal.

mod view;

use std::io::{self, IsTerminal};
use std::sync::mpsc::{Receiver, TryRecvError, sync_channel};
use std::time::Duration;

use ratatui::crossterm::event::{self, Event, KeyCode, KeyModifiers};
use wrenchd::control::{Reply, Request};

use crate::control::{Daemon, Target};
use crate::{Error, Outcome};
use view::History;

/// Rate of the view, Hz.
const RATE_HZ: f64 = 20.0;
/// How long a key is waited for between two pictures.
const KEY_WAIT: Duration = Duration::from_millis(20);
/// Answers that may wait to be shown.
const WAITING: usize = 64;

/// Which daemon to watch.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// Which daemon.
    #[command(flatten)]
    pub target: Target,
}

/// Watches until q, Escape or Ctrl-C, or until the daemon ends (1).
pub fn run(args: Args) -> Result<Outcome, Error> {
    if !(io::stdout().is_terminal() && io::stdin().is_terminal()) {
        return Err(Error::usage(
            "monitor draws on a terminal, and this is none; use `wrenchctl status`, with --json F for programs",
        ));
    }
    let mut daemon = args.target.connect()?;
    daemon.send(&Request::Stream { rate_hz: RATE_HZ })?;
    let first = daemon.hear()?;
    let replies = listen(daemon);
    let mut terminal = ratatui::try_init()?;
    let ended = watch(&mut terminal, first, &replies);
    ratatui::restore();
    ended
}

/// Hears answers on a thread of its own, so that keys are never waited behind them.
fn listen(mut daemon: Daemon) -> Receiver<Result<Reply, Error>> {
    let (sender, replies) = sync_channel(WAITING);
    std::thread::spawn(move || {
        loop {
            let reply = daemon.hear();
            let last = reply.is_err();
            if sender.send(reply).is_err() || last {
                return;
            }
        }
    });
    replies
}

fn watch(
    terminal: &mut ratatui::DefaultTerminal,
    first: Reply,
    replies: &Receiver<Result<Reply, Error>>,
) -> Result<Outcome, Error> {
    let mut history = History::default();
    let mut next = Some(first);
    loop {
        while let Some(reply) = next.take() {
            history.add(reply)?;
            next = match replies.try_recv() {
                Ok(reply) => Some(reply?),
                Err(TryRecvError::Empty) => None,
                Err(TryRecvError::Disconnected) => return Ok(Outcome::No),
            };
        }
        terminal.draw(|frame| view::draw(frame, &history))?;
        if event::poll(KEY_WAIT)?
            && let Event::Key(key) = event::read()?
        {
            let interrupt = key.code == KeyCode::Char('c') && key.modifiers.contains(KeyModifiers::CONTROL);
            if interrupt || matches!(key.code, KeyCode::Char('q') | KeyCode::Esc) {
                return Ok(Outcome::Done);
            }
        }
        next = match replies.recv_timeout(Duration::from_secs_f64(1.0 / RATE_HZ)) {
            Ok(reply) => Some(reply?),
            Err(_) => None,
        };
    }
}
