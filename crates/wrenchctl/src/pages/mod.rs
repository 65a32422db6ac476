//! What `--report` writes: pages made of the report crate's parts, one module a page.

pub mod arm;
pub mod calibration;
pub mod diagnosis;
pub mod joints;
pub mod residuals;
pub mod scores;
pub mod temperatures;
pub mod timeline;
pub mod validation;

use report::Text;

/// Most charts of one kind on a page: an arm with more gauges or joints shows the first of them, and says so.
pub(crate) const MOST_CHARTS: usize = 24;

/// A sentence for what [`MOST_CHARTS`] leaves out; none where nothing is.
pub(crate) fn left_out(there_are: usize, what: &str) -> Option<Text> {
    (there_are > MOST_CHARTS)
        .then(|| Text::new(format!("Shown are the first {MOST_CHARTS} of {there_are} {what}.")))
}

/// Root of the mean square; none of nothing.
pub(crate) fn root_mean_square(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, n) = values.fold((0.0, 0.0), |(sum, n), v| (sum + v * v, n + 1.0));
    (n > 0.0).then(|| f64::sqrt(sum / n))
}
