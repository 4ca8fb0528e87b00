//! The picture of a row: all pixels that came, the window with the fit, and what the fit leaves.

use std::ops::Range;
use std::path::Path;

use anyhow::{Context as _, Result};
use figures::axes::{self, Area, Axis, Panel, TEXT, text};
use figures::dark::{BLUE as PIXELS, GREY as LEVEL, RED as FIT};
use plotters::prelude::*;
use statistics::least_and_most;

use super::{Image, RowAnswer};

/// The pixels of an image.
const WINDOW: RGBColor = RGBColor(0xf2, 0xec, 0xd8);
const HEIGHTS: [u32; 3] = [380, 380, 260];

/// Draws a row.
pub fn draw(answer: &RowAnswer, path: &Path) -> Result<()> {
    let images = answer.images();
    let level = answer
        .level(&images)
        .context("no pixels beside a spot came: ask for the whole row, or for more pixels")?;
    let window = window(answer, &images);
    let fit = answer.fit().filter(|_| !window.is_empty());
    let height = match fit {
        Some(_) => HEIGHTS.iter().sum(),
        None => HEIGHTS[0],
    };
    let root = axes::figure(path, height)?;
    let (above, below) = root.split_vertically(HEIGHTS[0]);
    let saturated = f64::from(answer.saturated);
    let highest = answer.counts.iter().max().copied().unwrap_or_default();
    let all = answer.first..answer.first + answer.counts.len();
    let title = match &answer.centre {
        Ok(centre) => format!("the row: centre {:.3} px", centre.x_px),
        Err(no_centre) => format!("the row: {}", no_centre.fault),
    };
    // The saturation is always in view: the room up to it is what one sets the exposure by.
    let top = 1.06 * saturated.max(highest.into());
    let mut panel = panel(&above, &title, &all, (0.0, top))?;
    let windows = images.iter().filter(|image| answer.has(image.x_px));
    let windows = windows.map(|image| {
        let reach = image.reach_px();
        let least = (image.x_px - reach).max(all.start as f64);
        let most = (image.x_px + reach).min(all.end as f64);
        Rectangle::new([(least, 0.0), (most, top)], WINDOW.filled())
    });
    panel.draw_series(windows)?;
    // The words of the level lie above its line, those of the black level below.
    let levels = [
        ("saturated", Some(saturated), 5),
        ("level beside the spot", Some(level), -22),
        ("black level", answer.black, 5),
    ];
    for at in levels.iter().filter_map(|(_, at, _)| *at) {
        draw_level(&mut panel, &all, at)?;
    }
    draw_pixels(&mut panel, answer.points(&all))?;
    for (words, at, below) in levels {
        let Some(at) = at else { continue };
        let (x, y) = panel.backend_coord(&(all.start as f64, at));
        let (_, axis) = panel.backend_coord(&(all.start as f64, 0.0));
        // The words of a low level stay above the axis.
        let y = (y + below).min(axis - 16);
        above.draw(&Text::new(words, (x + 8, y), text(TEXT - 3, LEVEL)))?;
    }
    if let Some(fit) = &fit {
        let (middle, lowest) = below.split_vertically(HEIGHTS[1]);
        draw_fit(&middle, &lowest, answer, &images, &window, level, fit)?;
    }
    root.present()
        .with_context(|| format!("{} cannot be written", path.display()))
}

/// The pixels that came from the first image's window to the last one's. Empty if there are none.
pub(super) fn window(answer: &RowAnswer, images: &[Image]) -> Range<usize> {
    let ends = images.iter().map(|image| {
        let reach = image.reach_px();
        [image.x_px - reach, image.x_px + reach]
    });
    let (first, last) = least_and_most(ends.flatten());
    let came = answer.first..answer.first + answer.counts.len();
    (first.max(0.0) as usize).max(came.start)..(last as usize + 1).min(came.end)
}

/// The pixels around the spot with the fit, and what the fit leaves.
fn draw_fit(
    middle: &Area<'_>,
    lowest: &Area<'_>,
    answer: &RowAnswer,
    images: &[Image],
    window: &Range<usize>,
    level: f64,
    fit: impl Fn(f64) -> f64,
) -> Result<()> {
    let highest = images.iter().map(|image| image.height).fold(0.0, f64::max);
    let range = (level - 0.08 * highest, level + 1.25 * highest);
    let title = "pixels (blue) and fit (red)";
    let mut panel = panel(middle, title, window, range)?;
    for at in [Some(level), answer.black, Some(answer.saturated.into())] {
        if let Some(at) = at.filter(|at| (range.0..range.1).contains(at)) {
            draw_level(&mut panel, window, at)?;
        }
    }
    let places = (window.start * 4..window.end * 4).map(|quarter| f64::from(quarter as u32) / 4.0);
    let line: Vec<(f64, f64)> = places.map(|pixel| (pixel, fit(pixel))).collect();
    axes::draw_line(&mut panel, line, FIT.stroke_width(2))?;
    let pixels = answer.points(window);
    let left = |&(pixel, count): &(f64, f64)| (pixel, count - fit(pixel));
    let left = pixels.iter().map(left);
    let left: Vec<(f64, f64)> = left.collect();
    draw_pixels(&mut panel, pixels)?;
    let most = left
        .iter()
        .fold(1.0, |most: f64, (_, left)| left.abs().max(most));
    let title = "what the fit leaves";
    let mut panel = self::panel(lowest, title, window, (-1.1 * most, 1.1 * most))?;
    draw_pixels(&mut panel, left)
}

fn panel<'a, 'b>(
    area: &'b Area<'a>,
    title: &str,
    pixels: &Range<usize>,
    counts: (f64, f64),
) -> Result<Panel<'a, 'b>> {
    let x = Axis::linear((pixels.start as f64, pixels.end as f64), "pixel", 10, 0);
    let y = Axis::linear(counts, "counts", 6, 0);
    axes::panel(area, title, 30, &x, &y)
}

fn draw_level(panel: &mut Panel<'_, '_>, pixels: &Range<usize>, level: f64) -> Result<()> {
    let line = vec![(pixels.start as f64, level), (pixels.end as f64, level)];
    axes::draw_line(panel, line, LEVEL.stroke_width(1))
}

/// Draws a line if there are many points, otherwise dots.
fn draw_pixels(panel: &mut Panel<'_, '_>, points: Vec<(f64, f64)>) -> Result<()> {
    match points.len() > 300 {
        true => axes::draw_line(panel, points, PIXELS.stroke_width(1)),
        false => axes::draw_dots(panel, points, 3, PIXELS.filled()),
    }
}
