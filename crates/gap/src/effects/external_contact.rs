//! Somebody or something touches a link for a while: a force and a moment on that link, `J_k' F`.
//!
//! A. De Luca, A. Albu-Schäffer, S. Haddadin, G. Hirzinger, IROS 2006: the innermost link whose outboard sensors stay silent is the one
//! that is touched. The stretch is where the gap of all sensors together is largest (J. Bentley's maximum subarray, Comm. ACM 27, 1984);
//! the force keeps its direction in the base or in the link.

use super::*;

/// Contact with a link.
pub(super) struct ExternalContact;

/// Gaps are looked at in steps of this time, s.
const BIN_S: f64 = 0.02;
/// A contact is shorter than this share of the recordings: otherwise it is no event.
const LONGEST_SHARE: f64 = 0.6;

impl Effect for ExternalContact {
    fn id(&self) -> &'static str {
        "external_contact"
    }

    fn words(&self) -> &'static str {
        "something that touched the arm for a while"
    }

    fn remedy(&self) -> &'static str {
        "leave the stretch out ([[exclude]]), or clear the workspace"
    }

    fn missing(&self, session: &Session) -> Option<String> {
        let known = session.channels.iter().any(|channel| channel.gauge.is_some());
        (!known).then(|| "the whole load of each sensor's section (a run with its model)".to_owned())
    }

    fn places(&self, session: &Session) -> Vec<Place> {
        if session.channels.iter().all(|channel| channel.gauge.is_none()) {
            return Vec::new();
        }
        arm::links(session)
    }

    fn shape_parameters(&self) -> &'static [(&'static str, &'static str)] {
        &[("from_s", "s"), ("to_s", "s")]
    }

    fn shapes(&self, session: &Session, place: Place) -> Vec<Shape> {
        let Place::Link(link) = place else { return Vec::new() };
        let Some([from_s, to_s]) = stretch(session, &arm::felt_by(session, link)) else { return Vec::new() };
        [arm::IN_BASE, arm::IN_LINK].map(|frame| vec![from_s, to_s, frame]).to_vec()
    }

    fn columns(&self, session: &Session, place: Place, shape: &[f64]) -> Vec<Column> {
        let (Place::Link(link), Some(time_s)) = (place, &session.time_s) else { return Vec::new() };
        let rows: Vec<usize> =
            (0..session.rows()).filter(|row| (shape[0]..shape[1]).contains(&time_s[*row])).collect();
        let unit = |row: usize| session.hold_out.unit_of_block[session.hold_out.block_of_row[row]];
        let mut units: Vec<usize> = rows.iter().map(|row| unit(*row)).collect();
        units.sort_unstable();
        units.dedup();
        let mut columns = Vec::new();
        for own in units {
            let here: Vec<usize> = rows.iter().copied().filter(|row| unit(*row) == own).collect();
            let felt = arm::force_columns(session, link, &here, shape[2]);
            columns.extend(felt.into_iter().map(|column| Column { unit_only: Some(own), ..column }));
        }
        columns
    }

    fn report(&self, _session: &Session, term: &Fitted<'_>) -> Option<Vec<Reported>> {
        let forces = || term.values.chunks(6).map(|six| six[..3].iter().map(|f| f * f).sum::<f64>());
        let count = forces().count().max(1) as f64;
        let force_n = (forces().sum::<f64>() / count).sqrt();
        let sigma_n = term.sigmas.chunks(6).flat_map(|six| &six[..3]).map(|s| s * s).sum::<f64>();
        Some(vec![("force_n".to_owned(), force_n, Some((sigma_n / count).sqrt()), "N".to_owned())])
    }

    fn experiment(&self) -> &'static str {
        "the same motion again with nobody near"
    }
}

/// The stretch (s) in which these channels' gap is largest against the rest.
fn stretch(session: &Session, channels: &[usize]) -> Option<[f64; 2]> {
    let time_s = session.time_s.as_ref()?;
    // Runs of other sessions may overlap in time.
    let first = time_s.iter().copied().min_by(f64::total_cmp)?;
    let last = time_s.iter().copied().max_by(f64::total_cmp)?;
    let bins = ((last - first) / BIN_S) as usize + 1;
    let (mut squares, mut counts) = (vec![0.0; bins], vec![0.0; bins]);
    for &channel in channels {
        let own = &session.channels[channel];
        for (row, gap) in own.gap.iter().enumerate() {
            let bin = ((time_s[row] - first) / BIN_S) as usize;
            squares[bin] += (gap / own.scale).powi(2);
            counts[bin] += f64::from(u8::from(own.is_read(row)));
        }
    }
    let used = || (0..bins).filter(|bin| counts[*bin] > 0.0);
    let mean = used().map(|bin| squares[bin]).sum::<f64>() / used().map(|bin| counts[bin]).sum::<f64>();
    let (mut best, mut from, mut sum) = ((0.0, 0, 0), 0, 0.0);
    for bin in 0..bins {
        sum += squares[bin] - mean * counts[bin];
        if sum <= 0.0 {
            (sum, from) = (0.0, bin + 1);
        } else if sum > best.0 {
            best = (sum, from, bin + 1);
        }
    }
    let short = (best.2 - best.1) as f64 <= LONGEST_SHARE * bins as f64;
    (best.0 > 0.0 && short).then(|| [best.1, best.2].map(|bin| first + bin as f64 * BIN_S))
}
