//! The end of a round: sampling instants, ages, and a snapshot of it

use super::{Absence, Assembler, GaugeSlots, Held, JointReading, Reading, Signal, Snapshot};

impl Assembler {
    /// Ends the open round and hands on its snapshot
    pub(super) fn close(&mut self) {
        let instant_ns = self.instant_ns();
        for number in 0..self.streams.len() {
            if self.streams[number].arrived {
                self.stamp_readings(number, instant_ns);
            }
        }
        self.open = false;
        self.counts.rounds += 1;
        let cut = std::mem::take(&mut self.discard) || self.rhythm.looks_cut();
        let handed_on = !cut && self.ready < self.out.len();
        let cycles = self.cycles.close(handed_on);
        if cut {
            self.counts.discarded_rounds += 1;
        } else if handed_on {
            let mut out = std::mem::replace(&mut self.out[self.ready], Snapshot::empty(0, 0));
            self.fill(&mut out, instant_ns, cycles);
            self.counts.complete_rounds += u64::from(out.complete);
            self.out[self.ready] = out;
            self.ready += 1;
        }
        self.last_instant_ns = instant_ns;
        self.ended_stamp_ns = self.last_stamp_ns;
        for stream in &mut self.streams {
            self.counts.missed += u64::from(stream.end_round(self.round));
        }
        if self.rhythm.looks(self.round) {
            self.realign();
        }
    }

    /// The snapshot that the open round would end in now, once a gauge has come: to make ready what does not wait for the rest. Changes nothing
    pub fn preview(&mut self) -> Option<&Snapshot> {
        let is_of_gauge = |gauge: &GaugeSlots| self.streams[usize::from(gauge.stream)].arrived;
        if !self.open || self.discard || !self.compiled.gauges.iter().any(is_of_gauge) {
            return None;
        }
        let mut ahead = std::mem::replace(&mut self.ahead, Snapshot::empty(0, 0));
        self.fill(&mut ahead, self.instant_ns(), self.cycles.passed());
        self.ahead = ahead;
        Some(&self.ahead)
    }

    /// Earliest (stamp - delay) of the round's gauge frames; of its joint frames where there is no gauge
    fn instant_ns(&self) -> i64 {
        let arrived = |stream: u16| self.streams[usize::from(stream)].arrived;
        let sampled =
            |slot: u16, delay: Option<i64>| self.held[usize::from(slot)].stamp_ns - delay.unwrap_or(0);
        let gauges = self.compiled.gauges.iter().filter(|gauge| arrived(gauge.stream));
        let joints = self.compiled.joints.iter().filter(|joint| arrived(joint.stream));
        gauges
            .map(|gauge| sampled(gauge.counts, gauge.delay_ns))
            .min()
            .or_else(|| joints.map(|joint| sampled(joint.position, joint.delay_ns)).min())
            .unwrap_or(self.last_stamp_ns)
    }

    /// Gives the readings of a stream their sampling instant
    pub(super) fn stamp_readings(&mut self, stream: usize, instant_ns: i64) {
        let held = &mut self.held;
        let mut stamp = |slot: u16, of: u16, delay: Option<i64>| {
            if usize::from(of) == stream {
                let held = &mut held[usize::from(slot)];
                held.at_ns = held.sampled_ns(delay, instant_ns);
            }
        };
        for gauge in &self.compiled.gauges {
            stamp(gauge.counts, gauge.stream, gauge.delay_ns);
        }
        for joint in &self.compiled.joints {
            stamp(joint.position, joint.stream, joint.delay_ns);
            if let Some((slot, of)) = joint.velocity {
                stamp(slot, of, joint.delay_ns);
            }
        }
    }

    fn fill(&self, out: &mut Snapshot, instant_ns: i64, cycles: Option<u32>) {
        out.instant_ns = instant_ns;
        out.last_stamp_ns = self.last_stamp_ns;
        out.round = self.round;
        out.cycles = cycles;
        out.complete = true;
        for (number, gauge) in self.compiled.gauges.iter().enumerate() {
            let signal = self.gauge(gauge, instant_ns);
            out.complete &= signal.is_ok();
            out.gauges[number] = signal;
            out.temperatures[number] = match gauge.temperature {
                Some(slot) => self.slow(slot, instant_ns),
                None => Err(Absence::NotConfigured),
            };
        }
        for (number, joint) in self.compiled.joints.iter().enumerate() {
            let position = self.streamed(joint.position, joint.stream, joint.delay_ns, instant_ns);
            let velocity = match joint.velocity {
                Some((slot, stream)) => self.streamed(slot, stream, joint.delay_ns, instant_ns),
                None => Err(Absence::NotConfigured),
            };
            out.complete &= position.is_ok();
            out.joints[number] = JointReading { position, velocity };
        }
    }

    fn gauge(&self, gauge: &GaugeSlots, instant_ns: i64) -> Signal {
        let reading = self.streamed(gauge.counts, gauge.stream, gauge.delay_ns, instant_ns)?;
        let Some((slot, same_frame)) = gauge.saturated else { return Ok(reading) };
        let flag = &self.held[usize::from(slot)];
        let current = same_frame || instant_ns.saturating_sub(flag.at_ns) <= self.temperature_stale_after_ns;
        if flag.seen && current && flag.value != 0.0 { Err(Absence::Saturated) } else { Ok(reading) }
    }

    fn streamed(&self, slot: u16, stream: u16, delay_ns: Option<i64>, instant_ns: i64) -> Signal {
        let held = &self.held[usize::from(slot)];
        let stream = &self.streams[usize::from(stream)];
        let at_ns = if stream.arrived { held.sampled_ns(delay_ns, instant_ns) } else { held.at_ns };
        let age_ns = instant_ns.saturating_sub(at_ns);
        if !held.seen {
            return Err(stream.fault(self.round).unwrap_or(Absence::NeverSeen));
        }
        let too_old = age_ns > self.stale_after_ns;
        if !stream.holds(self.round) {
            return Err(stream.fault(self.round).unwrap_or(if too_old {
                Absence::Stale
            } else {
                Absence::Missed
            }));
        }
        if too_old {
            return Err(Absence::Stale);
        }
        if stream.is_doubted(self.round) {
            return Err(Absence::Repeated);
        }
        reading(held, at_ns, age_ns, if stream.is_unplaced() { self.rhythm.period_ns() } else { 0 })
    }

    /// A signal that is held until stale
    fn slow(&self, slot: u16, instant_ns: i64) -> Signal {
        let held = &self.held[usize::from(slot)];
        let age_ns = instant_ns.saturating_sub(held.at_ns);
        if !held.seen {
            return Err(Absence::NeverSeen);
        }
        if age_ns > self.temperature_stale_after_ns {
            return Err(Absence::Stale);
        }
        reading(held, held.at_ns, age_ns, 0)
    }
}

fn reading(held: &Held, at_ns: i64, age_ns: i64, unsure_ns: i64) -> Signal {
    if held.value.is_finite() {
        Ok(Reading { value: held.value, at_ns, age_ns, unsure_ns })
    } else {
        Err(Absence::NotFinite)
    }
}
