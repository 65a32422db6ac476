//! Reports as one self-contained HTML page: no scripts, nothing from the network, figures as inline SVG, light and dark.
//!
//! A [`Page`] is a list of [`Part`]s, and a part is one file here: to add a kind of figure, write its `Part`. Whatever is shown is
//! text to this crate, escaped where it is written. Long recordings are decimated without hiding anything: [`Trace`] keeps
//! what a line drawn through every sample would have covered, [`thinned`] what all dots together would have.
//!
//! ```
//! use wrenchd_report::{Bars, Page, Text};
//!
//! let mut page = Page::new("Crosstalk <of> an arm", "2 gauges");
//! page.add(Text::new("Less is better."));
//! page.add(Bars::new("Crosstalk", "%", &["before", "after"]).row("s1", &[Some(178.0), Some(2.0)]));
//! assert!(page.html().contains("Crosstalk &lt;of&gt; an arm"));
//! ```

mod bars;
mod chart;
mod dots;
mod escape;
mod figure;
mod heat;
mod labels;
mod page;
mod scale;
mod scene;
mod svg;
mod table;
mod text;
mod trace;
mod waterfall;

pub use bars::Bars;
pub use chart::{Chart, Size};
pub use dots::thinned;
pub use escape::{escape, number, short};
pub use heat::Heat;
pub use page::{Grid, Page, Part};
pub use scene::{Scene, Stroke};
pub use svg::Ink;
pub use table::{Cell, Table};
pub use text::{Heading, List, Text};
pub use trace::{Band, Trace};
pub use waterfall::Waterfall;
