//! A progress bar on standard error where a person watches; nothing elsewhere.

use indicatif::{ProgressBar, ProgressStyle};

/// Progress of one long step; the bar goes away when it is dropped.
#[derive(Debug)]
pub struct Progress(Option<ProgressBar>);

impl Progress {
    /// For so many bytes of something.
    pub fn bytes(total: u64, what: &str) -> Self {
        Self::with(total, what, "{msg} {wide_bar} {bytes}/{total_bytes} {eta}")
    }

    /// For so many steps of something.
    pub fn steps(total: u64, what: &str) -> Self {
        Self::with(total, what, "{msg} {wide_bar} {pos}/{len} {eta}")
    }

    fn with(total: u64, what: &str, template: &str) -> Self {
        if !crate::output::watched() {
            return Self(None);
        }
        let bar = ProgressBar::new(total).with_message(what.to_owned());
        if let Ok(style) = ProgressStyle::with_template(template) {
            bar.set_style(style);
        }
        Self(Some(bar))
    }

    /// There are so many steps.
    pub fn of(&self, total: u64) {
        if let Some(bar) = &self.0 {
            bar.set_length(total);
        }
    }

    /// So much is done.
    pub fn at(&self, done: u64) {
        if let Some(bar) = &self.0 {
            bar.set_position(done);
        }
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        if let Some(bar) = &self.0 {
            bar.finish_and_clear();
        }
    }
}
