//! Where orders to the cycle are given: queues that the cycle never waits for, not even for who was stopped in the midst of giving one.

use std::time::Duration;

use rig::tare::TareRefusal;
use rtrb::{Consumer, Producer, RingBuffer};

use crate::command::{Command, Done, Order, Report};

/// Commands and answers that may wait at a time.
const ROOM: usize = 4;

/// The cycle's end of the queues.
#[derive(Debug)]
pub struct Inbox {
    commands: Consumer<Command>,
    reports: Producer<Report>,
}

impl Inbox {
    /// The next command, if there is one.
    pub fn take(&mut self) -> Option<Command> {
        self.commands.pop().ok()
    }

    /// Answers; nobody may listen any more.
    pub fn answer(&mut self, report: Report) {
        let _ = self.reports.push(report);
    }
}

/// The other end: gives one order at a time and waits for its answer.
#[derive(Debug)]
pub struct Desk {
    line: tokio::sync::Mutex<Line>,
}

#[derive(Debug)]
struct Line {
    commands: Producer<Command>,
    reports: Consumer<Report>,
    number: u64,
}

/// Why an order was not obeyed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NotDone {
    /// The tare was refused.
    #[error("not tared: {0}")]
    Refused(TareRefusal),
    /// Other orders are before this one.
    #[error("another tare or payload is under way; try again in a second")]
    Busy,
    /// The cycle does not answer.
    #[error("the real-time cycle does not answer; see the daemon's log")]
    Silent,
}

/// How long an order waits for those before it: a tare takes half a second.
const PATIENCE: Duration = Duration::from_secs(2);

/// How long the answer may take: a tare without snapshots gives up by itself before.
const ANSWER_LIMIT: Duration = Duration::from_secs(5);

/// How often the answer is looked for.
const LOOK_PERIOD: Duration = Duration::from_millis(5);

/// Both ends of a pair of queues.
pub fn desk() -> (Desk, Inbox) {
    let (commands, inbox) = RingBuffer::new(ROOM);
    let (answers, reports) = RingBuffer::new(ROOM);
    let line = tokio::sync::Mutex::new(Line { commands, reports, number: 0 });
    (Desk { line }, Inbox { commands: inbox, reports: answers })
}

impl Desk {
    /// Gives an order to the cycle and waits for what becomes of it.
    pub async fn order(&self, order: Order) -> Result<Done, NotDone> {
        let mut line = tokio::time::timeout(PATIENCE, self.line.lock()).await.map_err(|_| NotDone::Busy)?;
        line.number += 1;
        let number = line.number;
        if line.commands.is_abandoned() {
            return Err(NotDone::Silent);
        }
        line.commands.push(Command { number, order }).map_err(|_| NotDone::Busy)?;
        let begun = tokio::time::Instant::now();
        while begun.elapsed() < ANSWER_LIMIT {
            // What belongs to an order whose giver has gone is passed over.
            while let Ok(report) = line.reports.pop() {
                if report.number == number {
                    return report.outcome.map_err(NotDone::Refused);
                }
            }
            tokio::time::sleep(LOOK_PERIOD).await;
        }
        Err(NotDone::Silent)
    }
}
