//! The figure of a recording.

use std::path::Path;

use anyhow::{Context as _, Result};
use figures::axes::{self, Area, Axis, Scale, panel};
use figures::dark::{BLUE as MEASURED, RED as EXPECTED};
use plotters::prelude::*;
use statistics::{least_and_most, mean, standard_deviation};

use super::{Series, spectrum};

/// The height of a panel in pixels.
const HEIGHT: u32 = 340;
/// The fewest and the most bins of the histogram.
const BINS: (f64, f64) = (5.0, 60.0);

/// Draws a recording.
pub fn draw(series: &Series, allan: &[(f64, f64)], path: &Path) -> Result<()> {
    let root = axes::figure(path, 4 * HEIGHT)?;
    let areas = root.split_evenly((4, 1));
    let mm: Vec<f64> = series.readings.iter().map(|(_, mm)| *mm).collect();
    if let [over_time, histogram, deviation, frequencies] = areas.as_slice() {
        draw_over_time(over_time, series, &mm)?;
        draw_histogram(histogram, &mm)?;
        draw_allan(deviation, series, allan)?;
        draw_spectrum(frequencies, series)?;
    }
    root.present()
        .with_context(|| format!("{} cannot be written", path.display()))
}

/// The smallest and the largest value, with a little room. A range is never empty.
fn range(values: impl Iterator<Item = f64>) -> (f64, f64) {
    let (least, most) = least_and_most(values);
    let room = (0.05 * (most - least)).max(1e-4);
    (least - room, most + room)
}

/// Digits after the point with which the ticks of a range differ.
fn digits((least, most): (f64, f64)) -> usize {
    (1.0 - (most - least).log10()).ceil().clamp(0.0, 6.0) as usize
}

fn linear<'a>(range: (f64, f64), name: &'a str, ticks: usize) -> Axis<'a> {
    Axis::linear(range, name, ticks, digits(range))
}

/// A logarithmic axis around positive values, with ticks at 1, 2 and 5 of each decade.
fn log<'a>(values: impl Iterator<Item = f64>, name: &'a str) -> Axis<'a> {
    // Without a positive value, any range.
    let (least, most) = match least_and_most(values.filter(|value| *value > 0.0)) {
        (least, most) if least <= most => (0.8 * least, 1.25 * most),
        _ => (0.1, 10.0),
    };
    let decades = least.log10().floor() as i32..=most.log10().ceil() as i32;
    let is_wide = most / least > 300.0;
    let parts: &[f64] = if is_wide { &[1.0] } else { &[1.0, 2.0, 5.0] };
    let of_decade = |decade| parts.iter().map(move |part| part * 10f64.powi(decade));
    let ticks: Vec<f64> = decades.flat_map(of_decade).collect();
    Axis::new(Scale::Log, (least, most), name, &ticks, |value| {
        // Without the digits that the computer adds.
        let digits = (-value.log10().floor()).max(0.0) as usize;
        format!("{value:.digits$}")
    })
}

fn draw_over_time(area: &Area<'_>, series: &Series, mm: &[f64]) -> Result<()> {
    let start = series.readings.first().map_or(0.0, |(time, _)| *time);
    let end = series.readings.last().map_or(1.0, |(time, _)| *time);
    let (mean, deviation) = (mean(mm), standard_deviation(mm));
    let title = format!(
        "{} readings, mean {mean:.4} mm, standard deviation {deviation:.4} mm, {} faults (red)",
        mm.len(),
        series.faults.len()
    );
    let y = range(mm.iter().map(|mm| mm - mean));
    let x = linear((0.0, (end - start).max(1e-3)), "time in s", 10);
    let mut panel = panel(area, &title, 30, &x, &linear(y, "mm from the mean", 6))?;
    // A line over a pause would be no reading.
    let goes_on = |before: &(f64, f64), after: &(f64, f64)| after.0 - before.0 < series.pause_s;
    for run in series.readings.chunk_by(goes_on) {
        let points = run.iter().map(|(time, mm)| (time - start, mm - mean));
        axes::draw_line(&mut panel, points, MEASURED.stroke_width(1))?;
    }
    panel.draw_series(series.faults.iter().map(|time| {
        let time = time - start;
        let top = y.0 + 0.06 * (y.1 - y.0);
        PathElement::new(vec![(time, y.0), (time, top)], EXPECTED.stroke_width(1))
    }))?;
    Ok(())
}

fn draw_histogram(area: &Area<'_>, mm: &[f64]) -> Result<()> {
    let (mean, deviation) = (mean(mm), standard_deviation(mm));
    let (least, most) = range(mm.iter().copied());
    // Scott's rule: the bins that show a gaussian best.
    let width = 3.49 * deviation / (mm.len() as f64).cbrt();
    let bins = match width > 0.0 {
        true => ((most - least) / width).ceil(),
        false => BINS.0,
    };
    let bins = bins.clamp(BINS.0, BINS.1) as usize;
    let width = (most - least) / bins as f64;
    let mut counts = vec![0_u32; bins];
    for value in mm {
        if let Some(count) = counts.get_mut(((value - least) / width) as usize) {
            *count += 1;
        }
    }
    // The share of a gaussian's readings that a bin at its top has.
    let at_top = width / (deviation.max(1e-12) * (2.0 * std::f64::consts::PI).sqrt());
    let all = f64::from(counts.iter().sum::<u32>());
    let expected = |mm: f64| {
        let off = (mm - mean) / deviation.max(1e-12);
        at_top * (-0.5 * off * off).exp() * all
    };
    let highest = f64::from(counts.iter().copied().fold(1, u32::max));
    let highest = highest.max(expected(mean).min(2.0 * highest));
    let x = linear((least, most), "distance in mm", 8);
    let y = Axis::linear((0.0, 1.08 * highest), "readings in a bin", 6, 0);
    let title = "histogram, and the gaussian of the same deviation (red)";
    let mut panel = panel(area, title, 30, &x, &y)?;
    panel.draw_series(counts.iter().enumerate().map(|(bin, &count)| {
        let left = least + bin as f64 * width;
        let corners = [(left, 0.0), (left + width, f64::from(count))];
        Rectangle::new(corners, MEASURED.mix(0.5).filled())
    }))?;
    let steps = (0..=300).map(|step| least + (most - least) * f64::from(step) / 300.0);
    let curve = steps.map(|mm| (mm, expected(mm)));
    axes::draw_line(&mut panel, curve, EXPECTED.stroke_width(2))
}

fn draw_allan(area: &Area<'_>, series: &Series, allan: &[(f64, f64)]) -> Result<()> {
    let title = format!(
        "Allan deviation of the longest run, {} readings; red: white noise",
        series.run.len()
    );
    let x = log(allan.iter().map(|(time, _)| *time), "time of a mean in s");
    let deviations = allan.iter().map(|(_, deviation)| *deviation);
    let y = log(deviations, "deviation in mm");
    let mut panel = panel(area, &title, 30, &x, &y)?;
    if let Some(&(first, deviation)) = allan.first() {
        // Falls with the root of the time.
        let times = allan.iter().map(|(time, _)| *time);
        let noise = times.map(|time| (time, deviation * (first / time).sqrt()));
        axes::draw_line(&mut panel, noise, EXPECTED.stroke_width(1))?;
    }
    let of_readings = allan.iter().copied();
    axes::draw_line(&mut panel, of_readings.clone(), MEASURED.stroke_width(2))?;
    axes::draw_dots(&mut panel, of_readings, 3, MEASURED.filled())
}

fn draw_spectrum(area: &Area<'_>, series: &Series) -> Result<()> {
    let lines = spectrum::density(&series.run, 1.0 / series.interval_s);
    let x = log(lines.iter().map(|(hertz, _)| *hertz), "frequency in Hz");
    let y = log(lines.iter().map(|(_, density)| *density), "mm / root Hz");
    let mut panel = panel(area, "spectrum of the longest run", 30, &x, &y)?;
    axes::draw_line(&mut panel, lines, MEASURED.stroke_width(1))
}
