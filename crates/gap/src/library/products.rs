//! Columns as far as they show, and their products block by block

use std::ops::Range;

use crate::effects::Column;
use crate::session::Session;

/// Products of the columns of two terms: per block a matrix, row by row, from the first block in which any is not 0 to the last.
#[derive(Debug)]
pub(crate) struct Products {
    rows: usize,
    columns: usize,
    first: usize,
    values: Vec<f64>,
}

impl Products {
    fn new(rows: usize, columns: usize, values: &[f64]) -> Self {
        let size = (rows * columns).max(1);
        let is_shown = |block: &[f64]| block.iter().any(|value| *value != 0.0);
        let first = values.chunks(size).position(is_shown).unwrap_or(0);
        let end = values.chunks(size).rposition(is_shown).map_or(first, |last| last + 1);
        Self { rows, columns, first, values: values[first * size..end * size].to_vec() }
    }

    /// What it takes of the memory, bytes.
    pub(super) fn bytes(&self) -> usize {
        size_of_val(self.values.as_slice())
    }

    pub(crate) fn at(&self, block: usize, row: usize, column: usize) -> f64 {
        let Some(block) = block.checked_sub(self.first) else { return 0.0 };
        self.values.get((block * self.rows + row) * self.columns + column).copied().unwrap_or(0.0)
    }
}

/// A column's values over its channels' scales.
#[derive(Debug)]
pub(crate) struct Values {
    pub(crate) parts: Vec<Part>,
}

/// What a column adds to one channel, from the first row at which it shows to the last: an event shows in few.
#[derive(Debug)]
pub(crate) struct Part {
    pub(crate) channel: usize,
    pub(crate) first: usize,
    pub(crate) values: Vec<f64>,
}

impl Part {
    fn rows(&self) -> Range<usize> {
        self.first..self.first + self.values.len()
    }

    /// Its values at rows within its own.
    fn at(&self, rows: &Range<usize>) -> &[f64] {
        &self.values[rows.start - self.first..rows.end - self.first]
    }
}

/// The columns without the rows before they first and after they last show.
pub(super) fn trimmed(columns: Vec<Column>) -> Vec<Values> {
    let part = |(channel, mut values): (usize, Vec<f64>)| {
        let shows = |value: &f64| *value != 0.0;
        let first = values.iter().position(shows).unwrap_or(values.len());
        let end = values.iter().rposition(shows).map_or(first, |last| last + 1);
        if end - first < values.len() {
            values = values[first..end].to_vec();
        }
        Part { channel, first, values }
    };
    columns.into_iter().map(|column| Values { parts: column.parts.into_iter().map(part).collect() }).collect()
}

/// Rows one after the other in one block.
pub(super) struct Span {
    block: usize,
    rows: Range<usize>,
}

pub(super) fn spans(block_of_row: &[usize]) -> Vec<Span> {
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

/// The rows of every block that lie in `rows`, with the block.
fn within<'a>(spans: &'a [Span], rows: &'a Range<usize>) -> impl Iterator<Item = (usize, Range<usize>)> + 'a {
    let first = spans.partition_point(|span| span.rows.end <= rows.start);
    let here = spans[first..].iter().take_while(|span| span.rows.start < rows.end);
    let cut = |span: &Span| (span.block, span.rows.start.max(rows.start)..span.rows.end.min(rows.end));
    here.map(cut).filter(|(_, rows)| !rows.is_empty())
}

pub(super) fn products(session: &Session, spans: &[Span], some: &[Values], others: &[Values]) -> Products {
    let (rows, columns, blocks) = (some.len(), others.len(), session.blocks());
    let mut values = vec![0.0; rows * columns * blocks];
    for (r, a) in some.iter().enumerate() {
        for (c, b) in others.iter().enumerate() {
            for left in &a.parts {
                for right in b.parts.iter().filter(|other| other.channel == left.channel) {
                    let (own, other) = (left.rows(), right.rows());
                    let both = own.start.max(other.start)..own.end.min(other.end);
                    for (block, span) in within(spans, &both) {
                        values[(block * rows + r) * columns + c] += dot(left.at(&span), right.at(&span));
                    }
                }
            }
        }
    }
    Products::new(rows, columns, &values)
}

pub(super) fn with_gap(session: &Session, spans: &[Span], columns: &[Values]) -> Vec<f64> {
    let mut values = vec![0.0; columns.len() * session.blocks()];
    for (k, column) in columns.iter().enumerate() {
        for part in &column.parts {
            let channel = &session.channels[part.channel];
            for (block, rows) in within(spans, &part.rows()) {
                let sum = dot(part.at(&rows), &channel.gap[rows.clone()]);
                values[block * columns.len() + k] += sum / channel.scale;
            }
        }
    }
    values
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_zero_outside_an_event_is_not_kept() {
        let column = Column::of_parts("", "", 1.0, vec![(3, vec![0.0, 0.0, 2.0, 0.0, 5.0, 0.0])]);
        let kept = trimmed(vec![column]);
        let part = &kept[0].parts[0];
        assert_eq!((part.channel, part.first, part.values.as_slice()), (3, 2, [2.0, 0.0, 5.0].as_slice()));
        let nothing = trimmed(vec![Column::of_parts("", "", 1.0, vec![(0, vec![0.0; 4])])]);
        assert!(nothing[0].parts[0].rows().is_empty());
    }

    #[test]
    fn products_are_kept_of_the_blocks_that_show() {
        let products = Products::new(1, 2, &[0.0, 0.0, 0.0, 3.0, 4.0, 0.0, 0.0, 0.0]);
        assert_eq!(products.values.len(), 4);
        let at = |block| [products.at(block, 0, 0), products.at(block, 0, 1)];
        assert_eq!([at(0), at(1), at(2), at(3)], [[0.0, 0.0], [0.0, 3.0], [4.0, 0.0], [0.0, 0.0]]);
        assert_eq!(Products::new(2, 2, &[0.0; 8]).at(1, 1, 1), 0.0);
    }

    #[test]
    fn rows_are_cut_at_the_borders_of_blocks() {
        let spans = spans(&[0, 0, 1, 1, 1, 0]);
        let found: Vec<_> = within(&spans, &(1..4)).collect();
        assert_eq!(found, [(0, 1..2), (1, 2..4)]);
        assert_eq!((within(&spans, &(6..6)).count(), within(&spans, &(3..3)).count()), (0, 0));
    }
}
