//! Candidates as terms of a linear model, with the products that least squares needs, block by block.
//!
//! The data is read once per pair of terms: afterwards leaving units out, resampling blocks and trying combinations are
//! sums of small matrices. A unit's squared residual for parameters `x` is `y'y - 2 b'x + x'Gx`, with `G` and `b` of its
//! blocks. Everything is in units of the channels' scales.

use std::collections::HashMap;
use std::ops::Range;
use std::rc::Rc;

use crate::effects::{CATALOGUE, Column, Place, Role, Shape};
use crate::session::Session;

/// So many times its plausible range no parameter is.
const IMPLAUSIBLE: f64 = 4.0;
/// In place of an effect's index: a direction in which the simulation is uncertain.
const DOUBT: usize = usize::MAX;
/// Columns that are kept rather than computed again, bytes.
const KEPT_BYTES: usize = 120 << 20;

/// One candidate: an effect at a place with a shape.
#[derive(Debug, Clone)]
pub(crate) struct Term {
    /// Index in the catalogue.
    pub(crate) effect: usize,
    pub(crate) place: Place,
    pub(crate) shape: Shape,
    /// Its columns without their values.
    pub(crate) columns: Vec<Heading>,
    /// Channels that it touches, ascending.
    pub(crate) channels: Vec<usize>,
    own: Rc<Products>,
    /// Per block and column the product with the gap.
    pub(crate) gap: Rc<Vec<f64>>,
}

/// A column without its values.
#[derive(Debug, Clone)]
pub(crate) struct Heading {
    pub(crate) parameter: String,
    pub(crate) unit: String,
    pub(crate) role: Role,
    pub(crate) plausible: f64,
    /// The only unit that it exists in, for an event.
    pub(crate) unit_only: Option<usize>,
    /// What the parameter may be.
    pub(crate) range: [f64; 2],
}

impl Term {
    /// Number of columns.
    pub(crate) fn width(&self) -> usize {
        self.columns.len()
    }

    /// Parameters that are searched or fitted.
    pub(crate) fn freedom(&self) -> usize {
        let fitted = self.columns.iter().filter(|column| column.role != Role::Pinned).count();
        fitted + self.shape.len()
    }

    /// Whether any of it exists in one unit only.
    pub(crate) fn is_event(&self) -> bool {
        self.columns.iter().any(|column| column.unit_only.is_some())
    }

    pub(crate) fn touches(&self, other: &Self) -> bool {
        self.channels.iter().any(|channel| other.channels.contains(channel))
    }
}

/// Products of the columns of two terms: per block a matrix, row by row.
#[derive(Debug)]
pub(crate) struct Products {
    rows: usize,
    columns: usize,
    values: Vec<f64>,
}

impl Products {
    pub(crate) fn at(&self, block: usize, row: usize, column: usize) -> f64 {
        self.values[(block * self.rows + row) * self.columns + column]
    }
}

/// Index of a term in its library.
pub(crate) type TermId = usize;

/// The terms of a session with their products.
pub(crate) struct Library<'a> {
    pub(crate) session: &'a Session,
    pub(crate) terms: Vec<Term>,
    /// Per block the squared gap.
    pub(crate) squared: Vec<f64>,
    /// Per block the number of values (instants times channels).
    pub(crate) counts: Vec<f64>,
    known: HashMap<(usize, Place, Vec<u64>), Option<TermId>>,
    pairs: HashMap<(TermId, TermId), Rc<Products>>,
    kept: HashMap<TermId, Rc<Vec<Column>>>,
    kept_bytes: usize,
    /// Terms of the simulation's own uncertainty, each of standard deviation one.
    pub(crate) doubts: Vec<TermId>,
    spans: Vec<Span>,
}

impl<'a> Library<'a> {
    /// A library without terms.
    pub(crate) fn new(session: &'a Session) -> Self {
        let mut squared = vec![0.0; session.blocks()];
        let mut counts = vec![0.0; session.blocks()];
        for channel in &session.channels {
            for (gap, block) in channel.gap.iter().zip(&session.hold_out.block_of_row) {
                squared[*block] += (gap / channel.scale).powi(2);
            }
            for (row, block) in session.hold_out.block_of_row.iter().enumerate() {
                counts[*block] += f64::from(u8::from(channel.is_read(row)));
            }
        }
        let mut library = Self {
            session,
            terms: Vec::new(),
            squared,
            counts,
            known: HashMap::new(),
            pairs: HashMap::new(),
            kept: HashMap::new(),
            kept_bytes: 0,
            doubts: Vec::new(),
            spans: spans(&session.hold_out.block_of_row),
        };
        for index in 0..session.doubts.len() {
            let columns = library.doubt(index);
            let id = library.add(DOUBT, Place::Base, &[index as f64], columns);
            library.doubts.extend(id);
        }
        library
    }

    /// A direction in which the simulation is uncertain, as a column.
    fn doubt(&self, index: usize) -> Vec<Column> {
        let parts = self.session.doubts[index].parts.clone();
        scaled(self.session, vec![Column::of_parts("", "1", 1.0, parts)])
    }

    /// The term of an effect; nothing where it does not show in this data.
    pub(crate) fn term(&mut self, effect: usize, place: Place, shape: &[f64]) -> Option<TermId> {
        let key = (effect, place, shape.iter().map(|v| v.to_bits()).collect());
        if let Some(known) = self.known.get(&key) {
            return *known;
        }
        let id = self.make(effect, place, shape);
        self.known.insert(key, id);
        id
    }

    fn make(&mut self, effect: usize, place: Place, shape: &[f64]) -> Option<TermId> {
        let columns = scaled(self.session, CATALOGUE[effect].columns(self.session, place, shape));
        self.add(effect, place, shape, columns)
    }

    fn add(&mut self, effect: usize, place: Place, shape: &[f64], columns: Vec<Column>) -> Option<TermId> {
        let informative = |column: &Column| {
            let size = |values: &[f64]| values.iter().map(|v| v * v).sum::<f64>();
            column.parts.iter().map(|(_, v)| size(v)).sum::<f64>() > 1e-18 * self.session.rows() as f64
        };
        let finite = |column: &Column| column.parts.iter().all(|(_, v)| v.iter().all(|x| x.is_finite()));
        if columns.is_empty() || !columns.iter().all(|c| informative(c) && finite(c)) {
            return None;
        }
        let mut channels: Vec<usize> = columns.iter().flat_map(|c| c.parts.iter().map(|(k, _)| *k)).collect();
        channels.sort_unstable();
        channels.dedup();
        let heading = |c: &Column| Heading {
            parameter: c.parameter.clone(),
            unit: c.unit.clone(),
            role: c.role,
            plausible: c.plausible,
            unit_only: c.unit_only,
            range: [if c.is_positive { 0.0 } else { -IMPLAUSIBLE * c.plausible }, IMPLAUSIBLE * c.plausible],
        };
        let own = products(self.session, &self.spans, &columns, &columns);
        let gap = with_gap(self.session, &self.spans, &columns);
        let id = self.terms.len();
        self.terms.push(Term {
            effect,
            place,
            shape: shape.to_vec(),
            columns: columns.iter().map(heading).collect(),
            channels,
            own: Rc::new(own),
            gap: Rc::new(gap),
        });
        self.keep(id, columns);
        Some(id)
    }

    fn keep(&mut self, id: TermId, columns: Vec<Column>) -> Rc<Vec<Column>> {
        let bytes: usize = columns.iter().flat_map(|c| c.parts.iter().map(|(_, v)| v.len() * 8)).sum();
        // What touches several channels comes from the arm's dynamics and costs most to compute again.
        let is_dear = columns.iter().any(|column| column.parts.len() > 1);
        let columns = Rc::new(columns);
        if self.kept_bytes + bytes <= if is_dear { KEPT_BYTES } else { KEPT_BYTES / 3 } {
            self.kept_bytes += bytes;
            self.kept.insert(id, columns.clone());
        }
        columns
    }

    /// A term's columns over their channels' scales.
    pub(crate) fn columns(&self, id: TermId) -> Rc<Vec<Column>> {
        if let Some(columns) = self.kept.get(&id) {
            return columns.clone();
        }
        let term = &self.terms[id];
        if term.effect == DOUBT {
            return Rc::new(self.doubt(term.shape[0] as usize));
        }
        Rc::new(scaled(self.session, CATALOGUE[term.effect].columns(self.session, term.place, &term.shape)))
    }

    /// Makes sure that the products of these pairs are known; pairs without a common channel have none.
    pub(crate) fn prepare(&mut self, some: &[TermId], others: &[TermId]) {
        for &a in some {
            let mut columns = None;
            for &b in others {
                let key = (a.min(b), a.max(b));
                if a == b || self.pairs.contains_key(&key) || !self.terms[a].touches(&self.terms[b]) {
                    continue;
                }
                let columns = columns.get_or_insert_with(|| self.columns(a)).clone();
                let other = self.columns(b);
                let (first, second) = if a < b { (columns, other) } else { (other, columns) };
                self.pairs.insert(key, Rc::new(products(self.session, &self.spans, &first, &second)));
            }
        }
    }

    /// Product of two columns of terms in a block; the pair must be prepared.
    pub(crate) fn pair(&self, a: TermId, b: TermId) -> Option<(Rc<Products>, bool)> {
        if a == b {
            return Some((self.terms[a].own.clone(), false));
        }
        self.pairs.get(&(a.min(b), a.max(b))).map(|products| (products.clone(), a > b))
    }
}

fn scaled(session: &Session, mut columns: Vec<Column>) -> Vec<Column> {
    for (channel, values) in columns.iter_mut().flat_map(|column| &mut column.parts) {
        let channel = &session.channels[*channel];
        let factor = 1.0 / channel.scale;
        values.iter_mut().for_each(|value| *value *= factor);
        for (value, read) in values.iter_mut().zip(&channel.read) {
            *value *= f64::from(u8::from(*read));
        }
    }
    columns
}

/// Rows one after the other in one block.
struct Span {
    block: usize,
    rows: Range<usize>,
}

fn spans(block_of_row: &[usize]) -> Vec<Span> {
    let mut spans: Vec<Span> = Vec::new();
    for (row, &block) in block_of_row.iter().enumerate() {
        match spans.last_mut() {
            Some(last) if last.block == block => last.rows.end = row + 1,
            _ => spans.push(Span { block, rows: row..row + 1 }),
        }
    }
    spans
}

/// Scalar product in eight independent sums, which a processor adds side by side.
fn dot(a: &[f64], b: &[f64]) -> f64 {
    const LANES: usize = 8;
    let mut sums = [0.0; LANES];
    let (a_chunks, b_chunks) = (a.chunks_exact(LANES), b.chunks_exact(LANES));
    let rest: f64 = a_chunks.remainder().iter().zip(b_chunks.remainder()).map(|(x, y)| x * y).sum();
    for (x, y) in a_chunks.zip(b_chunks) {
        for lane in 0..LANES {
            sums[lane] += x[lane] * y[lane];
        }
    }
    rest + sums.iter().sum::<f64>()
}

fn products(session: &Session, spans: &[Span], some: &[Column], others: &[Column]) -> Products {
    let (rows, columns, blocks) = (some.len(), others.len(), session.blocks());
    let mut values = vec![0.0; rows * columns * blocks];
    for (r, a) in some.iter().enumerate() {
        for (c, b) in others.iter().enumerate() {
            for (channel, left) in &a.parts {
                for (_, right) in b.parts.iter().filter(|(other, _)| other == channel) {
                    for Span { block, rows: span } in spans {
                        let sum = dot(&left[span.clone()], &right[span.clone()]);
                        values[(block * rows + r) * columns + c] += sum;
                    }
                }
            }
        }
    }
    Products { rows, columns, values }
}

fn with_gap(session: &Session, spans: &[Span], columns: &[Column]) -> Vec<f64> {
    let mut values = vec![0.0; columns.len() * session.blocks()];
    for (k, column) in columns.iter().enumerate() {
        for (channel, part) in &column.parts {
            let channel = &session.channels[*channel];
            for Span { block, rows } in spans {
                let sum = dot(&part[rows.clone()], &channel.gap[rows.clone()]);
                values[block * columns.len() + k] += sum / channel.scale;
            }
        }
    }
    values
}
