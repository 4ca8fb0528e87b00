//! [`slitrange::centre::phase_table`] in f64: the window is moved and the table changed until both fit.

use crate::support::*;
use phase_tables::{Plan, Profile, design};
use slitrange::centre::tables::Table;

#[derive(Clone, Debug)]
pub struct Weights {
    width: f64,
    half_width: i64,
    /// Score, slope and stretch of each phase.
    phases: Vec<[Vec<f64>; 3]>,
    near_limit: f64,
    centre_per_ratio: f64,
    bend: f64,
    stretch_per_ratio: f64,
}

/// The core's own tables, in integers.
pub fn integer(tables: &[Table<'_>]) -> Vec<Weights> {
    let weights = |table: &Table<'_>| {
        let flat = |pairs: Vec<dual_mac::Pair>| -> Vec<f64> {
            let weights = pairs.iter().flat_map(|pair| [pair.0, pair.1]);
            weights.map(f64::from).take(table.taps()).collect()
        };
        let of_phase = |(weights, stretch): (&[dual_mac::Pairs], &[dual_mac::Pair])| {
            [
                flat(weights.iter().map(|pairs| pairs.0).collect()),
                flat(weights.iter().map(|pairs| pairs.1).collect()),
                flat(stretch.to_vec()),
            ]
        };
        let stretch = table.stretch.chunks(table.pairs());
        let phases = table.weights.chunks(table.pairs()).zip(stretch);
        Weights {
            width: libm::ldexp(table.width.into(), -16),
            half_width: i64::from(table.half_width),
            phases: phases.map(of_phase).collect(),
            near_limit: libm::ldexp(table.near_limit.into(), -26),
            centre_per_ratio: libm::ldexp(table.centre_per_ratio.into(), -25),
            bend: libm::ldexp(table.bend.into(), -31),
            stretch_per_ratio: libm::ldexp(table.stretch_per_ratio.into(), -25),
        }
    };
    tables.iter().map(weights).collect()
}

/// The same before they become integers.
pub fn exact(profile: Profile<'_>, plan: Plan) -> Vec<Weights> {
    let weights = |i: usize| {
        let width = plan.widths.narrowest * plan.widths.ratio.powi(i as i32);
        let shape = plan.shape(width);
        let table = design(profile, shape, plan.noise_ratio, plan.background);
        let of_phase = |k: usize| {
            [&table.score, &table.slope, &table.stretch]
                .map(|rows| rows[k].iter().copied().collect())
        };
        Weights {
            width,
            half_width: table.shape.half_width as i64,
            phases: (0..table.shape.phases).map(of_phase).collect(),
            near_limit: table.shape.near_limit(),
            centre_per_ratio: 1.0,
            bend: table.bend,
            stretch_per_ratio: 1.0,
        }
    };
    (0..plan.widths.count).map(weights).collect()
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Found {
    /// The centre in pixels.
    pub centre: f64,
    /// Pixels in a sample.
    pub block: u8,
    /// Index of the table.
    pub table: usize,
    /// The window's first pixel, and its phase: rows with the same are weighed by the same.
    pub window: (usize, usize),
}

/// The centre of a spot that the core's coarse search found. `None` where no table fits.
pub fn centre(light: &[u16], spot: &Spot, tables: &[Weights]) -> Option<Found> {
    let start = spot.centre as f64;
    let start_width = 0.9 * f64::from(1 << spot.block_log2);
    let mut at = start;
    let (mut block, mut index) = choose(tables, start_width);
    let mut cut = false;
    for pass in 0..10 {
        let table = &tables[index];
        let Some(look) = Look::at(light, at, block, table) else {
            cut = true;
            let narrower = table.width * f64::from(block) * 0.7;
            (block, index) = choose(tables, narrower);
            if narrower < 0.6 {
                return None;
            }
            continue;
        };
        if look.slope <= 0.0 {
            return None;
        }
        at = look.centre;
        let width = table.width * f64::from(block) * (1.0 + look.stretch);
        if (at - start).abs() > 4.0 * start_width {
            return None;
        }
        let (steps, margin) = match if cut { 0 } else { pass } {
            0..=3 => (1.0, 0.005),
            4..=6 => (2.0, 0.1),
            _ => (2.0, 0.3),
        };
        let better = choose(tables, width);
        let fits =
            mismatch(tables, (block, index), width) <= mismatch(tables, better, width) + margin;
        if fits && look.distance.abs() <= steps * look.near_limit {
            return (0.6..150.0).contains(&width).then_some(Found {
                centre: at,
                block,
                table: index,
                window: look.window,
            });
        }
        if fits {
            cut = false;
        } else {
            (block, index) = better;
        }
    }
    None
}

/// Pixels in a sample, and the table for a width, with samples as fine as may be.
fn choose(tables: &[Weights], width: f64) -> (u8, usize) {
    // Half a step between the widths, and a tenth of it.
    let reach = 0.6 * (tables[1].width / tables[0].width - 1.0);
    let widest = tables[tables.len() - 1].width * (1.0 + reach);
    let mut blocks = BLOCKS.into_iter();
    let block = blocks.find(|&block| width <= widest * f64::from(block));
    let block = block.unwrap_or(16);
    let samples = width / f64::from(block);
    let narrower = |pair: &&[Weights]| samples * samples > pair[0].width * pair[1].width;
    (block, tables.windows(2).take_while(narrower).count())
}

fn mismatch(tables: &[Weights], (block, index): (u8, usize), width: f64) -> f64 {
    (width / (tables[index].width * f64::from(block)) - 1.0).abs()
}

/// What the window says whose phase is nearest to a place.
struct Look {
    centre: f64,
    window: (usize, usize),
    distance: f64,
    near_limit: f64,
    slope: f64,
    stretch: f64,
}

impl Look {
    /// `None` where it reaches over the sensor's edge.
    fn at(light: &[u16], at: f64, block: u8, table: &Weights) -> Option<Self> {
        let (phases, pixels) = (table.phases.len(), f64::from(block));
        let place = |phase: usize| {
            (2.0 * phase as f64 + 1.0 - phases as f64) / (2.0 * phases as f64) * pixels
        };
        let (phase, middle, reference) = if block == 1 {
            let middle = (at + 0.5).floor();
            let phase = ((at + 0.5 - middle) * phases as f64) as usize;
            (phase, middle, middle + place(phase))
        } else {
            let phase = phases / 2;
            let offset = (pixels - 1.0) / 2.0 + place(phase);
            let middle = (at - offset + 0.5).floor();
            (phase, middle, middle + offset)
        };
        let first = usize::try_from(middle as i64 - table.half_width * i64::from(block)).ok()?;
        // The core's weights come in pairs, the last of them zero: its window has a sample more.
        let taps = 2 * table.half_width as usize + 2;
        let window = light.get(first..first + taps * usize::from(block))?;
        let sum = |pixels: &[u16]| pixels.iter().map(|&count| f64::from(count)).sum();
        let samples: Vec<f64> = window.chunks(block.into()).map(sum).collect();
        let [score, slope, stretch] = table.phases[phase].each_ref().map(|weights| {
            let products = weights
                .iter()
                .zip(&samples)
                .map(|(weight, sample)| weight * sample);
            products.sum::<f64>()
        });
        let straight = score / slope * table.centre_per_ratio;
        let near_limit = match block {
            1 => table.near_limit,
            _ => 0.55 / pixels,
        };
        let bent = |straight: f64| 1.0 - table.bend * straight * straight;
        let distance = if straight.abs() <= near_limit {
            straight * bent(straight)
        } else {
            let straight = straight.clamp(-1.5 * table.width, 1.5 * table.width);
            straight * bent(straight).clamp(0.9, 1.1)
        };
        Some(Self {
            centre: reference + distance * pixels,
            window: (first, phase),
            distance,
            near_limit,
            slope,
            stretch: (stretch / slope * table.stretch_per_ratio).clamp(-0.4, 0.7),
        })
    }
}
