//! What the gauges' thermometers said during a recording.

use calibration::recording::for_each_frame;
use can::assembly::Assembler;
use rig::{Rig, Run};

use crate::Error;

/// Thermometers change slowly: a reading a second is kept.
const EVERY_NS: i64 = 1_000_000_000;

/// Temperatures of all gauges over one recording.
#[derive(Clone, Debug, Default)]
pub struct Temperatures {
    /// Instant (ns since the Unix epoch) and degC of each gauge.
    rows: Vec<(i64, Vec<Option<f64>>)>,
}

impl Temperatures {
    /// Reads a run's log once more; nothing where no gauge has a thermometer.
    pub fn read(run: &Run, rig: &Rig) -> Result<Self, Error> {
        let mut this = Self::default();
        if rig.config.sensors.iter().all(|sensor| sensor.temperature.is_none()) {
            return Ok(this);
        }
        let mut assembler = Assembler::new(&rig.layout)?;
        let mut next_ns = i64::MIN;
        for_each_frame(run, |frame, _| {
            for snapshot in assembler.push(frame) {
                if snapshot.instant_ns >= next_ns {
                    next_ns = snapshot.instant_ns + EVERY_NS;
                    let said = snapshot.temperatures.iter().map(|t| t.ok().map(|reading| reading.value));
                    this.rows.push((snapshot.instant_ns, said.collect()));
                }
            }
        })?;
        Ok(this)
    }

    /// What a gauge's thermometer last said at an instant, degC.
    pub fn at(&self, instant_ns: i64, gauge: usize) -> Option<f64> {
        let after = self.rows.partition_point(|(at, _)| *at <= instant_ns);
        self.rows.get(after.checked_sub(1)?)?.1.get(gauge).copied().flatten()
    }

    /// The mean of all thermometers at an instant, degC.
    pub fn mean(&self, instant_ns: i64) -> Option<f64> {
        let after = self.rows.partition_point(|(at, _)| *at <= instant_ns);
        let said: Vec<f64> = self.rows.get(after.checked_sub(1)?)?.1.iter().flatten().copied().collect();
        (!said.is_empty()).then(|| said.iter().sum::<f64>() / said.len() as f64)
    }
}
