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
                match weak.upgrade() {
                    Some(bar) if !bar.is_finished() => eprintln!("{}", line(&bar)),
                    _ => return,
                }
            }
        });
    }
    Ok(bar)
}

fn line(bar: &ProgressBar) -> String {
    let (done, all, seconds) = (
        bar.position(),
        bar.length().unwrap_or(0),
        bar.elapsed().as_secs(),
    );
    format!("{} {done} of {all} after {seconds} s", bar.message())
        .trim_start()
        .to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_says_how_far_a_run_is() {
        let bar = ProgressBar::hidden();
        bar.set_length(9);
        bar.inc(4);
        assert_eq!(line(&bar), "4 of 9 after 0 s");
        bar.set_message("paper, comb:");
        assert_eq!(line(&bar), "paper, comb: 4 of 9 after 0 s");
    }
}
