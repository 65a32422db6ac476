//! Sensitivity to loads that the channel should not see: the sensing axis is not where it was meant to be.
//!
//! The compliance vector of a section is `r [l x R, R]` (Y.-L. Kim, J.-J. Park, J.-B. Song, J. Mech. Sci. Technol. 24(8), 2010); a
//! small turn or shift adds multiples of the other load components. Of a gauge whose section's load is known, the columns are
//! the derivatives of that vector by the axis' four numbers, with the scale alongside (an axis that turns loses some of it); an
//! axis that is far off takes the whole vector. With nothing but load columns given each is a column here.

use model::sensing::{ActualFrame, Compliance};
use nalgebra::Vector6;

use super::*;
use crate::session::Gauge;

/// Crosstalk of loads.
pub(super) struct SensingAxis;

/// The axis moved a little: turns, shifts, and the scale.
const MOVED: f64 = 0.0;
/// Any compliance.
const WHOLE: f64 = 1.0;
/// How far an axis may be off: rad, rad, m, m.
const PLAUSIBLE: [f64; 4] = [0.2, 0.2, 0.02, 0.02];

impl Effect for SensingAxis {
    fn id(&self) -> &'static str {
        "sensing_axis"
    }

    fn words(&self) -> &'static str {
        "crosstalk of other load components (a sensing axis off its place)"
    }

    fn remedy(&self) -> &'static str {
        "calibrate the full compliance of the sensor"
    }

    fn missing(&self, session: &Session) -> Option<String> {
        if session.loads.len() < 2 && session.channels.iter().all(|channel| channel.gauge.is_none()) {
            return Some("the other components of the load ([covariates] load = [columns])".to_owned());
        }
        None
    }

    fn places(&self, session: &Session) -> Vec<Place> {
        every_channel(session)
    }

    fn shapes(&self, session: &Session, place: Place) -> Vec<Shape> {
        let Place::Channel(channel) = place else { return Vec::new() };
        let gauge = session.channels[channel].gauge.as_ref();
        if gauge.is_none() { vec![Shape::new()] } else { vec![vec![MOVED], vec![WHOLE]] }
    }

    fn columns(&self, session: &Session, place: Place, shape: &[f64]) -> Vec<Column> {
        let Place::Channel(channel) = place else { return Vec::new() };
        match &session.channels[channel].gauge {
            Some(gauge) if shape[0] == MOVED => moved(gauge, channel),
            Some(gauge) => whole(gauge, channel),
            None => of_loads(session, channel),
        }
    }

    fn report(&self, session: &Session, term: &Fitted<'_>) -> Option<Vec<Reported>> {
        let Place::Channel(channel) = term.place else { return None };
        let gauge = session.channels[channel].gauge.as_ref()?;
        let change = if term.shape[0] == MOVED { tangent(&gauge.compliance)? } else { components() };
        let mut compliance = gauge.compliance;
        change.iter().zip(term.values).for_each(|(direction, value)| compliance += direction * *value);
        let before = Compliance::from_vector(&gauge.compliance).actual_frame()?;
        let after = Compliance::from_vector(&compliance).actual_frame()?;
        let whole = term.shape[0] == WHOLE;
        Some(reported(&before, &after, (!whole).then_some(term.sigmas)))
    }

    fn compensate(&self, session: &Session, term: &Fitted<'_>) -> Vec<Compensation> {
        let Place::Channel(channel) = term.place else { return Vec::new() };
        let Some(gauge) = &session.channels[channel].gauge else { return Vec::new() };
        let directions = if term.shape[0] == MOVED {
            tangent(&gauge.compliance).unwrap_or_default()
        } else {
            components()
        };
        let mut change = Vector6::zeros();
        directions.iter().zip(term.values).for_each(|(direction, value)| change += direction * *value);
        vec![Compensation::Compliance { gauge: channel, change }]
    }

    fn experiment(&self) -> &'static str {
        "loads in other directions at other points"
    }
}

fn reported(before: &ActualFrame, after: &ActualFrame, sigmas: Option<&[f64]>) -> Vec<Reported> {
    let turned = |a: f64, b: f64| {
        (b - a + std::f64::consts::PI).rem_euclid(std::f64::consts::TAU) - std::f64::consts::PI
    };
    let values = [
        ("d_ax", turned(before.a_x_rad, after.a_x_rad), "rad"),
        ("d_ay", turned(before.a_y_rad, after.a_y_rad), "rad"),
        ("d_lx", after.l_x_m - before.l_x_m, "m"),
        ("d_ly", after.l_y_m - before.l_y_m, "m"),
    ];
    let of = |(k, (name, value, unit)): (usize, (&str, f64, &str))| {
        (name.to_owned(), value, sigmas.map(|sigmas| sigmas[k]), unit.to_owned())
    };
    values.into_iter().enumerate().map(of).collect()
}

/// Change of the compliance by a_x, a_y (rad), l_x, l_y (m), and by the scale (per unit).
fn tangent(compliance: &Vector6<f64>) -> Option<Vec<Vector6<f64>>> {
    let frame = Compliance::from_vector(compliance).actual_frame()?;
    let of = |change: &dyn Fn(&mut ActualFrame, f64)| {
        let step = 1e-6;
        let at = |sign: f64| {
            let mut moved = frame;
            change(&mut moved, sign * step);
            moved.compliance().vector()
        };
        (at(1.0) - at(-1.0)) / (2.0 * step)
    };
    Some(vec![
        of(&|frame, step| frame.a_x_rad += step),
        of(&|frame, step| frame.a_y_rad += step),
        of(&|frame, step| frame.l_x_m += step),
        of(&|frame, step| frame.l_y_m += step),
        *compliance,
    ])
}

fn components() -> Vec<Vector6<f64>> {
    (0..6).map(|k| Vector6::ith(k, 1.0)).collect()
}

/// Counts that a change of the compliance makes of the section's load, per row.
pub(super) fn changed(gauge: &Gauge, change: &Vector6<f64>) -> Vec<f64> {
    gauge.loads.iter().map(|load| change.dot(load)).collect()
}

fn moved(gauge: &Gauge, channel: usize) -> Vec<Column> {
    let Some(tangent) = tangent(&gauge.compliance) else { return Vec::new() };
    let names = ["d_ax", "d_ay", "d_lx", "d_ly"];
    let units = ["rad", "rad", "m", "m"];
    let columns = tangent.iter().enumerate().map(|(k, change)| {
        let values = changed(gauge, change);
        match names.get(k) {
            Some(name) => Column::value(name, units[k], PLAUSIBLE[k], channel, values),
            None => Column::value("", "1", 0.05, channel, values).role(Role::Nuisance),
        }
    });
    columns.filter(is_loaded).collect()
}

fn whole(gauge: &Gauge, channel: usize) -> Vec<Column> {
    let scale = gauge.compliance.fixed_rows::<3>(3).norm();
    let length_m = model::sensing::CHARACTERISTIC_LENGTH_M;
    let columns = components().into_iter().enumerate().map(|(k, change)| {
        // A gauge whose axis points anywhere, up to two characteristic lengths away.
        let plausible = if k < 3 { 2.0 * scale * length_m } else { 2.0 * scale };
        Column::value("", "counts/N or counts/Nm", plausible, channel, changed(gauge, &change))
    });
    columns.filter(is_loaded).collect()
}

fn is_loaded(column: &Column) -> bool {
    column.parts.iter().any(|(_, values)| values.iter().any(|value| *value != 0.0))
}

/// One column a load that is given.
fn of_loads(session: &Session, channel: usize) -> Vec<Column> {
    let own = &session.channels[channel];
    let span = deviation(&own.simulated).max(own.rms_gap());
    let mut columns = Vec::new();
    for load in session.loads.iter().filter(|load| deviation(&load.values) > 0.0) {
        let plausible = span / deviation(&load.values);
        let column = Column::value(&format!("c_{}", load.name), "1", plausible, channel, load.values.clone());
        // An axis that turns loses some of its own load, and what hangs on a lever loads several components at once.
        let is_own = is_same(&load.values, &own.simulated);
        columns.push(if is_own { column.role(Role::Nuisance) } else { column });
    }
    columns
}

/// Whether one column repeats the other but for rounding.
fn is_same(a: &[f64], b: &[f64]) -> bool {
    let tolerance = 1e-9 * a.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
    a.iter().zip(b).all(|(a, b)| (a - b).abs() <= tolerance)
}
