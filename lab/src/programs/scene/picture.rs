//! A scene's picture: its rows as the sensor sees them, one of them with the fit over it, and what the fit
//! leaves.

use statistics::upper_median;
use std::ops::Range;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result};
use figures::axes::{self, GRID};
use figures::dark::{BLUE as COUNTS, RED as FIT};
use phase_tables::gaussian;
use plotters::coord::Shift;
use plotters::prelude::*;
use simulator::optics::Aperture;
use simulator::scene::{Scene, Simulation, quantise};
use slitrange::base::fault::Fault;
use slitrange::centre::{Estimator, RowCentre};

use crate::budget::row_centre;
use crate::programs::scene::embedded::Grey;
use crate::programs::scene::words;

/// Rows of a line sensor that are shown.
const ROWS: u64 = 48;

/// The width of a spot that a dark row might have, in pixels.
const DARK: f64 = 8.0;

/// The name of the row's axis.
const PIXELS: &str = "pixel of the light range";

const SIZE: (u32, u32) = (1000, 900);
const TEXT: i32 = 17;
const TITLE: i32 = 20;
const SMALL: i32 = 15;

/// Draws a scene into `folder`, and gives the file's path.
///
/// # Errors
/// The file cannot be written.
pub fn write(name: &str, scene: &Scene, estimator: Estimator, folder: &Path) -> Result<PathBuf> {
    write_as(name, name, scene, estimator, folder)
}

/// The same under another file name.
///
/// # Errors
/// The file cannot be written.
pub fn write_as(
    file: &str,
    name: &str,
    scene: &Scene,
    estimator: Estimator,
    folder: &Path,
) -> Result<PathBuf> {
    std::fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
    let path = folder.join(format!("{file}.svg"));
    let svg = Seen::of(scene, estimator).draw(name)?;
    std::fs::write(&path, svg).with_context(|| path.display().to_string())?;
    Ok(path)
}

/// What is shown.
struct Seen<'a> {
    scene: &'a Scene,
    estimator: Estimator,
    /// Counts of the light range, row by row.
    rows: Vec<Vec<u16>>,
    /// The pixels of the image, and its rows.
    image: (Range<usize>, Range<usize>),
    /// Which of the rows is fitted.
    row: usize,
    /// The pixels of that row that are shown.
    window: Range<usize>,
    fit: Result<RowCentre, Fault>,
    /// The true centre of that row.
    truth: f64,
}

impl<'a> Seen<'a> {
    fn of(scene: &'a Scene, estimator: Estimator) -> Self {
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
        let fit = row_centre(&counts[row], &geometry, estimator);
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
            estimator,
            rows: counts.iter().map(light).collect(),
            image: (image, image_rows),
            row,
            window: around(truth, truth),
            fit,
            truth,
        }
    }

    fn draw(&self, name: &str) -> Result<String> {
        let mut svg = String::new();
        let mut fine = Fine::default();
        let (image, bar) = {
            let root = SVGBackend::with_string(&mut svg, SIZE).into_drawing_area();
            root.fill(&WHITE)?;
            let (head, rest) = root.split_vertically(78);
            self.draw_head(&head, name)?;
            let (top, rest) = rest.split_vertically(330);
            let places = self.draw_image_axes(&top)?;
            match self.fit_and_level() {
                Some((fit, level)) => {
                    let (middle, bottom) = rest.split_vertically(300);
                    self.draw_row(&middle, "", &mut fine)?;
                    self.draw_residuals(&bottom, fit, level, &mut fine)?;
                }
                None => self.draw_row(&rest, PIXELS, &mut fine)?,
            }
            root.present()?;
            places
        };
        let end = svg.rfind("</svg>").context("no end of the SVG file")?;
        svg.insert_str(end, &fine.0);
        self.grey().place(&mut svg, image)?;
        let scale = Grey {
            width: 8,
            pixels: (0..=255).rev().flat_map(|grey| [grey; 8]).collect(),
        };
        scale.place(&mut svg, bar)?;
        Ok(svg)
    }

    fn draw_head(&self, head: &Area<'_>, name: &str) -> Result<()> {
        let style = ("sans-serif", TITLE, FontStyle::Bold).into_font();
        head.draw(&Text::new(name.to_owned(), (16, 8), style))?;
        let about = cut(&self.scene.about, 130);
        head.draw(&Text::new(about, (16, 33), text(SMALL)))?;
        let setting = words::setting(self.scene);
        head.draw(&Text::new(setting, (16, 54), text(SMALL)))?;
        Ok(())
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
    #[expect(clippy::type_complexity, reason = "two places, as plotters has them")]
    fn draw_image_axes(
        &self,
        area: &Area<'_>,
    ) -> Result<((Range<i32>, Range<i32>), (Range<i32>, Range<i32>))> {
        let (pixels, rows) = &self.image;
        let title = match self.scene.sensor.rows() {
            1 => "rows of the sensor, one after the other".to_owned(),
            _ => "a frame of the sensor".to_owned(),
        };
        // Row 0 is at the top: heights are negative row numbers.
        let heights = 0.5 - rows.end as f64..0.5 - rows.start as f64;
        let mut panel = builder(area, &title, "").build_cartesian_2d(columns(pixels), heights)?;
        panel
            .configure_mesh()
            .disable_mesh()
            .x_labels(12)
            .y_labels(6)
            .axis_style(BLACK)
            .label_style(text(TEXT))
            .x_label_formatter(&whole)
            .y_label_formatter(&|height| whole(&height.abs()))
            .y_desc("row")
            .axis_desc_style(text(TEXT))
            .draw()?;
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
        for (label, at) in [
            (format!("{to}"), heights.start + 2),
            (format!("{from}"), heights.end - TEXT),
            (
                "counts".to_owned(),
                (heights.start + heights.end) / 2 - TEXT / 2,
            ),
        ] {
            area.draw(&Text::new(
                label,
                (bar.end + 6 - left, at - top),
                text(SMALL),
            ))?;
        }
        Ok(((across, heights.clone()), (bar, heights)))
    }

    /// The counts of the row with the fit, where there is one.
    fn draw_row(&self, area: &Area<'_>, x_name: &str, fine: &mut Fine) -> Result<()> {
        let counts = self.counts();
        let title = match &self.fit {
            Ok(fit) => format!(
                "row {}, {}: centre {:.3} px, {:+.4} px off the truth (claimed ± {:.4}); sigma {:.2} px, \
                 height {:.0} counts",
                self.row,
                self.estimator.name(),
                fit.centre.to_f64(),
                fit.centre.to_f64() - self.truth,
                fit.uncertainty.to_f64(),
                fit.width.to_f64(),
                fit.amplitude.to_f64()
            ),
            Err(fault) => format!(
                "row {}, {}: {}",
                self.row,
                self.estimator.name(),
                fault.name()
            ),
        };
        let (low, high) = range(counts.iter().map(|(_, count)| *count));
        let margin = 0.08 * (high - low).max(10.0);
        let heights = low - margin..high + margin;
        let mut panel = builder(area, &title, x_name)
            .build_cartesian_2d(columns(&self.window), heights.clone())?;
        mesh(&mut panel, "counts", x_name, 6)?;
        fine.draw_dots(&panel, &counts, 3);
        if let Some((fit, level)) = self.fit_and_level() {
            let steps = self.window.len() * 8;
            let columns = columns(&self.window);
            let curve = (0..=steps).map(|i| {
                let x = columns.start + i as f64 / 8.0;
                (x, level + model(fit, x))
            });
            fine.draw_line(&panel, curve, 2);
            let centre = fit.centre.to_f64();
            fine.draw_line(&panel, [heights.start, heights.end].map(|y| (centre, y)), 1);
        }
        Ok(())
    }

    /// The counts less the fit.
    fn draw_residuals(
        &self,
        area: &Area<'_>,
        fit: &RowCentre,
        level: f64,
        fine: &mut Fine,
    ) -> Result<()> {
        let left: Vec<(f64, f64)> = self
            .counts()
            .into_iter()
            .map(|(x, count)| (x, count - level - model(fit, x)))
            .collect();
        let (low, high) = range(left.iter().map(|(_, count)| *count));
        let end = 1.1 * low.abs().max(high.abs()).max(1.0);
        let mut panel =
            builder(area, "", PIXELS).build_cartesian_2d(columns(&self.window), -end..end)?;
        mesh(&mut panel, "counts - fit", PIXELS, 5)?;
        let Range { start, end } = columns(&self.window);
        fine.draw_line(&panel, [start, end].map(|x| (x, 0.0)), 1);
        fine.draw_dots(&panel, &left, 2);
        Ok(())
    }

    /// Pixels and counts of the fitted row.
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

/// Curves and dots on hundredths of a pixel, as SVG. plotters places everything on whole pixels.
#[derive(Default)]
struct Fine(String);

impl Fine {
    /// Draws the fit's curve, or a line of its colour.
    fn draw_line(
        &mut self,
        panel: &Panel<'_, '_>,
        points: impl IntoIterator<Item = (f64, f64)>,
        width: u32,
    ) {
        let places = points.into_iter().map(|point| {
            let (x, y) = place(panel, point);
            format!("{x:.2},{y:.2}")
        });
        let places = places.collect::<Vec<_>>().join(" ");
        self.0 += &format!(
            "<polyline fill=\"none\" stroke=\"{}\" stroke-width=\"{width}\" points=\"{places}\"/>\n",
            hex(FIT)
        );
    }

    /// Draws counts.
    fn draw_dots(&mut self, panel: &Panel<'_, '_>, points: &[(f64, f64)], radius: u32) {
        for &point in points {
            let (x, y) = place(panel, point);
            self.0 += &format!(
                "<circle cx=\"{x:.2}\" cy=\"{y:.2}\" r=\"{radius}\" fill=\"{}\"/>\n",
                hex(COUNTS)
            );
        }
    }
}

/// The place of a panel's point in the picture, in pixels.
fn place(panel: &Panel<'_, '_>, (x, y): (f64, f64)) -> (f64, f64) {
    let (columns, rows) = panel.plotting_area().get_pixel_range();
    let part = |value: f64, range: Range<f64>| (value - range.start) / (range.end - range.start);
    let (along, up) = (part(x, panel.x_range()), part(y, panel.y_range()));
    (
        f64::from(columns.start) + along * f64::from(columns.end - columns.start),
        f64::from(rows.end) - up * f64::from(rows.end - rows.start),
    )
}

/// A colour in SVG.
fn hex(RGBColor(red, green, blue): RGBColor) -> String {
    format!("#{red:02x}{green:02x}{blue:02x}")
}

/// From the left edge of the first pixel to the right edge of the last.
fn columns(pixels: &Range<usize>) -> Range<f64> {
    pixels.start as f64 - 0.5..pixels.end as f64 - 0.5
}

/// What a pixel at x gathers of the fitted gaussian, in counts.
fn model(fit: &RowCentre, x: f64) -> f64 {
    fit.amplitude.to_f64() * gaussian(x - fit.centre.to_f64(), fit.width.to_f64())
}

fn builder<'a, 'b>(
    area: &'b Area<'a>,
    title: &str,
    x_name: &str,
) -> ChartBuilder<'b, 'b, SVGBackend<'a>> {
    let below = match x_name {
        "" => TEXT + 10,
        _ => 2 * TEXT + 16,
    };
    let mut builder = ChartBuilder::on(area);
    builder
        .margin_right(96)
        .margin_left(8)
        .margin_bottom(4)
        .x_label_area_size(below)
        .y_label_area_size(78);
    if !title.is_empty() {
        builder.caption(title, text(SMALL));
    }
    builder
}

fn mesh(panel: &mut Panel<'_, '_>, y_name: &str, x_name: &str, labels: usize) -> Result<()> {
    panel
        .configure_mesh()
        .bold_line_style(GRID)
        .max_light_lines(0)
        .axis_style(BLACK)
        .label_style(text(TEXT))
        .axis_desc_style(text(TEXT))
        .x_labels(12)
        .y_labels(labels)
        .x_label_formatter(&whole)
        .y_label_formatter(&whole)
        .y_desc(y_name)
        .x_desc(x_name)
        .draw()?;
    Ok(())
}

/// A drawing, or a part of one. Its image has whole pixels.
type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;

/// A part with axes.
type Panel<'a, 'b> = ChartContext<'b, SVGBackend<'a>, Plane>;

type Plane =
    Cartesian2d<plotters::coord::types::RangedCoordf64, plotters::coord::types::RangedCoordf64>;

fn text(size: i32) -> TextStyle<'static> {
    axes::text(size, BLACK)
}

fn whole(value: &f64) -> String {
    // Not "-0".
    format!("{:.0}", value + 0.0)
}

fn range(values: impl Iterator<Item = f64>) -> (f64, f64) {
    values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| {
        (low.min(value), high.max(value))
    })
}

/// At most so many characters, cut at a word.
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
        let seen = Seen::of(&scene, Estimator::default());
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
            let svg = (Seen::of(&scene, Estimator::default()).draw(name)).expect("a picture");
            println!("{name}: {} bytes", svg.len());
            assert!(svg.len() < 300_000);
            // The rows, and the scale of grey; both before the end.
            assert_eq!(svg.matches("<image").count(), 2);
            assert!(svg.trim_end().ends_with("</svg>"));
            let fitted = svg.contains("counts - fit");
            assert_eq!(fitted, name != "laser-off");
        }
    }
}
