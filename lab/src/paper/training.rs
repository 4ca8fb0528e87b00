//! What a sensor's maker measures before: the profile of its rows, and the residuals of eq. (1). On other
//! pieces of the material than the one that is judged.

use anyhow::Context as _;
use phase_tables::{DEFAULT, FINE, IntegerTable, Plan, Widths};
use rayon::prelude::*;
use slitrange::centre::tables::{GAUSSIAN, Sampling, TableSet};
use slitrange::centre::{RowCentre, phase_table};
use slitrange::row::Row;
use slitrange::spot;

use crate::paper::apparatus::{Aperture, TABLE};
use crate::paper::camera::{self, FULL_SCALE, ShotNoise};
use crate::paper::data_set::{Centres, DataSet, JUDGED, Target};
use crate::paper::errors::{self, Tables};
use crate::paper::methods::Method;
use crate::paper::slit_path::{self, COLUMNS, RowTables};
use judges::core_tables;
use judges::measured_profile::MeasuredProfile;

/// Pieces of a material that are measured, usually. Speckle is new on each.
pub const PIECES: u64 = 8;

/// From position to position on a piece, in metres: about the travel over which its speckle changes.
pub const STEP: f64 = 4e-3;

/// The data sets to train on: the positions of one lie between those of the others.
pub fn data_sets(material: usize, aperture: Aperture, seed: u64, pieces: u64) -> Vec<DataSet> {
    let positions = ((TABLE.1 - TABLE.0) / STEP) as usize;
    (0..pieces)
        .map(|piece| DataSet {
            material,
            aperture,
            seed,
            piece: JUDGED + 1 + piece,
            distances: (0..positions)
                .map(|i| TABLE.0 + STEP * (i as f64 + piece as f64 / pieces as f64))
                .collect(),
            captures: 1,
        })
        .collect()
}

#[derive(Clone, Debug)]
pub struct Trained {
    pub residuals: Tables,
    /// Every method's MAE in metres, on pieces whose residuals are not in the tables that it uses.
    pub mae: Vec<(Method, f64)>,
}

/// Trains on data sets: each half of the pieces is judged with the residual tables of the other half.
pub fn train(
    sets: &[DataSet],
    tables: &RowTables<'_>,
    done: &(dyn Fn() + Sync),
) -> anyhow::Result<Trained> {
    let aperture = sets.first().context("no data sets to train on")?.aperture;
    let mut halves = [Centres::default(), Centres::default()];
    for (i, set) in sets.iter().enumerate() {
        halves[i % 2].append(set.measure(tables, done)?);
    }
    let of_halves = [errors::tables(&halves[0])?, errors::tables(&halves[1])?];
    let judged = [
        errors::judge(aperture, &halves[0], &of_halves[1])?,
        errors::judge(aperture, &halves[1], &of_halves[0])?,
    ];
    let of_both = judged[0].iter().zip(&judged[1]);
    let mae = of_both
        .map(|(a, b)| (a.method, 0.5 * (a.mae + b.mae)))
        .collect();
    let [mut all, other] = halves;
    all.append(other);
    Ok(Trained {
        residuals: errors::tables(&all)?,
        mae,
    })
}

/// Of a data set's positions, every so many give rows for the profile.
const POSITIONS_APART: usize = 4;

/// Of their rows, every so many: neighbours share their speckle.
const ROWS_APART: usize = 8;

/// Tables of the profile that the rows of a data set have. Rows that are brighter than the mean, because the
/// others are noisier.
pub fn measured_tables(set: &DataSet) -> anyhow::Result<Vec<IntegerTable>> {
    let target = Target::new(set)?;
    let geometry = camera::geometry(COLUMNS, ShotNoise::Known);
    let positions: Vec<usize> = (0..set.distances.len()).step_by(POSITIONS_APART).collect();
    let rows_of = |&position: &usize| {
        let (exposure, _) = target.expose(position)?;
        let mut counts = vec![];
        target.capture(&exposure, position, 0, &mut counts);
        let rows = counts.as_chunks::<COLUMNS>().0.iter().step_by(ROWS_APART);
        let found = rows.filter_map(|counts| {
            let row = Row::new(counts, &[], FULL_SCALE).ok()?;
            let (spot, _) = spot::find(&row).ok()?;
            let centre =
                phase_table::centre(&row, &spot, None, &geometry, &GAUSSIAN, Sampling::Fine);
            Some((counts.to_vec(), centre.ok()?))
        });
        Ok(found.collect())
    };
    let of_positions = positions.par_iter().map(rows_of);
    let mut rows: Vec<(Vec<u16>, RowCentre)> = of_positions
        .collect::<anyhow::Result<Vec<Vec<_>>>>()?
        .concat();
    let mean = rows
        .iter()
        .map(|(_, row)| row.amplitude.to_f64())
        .sum::<f64>()
        / rows.len() as f64;
    rows.retain(|(_, row)| row.amplitude.to_f64() > mean);
    anyhow::ensure!(!rows.is_empty(), "no row of a training set has a centre");
    let profile = MeasuredProfile::of(&rows);
    // The default's widths, from a third below the measured one to a third above, in samples of two pixels:
    // the core's windows have no room for as many pixels.
    let steps = 4;
    let plan = Plan {
        widths: Widths {
            narrowest: 0.5 * profile.width / FINE.ratio.powi(steps),
            count: 2 * steps as usize + 1,
            ..FINE
        },
        ..DEFAULT
    };
    Ok(phase_tables::set(
        &|offset, width| profile.at(offset, width),
        plan,
    ))
}

/// Calls a function with the tables that the core takes.
pub fn with_tables<T>(
    measured: Option<&[IntegerTable]>,
    then: impl FnOnce(&RowTables<'_>) -> anyhow::Result<T>,
) -> anyhow::Result<T> {
    let speckle = [slit_path::speckle_table()];
    let [speckle, measured] = [&speckle[..], measured.unwrap_or_default()].map(core_tables::borrow);
    let set = |tables| {
        TableSet::new(tables)
            .map_err(|error| anyhow::anyhow!("{error:?}"))
            .context("the core refuses the tables")
    };
    let speckle = set(&speckle)?;
    let measured = match measured.is_empty() {
        true => None,
        false => Some(set(&measured)?),
    };
    then(&RowTables {
        measured: measured.as_ref(),
        speckle: &speckle,
    })
}
