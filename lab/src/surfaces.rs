//! How true u is on rough surfaces: a simulated sensor is calibrated on a material, and then reads other
//! places of the same material.

pub mod estimators;
pub mod steps;

use calibration::fit::comb;
use calibration::fit::solve::solve;
use calibration::points::{KnownShape, Point, Setup, Shape, slit_images};
use calibration::positions::{STAGE_MM, even_pixels};
use calibration::record::{self, form};
use judges::frames;
use slitrange::{Options, Reading};
use slitrange_device::record::Record;
use slitrange_device::record::date::Date;

use crate::prelude::*;
use crate::table;

/// The materials, by the scenes that show them. The first is white paper in the light of a laser with a
/// single wavelength; the others have a laser of 1 nm.
pub const MATERIALS: [(&str, &str); 6] = [
    ("white paper", "speckle-at-rest"),
    ("brushed metal", "brushed-metal"),
    ("rusty metal", "rusty-metal"),
    ("light wood", "light-wood"),
    ("black tape", "black-tape"),
    ("microfiber", "microfiber"),
];

/// Distances over which sensors are judged: the paper's position table, in metres.
pub const TABLE: [f64; 2] = [0.60, 1.02];

/// Distances of a calibration's points, in millimetres: a little more than the table.
const POINTS_MM: [f64; 2] = [580.0, 1050.0];

/// Rows in a frame: the firmware's default.
pub const ROWS: u16 = 16;

/// Measures a frame of a target at rest on a surface, at a distance in metres. The rows have numbers from
/// `first` on.
pub fn frame_from(
    scene: &Scene,
    surface: u64,
    distance: f64,
    first: u64,
) -> Result<Measured, Fault> {
    let simulation = Simulation::on_surface(scene.clone(), surface);
    let slits = match scene.comb {
        Some(_) => Slits::Comb,
        None => Slits::One,
    };
    let options = with(Options::default(), |it| (it.rows, it.slits) = (ROWS, slits));
    frames::measure(&simulation, options, distance, first, None)
}

/// The same with other noise for each surface.
fn frame(scene: &Scene, surface: u64, distance: f64) -> Result<Measured, Fault> {
    frame_from(scene, surface, distance, u64::from(ROWS) * surface)
}

/// Calibrates a sensor on a material, as its owner does: points at known distances, each on another place of
/// the surface, then the tool's fit. `first` is the number of the first surface.
pub fn calibrate(scene: &Scene, points: usize, first: u64) -> Result<Record> {
    let positions = even_pixels(POINTS_MM[0], POINTS_MM[1], points, STAGE_MM)?;
    let points: Vec<Point> = (positions.into_par_iter().enumerate())
        .filter_map(|(index, d_mm)| {
            let line = index as u64 + 2;
            // A place without a centre is passed over for the next one.
            let frame = (0..10)
                .find_map(|other| frame(scene, first + 10 * line + other, 1e-3 * d_mm).ok())?;
            Some(Point {
                line,
                x_px: frame.frame.centre.to_f64(),
                d_mm,
                sigma_px: Some(frame.frame.uncertainty.to_f64()),
                height_counts: Some(frame.frame.amplitude.to_f64()),
                shape: Some(shape_of(&frame)),
                slits: frame.comb.map(|comb| slit_images(&comb.centres)),
            })
        })
        .collect();
    let comb = comb::fit(&points)?;
    let solved = solve(comb.as_ref().map_or(&points, |comb| &comb.points), None)?;
    let made = form::make(&solved, None)?;
    let setup = Setup {
        serial_number: Some(1),
        estimator: Some(Estimator::default()),
        ..Setup::default()
    };
    let date = Date::new(2026, 11, 22).context("a day")?;
    Ok(record::of(&setup, date, &solved, &made, comb.as_ref()))
}

/// The shape of a frame's spot, as the tool reads it from the serial line.
fn shape_of(measured: &Measured) -> KnownShape {
    let shape = measured.frame.shape;
    KnownShape {
        shape: Shape {
            width_px: shape.width.to_f64(),
            components_px: shape.components.map(Pixels::to_f64),
        },
        noise_px: measured.frame.uncertainty.to_f64(),
    }
}

/// A reading and how far it is off, in micrometres.
#[derive(Clone, Copy, Debug)]
pub struct Judged {
    pub reading: Reading,
    /// Distance less truth.
    pub error: f64,
}

impl Judged {
    pub fn in_u(&self) -> f64 {
        self.error / self.reading.uncertainty.to_f64()
    }
}

/// The distance of a surface in metres within a range, by an additive recurrence with the golden ratio: even
/// over the range for any number of surfaces.
pub fn distance_within([first, last]: [f64; 2], number: u64) -> f64 {
    first + (number as f64 * 0.618_033_988_749_895).fract() * (last - first)
}

/// Frames of `count` surfaces at distances spread over the table, which are given in metres.
pub fn see(scene: &Scene, count: u64, first: u64) -> Vec<(f64, Measured)> {
    (first..first + count)
        .into_par_iter()
        .filter_map(|number| {
            let distance = distance_within(TABLE, number);
            Some((distance, frame(scene, number, distance).ok()?))
        })
        .collect()
}

/// A frame as a sensor with a record sees it: the sensor knows its own spot.
pub fn known(measured: &Measured, record: &Record) -> Measured {
    let own = record.profile.map(|own| own.at(measured.frame.centre));
    Measured {
        by_shape: (measured.estimator).by_shape(&measured.frame.shape, own.as_ref()),
        ..*measured
    }
}

pub fn judge(seen: &[(f64, Measured)], record: &Record) -> Vec<Judged> {
    let calibration = Some(&record.calibration);
    (seen.iter())
        .filter_map(|(distance, measured)| {
            let measured = known(measured, record);
            let reading = measured.reading(calibration, &record.errors, Surface::Auto);
            let reading = reading.ok()?;
            Some(Judged {
                reading,
                error: reading.distance.to_f64() - 1e6 * distance,
            })
        })
        .collect()
}

#[derive(Clone, Debug)]
pub struct Study {
    pub name: &'static str,
    /// Readings of sensors that were calibrated on it.
    pub own: Summary,
    /// Readings of the same surfaces with the nominal calibration.
    pub nominal: Summary,
    /// The same without the tolerances of an unadjusted head, which these heads do not have.
    pub physical: Summary,
}

pub const POINTS: usize = 60;

impl Study {
    /// Calibrates sensors on a material, and lets each read surfaces of its own.
    pub fn run(name: &'static str, scene: &str, sensors: u64, surfaces: u64) -> Result<Self> {
        let scene = Scene::load(scene)?;
        let nominal_record = Record::nominal().context("the nominal calibration")?;
        let errors = CalibrationErrors::Unknown;
        let physical_record = with(nominal_record.clone(), |it| it.errors = errors);
        let (mut own, mut nominal, mut physical) = (vec![], vec![], vec![]);
        for sensor in 1..=sensors {
            // Surfaces that no other sensor sees: first those of its calibration.
            let first = 100_000 * sensor;
            let record = calibrate(&scene, POINTS, first)?;
            let seen = see(&scene, surfaces, first + 50_000);
            own.extend(judge(&seen, &record));
            nominal.extend(judge(&seen, &nominal_record));
            physical.extend(judge(&seen, &physical_record));
        }
        Ok(Self {
            name,
            own: Summary::of(&own),
            nominal: Summary::of(&nominal),
            physical: Summary::of(&physical),
        })
    }
}

pub fn report(studies: &[Study]) -> String {
    let percent = |share: f64| format!("{:.1} %", 100.0 * share);
    let rows = studies.iter().map(|study| {
        let it = &study.own;
        let mut row = vec![
            study.name.to_owned(),
            it.count.to_string(),
            format!("{:.0}", it.rms),
            format!("{:.0}", it.median_u),
            format!("{:.1}", it.median_r),
        ];
        row.extend(it.within.map(percent));
        row.extend([study.nominal, study.physical].map(|it| percent(it.within[1])));
        row
    });
    let head = "material | readings | RMS error | median u | median r | within u | 2u | 3u \
                | nominal: within 2u | its surface part alone: within 2u";
    format!(
        "Simulated on a PC: sensors that are calibrated with 60 points on a material, and then read other \
         places of it, at 0.60 to 1.02 m, in frames of 16 rows. Lengths in um; within 2u: the share of errors \
         that are at most twice u, which is 95.4 % for normal errors.\n\n{}",
        table::of(head, rows)
    )
}

#[derive(Clone, Copy, Debug)]
pub struct Summary {
    pub count: usize,
    /// Root mean square error in micrometres.
    pub rms: f64,
    /// Median of u in micrometres.
    pub median_u: f64,
    /// Median of r in micrometres.
    pub median_r: f64,
    /// Shares of the errors within u, 2 u and 3 u.
    pub within: [f64; 3],
}

impl Summary {
    pub fn of(judged: &[Judged]) -> Self {
        let count = judged.len();
        let median = |value: &dyn Fn(&Reading) -> f64| {
            upper_median(judged.iter().map(|it| value(&it.reading)))
        };
        Self {
            count,
            rms: rms(judged.iter().map(|it| it.error)),
            median_u: median(&|reading| reading.uncertainty.to_f64()),
            median_r: median(&|reading| reading.parts.noise.to_f64()),
            within: [1.0, 2.0, 3.0].map(|times| {
                judged.iter().filter(|it| it.in_u().abs() <= times).count() as f64 / count as f64
            }),
        }
    }
}
