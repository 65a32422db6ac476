//! Candidates as terms of a linear model, with the products that least squares needs, block by block.
//!
//! The data is read once per pair of terms: afterwards leaving units out, resampling blocks and trying combinations are
//! sums of small matrices. A unit's squared residual for parameters `x` is `y'y - 2 b'x + x'Gx`, with `G` and `b` of its
//! blocks. Everything is in units of the channels' scales.

use std::collections::HashMap;
use std::rc::Rc;

use crate::effects::{CATALOGUE, Column, Place, Role, Shape};
use crate::session::Session;

/// So many times its plausible range no parameter is.
const IMPLAUSIBLE: f64 = 4.0;
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
}

impl<'a> Library<'a> {
    /// A library without terms.
    pub(crate) fn new(session: &'a Session) -> Self {
        let mut squared = vec![0.0; session.blocks()];
        let mut counts = vec![0.0; session.blocks()];
        for channel in &session.channels {
            for (gap, block) in channel.gap.iter().zip(&session.hold_out.block_of_row) {
                squared[*block] += (gap / channel.scale).powi(2);
                counts[*block] += 1.0;
            }
        }
        Self {
            session,
            terms: Vec::new(),
            squared,
            counts,
            known: HashMap::new(),
            pairs: HashMap::new(),
            kept: HashMap::new(),
            kept_bytes: 0,
        }
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
            range: [if c.is_positive { 0.0 } else { -IMPLAUSIBLE * c.plausible }, IMPLAUSIBLE * c.plausible],
        };
        let own = products(self.session, &columns, &columns);
        let gap = with_gap(self.session, &columns);
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
                self.pairs.insert(key, Rc::new(products(self.session, &first, &second)));
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
        let factor = 1.0 / session.channels[*channel].scale;
        values.iter_mut().for_each(|value| *value *= factor);
    }
    columns
}

fn products(session: &Session, some: &[Column], others: &[Column]) -> Products {
    let (rows, columns, blocks) = (some.len(), others.len(), session.blocks());
    let mut values = vec![0.0; rows * columns * blocks];
    let block_of_row = &session.hold_out.block_of_row;
    for (r, a) in some.iter().enumerate() {
        for (c, b) in others.iter().enumerate() {
            for (channel, left) in &a.parts {
                for (_, right) in b.parts.iter().filter(|(other, _)| other == channel) {
                    for ((x, y), block) in left.iter().zip(right).zip(block_of_row) {
                        values[(block * rows + r) * columns + c] += x * y;
                    }
                }
            }
        }
    }
    Products { rows, columns, values }
}

fn with_gap(session: &Session, columns: &[Column]) -> Vec<f64> {
    let mut values = vec![0.0; columns.len() * session.blocks()];
    for (k, column) in columns.iter().enumerate() {
        for (channel, part) in &column.parts {
            let channel = &session.channels[*channel];
            for ((x, gap), block) in part.iter().zip(&channel.gap).zip(&session.hold_out.block_of_row) {
                values[block * columns.len() + k] += x * gap / channel.scale;
            }
        }
    }
    values
}
