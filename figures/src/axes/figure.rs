//! A figure whose curves and points lie on tenths of a pixel.
//!
//! plotters places everything on whole pixels. Here the file has [`FINE`] times as many pixels as it is shown
//! with, so that what is drawn with [`draw_line`] and [`draw_dots`] lies where it belongs.

use std::io;
use std::path::{Path, PathBuf};

use plotters::coord::Shift;
use plotters::element::{Drawable, PointCollection};
use plotters::prelude::*;
use plotters_backend::{
    BackendColor, BackendCoord, BackendStyle, BackendTextStyle, DrawingErrorKind, FontFamily,
    FontStyle, FontTransform, text_anchor,
};

use super::Panel;

/// Pixels of the file for each pixel that is shown.
pub const FINE: i32 = 10;
/// Width of a figure in pixels as it is shown.
const WIDTH: u32 = 1000;

type Drawn = Result<(), DrawingErrorKind<io::Error>>;

/// Begins a figure that is `height` pixels high.
pub fn figure(path: &Path, height: u32) -> anyhow::Result<DrawingArea<Figure<'_>, Shift>> {
    let fine = FINE.unsigned_abs();
    let svg = SVGBackend::new(path, (WIDTH * fine, height * fine));
    let root = Figure {
        svg,
        path: path.to_owned(),
        height,
    }
    .into_drawing_area();
    root.fill(&WHITE)?;
    Ok(root)
}

/// Draws a curve.
pub fn draw_line(
    panel: &mut Panel<'_, '_>,
    points: impl IntoIterator<Item = (f64, f64)>,
    style: ShapeStyle,
) -> anyhow::Result<()> {
    draw(panel, points, style, None)
}

/// Draws a curve in pieces, with gaps between them: the lengths of both, in pixels.
pub fn draw_broken_line(
    panel: &mut Panel<'_, '_>,
    points: impl IntoIterator<Item = (f64, f64)>,
    (piece, gap): (u32, u32),
    style: ShapeStyle,
) -> anyhow::Result<()> {
    let ends = [f64::from(piece), f64::from(piece + gap)].map(|length| length * f64::from(FINE));
    let shape = |places| Shape {
        places,
        radius: None,
        style,
    };
    let pieces = pieces(&places(panel, points), ends);
    panel.draw_series(pieces.into_iter().map(shape))?;
    Ok(())
}

/// The pieces of a line: each is `ends[0]` long, and the next begins `ends[1]` after its beginning.
fn pieces(line: &[BackendCoord], ends: [f64; 2]) -> Vec<Vec<BackendCoord>> {
    let mut pieces = Vec::new();
    let mut piece: Vec<BackendCoord> = line.first().copied().into_iter().collect();
    // How far the last place is from the beginning of the last piece.
    let mut along = 0.0;
    for pair in line.windows(2) {
        let [from, to] = [pair[0], pair[1]].map(|(x, y)| (f64::from(x), f64::from(y)));
        let length = (to.0 - from.0).hypot(to.1 - from.1);
        let mut done = 0.0;
        loop {
            let end = if along < ends[0] { ends[0] } else { ends[1] };
            let step = end - along;
            if done + step > length {
                break;
            }
            done += step;
            let at = |from: f64, to: f64| (from + done / length * (to - from)).round() as i32;
            piece.push((at(from.0, to.0), at(from.1, to.1)));
            if end == ends[0] {
                pieces.push(std::mem::take(&mut piece));
                along = end;
            } else {
                along = 0.0;
            }
        }
        along += length - done;
        if along < ends[0] {
            piece.push(pair[1]);
        }
    }
    pieces.push(piece);
    pieces.retain(|piece| piece.len() > 1);
    pieces
}

/// Draws points as circles.
pub fn draw_dots(
    panel: &mut Panel<'_, '_>,
    points: impl IntoIterator<Item = (f64, f64)>,
    radius: u32,
    style: ShapeStyle,
) -> anyhow::Result<()> {
    draw(panel, points, style, Some(radius))
}

fn draw(
    panel: &mut Panel<'_, '_>,
    points: impl IntoIterator<Item = (f64, f64)>,
    style: ShapeStyle,
    radius: Option<u32>,
) -> anyhow::Result<()> {
    let shape = Shape {
        places: places(panel, points),
        radius,
        style,
    };
    panel.draw_series([shape])?;
    Ok(())
}

/// The file's pixels of a panel's points.
fn places(
    panel: &Panel<'_, '_>,
    points: impl IntoIterator<Item = (f64, f64)>,
) -> Vec<BackendCoord> {
    let (columns, rows) = panel.plotting_area().get_pixel_range();
    let axes = panel.as_coord_spec();
    // The nearest of the file's pixels.
    let fine = |place: f64| (place * f64::from(FINE)).round() as i32;
    let place = |(x, y)| {
        let column = axes.x_spec().place(x, (columns.start, columns.end));
        // The last row is the lowest.
        let row = axes.y_spec().place(y, (rows.end, rows.start));
        (fine(column), fine(row))
    };
    points.into_iter().map(place).collect()
}

/// The file's pixel of a pixel.
fn scaled((x, y): BackendCoord) -> BackendCoord {
    (x * FINE, y * FINE)
}

/// A curve, or circles.
struct Shape {
    /// In the file's pixels.
    places: Vec<BackendCoord>,
    /// Of circles.
    radius: Option<u32>,
    style: ShapeStyle,
}

impl<'a> PointCollection<'a, (f64, f64)> for &'a Shape {
    type Point = &'a (f64, f64);
    type IntoIter = std::iter::Empty<Self::Point>;

    /// None that plotters has to place.
    fn point_iter(self) -> Self::IntoIter {
        std::iter::empty()
    }
}

impl Drawable<Figure<'_>> for Shape {
    fn draw<I: Iterator<Item = BackendCoord>>(
        &self,
        _: I,
        figure: &mut Figure<'_>,
        _: (u32, u32),
    ) -> Drawn {
        let style = Scaled(&self.style);
        match self.radius {
            None => figure.svg.draw_path(self.places.iter().copied(), &style),
            Some(radius) => self.places.iter().try_for_each(|&place| {
                let radius = radius * FINE.unsigned_abs();
                figure
                    .svg
                    .draw_circle(place, radius, &style, self.style.filled)
            }),
        }
    }
}

/// An SVG file with `FINE` times the pixels that plotters knows of.
pub struct Figure<'a> {
    svg: SVGBackend<'a>,
    path: PathBuf,
    height: u32,
}

impl DrawingBackend for Figure<'_> {
    type ErrorType = io::Error;

    fn get_size(&self) -> (u32, u32) {
        (WIDTH, self.height)
    }

    fn ensure_prepared(&mut self) -> Drawn {
        self.svg.ensure_prepared()
    }

    /// Writes the file, and says in it how large it is shown.
    fn present(&mut self) -> Drawn {
        self.svg.present()?;
        let (width, height) = self.svg.get_size();
        let size = |width: u32, height: u32| format!("<svg width=\"{width}\" height=\"{height}\"");
        std::fs::read_to_string(&self.path)
            .map(|text| text.replacen(&size(width, height), &size(WIDTH, self.height), 1))
            .and_then(|text| std::fs::write(&self.path, text))
            .map_err(DrawingErrorKind::DrawingError)
    }

    fn draw_pixel(&mut self, point: BackendCoord, colour: BackendColor) -> Drawn {
        self.draw_rect(point, point, &colour, true)
    }

    fn draw_line<S: BackendStyle>(
        &mut self,
        from: BackendCoord,
        to: BackendCoord,
        style: &S,
    ) -> Drawn {
        self.svg.draw_line(scaled(from), scaled(to), &Scaled(style))
    }

    fn draw_rect<S: BackendStyle>(
        &mut self,
        upper_left: BackendCoord,
        bottom_right: BackendCoord,
        style: &S,
        fill: bool,
    ) -> Drawn {
        let (from, to) = (scaled(upper_left), scaled(bottom_right));
        self.svg.draw_rect(from, to, &Scaled(style), fill)
    }

    fn draw_path<S: BackendStyle, I: IntoIterator<Item = BackendCoord>>(
        &mut self,
        path: I,
        style: &S,
    ) -> Drawn {
        self.svg
            .draw_path(path.into_iter().map(scaled), &Scaled(style))
    }

    fn draw_circle<S: BackendStyle>(
        &mut self,
        centre: BackendCoord,
        radius: u32,
        style: &S,
        fill: bool,
    ) -> Drawn {
        let radius = radius * FINE.unsigned_abs();
        self.svg
            .draw_circle(scaled(centre), radius, &Scaled(style), fill)
    }

    fn fill_polygon<S: BackendStyle, I: IntoIterator<Item = BackendCoord>>(
        &mut self,
        corners: I,
        style: &S,
    ) -> Drawn {
        self.svg
            .fill_polygon(corners.into_iter().map(scaled), &Scaled(style))
    }

    fn draw_text<S: BackendTextStyle>(&mut self, text: &str, style: &S, at: BackendCoord) -> Drawn {
        self.svg.draw_text(text, &Scaled(style), scaled(at))
    }
}

/// A style for the file's pixels.
struct Scaled<'a, S>(&'a S);

impl<S: BackendStyle> BackendStyle for Scaled<'_, S> {
    fn color(&self) -> BackendColor {
        self.0.color()
    }

    fn stroke_width(&self) -> u32 {
        self.0.stroke_width() * FINE.unsigned_abs()
    }
}

impl<S: BackendTextStyle> BackendTextStyle for Scaled<'_, S> {
    type FontError = S::FontError;

    fn color(&self) -> BackendColor {
        self.0.color()
    }

    fn size(&self) -> f64 {
        self.0.size() * f64::from(FINE)
    }

    fn transform(&self) -> FontTransform {
        self.0.transform()
    }

    fn style(&self) -> FontStyle {
        self.0.style()
    }

    fn anchor(&self) -> text_anchor::Pos {
        self.0.anchor()
    }

    fn family(&self) -> FontFamily<'_> {
        self.0.family()
    }

    // The SVG file does not ask for the two below.
    fn layout_box(&self, text: &str) -> Result<((i32, i32), (i32, i32)), Self::FontError> {
        self.0.layout_box(text)
    }

    fn draw<E, F: FnMut(i32, i32, BackendColor) -> Result<(), E>>(
        &self,
        text: &str,
        at: BackendCoord,
        draw: F,
    ) -> Result<Result<(), E>, Self::FontError> {
        self.0.draw(text, at, draw)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::axes::{Axis, panel};

    /// Pieces of 3 with gaps of 2 along 4 to the right and 9 down.
    #[test]
    fn a_broken_line_goes_around_corners() {
        let line = [(0, 0), (4, 0), (4, 9)];
        let expected = [
            vec![(0, 0), (3, 0)],
            vec![(4, 1), (4, 4)],
            vec![(4, 6), (4, 9)],
        ];
        assert_eq!(pieces(&line, [3.0, 5.0]), expected);
        let corner = [vec![(0, 0), (4, 0), (4, 2)], vec![(4, 4), (4, 9)]];
        assert_eq!(pieces(&line, [6.0, 8.0]), corner);
        assert_eq!(pieces(&line[..1], [3.0, 5.0]), Vec::<Vec<_>>::new());
    }

    /// A parabola's points lie within 0.05 px of it, and the figure is shown 1000 px wide.
    #[test]
    fn curves_lie_on_tenths_of_a_pixel() {
        let directory = tempfile::tempdir().expect("a directory");
        let path = directory.path().join("a.svg");
        let curve = |x: f64| x * x;
        let (columns, rows) = {
            let root = figure(&path, 500).expect("a figure");
            let [x, y] = ["x", "y"].map(|name| Axis::linear((0.0, 1.0), name, 5, 1));
            let mut panel = panel(&root, "a curve", 30, &x, &y).expect("a panel");
            let places = (0..=100).map(|step| 0.01 * f64::from(step));
            let points = places.map(|x| (x, curve(x)));
            let line = ShapeStyle::from(BLACK).stroke_width(2);
            draw_line(&mut panel, points.clone(), line).expect("drawn");
            draw_dots(&mut panel, points, 4, RED.filled()).expect("drawn");
            root.present().expect("written");
            panel.plotting_area().get_pixel_range()
        };
        let text = std::fs::read_to_string(&path).expect("text");
        assert!(text.starts_with("<svg width=\"1000\" height=\"500\" viewBox=\"0 0 10000 5000\""));
        assert_eq!(text.matches("<circle").count(), 101);
        let is_curve = |line: &&str| line.matches(',').count() >= 101;
        let line = text.lines().find(is_curve).expect("a line");
        let (_, points) = line.split_once("points=\"").expect("points");
        let mut most: f64 = 0.0;
        for pair in points.trim_end_matches("\"/>").split_whitespace() {
            let (x, y) = pair.split_once(',').expect("a pair");
            let at = |text: &str| text.parse::<f64>().expect("a number") / 10.0;
            let part = |at: f64, from: i32, to: i32| (at - f64::from(from)) / f64::from(to - from);
            let x = part(at(x), columns.start, columns.end);
            let wanted = f64::from(rows.end) + curve(x) * f64::from(rows.start - rows.end);
            most = most.max((at(y) - wanted).abs());
        }
        println!("off by {most:.3} px at most");
        // Half a tenth of a pixel in each direction, with a slope of up to 2 of 441 px on 886 px.
        assert!(most <= 0.05 + 0.05 * 1.0);
    }
}
