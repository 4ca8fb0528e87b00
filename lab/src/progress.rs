//! How far a long run is, on standard error: a bar on a terminal, elsewhere a line now and then.

use std::io::{IsTerminal as _, stderr};
use std::thread;
use std::time::Duration;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressFinish, ProgressStyle};

/// From line to line where standard error is no terminal.
const PERIOD: Duration = Duration::from_secs(15);

/// A bar of `length` steps, which goes away when it is dropped. `template` is indicatif's, for instance
/// `{wide_bar} {pos}/{len}`.
pub fn bar(length: u64, template: &str) -> anyhow::Result<ProgressBar> {
    let target = ProgressDrawTarget::stderr_with_hz(4);
    let style = ProgressStyle::with_template(template)?;
    let bar = ProgressBar::with_draw_target(Some(length), target).with_style(style);
    let bar = bar.with_finish(ProgressFinish::AndClear);
    if !stderr().is_terminal() {
        let weak = bar.downgrade();
        thread::spawn(move || {
            loop {
                thread::sleep(PERIOD);
                let Some(bar) = weak.upgrade().filter(|it| !it.is_finished()) else {
                    return;
                };
                let (done, all) = (bar.position(), bar.length().unwrap_or(0));
                let (name, time) = (bar.message(), bar.elapsed());
                eprintln!("{name} {done} of {all} after {time:.0?}");
            }
        });
    }
    Ok(bar)
}
