//! A gauge that feels force along its sensing axis: a screw with a pitch, not a line.
//!
//! What four numbers of an axis and a scale leave of a compliance vector is `h = C_f . R3 / r`; a bridge whose gauges are not exactly
//! opposite has one (K. Hoffmann, An Introduction to Measurements using Strain Gages, 1989).

use model::sensing::Compliance;
use nalgebra::Vector6;

use super::axis::changed;
use super::*;

/// Sensitivity to force along the axis.
pub(super) struct AxialForce;

impl Effect for AxialForce {
    fn id(&self) -> &'static str {
        "axial_force"
    }

    fn words(&self) -> &'static str {
        "a sensor that feels force along its axis"
    }

    fn remedy(&self) -> &'static str {
        "calibrate the full compliance, with different masses or a push along the axis"
    }

    fn missing(&self, session: &Session) -> Option<String> {
        let known = session.channels.iter().any(|channel| channel.gauge.is_some());
        (!known).then(|| "the whole load of each sensor's section (a run with its model)".to_owned())
    }

    fn places(&self, session: &Session) -> Vec<Place> {
        every_channel(session)
    }

    fn is_exact(&self) -> bool {
        true
    }

    fn columns(&self, session: &Session, place: Place, _shape: &[f64]) -> Vec<Column> {
        let Place::Channel(channel) = place else { return Vec::new() };
        let Some(gauge) = &session.channels[channel].gauge else { return Vec::new() };
        let Some(change) = per_metre(&gauge.compliance) else { return Vec::new() };
        vec![Column::value("pitch_m", "m", 0.01, channel, changed(gauge, &change))]
    }

    fn compensate(&self, session: &Session, term: &Fitted<'_>) -> Vec<Compensation> {
        let Place::Channel(channel) = term.place else { return Vec::new() };
        let Some(gauge) = &session.channels[channel].gauge else { return Vec::new() };
        let change = per_metre(&gauge.compliance).zip(term.values.first());
        change
            .map(|(change, pitch_m)| Compensation::Compliance { gauge: channel, change: change * *pitch_m })
            .into_iter()
            .collect()
    }

    fn experiment(&self) -> &'static str {
        "different masses at one point: force along the axis must change by itself"
    }
}

/// Change of a compliance by a pitch, per m.
fn per_metre(compliance: &Vector6<f64>) -> Option<Vector6<f64>> {
    let frame = Compliance::from_vector(compliance).actual_frame()?;
    let along = frame.axes().row(2) * frame.r_counts_per_nm;
    Some(Vector6::new(along[0], along[1], along[2], 0.0, 0.0, 0.0))
}
