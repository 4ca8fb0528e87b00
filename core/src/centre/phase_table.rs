//! The phase-table score: two integer inner products, and a quotient.
//!
//! This is a gaussian least-squares fit with amplitude, black level and width projected out in advance. The
//! crate `phase-tables` designs the tables, and explains them. Score / slope is the distance of the centre
//! from a table's phase. A third product, stretch / slope, says how far the spot's width is from the table's,
//! and so picks the table.
//!
//! All of it is integers, so the chip and a PC agree bit for bit. The inner products of 16-bit samples and
//! weights fit an i32, and each row of weights sums to zero: [`TableSet::new`] proves both. The quotients
//! have Q24 or more, and are right to 2^-23 of themselves; u is right to 2^-19.
//!
//! **`adaptive`**: the weights follow the row, by the width of its spot, its noise, and the background under
//! the spot. Each set in [`MIXES`] is the best for one ratio r, the variance of the read noise over that of
//! the shot noise at the peak. The row's own r chooses the set. The third product, smoothed over the rows,
//! gives the width. If the background beside the spot is tilted, the set [`TILTED`] takes over: a tilt
//! changes neither its score nor its slope. This set costs 5 % of accuracy in white noise. With the other
//! sets, a tilt of one count a pixel would shift a centre by hundredths of a pixel (narrow spots) to whole
//! ones (wide, dim ones). As long as the tilt lasts, each row takes two more measurements.
//!
//! **A lopsided spot.** Speckle makes one side of the light in the slit brighter than the other, and this
//! moves a fit. Weights for shot noise let it move most: their flanks weigh much. So where the spot is more
//! lopsided than noise explains, the set [`LOPSIDED`] takes over until the frame ends, unless a repair finds
//! another cause. It lets such light move the centre least. Its error by noise is 8 % (read noise) to 25 %
//! (shot noise) larger.

use crate::base::numeric::{product, saturated};
use crate::base::{Counts, Fault, Pixels, numeric};
use crate::centre::tables::{
    LOPSIDED, MIXES, NARROWEST, ONE_Q24, SLIT, Score, Slope, TILTED, Table, TableSet, Window,
    halvings, is_spot_width,
};
use crate::centre::{RowCentre, WidthClass, check_saturation, check_uncertainty, position_on_row};
use crate::row::{Geometry, Light, Row};
use crate::spot::Spot;

/// The most passes. A pass moves the window or changes its table, until both fit.
const MAX_PASSES: usize = 10;

/// How well a window and a table must fit in a pass. The first number limits the distance to the phase, in
/// units of `Score::near_limit`. The second limits how much worse the table matches the width than the best
/// table does, as a share of the width, Q24. In noise two tables, or two phases, may each prefer the other,
/// so later passes accept a worse fit.
const fn slack(pass: usize) -> (i32, u32) {
    const ONE: u32 = ONE_Q24.cast_unsigned();
    match pass {
        0..=3 => (1, ONE / 200),
        4..=6 => (2, ONE / 10),
        _ => (2, ONE / 10 * 3),
    }
}

/// Where a window reaches over the sensor's edge, a table this much narrower is tried. The coarse search may
/// take a spot for twice as wide as it is, and its place may be off by half the width. 0.7, Q16.
const NARROWER: i32 = 45_875;
/// Near the sensor's edge only narrow tables fit on the row. If the table that fits has less than this part
/// of the coarse search's width, it fits a ripple on a spot that is cut. 0.4, Q16.
const RIPPLE: i32 = 26_214;
/// The coarse kernel fits a width of 0.9 of its block best, Q16.
const WIDTH_OF_BLOCK: i32 = 58_982;

/// A width times a share, Q16. Both are positive.
fn part(width: Pixels, share: i32) -> Pixels {
    Pixels::from_bits(saturated(product(width.to_bits(), share) >> 16))
}

/// Finds the centre of a spot that [`crate::spot::find`] found, with the tables of one set.
///
/// If the row before had its spot near this one, its table and its width are used again, and the third
/// product is not computed.
///
/// # Errors
/// See [`crate::centre::centre`].
#[inline(always)]
pub fn centre(
    row: &Row<'_>,
    spot: &Spot,
    before: Option<&RowCentre>,
    geometry: &Geometry,
    tables: &TableSet<'_>,
) -> Result<RowCentre, Fault> {
    fit(row, spot, before, geometry, tables, WidthSource::Previous)?
        .with_uncertainty(spot.background.noise, geometry)
}

/// Where the width comes from that chooses the table, if there is a row before.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum WidthSource {
    /// From the row before, unchanged.
    Previous,
    /// From the third product, smoothed over the rows.
    Measured,
}

/// Finds the table that fits, and the centre by it.
#[inline(always)]
fn fit<'a>(
    row: &Row<'_>,
    spot: &Spot,
    before: Option<&RowCentre>,
    geometry: &Geometry,
    tables: &TableSet<'a>,
    source: WidthSource,
) -> Result<Fit<'a>, Fault> {
    if let Some(before) = before
        && before.class.block == 1
        // Samples of one pixel are usual: here the block size is a constant for what is inlined.
        && let class = (WidthClass {
            block: 1,
            ..before.class
        })
        && let Some(fit) = track_once(row, spot, before, class, tables, source)
    {
        check_saturation(row, fit.centre, fit.width)?;
        return Ok(fit);
    }
    fit_in_full(row, spot, before, geometry, tables, source)
}

/// As [`fit`], without [`track_once`].
#[cold]
#[inline(never)]
fn fit_in_full<'a>(
    row: &Row<'_>,
    spot: &Spot,
    before: Option<&RowCentre>,
    geometry: &Geometry,
    tables: &TableSet<'a>,
    source: WidthSource,
) -> Result<Fit<'a>, Fault> {
    let tracked = before.and_then(|before| track(row.light(), spot, before, tables, source));
    let fit = match tracked {
        Some(fit) => fit,
        None => fit_afresh(row, spot, geometry, tables)?,
    };
    check_saturation(row, fit.centre, fit.width)?;
    Ok(fit)
}

/// A table that fits, and the measurement with it.
#[derive(Clone, Copy)]
struct Fit<'a> {
    centre: Pixels,
    /// Sigma.
    width: Pixels,
    /// The spot's width over the table's, Q24.
    ratio: i32,
    slope: Slope,
    class: WidthClass,
    table: &'a Table<'a>,
}

/// Measures the spot once, at its place in the row before: enough for a target at rest. `None` if the spot is
/// not there. All of it is inlined into one straight line.
#[inline(always)]
fn track_once<'a>(
    row: &Row<'_>,
    spot: &Spot,
    before: &RowCentre,
    class: WidthClass,
    tables: &TableSet<'a>,
    source: WidthSource,
) -> Option<Fit<'a>> {
    let table = tables.get(class)?;
    if !is_near(spot, before) {
        return None;
    }
    let (light, at, width) = (row.light(), before.centre, before.width);
    measure_at(light, at, width, class, tables, table, source)?.ok()
}

/// Measures the spot twice with the table of the row before: first at the centre of the row before, then at
/// the centre that the first measurement gives. `None` if the coarse search found the spot elsewhere, or if
/// another spot is there.
#[inline(never)]
fn track<'a>(
    light: Light<'_>,
    spot: &Spot,
    before: &RowCentre,
    tables: &TableSet<'a>,
    source: WidthSource,
) -> Option<Fit<'a>> {
    if !is_near(spot, before) {
        return None;
    }
    let (class, table) = tables.get_or_choose(before.class, before.width)?;
    let mut at = before.centre;
    for _ in 0..MAX_TRACKING {
        match measure_at(light, at, before.width, class, tables, table, source)? {
            Ok(fit) => return Some(fit),
            Err(beside) => at = beside,
        }
    }
    None
}

/// Measures a spot of a known width at a place. `Err` holds the spot's place, if it is too far from the place
/// that was tried. `None` if no spot is there, or the table no longer fits the width.
#[inline(always)]
fn measure_at<'a>(
    light: Light<'_>,
    at: Pixels,
    width: Pixels,
    class: WidthClass,
    tables: &TableSet<'_>,
    table: &'a Table<'a>,
    source: WidthSource,
) -> Option<Result<Fit<'a>, Pixels>> {
    let window = Window::place(light, at, class, table)?;
    let score = window.score()?;
    if !score.is_near {
        return Some(Err(score.centre));
    }
    let mut width = width;
    if source == WidthSource::Measured {
        let measured = window.width(window.stretch(&score)).to_bits();
        // The difference is rounded to the nearest step.
        let more = measured.saturating_sub(width.to_bits()).saturating_add(2) >> SMOOTHING;
        width = Pixels::from_bits(width.to_bits().saturating_add(more));
    }
    let fit = Fit::new(&score, width, class, table);
    if source == WidthSource::Measured
        && fit.ratio.abs_diff(ONE_Q24) > tables.largest_mismatch.cast_unsigned()
    {
        return None;
    }
    Some(Ok(fit))
}

/// A row has the weight of 1/4, as a power of two, in the smoothed width, which averages about seven rows.
const SMOOTHING: u32 = 2;

/// Measures the same spot with the tables of another set, from its known place. `None` where that set's
/// window reaches over the sensor's edge.
#[inline(never)]
fn refit<'a>(light: Light<'_>, fit: &Fit<'_>, tables: &TableSet<'a>) -> Option<Fit<'a>> {
    let (class, table) = tables.choose(fit.width)?;
    let mut score = Window::place(light, fit.centre, class, table)?.score()?;
    if !score.is_near {
        score = Window::place(light, score.centre, class, table)?.score()?;
    }
    Some(Fit::new(&score, fit.width, class, table))
}

/// Passes before a spot that moved is measured afresh.
const MAX_TRACKING: usize = 3;

/// Whether the coarse search found the spot within a width of its place in the row before. The coarse search
/// may be off by half a block.
#[inline(always)]
fn is_near(spot: &Spot, before: &RowCentre) -> bool {
    // These wrap only for a spot off the row. The cost is time: the spot is looked for in vain, or from the
    // start.
    #[expect(clippy::cast_possible_truncation, reason = "wraps off the row")]
    let centre = (spot.centre as i32).wrapping_shl(Pixels::FRACTION);
    let block = (1i32 << Pixels::FRACTION).wrapping_shl(spot.block_log2);
    let reach = before.width.to_bits().wrapping_add(block);
    let apart = centre.wrapping_sub(before.centre.to_bits());
    // From -reach to reach.
    apart.wrapping_add(reach).cast_unsigned() <= 2 * (reach.cast_unsigned() & 0x7fff_ffff)
}

/// Finds place, width and table from the result of the coarse search.
#[inline(never)]
fn fit_afresh<'a>(
    row: &Row<'_>,
    spot: &Spot,
    geometry: &Geometry,
    tables: &TableSet<'a>,
) -> Result<Fit<'a>, Fault> {
    let light = row.light();
    let start = position_on_row(light, spot)?;
    let start_width = WIDTH_OF_BLOCK * (1i32 << spot.block_log2.min(7));
    let start_width = Pixels::from_bits(start_width);
    check_saturation(row, start, start_width)?;
    settle(light, start, start_width, tables).map_err(|error| match error {
        Unsettled::Edge(centre) => Fault::SpotAtEdge { centre },
        Unsettled::NotASpot => spot.no_spot(),
        // Noise may also keep a table from fitting.
        Unsettled::Never(fit) => match fit.with_uncertainty(spot.background.noise, geometry) {
            Err(too_dim) => too_dim,
            Ok(_) => spot.no_spot(),
        },
    })
}

/// Why no table fits.
enum Unsettled<'a> {
    /// The window reaches over the sensor's edge.
    Edge(Pixels),
    /// The light does not have the shape of a spot.
    NotASpot,
    /// Place or width did not come to rest; this is the last fit.
    Never(Fit<'a>),
}

/// Moves the window to the centre and changes the table to the width until both rest.
fn settle<'a>(
    light: Light<'_>,
    start: Pixels,
    start_width: Pixels,
    tables: &TableSet<'a>,
) -> Result<Fit<'a>, Unsettled<'a>> {
    let (mut at, mut width) = (start, start_width);
    let (mut class, mut table) = tables.choose(width).ok_or(Unsettled::NotASpot)?;
    let (mut cut, mut was_cut, mut last) = (false, false, None);
    for pass in 0..MAX_PASSES {
        let Some(window) = Window::place(light, at, class, table) else {
            // The place or the width may still be wrong. If the whole spot is on the row, a narrower table
            // corrects both.
            (cut, was_cut) = (true, true);
            width = part(table.width_in_pixels(class.block), NARROWER);
            (class, table) = tables.choose(width).ok_or(Unsettled::NotASpot)?;
            if width < NARROWEST {
                break;
            }
            continue;
        };
        let (score, stretch) = window.score_and_stretch().ok_or(Unsettled::NotASpot)?;
        at = score.centre;
        width = window.width(stretch);
        if at.to_bits().abs_diff(start.to_bits()) / 4 > start_width.to_bits().unsigned_abs() {
            return Err(Unsettled::NotASpot);
        }
        let (steps, margin) = slack(if cut { 0 } else { pass });
        let (better_class, better) = tables.choose(width).ok_or(Unsettled::NotASpot)?;
        let fits = table.mismatch(width, class.block)
            <= (better.mismatch(width, better_class.block)).saturating_add(margin);
        let fit = Fit::new(&score, width, class, table);
        if fits && score.distance.saturating_abs() / steps <= score.near_limit {
            if was_cut && width < part(start_width, RIPPLE) {
                return Err(Unsettled::Edge(at));
            }
            return if is_spot_width(width) {
                Ok(fit)
            } else {
                Err(Unsettled::NotASpot)
            };
        }
        last = Some(fit);
        if fits {
            // The window of a table of the spot's width lies on the row, so it is not the edge that keeps the
            // fit from resting.
            cut = false;
        } else {
            (class, table) = (better_class, better);
        }
    }
    Err(match last {
        _ if cut => Unsettled::Edge(at),
        Some(fit) => Unsettled::Never(fit),
        None => Unsettled::NotASpot,
    })
}

impl<'a> Fit<'a> {
    #[inline(always)]
    fn new(score: &Score, width: Pixels, class: WidthClass, table: &'a Table<'a>) -> Self {
        Self {
            centre: score.centre,
            width,
            ratio: table.ratio(width, class.block),
            slope: score.slope,
            class,
            table,
        }
    }

    /// A sample is the sum of 2^n pixels, halved m times: n and m.
    #[inline(always)]
    fn block(&self) -> (u32, u32) {
        let halvings = halvings(self.class.block.into());
        (self.class.block.trailing_zeros(), halvings)
    }

    /// The spot's height at its peak.
    #[inline(always)]
    fn amplitude(&self) -> Counts {
        let (log2, halvings) = self.block();
        // From Q10 of a sample to Q8 of a pixel. A height is below 2^30: (2^31)^2 / 2^32.
        let bits = 2u32.wrapping_add(log2).wrapping_sub(halvings);
        let half = 2i32.wrapping_shl(log2.wrapping_sub(halvings));
        Counts::from_bits(self.slope.height(self.table).wrapping_add(half) >> (bits & 31))
    }

    /// The standard uncertainty of the centre: the noise of the score over its slope.
    #[inline(always)]
    fn uncertainty(&self, noise: Counts, geometry: &Geometry) -> Pixels {
        let (log2, halvings) = self.block();
        // Noise is below 2^16 counts: its square in Q16 is below 2^48. A sum of 2^log2 pixels has so many
        // times the variance, and its half a quarter of it.
        let noise = noise.to_bits().clamp(0, 1 << 24);
        let pixels = log2.wrapping_sub(2 * halvings);
        let read = product(noise, noise).wrapping_shl(pixels);
        // Q16: a sample of 2^15 counts at one electron a count fits.
        let height = self.slope.height(self.table);
        let per_count = geometry.shot_variance_per_count_q16.into();
        let shot = saturated(product(height, per_count) >> 10u32.wrapping_add(halvings));
        // The table's shot noise is that of a spot of the table's width. Near it the variance grows as
        // width^1.5 (1.44 to 1.60 over the tables): by this number, Q24.
        let ratio = self.ratio.clamp(ONE_Q24 / 2, 2 * ONE_Q24);
        let growth = ratio + ratio / 2 - ONE_Q24 / 2;
        let share = saturated(product(self.table.shot_share, growth) >> 24);
        let shot = product(shot, share) >> 28;
        let variance = read.wrapping_add(shot).cast_unsigned();
        (self.slope).uncertainty(variance, self.table, self.class.block)
    }

    /// Makes a centre of the fit, with its amplitude and its uncertainty.
    #[inline(always)]
    pub(super) fn with_uncertainty(
        &self,
        noise: Counts,
        geometry: &Geometry,
    ) -> Result<RowCentre, Fault> {
        let (amplitude, uncertainty) = (self.amplitude(), self.uncertainty(noise, geometry));
        check_uncertainty(amplitude, uncertainty, self.width)?;
        Ok(RowCentre {
            centre: self.centre,
            uncertainty,
            amplitude,
            width: self.width,
            class: self.class,
            ..RowCentre::default()
        })
    }
}

/// The estimator `fraunhofer`: the diffraction pattern of a slit, eq. (6), sinc^2 in place of the gaussian.
///
/// This is the pattern of a point on the target, if the slit is narrow enough and far enough away for
/// Fraunhofer's approximation. A laser spot of a millimetre or more blurs the side lobes away, and then the
/// gaussian is as good: so the paper found. The width is that of the gaussian that fits best, 0.376 of the
/// distance from the centre to the first zero.
///
/// The weights are close to those of an unweighted fit of eq. (6), the paper's, and so is the centre. It lies
/// at most 0.7 times as far from that fit's as the centre of `phase-table` does, on patterns that a laser
/// spot blurs by up to a width, in read noise, shot noise, on a slope, and with unequal pixels. The error on
/// the pattern of a point is 0.97 of `phase-table`'s in white noise, and 1.04 in shot noise.
pub fn fraunhofer(
    row: &Row<'_>,
    spot: &Spot,
    before: Option<&RowCentre>,
    geometry: &Geometry,
) -> Result<RowCentre, Fault> {
    centre(row, spot, before, geometry, &SLIT)
}

/// Finds the centre of a spot, in the set of tables that serves the row best.
pub fn adaptive(
    row: &Row<'_>,
    spot: &Spot,
    before: Option<&RowCentre>,
    geometry: &Geometry,
) -> Result<RowCentre, Fault> {
    let noise = spot.background.noise;
    let expected = before.map_or(spot.height, |before| before.amplitude);
    let tables = match before {
        Some(before) if stays_lopsided(before) => &LOPSIDED,
        _ => for_mix(noise, expected, geometry),
    };
    let mut fit = fit(row, spot, before, geometry, tables, WidthSource::Measured)?;
    if before.is_none() {
        // The coarse search may know only half of the spot's height.
        let better = for_mix(noise, fit.amplitude(), geometry);
        if better.number != tables.number {
            fit = refit(row.light(), &fit, better).unwrap_or(fit);
        }
    }
    if is_tilted(row.light(), &fit, noise) {
        // Noise may look like a spot to one set of tables. It seldom does to two.
        let uncertainty = part(fit.uncertainty(noise, geometry), LEAST_EVIDENCE);
        check_uncertainty(fit.amplitude(), uncertainty, fit.width)?;
        fit = refit(row.light(), &fit, &TILTED).unwrap_or(fit);
    } else if before.is_none()
        && let Some(other) = refit(row.light(), &fit, &LOPSIDED)
        && is_lopsided(&fit, &other, noise, geometry)
    {
        fit = other;
    }
    fit.with_uncertainty(noise, geometry)
}

/// Whether the spot counts as lopsided because of the row before: by its shape then, or because it already
/// counted as lopsided.
#[inline(always)]
fn stays_lopsided(before: &RowCentre) -> bool {
    before.class.set == LOPSIDED.number || before.shape.exceeds(MOST_BY_NOISE)
}

/// The sum of squares of a shape's components, in variances, that noise exceeds in one spot of 2,000 (chi
/// square of four degrees of freedom).
const MOST_BY_NOISE: i64 = 20;

/// Whether the centre by [`LOPSIDED`] differs from that by the set for the noise by more than three standard
/// deviations. The variance of the difference is the variance by [`LOPSIDED`] less that by the other set.
/// Noise may make this too small, so it is at least a quarter of the latter. Squares of an i32 fit an i64.
fn is_lopsided(best: &Fit<'_>, other: &Fit<'_>, noise: Counts, geometry: &Geometry) -> bool {
    let squared = |it: i32| product(it, it);
    let variance = |fit: &Fit<'_>| squared(fit.uncertainty(noise, geometry).to_bits());
    let of_best = variance(best);
    let of_difference = variance(other).saturating_sub(of_best).max(of_best / 4);
    let apart = other.centre.to_bits().saturating_sub(best.centre.to_bits());
    squared(apart) / 9 > of_difference
}

/// The least evidence of a spot on a tilt, in the tables that do not know of the tilt: this part of what a
/// spot without a tilt must have. Nearly all spots that [`TILTED`] shows have more. Where light rises along
/// the row, noise that [`TILTED`] takes for a spot, or nearly, has 0.3 to 0.77. It is 0.8, Q16.
const LEAST_EVIDENCE: i32 = 52_429;

/// The tables for the noise of a spot of this height.
#[inline(always)]
fn for_mix(noise: Counts, height: Counts, geometry: &Geometry) -> &'static TableSet<'static> {
    // Q24 both. Noise is below 2^16 counts.
    let noise = noise.to_bits().clamp(0, 1 << 24);
    let read = product(noise, noise).wrapping_mul(1 << 8);
    let shot = product(
        height.to_bits(),
        geometry.shot_variance_per_count_q16.into(),
    );
    let [white, ..] = &MIXES;
    // Below 2^47, so its product with a number of 16 bits fits.
    let found = MIXES
        .iter()
        .find(|&&(least, _)| read >= shot.wrapping_mul(least.into()) >> 16);
    found.unwrap_or(white).1
}

/// Pixels in a flank: the background on one side of the spot, which is tested for a tilt.
const FLANK: usize = 16;
/// The least difference of the flanks that is a tilt, in standard deviations. Noise alone gets there in one
/// row of 16,000.
const TILT: i32 = 4;
/// The same over the standard deviation of a pixel: the difference's is sqrt(2 * FLANK) = 5.657 times as
/// large. Q8.
const TILT_IN_NOISE: i32 = 1448 * TILT;
/// Widths from the centre to the flanks. The side lobes of a slit's diffraction pattern, which are 4.5 % of
/// its peak at four widths, are 1 % there.
const CLEAR: i32 = 6;

/// Whether the background is higher on one side of the spot than on the other. `false` where a flank reaches
/// over the sensor's edge.
fn is_tilted(light: Light<'_>, fit: &Fit<'_>, noise: Counts) -> bool {
    let Some((left, right)) = flanks(light, fit) else {
        return false;
    };
    // Sums of a flank are below 2^16.
    let difference = sum(right).wrapping_sub(sum(left));
    i64::from(difference.unsigned_abs()) > product(noise.to_bits(), TILT_IN_NOISE) >> 16
        && is_straight(left, right, difference, fit.width, noise)
}

/// Whether each flank rises as steeply as the difference between the two says. A second spot on one flank
/// makes a difference too, but not that rise.
#[cold]
#[inline(never)]
fn is_straight(
    left: Light<'_>,
    right: Light<'_>,
    difference: i32,
    width: Pixels,
    noise: Counts,
) -> bool {
    const HALF: usize = FLANK / 2;
    const FLANK_Q16: i32 = Pixels::from_int(numeric::to_i32(FLANK)).to_bits();
    /// HALF^2 / FLANK.
    const TILT_Q16: i32 = Pixels::from_int(numeric::to_i32(HALF * HALF / FLANK)).to_bits();
    // Each of these is a rise in counts a pixel, times HALF^2, times `apart`: the pixels from flank to flank,
    // Q16, below 2^28 because a width is below 2^8 pixels.
    let apart = numeric::mul_i32(width.to_bits().min(1 << 24), 2 * CLEAR).wrapping_add(FLANK_Q16);
    let tilt = product(difference, TILT_Q16);
    let within = |flank: Light<'_>| {
        let (first, second) = flank.split(HALF);
        product(sum(second).wrapping_sub(sum(first)), apart)
    };
    // The standard deviation within a flank is sqrt(2 HALF) / HALF^2 = 1/16 of a pixel's: HALF^2 / 16 of it.
    let noise =
        product(noise.to_bits().clamp(0, 1 << 20), apart).wrapping_mul(i64::from(TILT) * 4) >> 8;
    let allowed = (tilt.unsigned_abs() / 2).wrapping_add(noise.unsigned_abs());
    within(left).abs_diff(tilt) <= allowed && within(right).abs_diff(tilt) <= allowed
}

/// The flanks to the left and to the right, equally far from the centre to half a pixel, so that the light of
/// a symmetric spot does not look like a tilt.
fn flanks<'a>(light: Light<'a>, fit: &Fit<'_>) -> Option<(Light<'a>, Light<'a>)> {
    const HALF: i32 = 1 << (Pixels::FRACTION - 1);
    // A centre is below 2^13 pixels, a width below 2^8.
    let centre = fit.centre.to_bits();
    let reach = numeric::mul_i32(CLEAR, fit.width.to_bits());
    let right = (numeric::add_i32(centre, reach) >> Pixels::FRACTION) + 1;
    // The mirror image of the pixel before `right`: there the left flank ends.
    let left =
        (numeric::add_i32(numeric::mul_i32(2, centre), 3 * HALF) >> Pixels::FRACTION) - right;
    let from = usize::try_from(left).ok()?.checked_sub(FLANK)?;
    let to = usize::try_from(right).ok()? + FLANK;
    let pixels = light.slice(from..to)?;
    let end = pixels.len().checked_sub(FLANK)?;
    Some((pixels.slice(..FLANK)?, pixels.slice(end..)?))
}

/// The sum of a flank, or of half of one: below 2^16.
fn sum(flank: Light<'_>) -> i32 {
    flank.iter().map(i32::from).fold(0, numeric::add_i32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::centre::tables::BLOCKS;
    use crate::centre::tables::GAUSSIAN;
    use crate::tests::{hash, row, spot_at, tcd1304dg};

    /// Height and u against f64, from no noise to 4095 counts, and from one electron a count to many.
    #[test]
    fn height_and_u_are_those_of_their_definitions() {
        let (mut worst, mut worst_u) = (0.0f64, 0.0f64);
        let bits = |bits: i32, fraction: i32| libm::ldexp(bits.into(), -fraction);
        for i in 0..4000 {
            let number = hash(i);
            let table = &GAUSSIAN.tables()[i % GAUSSIAN.tables().len()];
            let block = BLOCKS[i % BLOCKS.len()];
            // Heights of a sample from 60 to 32,760 counts.
            let value = (1 << 20) + (number % (580 << 20)).cast_signed();
            let fit = Fit {
                centre: Pixels::default(),
                width: Pixels::default(),
                ratio: (0.6 * 16_777_216.0) as i32 + (number >> 8).cast_signed(),
                slope: Slope::new(value).expect("positive"),
                class: WidthClass {
                    set: 0,
                    table: 0,
                    block,
                },
                table,
            };
            let noise = [0, 4095 << 8, 20 + (number % 5000).cast_signed()][i % 3];
            let geometry = Geometry {
                shot_variance_per_count_q16: [0, u16::MAX, (number >> 16) as u16][i / 3 % 3],
                ..tcd1304dg()
            };
            let (pixels, half) = (f64::from(block), f64::from(1u32 << halvings(block.into())));
            let height = f64::from(value) * bits(table.height_per_slope, 42);
            let amplitude = fit.amplitude().to_f64();
            worst = worst.max((amplitude - height * half / pixels).abs());
            let shot = f64::from(geometry.shot_variance_per_count_q16) / 65536.0 * height / half;
            let growth = 1.5 * bits(fit.ratio, 24) - 0.5;
            let variance = bits(noise, 8).powi(2) * pixels / (half * half)
                + shot * growth * bits(table.shot_share, 28);
            let exact =
                variance.sqrt() * bits(table.deviation_per_noise, 13) * pixels / f64::from(value);
            let found = fit
                .uncertainty(Counts::from_bits(noise), &geometry)
                .to_f64();
            let allowed = libm::ldexp(0.6, -16) + exact * 4e-5;
            worst_u = worst_u.max((found - exact).abs() / allowed);
            // Noise below zero counts as none, and the largest gives a u.
            let [none, least, most] = [Counts::default(), Counts::MIN, Counts::MAX]
                .map(|noise| fit.uncertainty(noise, &geometry));
            assert!(none == least && most > none, "{none} {least} {most}");
        }
        println!("{worst:.4} counts, {worst_u:.2} of what is allowed");
        assert!(worst < 0.003 && worst_u < 1.0);
    }

    #[test]
    fn the_noise_chooses_the_set() {
        // One electron a count: the variance of 1000 counts of light is 1000.
        let geometry = Geometry {
            shot_variance_per_count_q16: u16::MAX,
            ..tcd1304dg()
        };
        let height = Counts::from_int(1000);
        for (ratio, set) in [
            (1.0, 3),
            (0.8, 0),
            (0.13, 0),
            (0.11, 4),
            (0.03, 5),
            (0.01, 6),
        ] {
            let noise = Counts::from_f32(libm::sqrtf(1000.0 * ratio));
            assert_eq!(for_mix(noise, height, &geometry).number, set, "{ratio}");
        }
        assert_eq!(for_mix(Counts::MAX, Counts::MAX, &geometry).number, 3);
        assert_eq!(for_mix(Counts::MIN, Counts::MAX, &geometry).number, 6);
    }

    #[test]
    fn a_candidate_beside_the_row_is_at_the_edge() {
        for place in [64, 32_768, usize::MAX] {
            let (light, spot) = ([100; 64], spot_at(place, 31, 0.0, (100.0, 1.0)));
            let (row, geometry) = (row(&light), tcd1304dg());
            let fault = centre(&row, &spot, None, &geometry, &GAUSSIAN);
            assert!(matches!(fault, Err(Fault::SpotAtEdge { .. })), "{fault:?}");
        }
    }
}
