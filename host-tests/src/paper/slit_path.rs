//! The slit's captures through the core: rows in, the centres of frames out.

use phase_tables::{Background, Plan, Widths};
use slitrange::estimator::tables::{Sampling, TableSet};
use slitrange::estimator::{Estimator, RowCentre, centre, phase_table};
use slitrange::reading::Fault;
use slitrange::row::{Geometry, Row};
use slitrange::spot::{self, Spot};

use crate::paper::apparatus::{Aperture, BASELINE, SLIT, TABLE};
use crate::paper::camera::{self, Exposure, FULL_SCALE, PITCH, ROWS, ShotNoise};
use crate::paper::data_set::DataSet;
use crate::paper::materials::{MATERIALS, Material};
use crate::paper::methods::RowEstimator;
use crate::paper::row_mean::{RowFit, RowMean};
use crate::paper::stub_field::{Surface, slit_image};
use crate::paper::apparatus;

/// Pixels of a row that are simulated, around the spot. The spot's sigma is 10 to 13 pixels and its side lobes end at some 60: more
/// than half of them are background, from which the core tells level and noise (medians over blocks), and 12 sigma to
/// either side are more than any estimator looks at. The other 1664 would tell the noise to 2 % in place of 6 %.
pub const COLUMNS: usize = 256;

/// The light is computed on every so many rows, and interpolated between them: the speckle of a spot of half a millimetre is some
/// 150 rows high.
const ROW_STEP: usize = 4;

/// The mean peak in counts: a quarter of full scale, because a speckle pattern's peaks are several times its mean.
pub const PEAK: f64 = 0.25 * FULL_SCALE as f64;

/// Tables that the core does not have.
#[derive(Clone, Copy)]
pub struct RowTables<'a> {
    /// Of the profile that rows of the sensor have, where it was measured.
    pub measured: Option<&'a TableSet<'a>>,
    /// One table, narrower than the spot.
    pub narrow: &'a TableSet<'a>,
}

/// Width of the narrow table in pixels: three quarters of the spot's. Chosen by the scatter of simulated frames, which from 5 to 9 pixels
/// changes by 2 %.
pub const NARROW_WIDTH: f64 = 8.0;

/// What the narrow table is designed for: least squares.
pub const NARROW: Plan = Plan {
    noise_ratio: f64::INFINITY,
    background: Background::Level,
    widths: Widths {
        narrowest: NARROW_WIDTH,
        ratio: 1.0,
        count: 1,
        phases: 3.0,
    },
};

/// The centres of the captures at a position, by every method: a value for each of
/// [`CentreMethod::all`](crate::paper::methods::CentreMethod::all), not a number where there is none.
pub fn centres(
    set: &DataSet,
    surface: &Surface,
    tables: &RowTables<'_>,
    position: usize,
    distance: f64,
) -> Vec<Vec<f64>> {
    let (exposure, first) = expose(set, surface, distance);
    let mut counts = Vec::with_capacity(ROWS * COLUMNS);
    (0..set.captures)
        .map(|capture| {
            let mut random = camera::noise(set.noise_seed(), position as u64, capture as u64);
            exposure.capture(&mut random, &mut counts);
            let rows = fit_rows(&counts, tables);
            rows.iter()
                .flat_map(|rows| {
                    RowMean::ALL.map(|mean| mean.of(rows).map_or(f64::NAN, |c| c + first as f64))
                })
                .collect()
        })
        .collect()
}

/// The light of a position, and the sensor's column at which it begins.
pub fn expose(set: &DataSet, surface: &Surface, distance: f64) -> (Exposure, usize) {
    let centre = apparatus::centre(Aperture::Slit, distance);
    let first = centre.round() as usize - COLUMNS / 2;
    let columns: Vec<f64> = (first..first + COLUMNS)
        .map(|column| (column as f64 - centre) * PITCH)
        .collect();
    let rows: Vec<f64> = (0..=ROWS.div_ceil(ROW_STEP))
        .map(|i| ((i * ROW_STEP) as f64 - (ROWS as f64 - 1.0) / 2.0) * PITCH)
        .collect();
    let image = slit_image(surface, &set.view(distance), &SLIT, &columns, &rows);
    let counts = (PEAK * brightness(&MATERIALS[set.material], distance)) as f32;
    let light = (0..ROWS * COLUMNS).map(|i| {
        let (row, column) = (i / COLUMNS, i % COLUMNS);
        let (above, part) = (row / ROW_STEP, (row % ROW_STEP) as f32 / ROW_STEP as f32);
        let at = |row: usize| image.light[row * COLUMNS + column];
        counts * (at(above) * (1.0 - part) + at(above + 1) * part)
    });
    (Exposure::new(light), first)
}

/// The spot's mean brightness at a distance, over its mean along the table: the material's lobe, and the square of the way to
/// the slit.
fn brightness(material: &Material, distance: f64) -> f64 {
    let at = |distance: f64| {
        let way = BASELINE.hypot(distance);
        material.lobe.brightness((BASELINE / distance).atan()) / (way * way)
    };
    const SAMPLES: usize = 64;
    let mean: f64 = (0..SAMPLES)
        .map(|i| at(TABLE.0 + (TABLE.1 - TABLE.0) * (i as f64 + 0.5) / SAMPLES as f64))
        .sum::<f64>()
        / SAMPLES as f64;
    at(distance) / mean
}

/// The rows of a capture that have a centre, for each estimator. As the core's pipeline does, a row is searched near the spot of the
/// row before; the estimators share that search.
pub fn fit_rows(
    counts: &[u16],
    tables: &RowTables<'_>,
) -> [Vec<RowFit>; RowEstimator::ALL.len()] {
    let known = camera::geometry(COLUMNS, ShotNoise::Known);
    let ignored = camera::geometry(COLUMNS, ShotNoise::Ignored);
    let mut found = RowEstimator::ALL.map(|_| Vec::with_capacity(ROWS));
    let mut last_spot: Option<(Spot, RowCentre)> = None;
    let mut last = [None; RowEstimator::ALL.len()];
    for row in counts.chunks_exact(COLUMNS) {
        let row = Row::new(row, &[], FULL_SCALE).expect("a camera of 12 bits");
        let spot = match &last_spot {
            Some((spot, centre)) => spot::find_again(&row, spot, centre.width),
            None => spot::find(&row),
        };
        let Ok(spot) = spot else {
            (last_spot, last) = (None, Default::default());
            continue;
        };
        for ((estimator, last), found) in RowEstimator::ALL.into_iter().zip(&mut last).zip(&mut found)
        {
            let geometry = match estimator {
                RowEstimator::Gaussian => &ignored,
                _ => &known,
            };
            *last = centre_of(estimator, &row, &spot, last.as_ref(), geometry, tables).ok();
            found.extend(last.map(|centre| RowFit {
                centre: centre.centre.to_f64(),
                amplitude: centre.amplitude.to_f64(),
            }));
        }
        last_spot = last[RowEstimator::PhaseTable as usize].map(|centre| (spot, centre));
    }
    found
}

fn centre_of(
    estimator: RowEstimator,
    row: &Row<'_>,
    spot: &Spot,
    before: Option<&RowCentre>,
    geometry: &Geometry,
    tables: &RowTables<'_>,
) -> Result<RowCentre, Fault> {
    let rung = |rung| centre(rung, row, spot, before, geometry);
    let with = |tables| phase_table::centre(row, spot, before, geometry, tables, Sampling::Fine);
    match estimator {
        RowEstimator::Gaussian => rung(Estimator::GaussNewton),
        RowEstimator::Fraunhofer => rung(Estimator::Fraunhofer),
        RowEstimator::PhaseTable => rung(Estimator::PhaseTable),
        RowEstimator::Adaptive => rung(Estimator::Adaptive),
        RowEstimator::Robust => rung(Estimator::Robust),
        RowEstimator::MeasuredProfile => tables.measured.map_or_else(
            || Err(Fault::NoSpot { amplitude: spot.height }),
            with,
        ),
        RowEstimator::Narrow => with(tables.narrow),
    }
}
