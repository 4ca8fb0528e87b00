//! A scene's picture: its rows as the sensor sees them, one of them with the fit over it, and what the fit
//! leaves.

use std::ops::Range;

use figures::axes::{self, Area, Axis, Scale};
use figures::dark::{BLUE as COUNTS, RED as FIT};
use phase_tables::gaussian;
use plotters::prelude::*;
use statistics::least_and_most;

use crate::budget::row_centre;
use crate::prelude::*;
use crate::programs::scene::embedded::{Grey, Place};
use crate::programs::scene::words;

/// Rows of a line sensor that are shown.
const ROWS: u64 = 48;

/// The width of a spot that a dark row might have, in pixels.
const DARK: f64 = 8.0;

const PIXELS: &str = "pixel of the light range";

/// Size of texts that would not fit otherwise.
const SMALL: i32 = 15;

/// Pixels beside a panel: room for the scale of grey.
const RIGHT: i32 = 96;

const TITLE: (i32, i32) = (90, 2);

/// Draws a scene into `folder`, and gives the file's path.
pub fn write(file: &str, name: &str, scene: &Scene, folder: &Path) -> Result<PathBuf> {
    std::fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
    let path = folder.join(format!("{file}.svg"));
    Seen::of(scene).draw(name, &path)?;
    Ok(path)
}

struct Seen<'a> {
    scene: &'a Scene,
    /// Counts of the light range, row by row.
    rows: Vec<Vec<u16>>,
    /// The pixels of the image, and its rows.
    image: (Range<usize>, Range<usize>),
    /// Which of the rows is fitted.
    row: usize,
    /// The pixels of that row that are shown.
    window: Range<usize>,
    fit: Result<RowCentre, Fault>,
    truth: f64,
}

impl<'a> Seen<'a> {
    fn of(scene: &'a Scene) -> Self {
        let simulation = Simulation::new(scene.clone());
        let geometry = scene.geometry();
        // A camera's frame, or a line sensor's first rows; of the former the middle one is fitted, of the
        // latter the first.
        let (rows, row) = match scene.sensor.rows() {
            1 => (ROWS, 0),
            rows => (rows, rows / 2),
        };
        let counts: Vec<Vec<u16>> = (0..rows)
            .map(|row| {
                let counts = simulation.row(row, scene.distance, scene.exposure);
                quantise(&counts, geometry.full_scale())
            })
            .collect();
        let row = row as usize;
        let fit = row_centre(&counts[row], &geometry, Estimator::default());
        let truth = simulation.true_centre(row as u64, scene.distance);
        let end = geometry.light.len() as f64;
        let half = {
            let width = match (&fit, scene.spot) {
                (Ok(fit), _) => fit.width.to_f64(),
                (Err(_), Some(spot)) => spot.width,
                (Err(_), None) => DARK,
            };
            (7.0 * width).clamp(12.0, 150.0).ceil()
        };
        let around = |from: f64, to: f64| {
            let within = |x: f64| x.round().clamp(0.0, end - 1.0);
            // At the edge of the sensor as many pixels as elsewhere.
            let (from, to) = (within(from - half), within(to + half));
            let from = from.min(to - 2.0 * half).max(0.0);
            let to = to.max(from + 2.0 * half).min(end - 1.0);
            from as usize..to as usize + 1
        };
        // A target that moves takes the spot along.
        let last = simulation.true_centre(rows - 1, scene.distance);
        let image = around(truth.min(last), truth.max(last));
        // Behind a lens the spot is round.
        let image_rows = match scene.optics.aperture {
            Aperture::Lens { .. } if rows > ROWS => {
                row.saturating_sub(half as usize)..(row + half as usize + 1).min(rows as usize)
            }
            _ => 0..rows as usize,
        };
        let light = |counts: &Vec<u16>| counts[geometry.light.clone()].to_vec();
        Self {
            scene,
            rows: counts.iter().map(light).collect(),
            image: (image, image_rows),
            row,
            window: around(truth, truth),
            fit,
            truth,
        }
    }

    fn draw(&self, name: &str, path: &Path) -> Result<()> {
        let (image, bar) = {
            let root = axes::figure(path, 940)?;
            let (head, rest) = root.split_vertically(78);
            let style = ("sans-serif", axes::TITLE, FontStyle::Bold).into_font();
            head.draw(&Text::new(name.to_owned(), (16, 8), style))?;
            write_small(&head, (16, 33), cut(&self.scene.about, 130))?;
            write_small(&head, (16, 54), words::setting(self.scene))?;
            let (top, rest) = rest.split_vertically(360);
            let places = self.draw_image_axes(&top)?;
            match self.fit_and_level() {
                Some((fit, level)) => {
                    let (middle, bottom) = rest.split_vertically(270);
                    self.draw_row(&middle, "")?;
                    self.draw_residuals(&bottom, fit, level)?;
                }
                None => self.draw_row(&rest, PIXELS)?,
            }
            root.present()?;
            places
        };
        let scale = Grey {
            width: 8,
            pixels: (0..=255).rev().flat_map(|grey| [grey; 8]).collect(),
        };
        let mut svg = std::fs::read_to_string(path)?;
        self.grey().place(&mut svg, image)?;
        scale.place(&mut svg, bar)?;
        Ok(std::fs::write(path, svg)?)
    }

    /// The counts of the image, row by row.
    fn image_counts(&self) -> impl Iterator<Item = u16> {
        let (columns, rows) = &self.image;
        self.rows[rows.clone()]
            .iter()
            .flat_map(|row| row[columns.clone()].iter().copied())
    }

    /// Counts that are black and white.
    fn ends(&self) -> (u16, u16) {
        let (from, to) = (self.image_counts().min(), self.image_counts().max());
        let from = from.unwrap_or(0);
        (from, to.unwrap_or(0).max(from + 1))
    }

    fn grey(&self) -> Grey {
        let (from, to) = self.ends();
        let grey = |count: u16| {
            let share = f64::from(count - from) / f64::from(to - from);
            (share * 255.0).round() as u8
        };
        Grey {
            width: self.image.0.len(),
            pixels: self.image_counts().map(grey).collect(),
        }
    }

    /// Axes around the image and its scale of grey. Gives the places of both.
    fn draw_image_axes(&self, area: &Area<'_>) -> Result<(Place, Place)> {
        let (pixels, rows) = &self.image;
        let title = match self.scene.sensor.rows() {
            1 => "rows of the sensor, one after the other",
            _ => "a frame of the sensor",
        };
        // Row 0 is at the top: heights are negative row numbers.
        let heights = (0.5 - rows.end as f64, 0.5 - rows.start as f64);
        let step = [10, 20, 50].into_iter().find(|step| rows.len() <= 7 * step);
        let ticks: Vec<f64> = (0..rows.end)
            .step_by(step.unwrap_or(100))
            .map(|row| -(row as f64))
            .collect();
        let x = Axis::linear(columns(pixels), PIXELS, 12, 0);
        let y = Axis::new(Scale::Linear, heights, "row", &ticks, |height| {
            format!("{:.0}", height.abs())
        });
        write_small(area, TITLE, title.to_owned())?;
        let inside = area.margin(18, 0, 0, 0);
        let panel = axes::panel(&inside, "", RIGHT, &x, &y)?;
        let (across, heights) = panel.plotting_area().get_pixel_range();
        let (left, top) = area.get_base_pixel();
        // The fitted row is marked beside the image.
        let (_, height) = panel.backend_coord(&(pixels.start as f64, -(self.row as f64)));
        area.draw(&Polygon::new(
            [(13, -6), (2, 0), (13, 6)].map(|(x, y)| (across.end - left + x, height - top + y)),
            FIT.filled(),
        ))?;
        let bar = across.end + 18..across.end + 34;
        let (from, to) = self.ends();
        let middle = (heights.start + heights.end) / 2;
        for (label, at) in [
            (to.to_string(), heights.start + 2),
            (from.to_string(), heights.end - SMALL),
            ("counts".to_owned(), middle - SMALL / 2),
        ] {
            write_small(area, (bar.end + 6 - left, at - top), label)?;
        }
        Ok(((across, heights.clone()), (bar, heights)))
    }

    fn draw_row(&self, area: &Area<'_>, x_name: &str) -> Result<()> {
        let counts = self.counts();
        let found = match &self.fit {
            Ok(fit) => format!(
                "centre {:.3} px, {:+.4} px off the truth (claimed ± {:.4}); sigma {:.2} px, height {:.0} counts",
                fit.centre.to_f64(),
                fit.centre.to_f64() - self.truth,
                fit.uncertainty.to_f64(),
                fit.width.to_f64(),
                fit.amplitude.to_f64()
            ),
            Err(fault) => fault.name().to_owned(),
        };
        let title = format!("row {}, {}: {found}", self.row, Estimator::default().name());
        let (low, high) = least_and_most(counts.iter().map(|(_, count)| *count));
        let margin = 0.08 * (high - low).max(10.0);
        let heights = (low - margin, high + margin);
        let x = Axis::linear(columns(&self.window), x_name, 12, 0);
        let y = Axis::linear(heights, "counts", 6, 0);
        write_small(area, TITLE, title)?;
        let inside = area.margin(18, 0, 0, 0);
        let mut panel = axes::panel(&inside, "", RIGHT, &x, &y)?;
        axes::draw_dots(&mut panel, counts, 3, COUNTS.filled())?;
        if let Some((fit, level)) = self.fit_and_level() {
            let (start, _) = columns(&self.window);
            let curve = (0..=self.window.len() * 8).map(|i| {
                let x = start + i as f64 / 8.0;
                (x, level + model(fit, x))
            });
            axes::draw_line(&mut panel, curve, FIT.stroke_width(2))?;
            let centre = fit.centre.to_f64();
            let line = [(centre, heights.0), (centre, heights.1)];
            axes::draw_line(&mut panel, line, FIT.stroke_width(1))?;
        }
        Ok(())
    }

    fn draw_residuals(&self, area: &Area<'_>, fit: &RowCentre, level: f64) -> Result<()> {
        let left = self.counts().into_iter();
        let left: Vec<(f64, f64)> = left
            .map(|(x, count)| (x, count - level - model(fit, x)))
            .collect();
        let (low, high) = least_and_most(left.iter().map(|(_, count)| *count));
        let end = 1.1 * low.abs().max(high.abs()).max(1.0);
        let columns = columns(&self.window);
        let x = Axis::linear(columns, PIXELS, 12, 0);
        let y = Axis::linear((-end, end), "counts - fit", 5, 0);
        let mut panel = axes::panel(area, "", RIGHT, &x, &y)?;
        let zero = [(columns.0, 0.0), (columns.1, 0.0)];
        axes::draw_line(&mut panel, zero, FIT.stroke_width(1))?;
        axes::draw_dots(&mut panel, left, 2, COUNTS.filled())
    }

    fn counts(&self) -> Vec<(f64, f64)> {
        let row = &self.rows[self.row];
        (self.window.clone())
            .map(|pixel| (pixel as f64, f64::from(row[pixel])))
            .collect()
    }

    /// The fit, and the level on which its gaussian lies: the median of what it leaves. The core has no need
    /// to know it.
    fn fit_and_level(&self) -> Option<(&RowCentre, f64)> {
        let fit = self.fit.as_ref().ok()?;
        let counts = self.counts().into_iter();
        let left = counts.map(|(x, count)| count - model(fit, x));
        Some((fit, upper_median(left)))
    }
}

fn write_small(area: &Area<'_>, at: (i32, i32), text: String) -> Result<()> {
    Ok(area.draw(&Text::new(text, at, axes::text(SMALL, BLACK)))?)
}

/// From the left edge of the first pixel to the right edge of the last.
fn columns(pixels: &Range<usize>) -> (f64, f64) {
    (pixels.start as f64 - 0.5, pixels.end as f64 - 0.5)
}

/// What a pixel at x gathers of the fitted gaussian, in counts.
fn model(fit: &RowCentre, x: f64) -> f64 {
    fit.amplitude.to_f64() * gaussian(x - fit.centre.to_f64(), fit.width.to_f64())
}

fn cut(text: &str, characters: usize) -> String {
    if text.chars().count() <= characters {
        return text.to_owned();
    }
    let start: String = text.chars().take(characters).collect();
    let end = start.rfind(' ').unwrap_or(start.len());
    format!("{} ...", &start[..end])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_spot_is_where_the_scene_puts_it() {
        let scene = Scene::load("quiet-paper").expect("a scene");
        let seen = Seen::of(&scene);
        let (fit, level) = seen.fit_and_level().expect("a spot");
        let off = fit.centre.to_f64() - seen.truth;
        println!("off by {off} px, level {level}");
        assert!(off.abs() < 5.0 * fit.uncertainty.to_f64());
        // The median of 123 pixels of some five counts of noise.
        assert!((level - 300.0).abs() < 3.0);
        let image = seen.grey();
        let brightest = image.pixels.iter().position(|&grey| grey == 255);
        let column = (seen.image.0.start + brightest.expect("one is") % image.width) as f64;
        assert!((column - seen.truth).abs() < 4.0, "{column}");
    }

    /// Readers load all figures of docs/ over a network.
    #[test]
    fn pictures_are_small_and_whole() {
        for name in ["lens", "laser-off", "moving-target"] {
            let scene = Scene::load(name).expect("a scene");
            let folder = std::env::temp_dir().join("slitrange-scenes");
            let path = write(name, name, &scene, &folder).expect("a picture");
            let svg = std::fs::read_to_string(path).expect("a picture");
            println!("{name}: {} bytes", svg.len());
            assert!(svg.len() < 300_000);
            // The rows, and the scale of grey; both before the end.
            assert_eq!(svg.matches("<image").count(), 2);
            assert!(svg.trim_end().ends_with("</svg>"));
            assert_eq!(svg.contains("counts - fit"), name != "laser-off");
        }
    }
}
