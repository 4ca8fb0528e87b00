//! Shows the sensor the rows of a photograph, one after the other, and compares the firmware's centres with a
//! least-squares fit in f64.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use anyhow::{Result, ensure};
use serde::Serialize;
use simulator::least_squares::{self, Gaussian};
use simulator::photograph::Photograph;
use statistics::{mean, rms};
use virtual_board::light::LIGHT;
use virtual_board::{Exposure, FULL_SCALE, Firmware, PIXELS, VirtualBoard};

use crate::command_line::say;
use crate::lines::{Reading, Report};
use crate::moving_target::next_report;

/// The least height of a spot that is compared: a twentieth of full scale. In dimmer rows, noise would
/// dominate the comparison.
const BRIGHT: f64 = FULL_SCALE as f64 / 20.0;

/// Before the photograph, three rows show a spot at a place where no picture has one. With these, lines and
/// rows can be matched.
const MARKER: f64 = 1250.0;
const MARKERS: usize = 3;

#[derive(Debug, Serialize)]
pub struct Summary {
    rows: usize,
    centres: usize,
    /// The number of rows whose centre was compared: the spot is bright and wholly in the photograph.
    compared: usize,
    /// Distance from the least-squares fit over the spot's sigma, root mean square and largest.
    rms_sigma: Option<f64>,
    max_sigma: Option<f64>,
    /// Mean sigma of the compared rows in pixels.
    mean_width_px: Option<f64>,
    faults: BTreeMap<String, usize>,
}

pub fn show(firmware: &Firmware, path: &Path, json: bool) -> Result<Summary> {
    let say = |text: &str| say(json, text);
    let photograph = Arc::new(Photograph::read(path)?);
    let rows = photograph.height;
    let (path, width, white) = (path.display(), photograph.width, photograph.white);
    say(&format!(
        "{path}: {width} x {rows} pixels, white is {white}"
    ));
    let reports = reports(firmware, &photograph)?;
    ensure!(!reports.is_empty(), "the firmware reports nothing");

    say("   row  centre px  least squares px  off by (sigma)  amplitude  sigma px");
    let (mut faults, mut offs, mut widths, mut centres) = (BTreeMap::new(), vec![], vec![], 0);
    for (y, report) in reports.iter().enumerate() {
        let reading = match report {
            Report::Reading(reading) => reading,
            Report::Fault(fault) => {
                let name = fault.split(':').next().unwrap_or(fault);
                *faults.entry(name.to_owned()).or_insert(0) += 1;
                continue;
            }
        };
        centres += 1;
        let fit = fit(&photograph, y, reading).filter(|_| reading.amplitude >= BRIGHT);
        let Some((Gaussian { centre, width, .. }, first)) = fit else {
            continue;
        };
        let (found, height) = (reading.centre - first as f64, reading.amplitude);
        let off = (found - centre) / width;
        if offs.len() % 20 == 0 {
            say(&format!(
                "{y:>6} {found:>10.3} {centre:>17.3} {off:>+15.4} {height:>10.0} {width:>9.2}"
            ));
        }
        offs.push(off);
        widths.push(width);
    }
    let of_compared = |value: f64| (!offs.is_empty()).then_some(value);
    let summary = Summary {
        rows,
        centres,
        compared: offs.len(),
        rms_sigma: of_compared(rms(&offs)),
        max_sigma: offs.iter().map(|off| off.abs()).reduce(f64::max),
        mean_width_px: of_compared(mean(widths)),
        faults,
    };
    say(&summary.in_words());
    Ok(summary)
}

fn reports(firmware: &Firmware, photograph: &Arc<Photograph>) -> Result<Vec<Report>> {
    let shown = Arc::new(Mutex::new(None));
    let next = Arc::clone(&shown);
    let picture = Arc::clone(photograph);
    let marker: Vec<f32> = (0..LIGHT.len())
        .map(|i| (2000.0 * (-0.5 * ((i as f64 - MARKER) / 5.0).powi(2)).exp()) as f32)
        .collect();
    let light = Box::new(move |_: &Exposure| {
        let mut next = next.lock().unwrap_or_else(PoisonError::into_inner);
        let row: Option<usize> = *next;
        *next = row.map(|row| row + 1);
        let light = row.and_then(|row| match row.checked_sub(MARKERS) {
            Some(row) => picture.on_sensor(row).map(|(light, _)| light),
            None => Some(marker.clone()),
        });
        let mut outputs = vec![0.0; PIXELS];
        if let Some(light) = light {
            outputs[LIGHT].copy_from_slice(&light);
        }
        outputs
    });
    let mut board = VirtualBoard::power_on(firmware, light)?;
    let patience = Duration::from_secs(2);
    board.tell("rows 1", patience)?;
    // After power-up the firmware clears the sensor with pulses that read no row. The first result shows that
    // this is over.
    next_report(&mut board, patience)?;
    *shown.lock().unwrap_or_else(PoisonError::into_inner) = Some(0);

    let mut markers = 0;
    let mut reports = vec![];
    while reports.len() < photograph.height {
        let (_, report) = next_report(&mut board, patience)?;
        if markers == MARKERS {
            reports.push(report);
        } else if matches!(report, Report::Reading(Reading { centre, .. }) if (centre - MARKER).abs() < 1.0)
        {
            markers += 1;
        }
    }
    board.send("status\r\n");
    let is_dropped = |line: &str| line.starts_with("status lines dropped ");
    let dropped = board.run_until_line(is_dropped, patience)?.text;
    ensure!(
        dropped.ends_with(" 0"),
        "lines are missing, so lines and rows do not match: {dropped}"
    );
    board.finish()?;
    Ok(reports)
}

/// The least-squares fit of a row of counts, started at the firmware's centre, and the pixel on which the
/// picture begins. `None` if the fit fails, or if the spot is not wholly in the photograph.
fn fit(photograph: &Photograph, y: usize, reading: &Reading) -> Option<(Gaussian, i64)> {
    let (light, first) = photograph.on_sensor(y)?;
    let counts: Vec<f64> = light.iter().map(|count| f64::from(count.round())).collect();
    let from = usize::try_from(first.max(0)).ok()?;
    let picture = counts.get(from..(from + photograph.width).min(counts.len()))?;
    let fit = least_squares::fit_near(picture, reading.centre - from as f64)?;
    fit.is_whole_in(picture.len()).then_some((fit, from as i64))
}

impl Summary {
    fn in_words(&self) -> String {
        let faults = self.faults.iter();
        let faults = faults.map(|(name, count)| format!("{count} {name}"));
        let faults: Vec<String> = faults.collect();
        let compared = match (self.rms_sigma, self.max_sigma, self.mean_width_px) {
            (Some(rms), Some(largest), Some(width)) => format!(
                "{} of them bright (at least {BRIGHT:.0} counts) and whole in the picture: {rms:.4} sigma \
                 RMS from the least-squares fit, {largest:.4} at most, sigma {width:.1} px",
                self.compared
            ),
            _ => "none of them bright".to_owned(),
        };
        let (rows, centres) = (self.rows, self.centres);
        let faults = match faults.join(", ") {
            faults if faults.is_empty() => "none".to_owned(),
            faults => faults,
        };
        format!("{rows} rows, {centres} centres, {compared}\nwithout a centre: {faults}")
    }
}
