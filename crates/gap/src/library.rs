//! Candidates as terms of a linear model, with the products that least squares needs, block by block.
//!
//! The data is read once per pair of terms: afterwards leaving units out, resampling blocks and trying combinations are
//! sums of small matrices. A unit's squared residual for parameters `x` is `y'y - 2 b'x + x'Gx`, with `G` and `b` of its
//! blocks. Everything is in units of the channels' scales.

mod products;

use std::collections::HashMap;
use std::sync::Arc;

use crate::effects::{CATALOGUE, Column, Place, Role, Shape};
use crate::parallel;
use crate::session::Session;
pub(crate) use products::{Products, Values};
use products::{Span, products, spans, trimmed, with_gap};

/// So many times its plausible range no parameter is: what is ten times as large as practice knows is another cause. Where noise is not
/// known what is left are errors of all forms together, which an absurd parameter would take up.
const IMPLAUSIBLE: f64 = 10.0;
const IMPLAUSIBLE_BESIDE_ERRORS: f64 = 4.0;
/// In place of an effect's index: a direction in which the simulation is uncertain.
const DOUBT: usize = usize::MAX;
/// Columns that are kept rather than computed again, bytes.
const KEPT_BYTES: usize = 16 << 20;

/// Products of pairs that are kept when the next part of the data is looked at, bytes.
const PAIRS_BYTES: usize = 48 << 20;

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
    own: Arc<Products>,
    /// Per block and column the product with the gap.
    pub(crate) gap: Arc<Vec<f64>>,
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
        fitted + CATALOGUE.get(self.effect).map_or(self.shape.len(), |effect| effect.searched(&self.shape))
    }

    /// The same without what only comes along (a line beside a bend).
    pub(crate) fn own_freedom(&self) -> usize {
        self.freedom() - self.columns.iter().filter(|column| column.role == Role::Nuisance).count()
    }

    /// Whether any of it exists in one unit only.
    pub(crate) fn is_event(&self) -> bool {
        self.columns.iter().any(|column| column.unit_only.is_some())
    }

    pub(crate) fn touches(&self, other: &Self) -> bool {
        self.channels.iter().any(|channel| other.channels.contains(channel))
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
    pairs: HashMap<(TermId, TermId), Arc<Products>>,
    kept: HashMap<TermId, Arc<Vec<Values>>>,
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
            let shape = [index as f64];
            let made = Made::of_columns(session, &library.spans, DOUBT, Place::Base, &shape, columns);
            let id = made.map(|made| library.add(made));
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
        let made = Made::new(self.session, &self.spans, effect, place, shape)?;
        Some(self.add(made))
    }

    /// The terms of an effect at a place, one a shape that shows in this data.
    pub(crate) fn terms_of(&mut self, effect: usize, place: Place, shapes: &[Shape]) -> Vec<TermId> {
        let mut ids = Vec::with_capacity(shapes.len());
        for some in shapes.chunks(TOGETHER) {
            let (session, spans) = (self.session, &self.spans);
            let made = parallel::map(some, |shape| Made::new(session, spans, effect, place, shape));
            for (shape, made) in some.iter().zip(made) {
                let key = (effect, place, shape.iter().map(|v| v.to_bits()).collect());
                let known = self.known.get(&key).copied();
                let id = known.unwrap_or_else(|| made.map(|made| self.add(made)));
                self.known.insert(key, id);
                ids.extend(id);
            }
        }
        ids
    }

    fn add(&mut self, made: Made) -> TermId {
        let id = self.terms.len();
        self.terms.push(made.term);
        self.keep(id, made.columns);
        id
    }
}

/// Terms that are made at a time: their columns are all in memory.
const TOGETHER: usize = 12;

/// A term with its columns.
struct Made {
    term: Term,
    columns: Vec<Values>,
}

impl Made {
    fn new(session: &Session, spans: &[Span], effect: usize, place: Place, shape: &[f64]) -> Option<Self> {
        let columns = scaled(session, CATALOGUE[effect].columns(session, place, shape));
        Self::of_columns(session, spans, effect, place, shape, columns)
    }

    /// Nothing where a column does not show, or has no values.
    fn of_columns(
        session: &Session,
        spans: &[Span],
        effect: usize,
        place: Place,
        shape: &[f64],
        columns: Vec<Column>,
    ) -> Option<Self> {
        let informative = |column: &Column| {
            let size = |values: &[f64]| values.iter().map(|v| v * v).sum::<f64>();
            column.parts.iter().map(|(_, v)| size(v)).sum::<f64>() > 1e-18 * session.rows() as f64
        };
        let finite = |column: &Column| column.parts.iter().all(|(_, v)| v.iter().all(|x| x.is_finite()));
        if columns.is_empty() || !columns.iter().all(|c| informative(c) && finite(c)) {
            return None;
        }
        let mut channels: Vec<usize> = columns.iter().flat_map(|c| c.parts.iter().map(|(k, _)| *k)).collect();
        channels.sort_unstable();
        channels.dedup();
        let is_noise_known = !session.hold_out.is_even.is_empty();
        let most = if is_noise_known { IMPLAUSIBLE } else { IMPLAUSIBLE_BESIDE_ERRORS };
        let heading = |c: &Column| Heading {
            parameter: c.parameter.clone(),
            unit: c.unit.clone(),
            role: c.role,
            plausible: c.plausible,
            unit_only: c.unit_only.or_else(|| lone_unit(session, c)),
            range: [if c.is_positive { 0.0 } else { -most * c.plausible }, most * c.plausible],
        };
        let headings = columns.iter().map(heading).collect();
        let columns = trimmed(columns);
        let term = Term {
            effect,
            place,
            shape: shape.to_vec(),
            columns: headings,
            channels,
            own: Arc::new(products(session, spans, &columns, &columns)),
            gap: Arc::new(with_gap(session, spans, &columns)),
        };
        Some(Self { term, columns })
    }
}

/// Share of a column's square beyond which the other units say nothing of its parameter, however well they repeat each other.
const LONE: f64 = 0.97;

/// The unit in which a fitted column shows nearly alone: a joint that bears a load in one recording only. Where that is left out, nothing
/// else tells its parameter, and it is taken from even seconds as an event's is.
fn lone_unit(session: &Session, column: &Column) -> Option<usize> {
    let hold_out = &session.hold_out;
    if hold_out.is_even.is_empty() || column.role == Role::Nuisance || column.role == Role::Pinned {
        return None;
    }
    let mut squares = vec![0.0; hold_out.units.len()];
    for (channel, values) in &column.parts {
        let scale = session.channels[*channel].scale;
        for (value, block) in values.iter().zip(&hold_out.block_of_row) {
            squares[hold_out.unit_of_block[*block]] += (value / scale).powi(2);
        }
    }
    let all: f64 = squares.iter().sum();
    squares.iter().position(|own| *own > LONE * all)
}

impl Library<'_> {
    fn keep(&mut self, id: TermId, columns: Vec<Values>) {
        let bytes: usize =
            columns.iter().flat_map(|c| c.parts.iter().map(|part| part.values.len() * 8)).sum();
        // What touches several channels comes from the arm's dynamics and costs most to compute again.
        let is_dear = columns.iter().any(|column| column.parts.len() > 1);
        if self.kept_bytes + bytes <= if is_dear { KEPT_BYTES } else { KEPT_BYTES / 3 } {
            self.kept_bytes += bytes;
            self.kept.insert(id, Arc::new(columns));
        }
    }

    /// A term's columns over their channels' scales.
    pub(crate) fn columns(&self, id: TermId) -> Arc<Vec<Values>> {
        if let Some(columns) = self.kept.get(&id) {
            return columns.clone();
        }
        let term = &self.terms[id];
        if term.effect == DOUBT {
            return Arc::new(trimmed(self.doubt(term.shape[0] as usize)));
        }
        let columns = CATALOGUE[term.effect].columns(self.session, term.place, &term.shape);
        Arc::new(trimmed(scaled(self.session, columns)))
    }

    /// Makes sure that the products of these pairs are known; pairs without a common channel have none.
    pub(crate) fn prepare(&mut self, some: &[TermId], others: &[TermId]) {
        let is_missing = |a: TermId, b: TermId| {
            a != b && !self.pairs.contains_key(&(a.min(b), a.max(b))) && self.terms[a].touches(&self.terms[b])
        };
        let of = |a: &TermId| (*a, others.iter().copied().filter(|b| is_missing(*a, *b)).collect());
        let missing: Vec<(TermId, Vec<TermId>)> =
            some.iter().map(of).filter(|(_, with): &(TermId, Vec<TermId>)| !with.is_empty()).collect();
        let mut used: Vec<TermId> = missing.iter().flat_map(|(_, with)| with.iter().copied()).collect();
        used.sort_unstable();
        used.dedup();
        let columns: HashMap<TermId, Arc<Vec<Values>>> =
            used.iter().copied().zip(parallel::map(&used, |b| self.columns(*b))).collect();
        let found = parallel::map(&missing, |(a, with)| {
            let own = self.columns(*a);
            let pair = |b: &TermId| {
                let other = &columns[b];
                let (first, second) = if a < b { (&own, other) } else { (other, &own) };
                ((*a.min(b), *a.max(b)), Arc::new(products(self.session, &self.spans, first, second)))
            };
            with.iter().map(pair).collect::<Vec<_>>()
        });
        self.pairs.extend(found.into_iter().flatten());
    }

    /// Lets go of the products of pairs that are not both among these, if products take much memory: they are made again where they are asked for.
    pub(crate) fn make_room(&mut self, terms: &[TermId]) {
        if self.pairs.values().map(|products| products.bytes()).sum::<usize>() > PAIRS_BYTES {
            self.pairs.retain(|(a, b), _| terms.contains(a) && terms.contains(b));
        }
    }

    /// Whether a term shows on any of these blocks: a limit that is not reached there does not.
    pub(crate) fn shows(&self, id: TermId, blocks: &[usize]) -> bool {
        let own = &self.terms[id].own;
        let width = self.terms[id].width();
        blocks.iter().any(|block| (0..width).any(|k| own.at(*block, k, k) > 0.0))
    }

    /// Product of two columns of terms in a block; the pair must be prepared.
    pub(crate) fn pair(&self, a: TermId, b: TermId) -> Option<(Arc<Products>, bool)> {
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
