//! The paper's fig. 13: how the errors of each material are distributed, through the lens and through the
//! slit.

use std::path::Path;

use figures::axes::{self, Area, Axis, TEXT, TITLE, panel, text};
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::style::{RIGHT, colour, draw_zero};
use crate::paper::materials::MATERIALS;
use crate::paper::methods::{Method, OURS};
use crate::programs::table1::report::Report;

/// The errors that are shown, in micrometres to either side.
const RANGE: f64 = 900.0;

/// The lower end of the axis: below the errors there is room for figures.
const LOWEST: f64 = -1100.0;

const BINS: usize = 180;

/// Standard deviation of the kernel that smooths the distribution, in bins: 30 um.
const KERNEL: f64 = 3.0;

pub fn draw(report: &Report, path: &Path) -> anyhow::Result<()> {
    let ours = format!("slit, {OURS}");
    let names = ["lens", "slit, gaussian", "slit, Fraunhofer", &ours];
    let root = axes::figure(path, 1060)?;
    let (legend, rest) = root.split_vertically(44);
    let mut left = 30;
    for (method, name) in Method::ALL.into_iter().zip(names) {
        let colour = colour(method);
        legend.draw(&Rectangle::new(
            [(left, 14), (left + 22, 32)],
            colour.filled(),
        ))?;
        let style = text(TITLE, colour).pos(Pos::new(HPos::Left, VPos::Center));
        legend.draw(&Text::new(name, (left + 30, 23), style))?;
        left += 58 + (name.chars().count() as f64 * 0.58 * f64::from(TITLE)) as i32;
    }
    let style = text(TITLE, BLACK).pos(Pos::new(HPos::Right, VPos::Center));
    legend.draw(&Text::new("figures: MAE, um", (980, 23), style))?;
    for (material, area) in rest.split_evenly((3, 2)).iter().enumerate() {
        draw_material(report, material, area)?;
    }
    root.present()?;
    Ok(())
}

fn draw_material(report: &Report, material: usize, area: &Area<'_>) -> anyhow::Result<()> {
    let places = (-0.6, Method::ALL.len() as f64 - 0.4);
    let name = if material.is_multiple_of(2) {
        "error, um"
    } else {
        ""
    };
    let x = Axis::linear(places, "", 0, 0);
    let y = Axis::linear((LOWEST, RANGE), name, 7, 0);
    let mut panel = panel(area, MATERIALS[material].name, RIGHT, &x, &y)?;
    draw_zero(&mut panel, places)?;
    for (place, method) in (0..).zip(Method::ALL) {
        let place = f64::from(place);
        let (judged, colour) = (report.judged(material, method), colour(method));
        let density = density(&judged.errors);
        let widest = density
            .iter()
            .fold(0.0f64, |widest, &(_, value)| widest.max(value));
        let side = |sign: f64| {
            density
                .iter()
                .map(move |&(error, value)| (place + sign * 0.45 * value / widest, error))
        };
        let outline: Vec<(f64, f64)> = side(-1.0).chain(side(1.0).rev()).collect();
        panel.draw_series([Polygon::new(outline, colour.mix(0.55).filled())])?;
        // Quartiles, and the median broader.
        for (quantile, width, length) in [(0.25, 2, 0.16), (0.5, 4, 0.24), (0.75, 2, 0.16)] {
            let error = at_quantile(&judged.errors, quantile);
            panel.draw_series([PathElement::new(
                vec![(place - length, error), (place + length, error)],
                BLACK.stroke_width(width),
            )])?;
        }
        let mae = format!("{:.0}", judged.mae * 1e6);
        let style = text(TEXT, colour).pos(Pos::new(HPos::Center, VPos::Bottom));
        panel.draw_series([Text::new(mae, (place, LOWEST * 0.99), style)])?;
    }
    Ok(())
}

/// The errors' distribution, smoothed: places in micrometres and densities in any unit, where there are
/// errors.
fn density(errors: &[f32]) -> Vec<(f64, f64)> {
    let bin = 2.0 * RANGE / BINS as f64;
    let mut counts = [0.0f64; BINS];
    for error in errors.iter().filter(|error| error.is_finite()) {
        let place = (f64::from(*error) * 1e6 + RANGE) / bin;
        if (0.0..BINS as f64).contains(&place) {
            counts[place as usize] += 1.0;
        }
    }
    let smooth = |i: usize| -> f64 {
        let weight = |j: usize| (-0.5 * ((j as f64 - i as f64) / KERNEL).powi(2)).exp();
        (0..BINS).map(|j| counts[j] * weight(j)).sum()
    };
    let total: f64 = counts.iter().sum();
    (0..BINS)
        .map(|i| ((i as f64 + 0.5) * bin - RANGE, smooth(i)))
        .filter(|&(_, value)| value > 1e-4 * total)
        .collect()
}

/// The error in micrometres below which this share of them lies.
fn at_quantile(errors: &[f32], share: f64) -> f64 {
    let finite = errors.iter().filter(|error| error.is_finite());
    statistics::quantile(finite.map(|&error| f64::from(error)), share) * 1e6
}
