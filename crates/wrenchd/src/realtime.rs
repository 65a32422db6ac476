//! Real-time rights, the system's clocks and the deadline sleep: the unsafe code of the crate, but for the sockets that a service manager hands over.
//!
//! Each right is asked for by itself; where it is refused the daemon runs on without it and says what to do.

use std::cell::Cell;
use std::fs::{File, OpenOptions};
use std::io::{self, Write};
use std::mem::zeroed;

use crate::engine::Now;
use crate::station::Clock;

/// Priority of the cycle among the real-time threads: above ordinary ones, below the kernel's own interrupt threads.
pub const PRIORITY: i32 = 50;

/// Bit of `CAP_IPC_LOCK` in a set of capabilities.
const CAP_IPC_LOCK: u32 = 14;

/// How old the known distance between the clocks may be, ns.
const DISTANCE_HOLDS_NS: i64 = 100_000_000;

/// No stamp that was soon before now is longer ago, ns.
const SOON_NS: i64 = 5_000_000;

/// The system's clocks.
#[derive(Clone, Copy, Debug, Default)]
pub struct SystemClock;

/// The same for the cycle. Where reading a clock is a system call each read counts, so soon after a kernel stamp one read does: the
/// distance between the clocks is looked at again ten times a second, and at once where it contradicts the stamp. Of a step of the
/// wall clock by less than 5 ms it is a tenth of a second before records know.
#[derive(Debug, Default)]
pub struct CycleClock {
    last: Cell<Option<Now>>,
}

impl Clock for SystemClock {
    fn now(&self) -> Now {
        Now { realtime_ns: read(libc::CLOCK_REALTIME), monotonic_ns: read(libc::CLOCK_MONOTONIC) }
    }

    fn now_after(&self, earlier: Now) -> Now {
        earlier.later(read(libc::CLOCK_MONOTONIC) - earlier.monotonic_ns)
    }

    fn sleep_until_ns(&self, monotonic_ns: i64) {
        let until = timespec(monotonic_ns.max(0));
        // SAFETY: `until` outlives the call; no remainder is asked for. An interrupted sleep is a shorter one.
        unsafe {
            libc::clock_nanosleep(libc::CLOCK_MONOTONIC, libc::TIMER_ABSTIME, &until, std::ptr::null_mut());
        }
    }
}

impl Clock for CycleClock {
    fn now(&self) -> Now {
        let now = SystemClock.now();
        self.last.set(Some(now));
        now
    }

    fn now_soon_after(&self, stamp_ns: i64) -> Now {
        let Some(last) = self.last.get() else { return self.now() };
        let now = self.now_after(last);
        let holds = now.monotonic_ns - last.monotonic_ns < DISTANCE_HOLDS_NS;
        let agrees = (0..SOON_NS).contains(&(now.realtime_ns - stamp_ns));
        if holds && agrees { now } else { self.now() }
    }

    fn now_after(&self, earlier: Now) -> Now {
        SystemClock.now_after(earlier)
    }

    fn sleep_until_ns(&self, monotonic_ns: i64) {
        SystemClock.sleep_until_ns(monotonic_ns);
    }
}

fn read(clock: libc::clockid_t) -> i64 {
    let mut now = timespec(0);
    // SAFETY: `now` outlives the call, which only writes to it.
    unsafe { libc::clock_gettime(clock, &mut now) };
    now.tv_sec * 1_000_000_000 + now.tv_nsec
}

fn timespec(ns: i64) -> libc::timespec {
    libc::timespec { tv_sec: ns / 1_000_000_000, tv_nsec: ns % 1_000_000_000 }
}

/// Puts the calling thread under SCHED_FIFO at [`PRIORITY`]; else what to do.
pub fn first_in_first_out() -> Result<(), String> {
    // SAFETY: all zeros is a valid sched_param: integers only.
    let mut parameters: libc::sched_param = unsafe { zeroed() };
    parameters.sched_priority = PRIORITY;
    // SAFETY: `parameters` outlives the call; 0 is the calling thread.
    if unsafe { libc::sched_setscheduler(0, libc::SCHED_FIFO, &parameters) } == 0 {
        return Ok(());
    }
    Err(format!(
        "no SCHED_FIFO priority {PRIORITY} for the cycle: {}; it will be late whenever the computer is busy: \
         set LimitRTPRIO={PRIORITY} in the unit, or rtprio in limits.conf",
        io::Error::last_os_error()
    ))
}

/// Locks all memory, present and future, so that no page fault holds up the cycle; else what to do.
pub fn lock_memory() -> Result<(), String> {
    const REMEDY: &str = "a page fault may hold up the cycle: set LimitMEMLOCK=infinity in the unit";
    // SAFETY: all zeros is a valid rlimit: integers only.
    let mut limit: libc::rlimit = unsafe { zeroed() };
    // SAFETY: `limit` outlives the call, which only writes to it.
    unsafe { libc::getrlimit(libc::RLIMIT_MEMLOCK, &mut limit) };
    // Locking under a finite limit would make a later allocation fail.
    if limit.rlim_cur != libc::RLIM_INFINITY && !has_capability(CAP_IPC_LOCK) {
        return Err(format!("memory is not locked: only {} bytes may be; {REMEDY}", limit.rlim_cur));
    }
    // SAFETY: no pointers are passed.
    if unsafe { libc::mlockall(libc::MCL_CURRENT | libc::MCL_FUTURE) } == 0 {
        return Ok(());
    }
    Err(format!("memory is not locked: {}; {REMEDY}", io::Error::last_os_error()))
}

fn has_capability(bit: u32) -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let effective = status.lines().find_map(|line| line.strip_prefix("CapEff:"));
    let effective = effective.and_then(|hex| u64::from_str_radix(hex.trim(), 16).ok());
    effective.is_some_and(|set| set >> bit & 1 == 1)
}

/// Keeps the processor out of deep sleep states as long as the file is held; else what to do.
pub fn no_deep_sleep() -> Result<File, String> {
    const FILE: &str = "/dev/cpu_dma_latency";
    let open = || {
        let mut file = OpenOptions::new().write(true).open(FILE)?;
        file.write_all(&0i32.to_ne_bytes())?;
        Ok(file)
    };
    open().map_err(|error: io::Error| {
        format!("{FILE}: {error}; waking up may take longer on a quiet computer: let this user write it")
    })
}

/// Device and inode of standard error, as `JOURNAL_STREAM` has them.
pub fn standard_error_stream() -> Option<(u64, u64)> {
    // SAFETY: all zeros is a valid stat: integers only.
    let mut status: libc::stat = unsafe { zeroed() };
    // SAFETY: `status` outlives the call, which only writes to it.
    let done = unsafe { libc::fstat(libc::STDERR_FILENO, &mut status) };
    (done == 0).then_some((status.st_dev as u64, status.st_ino as u64))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sleeps_until_an_absolute_time() {
        let clock = SystemClock;
        let before = clock.now();
        clock.sleep_until_ns(before.monotonic_ns + 3_000_000);
        let after = clock.now();
        assert!(after.monotonic_ns >= before.monotonic_ns + 3_000_000);
        assert!(after.realtime_ns > 1_600_000_000_000_000_000);
        clock.sleep_until_ns(before.monotonic_ns);
        clock.sleep_until_ns(-5);
    }

    #[test]
    fn one_clock_tells_soon_after_a_stamp_unless_they_have_stepped_apart() {
        let clock = CycleClock::default();
        let real = clock.now();
        let told_ns = |stamp_ns| clock.now_soon_after(stamp_ns).realtime_ns - real.realtime_ns;
        // As if the wall clock had been two milliseconds, and then an hour, ahead when it was last read.
        clock.last.set(Some(Now { realtime_ns: real.realtime_ns + 2_000_000, ..real }));
        assert!(told_ns(real.realtime_ns) >= 2_000_000, "nothing contradicts it");
        clock.last.set(Some(Now { realtime_ns: real.realtime_ns + 3_600_000_000_000, ..real }));
        assert!(told_ns(real.realtime_ns) < 1_000_000_000, "the stamp contradicts it");
        clock.last.set(Some(real.earlier(DISTANCE_HOLDS_NS)));
        assert!(told_ns(real.realtime_ns) >= 0);
        assert!(
            clock.last.get().is_some_and(|last| last.monotonic_ns >= real.monotonic_ns),
            "looked at again"
        );
    }
}
