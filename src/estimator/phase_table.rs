//! The phase-table score: two integer inner products and one division.
//!
//! A gaussian least-squares fit with amplitude, black level and width projected out in advance. The tables are designed
//! by the crate `phase-tables`, which explains them. Score / slope is the distance of the centre from a table's phase; a
//! third product, stretch / slope, says how far the spot's width is from the table's, and so picks the table.
//!
//! | | |
//! |---|---|
//! | samples | u16, at most 32760: counts of 12 bits, or sums of up to 8 pixels, or halved sums of more |
//! | weights | i16, each row summing to zero, so a constant on the samples changes no bit |
//! | products | i32: no overflow, because sum of abs(weight) * 32760 < 2^31, proven by [`TableSet::new`] |
//! | division | f32: 24 bits on a quotient of at most a few pixels is 1e-7 pixel; one instruction on the chip |
//! | centre | Q16.16 pixels |
//!
//! Every float operation here is a single IEEE 754 operation or `libm`'s, so the chip and a PC agree bit for bit.

use dual_mac::{dot, dot2, square_root};

use crate::estimator::tables::{MAX_TAPS, NARROWEST, Sampling, Table, TableSet, halvings};
use crate::estimator::{RowCentre, WidthClass};
use crate::reading::Fault;
use crate::row::{Geometry, Row};
use crate::spot::Spot;
use crate::units::{Counts, Pixels};

/// Where a window lies on the row and which phase serves it.
pub(super) struct Window {
    class: WidthClass,
    /// The first pixel; negative where the window reaches over the sensor's edge.
    first: i32,
    phase: i32,
}

/// A window is moved and its table changed until both fit, at most this often.
const MAX_PASSES: usize = 10;

/// How nearly a window and a table must fit: to a tenth more than half a phase, and to half a per cent of the width more than
/// the best. In noise two tables, or two phases, may each hand the spot to the other; later passes are content with less.
const fn slack(pass: usize) -> (f32, f32) {
    match pass {
        0..=3 => (0.55, 0.005),
        4..=6 => (1.1, 0.1),
        _ => (1.1, 0.3),
    }
}

/// Where a window reaches over the sensor's edge a table this much narrower is tried: the coarse search may take a spot for
/// twice as wide as it is, and be off by half its width.
const NARROWER: f32 = 0.7;

/// A centre less certain than an eighth of the spot's width is not trusted: noise alone may look like that spot.
const DIMMEST: f32 = 8.0;

/// The centre of a spot that [`crate::spot::find`] found, with the tables of one set.
///
/// Where the row before had its spot near this one's, its table serves again, without the third product: the width is taken
/// over from that row.
///
/// # Errors
/// See [`crate::estimator::centre`].
pub fn centre(
    row: &Row<'_>,
    spot: &Spot,
    before: Option<&RowCentre>,
    geometry: &Geometry,
    tables: &TableSet<'_>,
    sampling: Sampling,
) -> Result<RowCentre, Fault> {
    fit(
        row,
        spot,
        before,
        geometry,
        tables,
        Width::TakenOver,
        sampling,
    )?
    .with_uncertainty(spot.background.noise, geometry)
}

/// Where the width comes from that says which table serves, where there is a row before.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Width {
    /// From the row before, as it was there.
    TakenOver,
    /// From the third product, smoothed over the rows.
    Measured,
}

/// The table that fits, and what it says.
///
/// # Errors
/// See [`crate::estimator::centre`].
pub(super) fn fit<'a>(
    row: &Row<'_>,
    spot: &Spot,
    before: Option<&RowCentre>,
    geometry: &Geometry,
    tables: &TableSet<'a>,
    width: Width,
    sampling: Sampling,
) -> Result<Fit<'a>, Fault> {
    let followed = before.and_then(|before| follow(row.light(), spot, before, tables, width));
    let fit = match followed {
        Some(fit) => fit,
        None => fit_afresh(row, spot, geometry, tables, sampling)?,
    };
    saturation(row, fit.centre, fit.width, geometry)?;
    Ok(fit)
}

/// A table that fits, and what it says.
#[derive(Clone, Copy)]
pub(super) struct Fit<'a> {
    pub(super) centre: Pixels,
    /// Sigma in pixels.
    pub(super) width: f32,
    /// The spot's width over the table's, less one.
    pub(super) stretch: f32,
    pub(super) slope: f32,
    pub(super) class: WidthClass,
    pub(super) table: &'a Table<'a>,
}

/// Looks where the row before had its spot, with its table. `None` where the coarse search found the spot elsewhere, or
/// what is there is not that spot.
#[inline]
fn follow<'a>(
    light: &[u16],
    spot: &Spot,
    before: &RowCentre,
    tables: &TableSet<'a>,
    source: Width,
) -> Option<Fit<'a>> {
    if !is_near(spot, before) {
        return None;
    }
    let mut width = before.width.to_f32();
    let (class, table) = tables.of(before.class, width)?;
    let (block, steps) = resolution(class, table);
    let mut at = before.centre;
    for _ in 0..MAX_FOLLOWING {
        let (window, reference) = place(at, class, table);
        let products = inner_products(light, &window, table)?;
        if products.slope <= 0 {
            return None;
        }
        let slope = products.slope as f32;
        let distance = distance(products.score as f32 / slope, table);
        at = moved(reference, distance * block);
        if distance.abs() * steps > slack(0).0 {
            continue;
        }
        if source == Width::Measured {
            let measured = table.width * block * (1.0 + stretch(light, &window, table, slope));
            width += (measured - width) * SMOOTHING;
            if table.mismatch(width, class.block) > tables.reach() {
                return None;
            }
        }
        return Some(Fit {
            centre: at,
            width,
            stretch: width / (table.width * block) - 1.0,
            slope,
            class,
            table,
        });
    }
    None
}

/// The share of a row in the width: what it says is averaged over about seven rows.
const SMOOTHING: f32 = 0.25;

/// The same spot with the tables of another set, from one look at the place that is known. `None` where that set's window
/// reaches over the sensor's edge.
#[inline(never)]
pub(super) fn refit<'a>(light: &[u16], fit: &Fit<'_>, tables: &TableSet<'a>) -> Option<Fit<'a>> {
    let (class, table) = tables.choose(fit.width, Sampling::Fine)?;
    let (window, reference) = place(fit.centre, class, table);
    let products = inner_products(light, &window, table)?;
    if products.slope <= 0 {
        return None;
    }
    let slope = products.slope as f32;
    let (block, _) = resolution(class, table);
    let distance = distance(products.score as f32 / slope, table);
    Some(Fit {
        centre: moved(reference, distance * block),
        width: fit.width,
        stretch: fit.width / (table.width * block) - 1.0,
        slope,
        class,
        table,
    })
}

/// Passes before a spot that moved is looked for afresh.
const MAX_FOLLOWING: usize = 3;

/// Whether the coarse search, which is good to half a block, found the spot within its width of where it was.
pub(super) fn is_near(spot: &Spot, before: &RowCentre) -> bool {
    let Ok(centre) = i32::try_from(spot.centre) else {
        return false;
    };
    let reach = before
        .width
        .to_bits()
        .saturating_add(Pixels::from_int(1 << spot.block_log2.min(7)).to_bits());
    Pixels::from_int(centre)
        .to_bits()
        .abs_diff(before.centre.to_bits())
        <= reach.unsigned_abs()
}

/// Finds place, width and table from what the coarse search says.
#[inline(never)]
fn fit_afresh<'a>(
    row: &Row<'_>,
    spot: &Spot,
    geometry: &Geometry,
    tables: &TableSet<'a>,
    sampling: Sampling,
) -> Result<Fit<'a>, Fault> {
    let light = row.light();
    let start = match i32::try_from(spot.centre) {
        Ok(start) if spot.centre < light.len() => Pixels::from_int(start),
        _ => {
            return Err(Fault::SpotAtEdge {
                centre: Pixels::MAX,
            });
        }
    };
    // The coarse kernel fits a width of 0.9 of its block best.
    let start_width = 0.9 * (1u32 << spot.block_log2.min(7)) as f32;
    saturation(row, start, start_width, geometry)?;
    let no_spot = Fault::NoSpot {
        amplitude: spot.height,
    };
    settle(light, start, start_width, tables, sampling).map_err(|error| match error {
        Unsettled::Edge(centre) => Fault::SpotAtEdge { centre },
        Unsettled::Shape => no_spot,
        // Noise may keep a table from fitting too.
        Unsettled::Never(fit) => match fit.with_uncertainty(spot.background.noise, geometry) {
            Err(too_dim) => too_dim,
            Ok(_) => no_spot,
        },
    })
}

/// Why no table fits.
enum Unsettled<'a> {
    /// The window reaches over the sensor's edge.
    Edge(Pixels),
    /// What is there is no spot.
    Shape,
    /// Neither place nor width came to rest; this was the last of them.
    Never(Fit<'a>),
}

/// Moves the window to the centre and changes the table to the width until both rest.
fn settle<'a>(
    light: &[u16],
    start: Pixels,
    start_width: f32,
    tables: &TableSet<'a>,
    sampling: Sampling,
) -> Result<Fit<'a>, Unsettled<'a>> {
    let (mut at, mut width) = (start, start_width);
    let (mut class, mut table) = tables.choose(width, sampling).ok_or(Unsettled::Shape)?;
    let (mut cut, mut last) = (false, None);
    for pass in 0..MAX_PASSES {
        let (window, reference) = place(at, class, table);
        let Some(products) = inner_products(light, &window, table) else {
            // The place or the width may still be off: a narrower table mends either, where the spot is whole.
            cut = true;
            width = table.width * f32::from(class.block) * NARROWER;
            (class, table) = tables.choose(width, sampling).ok_or(Unsettled::Shape)?;
            if width < NARROWEST {
                break;
            }
            continue;
        };
        if products.slope <= 0 {
            return Err(Unsettled::Shape);
        }
        let slope = products.slope as f32;
        let (block, steps) = resolution(class, table);
        let distance = distance(products.score as f32 / slope, table);
        let stretch = stretch(light, &window, table, slope);
        at = moved(reference, distance * block);
        width = table.width * block * (1.0 + stretch);
        if at.to_bits().abs_diff(start.to_bits())
            > Pixels::from_f32(4.0 * start_width).to_bits().unsigned_abs()
        {
            return Err(Unsettled::Shape);
        }
        let (half_phase, margin) = slack(if cut { 0 } else { pass });
        let (better_class, better) = tables.choose(width, sampling).ok_or(Unsettled::Shape)?;
        let fits = table.mismatch(width, class.block)
            <= better.mismatch(width, better_class.block) + margin;
        let fit = Fit {
            centre: at,
            width,
            stretch,
            slope,
            class,
            table,
        };
        if fits && distance.abs() * steps <= half_phase {
            return if tables.serves(width) {
                Ok(fit)
            } else {
                Err(Unsettled::Shape)
            };
        }
        last = Some(fit);
        if fits {
            // A table of the spot's width has its window on the row: whatever keeps it from resting, no edge does.
            cut = false;
        } else {
            (class, table) = (better_class, better);
        }
    }
    Err(match last {
        _ if cut => Unsettled::Edge(at),
        Some(fit) => Unsettled::Never(fit),
        None => Unsettled::Shape,
    })
}

/// Pixels in a sample, and into how many steps a sample is divided: a phase would be nearer from half a step on, or with
/// blocks, whose window moves by pixels, the next window.
fn resolution(class: WidthClass, table: &Table<'_>) -> (f32, f32) {
    if class.block == 1 {
        (1.0, f32::from(table.phases))
    } else {
        (f32::from(class.block), f32::from(class.block))
    }
}

/// How far the centre is from the window's phase, in samples. Limited to one and a half widths: further off, the products
/// say the direction and no more, and so does the bend, which is far below a tenth where a window rests.
fn distance(ratio: f32, table: &Table<'_>) -> f32 {
    let reach = 1.5 * table.width;
    let straight = limited(ratio * table.centre_per_ratio, -reach, reach);
    straight * (1.0 - table.bend * (straight * straight)).max(0.9)
}

/// A position below 2^13 pixels, moved by less than 1.5 * 106 * 16 < 2^12.
fn moved(reference: Pixels, by: f32) -> Pixels {
    Pixels::from_bits(
        reference
            .to_bits()
            .saturating_add(Pixels::from_f32(by).to_bits()),
    )
}

/// The spot's width over the table's, less one. Limited to a bit less than half or twice the width, like the distance.
pub(super) fn stretch(light: &[u16], window: &Window, table: &Table<'_>, slope: f32) -> f32 {
    let product = with_samples(light, window, table, |samples, pairs| {
        Some(dot(samples, table.stretch.get(pairs)?))
    });
    limited(
        product.unwrap_or_default() as f32 / slope * table.stretch_per_ratio,
        -0.4,
        0.7,
    )
}

/// `f32::clamp` without its panic on bounds that are not in order, which brings 20 KB of formatting to the chip.
#[allow(clippy::manual_clamp)]
pub(super) fn limited(value: f32, low: f32, high: f32) -> f32 {
    value.max(low).min(high)
}

impl Fit<'_> {
    /// Counts of the spot at its peak.
    pub(super) fn amplitude(&self) -> f32 {
        let divisor = (1u32 << halvings(self.class.block)) as f32;
        self.slope * self.table.height_per_slope * divisor / f32::from(self.class.block)
    }

    /// Amplitude and uncertainty: the noise of the score through its slope.
    pub(super) fn with_uncertainty(
        &self,
        noise: Counts,
        geometry: &Geometry,
    ) -> Result<RowCentre, Fault> {
        let block = f32::from(self.class.block);
        // A sample is the sum of a block's pixels over this.
        let divisor = (1u32 << halvings(self.class.block)) as f32;
        let height = self.slope * self.table.height_per_slope;
        let read = noise.to_f32() * noise.to_f32() * block / (divisor * divisor);
        let shot_variance_per_count = f32::from(geometry.shot_variance_per_count_q16) / 65536.0;
        // The table's shot noise is that of a spot of its own width; the variance grows as width^1.5 about it (1.44 to
        // 1.60 over the tables).
        let shot = height / divisor * shot_variance_per_count * (1.0 + 1.5 * self.stretch);
        let variance = self.table.variance_per_noise * read + self.table.variance_per_height * shot;
        let uncertainty = square_root(variance) / self.slope * block;
        let amplitude = height * divisor / block;
        // An uncertainty that is not a number is not certain either.
        let certain = uncertainty * DIMMEST <= self.width;
        if !certain {
            return Err(too_dim(amplitude, uncertainty, self.width));
        }
        Ok(RowCentre {
            centre: self.centre,
            uncertainty: Pixels::from_f32(uncertainty),
            amplitude: Counts::from_f32(amplitude),
            width: Pixels::from_f32(self.width),
            class: self.class,
            misfit: false,
        })
    }
}

#[cold]
fn too_dim(amplitude: f32, uncertainty: f32, width: f32) -> Fault {
    let needed = amplitude * uncertainty * DIMMEST / width;
    Fault::TooDim {
        amplitude: Counts::from_f32(amplitude),
        needed: Counts::from_f32(needed),
    }
}

/// The window whose phase is nearest to a position, and that phase's place on the row.
pub(super) fn place(at: Pixels, class: WidthClass, table: &Table<'_>) -> (Window, Pixels) {
    const HALF: i32 = 1 << (Pixels::FRACTION - 1);
    // Positions stay within 2^13 pixels of zero and offsets below 2^5, so nothing here overflows an i32 in Q16.
    let at = at.to_bits();
    let block = i32::from(class.block);
    let phases = i32::from(table.phases);
    let phase = if class.block == 1 {
        let nearest = at.saturating_add(HALF) >> Pixels::FRACTION;
        let from_its_edge = at - (nearest << Pixels::FRACTION) + HALF;
        ((from_its_edge * phases) >> Pixels::FRACTION).clamp(0, phases - 1)
    } else {
        phases / 2
    };
    // Where the phase lies from the middle sample's first pixel: half a block less half a pixel, and the phase itself.
    let offset = (block - 1) * HALF + (2 * phase - (phases - 1)) * block * HALF / phases;
    let middle = (at - offset).saturating_add(HALF) >> Pixels::FRACTION;
    let first = middle - i32::from(table.half_width) * block;
    (
        Window {
            class,
            first,
            phase,
        },
        Pixels::from_bits((middle << Pixels::FRACTION) + offset),
    )
}

/// The sums over a window, each proven to fit.
struct Products {
    score: i32,
    slope: i32,
}

/// `None` where the window reaches over an edge.
#[inline]
fn inner_products(light: &[u16], window: &Window, table: &Table<'_>) -> Option<Products> {
    with_samples(light, window, table, |samples, pairs| {
        // No step overflows: `prove` bounds the sum of the terms' magnitudes.
        let (score, slope) = dot2(samples, table.weights.get(pairs)?);
        Some(Products { score, slope })
    })
}

/// Gives the samples of a window, and the range of its phase's weights, to a function. `None` where the window reaches over an
/// edge.
#[inline]
fn with_samples<T>(
    light: &[u16],
    window: &Window,
    table: &Table<'_>,
    then: impl Fn(&[u16], core::ops::Range<usize>) -> Option<T>,
) -> Option<T> {
    let pairs = table.pairs();
    let block = usize::from(window.class.block);
    let first = usize::try_from(window.first).ok()?;
    let pixels = light.get(first..first + 2 * pairs * block)?;
    let phase = usize::try_from(window.phase).ok()?;
    let weights = phase * pairs..(phase + 1) * pairs;
    if block == 1 {
        return then(pixels, weights);
    }
    let mut sums = [0u16; MAX_TAPS];
    sum_blocks(pixels, window.class.block, &mut sums);
    then(sums.get(..2 * pairs)?, weights)
}

/// The sums of blocks of pixels, halved to fit. Adding n to every pixel adds a whole number to every sample, because a
/// block's size is a multiple of what its sum is divided by.
fn sum_blocks(pixels: &[u16], block: u8, sums: &mut [u16; MAX_TAPS]) {
    // 16 pixels of 12 bits fit 16 bits.
    match block {
        2 => sum_chunks(pixels.as_chunks::<2>().0, 0, sums),
        4 => sum_chunks(pixels.as_chunks::<4>().0, 0, sums),
        8 => sum_chunks(pixels.as_chunks::<8>().0, 0, sums),
        _ => sum_chunks(pixels.as_chunks::<16>().0, halvings(16), sums),
    }
}

fn sum_chunks<const BLOCK: usize>(
    chunks: &[[u16; BLOCK]],
    halvings: u32,
    sums: &mut [u16; MAX_TAPS],
) {
    for (sum, chunk) in sums.iter_mut().zip(chunks) {
        *sum = (chunk.iter().map(|&count| u32::from(count)).sum::<u32>() >> halvings) as u16;
    }
}

/// Counts the pixels at full scale within two widths.
#[inline]
pub(super) fn saturation(
    row: &Row<'_>,
    centre: Pixels,
    width: f32,
    geometry: &Geometry,
) -> Result<(), Fault> {
    if row.reaches_full_scale() {
        count_saturated(row.light(), centre, width, geometry)
    } else {
        Ok(())
    }
}

#[inline(never)]
fn count_saturated(
    light: &[u16],
    centre: Pixels,
    width: f32,
    geometry: &Geometry,
) -> Result<(), Fault> {
    let centre = usize::try_from(centre.to_bits() >> Pixels::FRACTION).unwrap_or_default();
    // `as` saturates.
    let reach = (2.0 * width) as usize + 1;
    let from = centre.saturating_sub(reach).min(light.len());
    let to = centre.saturating_add(reach + 1).min(light.len());
    let near = light.get(from..to).unwrap_or_default();
    match near
        .iter()
        .filter(|&&count| count >= geometry.full_scale())
        .count()
    {
        0 => Ok(()),
        pixels => Err(Fault::Saturated {
            pixels: u16::try_from(pixels).unwrap_or(u16::MAX),
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimator::tables::GAUSSIAN;

    #[test]
    fn a_candidate_beside_the_row_is_at_the_edge() {
        let light = [100u16; 64];
        let row = Row::new(&light, &[], 4095).expect("a row");
        let background = crate::spot::Background {
            level: Counts::from_int(100),
            noise: Counts::from_int(1),
        };
        for centre in [64, 32_768, usize::MAX] {
            let spot = Spot {
                centre,
                block_log2: 31,
                height: Counts::from_int(0),
                background,
            };
            let fault = centre_of(&row, &spot);
            assert!(matches!(fault, Err(Fault::SpotAtEdge { .. })), "{fault:?}");
        }
    }

    fn centre_of(row: &Row<'_>, spot: &Spot) -> Result<RowCentre, Fault> {
        centre(
            row,
            spot,
            None,
            &crate::sensor_heads::tcd1304dg(),
            &GAUSSIAN,
            Sampling::Fine,
        )
    }
}
