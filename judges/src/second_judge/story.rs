//! The story of one row or frame: what it is made of, how it differs from its clean spot, what comes of it.

use crate::second_judge::tally::{Judged, Verdict};
use crate::second_judge::{Frame, Kind};
use slitrange::centre::Estimator;
use std::fmt::Write as _;

/// Lines of the story that show pixels.
const LINES: i32 = 33;
/// The pixels that are shown reach so many widths to both sides of the spot.
const REACH: f64 = 4.0;

impl Frame {
    /// Tells the story, in lines.
    pub fn story(&self, kind: &Kind) -> String {
        let mut text = format!("{}: {}\n", kind.name, kind.what);
        let (sensor, spot, truth) = (self.sensor, self.spot, self.truth);
        let (black, noise, electrons) = (sensor.black, sensor.read_noise, sensor.electrons);
        let (shape, width, height) = (spot.shape, spot.width, spot.height);
        text += &format!(
            "sensor: black level {black:.1} counts, read noise {noise:.2} counts, {electrons:.1} electrons a \
             count\nspot: {shape:?}, width {width:.3} px, height {height:.1} counts\ntruth: {truth:?}\n\n\
             \x20  pixel    counts     clean     fault\n"
        );
        // The mean of the frame's rows, above the black level; a clean spot, whole.
        let seen = self.mean();
        let mut clean = vec![0.0; seen.len()];
        spot.add_to(&mut clean, |_| 1.0);
        let mut last = None;
        for line in 0..LINES {
            let widths = REACH * (2.0 * f64::from(line) / f64::from(LINES - 1) - 1.0);
            let pixel = (spot.centre + widths * spot.width).round();
            let at = |counts: &[f64]| counts.get(pixel as usize).copied();
            // A narrow spot has fewer pixels than lines.
            if let (Some(seen), Some(clean)) = (at(&seen), at(&clean))
                && last.replace(pixel) != Some(pixel)
                && pixel >= 0.0
            {
                let fault = seen - clean;
                _ = writeln!(text, "{pixel:8} {seen:9.1} {clean:9.1} {fault:+9.1}");
            }
        }
        text.push('\n');
        for estimator in Estimator::ALL {
            let judged = Judged {
                estimator,
                is_calibrated: true,
            };
            let words = words(&self.verdict(kind, judged));
            _ = writeln!(text, "{:>14}: {words}", estimator.name());
        }
        text
    }

    /// The mean of the rows' light pixels above the sensor's black level.
    fn mean(&self) -> Vec<f64> {
        let mut sums = vec![0.0; self.geometry.light.len()];
        let mut rows = 0.0;
        for words in &self.rows {
            if let Ok(row) = self.geometry.row(words) {
                rows += 1.0;
                for (sum, count) in sums.iter_mut().zip(row.light().iter()) {
                    *sum += f64::from(count);
                }
            }
        }
        let black = self.sensor.black;
        sums.iter_mut().for_each(|sum| *sum = *sum / rows - black);
        sums
    }
}

fn words(verdict: &Verdict) -> String {
    match *verdict {
        Verdict::Fault(fault) => format!("{fault:?}"),
        Verdict::Centre {
            error,
            claim,
            is_flagged,
            misfits,
        } => {
            let end = match (is_flagged, verdict.is_confident_error()) {
                (true, _) => ", flagged",
                (_, true) => ", CONFIDENT ERROR",
                _ => "",
            };
            format!("off by {error:.3} px, claims {claim:.4} px, {misfits} rows doubtful{end}")
        }
    }
}
