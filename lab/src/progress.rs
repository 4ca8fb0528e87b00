//! Bars that show on the terminal how far a long run is.

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressFinish, ProgressStyle};

/// A bar of `length` steps, which goes away when it is dropped. `template` is indicatif's, for instance
/// `{wide_bar} {pos}/{len}`.
pub fn bar(length: u64, template: &str) -> anyhow::Result<ProgressBar> {
    let target = ProgressDrawTarget::stderr_with_hz(4);
    let style = ProgressStyle::with_template(template)?;
    let bar = ProgressBar::with_draw_target(Some(length), target).with_style(style);
    Ok(bar.with_finish(ProgressFinish::AndClear))
}
