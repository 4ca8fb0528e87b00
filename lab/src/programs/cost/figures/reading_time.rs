//! What a user decides by: the time for a reading against the error of its distance, by each estimator and
//! number of rows, on a surface without speckle and on a rough one.

use figures::axes::{self, Area, Axis, TEXT, TITLE, text};
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use cost_on_chip::methods::Method;

use super::curves::{Curve, Kind, draw_curves};
use super::style::{self, bold};
use crate::prelude::*;
use crate::programs::cost::reading_time::{self, Light, Point, ROWS_PER_SECOND};
use crate::programs::cost::report::Measured;

const MILLISECONDS: [f64; 13] = [
    0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0,
];

const MICROMETRES: [f64; 13] = [
    0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1000.0, 2000.0, 5000.0,
];

/// Numbers of rows that are written at their points.
const NUMBERED: [u64; 4] = [1, 4, 16, 64];

pub fn draw(measured: &Measured, path: &Path) -> anyhow::Result<()> {
    let root = axes::figure(path, 1200)?;
    let root = root.titled(
        "A reading of 1 to 64 rows, target at 0.8 m: its time and its error",
        bold(TITLE, BLACK),
    )?;
    let [quiet, rough] = &root.split_evenly((2, 1))[..] else {
        unreachable!("two halves");
    };
    let points = &measured.readings;
    let title = "Without speckle: four times as many rows halve the error";
    draw_panel(quiet, title, points, Light::NoiseAlone, &[], None)?;
    let title = "White paper: more rows help only if the target moves";
    draw_panel(
        rough,
        title,
        points,
        Light::SpeckleAtRest,
        &[
            ("receding", Light::SpeckleReceding),
            ("sliding", Light::SpeckleSliding),
            ("comb of 16 slits", Light::SpeckleBehindComb),
        ],
        Some(reading_time::speckle_limit()?),
    )?;
    Ok(root.present()?)
}

type Time = fn(&Point) -> f64;
const WITH_SENSOR: Time = |point| point.milliseconds;
const COMPUTING: Time = |point| point.computing_milliseconds;

const ERROR: fn(&Point) -> f64 = |point| point.micrometres;

fn line<'a>(
    points: impl Iterator<Item = &'a Point>,
    time: Time,
    error: fn(&Point) -> f64,
) -> Vec<(f64, f64)> {
    let places = points.map(|point| (time(point), error(point)));
    let is_known = |(time, error): &(f64, f64)| time.is_finite() && error.is_finite();
    places.filter(is_known).collect()
}

fn draw_panel(
    area: &Area<'_>,
    title: &str,
    all: &[Point],
    light: Light,
    moving: &[(&str, Light)],
    limit: Option<f64>,
) -> anyhow::Result<()> {
    let of = |light: Light, estimator: Estimator| {
        all.iter()
            .filter(move |point| point.light == light && point.estimator == estimator)
    };
    let default = Estimator::default();
    let bound = |name, time| {
        let points = of(Light::NoiseAlone, default);
        Curve::bound(name, line(points, time, |point| point.bound_micrometres))
    };
    let mut curves = vec![bound("noise bound", WITH_SENSOR), bound("", COMPUTING)];
    let first = of(light, default).next();
    let last = of(light, default).next_back();
    if let Some((limit, (first, last))) = limit.zip(first.zip(last)) {
        let ends = [first.computing_milliseconds, last.milliseconds];
        curves.push(Curve::bound(
            "speckle's limit",
            ends.map(|time| (time, limit)).into(),
        ));
    }
    for (name, light) in moving {
        curves.push(Curve {
            name: (*name).into(),
            colour: style::BOUND,
            kind: Kind::Measured,
            points: line(of(*light, default), WITH_SENSOR, ERROR),
        });
    }
    // The default estimator lies on top.
    let mut estimators = Estimator::ALL;
    estimators.sort_by_key(|&estimator| estimator == default);
    for estimator in estimators {
        let method = Method::Estimator(estimator);
        let curve = |time| Curve::of(method, line(of(light, estimator), time, ERROR).into_iter());
        curves.push(Curve {
            name: String::new(),
            kind: Kind::Hollow,
            ..curve(COMPUTING)
        });
        curves.push(curve(WITH_SENSOR));
    }

    let places = || curves.iter().flat_map(|curve| &curve.points);
    let range = |of: fn(&(f64, f64)) -> f64, above: f64| {
        let least = places().map(of).fold(f64::INFINITY, f64::min);
        (least * 0.8, places().map(of).fold(0.0, f64::max) * above)
    };
    let above = if limit.is_some() { 3.0 } else { 1.8 };
    let times = range(|at| at.0, 1.35);
    let x = Axis::log(times, "time for a reading, ms", &MILLISECONDS);
    let errors = range(|at| at.1, above);
    let y = Axis::log(errors, "RMS error of the distance, um", &MICROMETRES);
    let panel = draw_curves(area, title, &x, &y, &curves)?;

    // What each group of points is, and the numbers of rows above the default estimator's points.
    let (left, top) = area.get_base_pixel();
    let (_, rows) = panel.plotting_area().get_pixel_range();
    let groups: [(Time, String); 2] = [
        (COMPUTING, "the chip alone".into()),
        (
            WITH_SENSOR,
            format!("with the sensor, {ROWS_PER_SECOND:.0} rows a second"),
        ),
    ];
    for (i, (time, what)) in groups.into_iter().enumerate() {
        let points = || of(light, default).filter(|point| time(point).is_finite());
        // Where the points of both groups lie on one line, only the sensor's are numbered.
        let is_numbered =
            |point: &&Point| NUMBERED.contains(&point.rows) && (i == 1 || limit.is_none());
        for point in points().filter(is_numbered) {
            let (x, y) = panel.backend_coord(&(time(point), point.micrometres));
            let style = text(TEXT, BLACK).pos(Pos::new(HPos::Center, VPos::Bottom));
            let number = match point.rows {
                1 => "1 row".to_owned(),
                rows => rows.to_string(),
            };
            area.draw(&Text::new(number, (x - left, y - top - 9), style))?;
        }
        if let Some(first) = points().next() {
            let (x, _) = panel.backend_coord(&(time(first), first.micrometres));
            let place = (x - left - 8, rows.start - top + 4);
            area.draw(&Text::new(what, place, text(TEXT, style::BOUND)))?;
        }
    }
    Ok(())
}
