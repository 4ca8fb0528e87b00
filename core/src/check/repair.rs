//! The robust fit: the adaptive phase-table score, and if the row fails the check about that centre, a fit of
//! the pixels that belong to the spot.
//!
//! The first centre is `adaptive`'s. It stays if the row is its own mirror image about it (see `check`),
//! as is usual. If not, samples that do not belong to the spot are searched in three ways. Each way is a
//! series of fits ([`gauss_newton`]) with these samples masked:
//!
//! 1. **Pixels.** Hot and dead ones: the worst first, because one outlier bends the fit and makes good pixels
//!    look bad until it is gone.
//! 2. **Light.** A second spot or a reflection, which leads a fit astray from the start. The first fit takes
//!    only the spot's top and the dark. The next fits mask only the second light, wherever it is more than a
//!    thousandth of the spot.
//! 3. **One pixel** of a narrow spot. Among its few pixels one bad pixel makes all of them look bad. The
//!    normal equations tell which single pixels to mask: see `gauss_newton::least_without`.
//!
//! A fit is taken if the rest of the row is symmetric about it and scatters no more than noise explains. A
//! repair ends when the row's budget is used up ([`WorkBudget`]): a sample in one pass is one unit. The pass
//! of a step, which sums up the normal equations, takes 37 instructions a sample.

use core::cell::Cell;

use crate::base::{Pixels, WorkBudget, numeric};
use crate::centre::RowCentre;
use crate::centre::check_uncertainty;
use crate::centre::gauss_newton::{self, Fit, Parameters, SAMPLES, Sample, Start, Window};
use crate::centre::half_width::WIDTHS;
use crate::centre::tables::TILTED;
use crate::check::compare;
use crate::check::own_spot::Profile;
use crate::row::{Geometry, Row};
use crate::spot::Spot;

/// The least deviation of an outlier, in standard deviations. In one row of a hundred, one of 128 good pixels
/// gets there.
const OUTLIER: f32 = 4.0;
/// How well the shape of a spot is known, as a share of its height. An exact Fresnel pattern lies up to 7 %
/// from the gaussian that fits it best, most of it within a width.
const SHAPE_UNCERTAINTY: f32 = 0.02;
/// How well the shape is known from pixel to pixel, as a multiple of [`SHAPE_UNCERTAINTY`], times the square
/// of the width in pixels: half of the second difference of lobes that are 2.66 widths apart,
/// (2 pi / 2.66)^2 / 2.
const NEIGHBOUR_UNCERTAINTY: f32 = 2.8;
/// A narrower spot, in pixels, has too few pixels to mask any.
const NARROWEST: f32 = 1.0;
/// If a fit with masked pixels finds a narrower spot, in pixels, it is flagged: the few bad pixels that are
/// left may fit by chance.
pub(crate) const NARROWEST_SURE_REFIT: Pixels = Pixels::from_positive_f32(2.5);
/// The most bad pixels side by side, in samples. More samples side by side are light, which may be the spot.
const BAD_PIXELS: u32 = 3;
/// Half of a window, in widths: room for a second spot at five widths, with three widths to either side of
/// it. A window is no larger than that of [`gauss_newton`].
const HALF_WINDOW: f32 = 8.0;
/// A width has at most so many samples, where the light of a second spot is searched. A repair fits the row
/// many times, so they are fewer than in [`gauss_newton`].
const SAMPLES_A_WIDTH: f32 = 8.0;
/// Up to this width, in pixels, bad pixels are searched in samples of one pixel: larger samples hide them.
const SINGLE_PIXELS: f32 = 11.0;
/// The fewest samples to either side, from which the level is known.
const FEWEST: usize = 16;
/// The most fits that each mask more pixels than the one before.
const PIXEL_ROUNDS: usize = 4;
/// The most fits that each mask the second light anew.
const LIGHT_ROUNDS: usize = 2;
/// The most steps of a fit before samples are masked anew. A fit that has not arrived goes on in the next
/// round.
const STEPS_OF_ROUND: usize = 4;
/// The most steps of the fit to the spot's top and the dark. It is only a start.
const STEPS_OF_TOP: usize = 3;
/// The work of a repair besides what it pays pass by pass: it clears its window and masks, and compares a
/// fit with the first centre.
const WORK_OF_REPAIR: usize = 420;
/// The work of a step besides its sums: four exponentials, and the equations' solution.
const WORK_OF_STEP: usize = 12;
/// The work of comparing the row with its mirror image, masked samples left out.
const WORK_OF_CHECK: usize = 210;
/// The comparison takes so much more for each pixel of the width.
const WORK_OF_CHECKED_PIXEL: usize = 6;
/// The work of finding a start for a narrow spot's top.
const WORK_OF_START: usize = 30;
/// The start takes so much more for each pixel of the spot's block.
const WORK_OF_STARTING_PIXEL: usize = 3;
/// So many pixels are summed into samples in one unit of work.
const PIXELS_IN_A_UNIT: usize = 10;

/// Fits the row again. `None` where there is no better centre than the first one, which failed the check.
#[inline(never)]
pub fn repair(
    row: &Row<'_>,
    spot: &Spot,
    geometry: &Geometry,
    profile: Option<&Profile>,
    first: &RowCentre,
    budget: &mut WorkBudget,
) -> Option<RowCentre> {
    // The tilt tables ignore a slope. The fits below would take it for outliers.
    if first.class.set == TILTED.number {
        return None;
    }
    budget.pay(WORK_OF_REPAIR)?;
    let scene = Scene {
        row,
        spot,
        geometry,
        profile,
        found: *first,
        budget: Cell::new(*budget),
    };
    let found = scene.refit();
    *budget = scene.budget.get();
    found
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Cause {
    /// Bad pixels: a few, and no more than [`BAD_PIXELS`] side by side. More of them are a background that is
    /// not level.
    Pixels,
    /// The light of a second spot.
    Light,
}

/// A spot whose first centre failed the check.
struct Scene<'a> {
    row: &'a Row<'a>,
    spot: &'a Spot,
    geometry: &'a Geometry,
    profile: Option<&'a Profile>,
    /// The first centre.
    found: RowCentre,
    budget: Cell<WorkBudget>,
}

impl Scene<'_> {
    #[inline(never)]
    fn refit(&self) -> Option<RowCentre> {
        let start = Start {
            centre: self.found.centre,
            width: self.found.width.to_f32(),
            amplitude: self.found.amplitude.to_f32(),
            is_whole: true,
        };
        let mut window = Window::empty();
        self.fill_for_pixels(&start, &mut window)?;
        let mut at = window.parameters(&start);
        at.level = level(&window, &at);
        if at.width < NARROW
            && let Some(found) = self.fit_without_one(&mut window, at)
        {
            return Some(found);
        }
        window.unmask();
        if let Some(found) = self.fit_without_pixels(&mut window, at) {
            return Some(found);
        }
        if at.width < 2.0 {
            return None;
        }
        let of_width = self.spot.block().saturating_mul(WORK_OF_STARTING_PIXEL);
        self.pay(WORK_OF_START.saturating_add(of_width))?;
        let start = Start::find(self.row, self.spot).ok()?;
        self.fill_for_light(&start, &mut window)?;
        let start = window.parameters(&start);
        self.fit_without_light(&mut window, start)
    }

    /// Fills the window in which bad pixels are searched. `None` if the budget is too small.
    fn fill_for_pixels(&self, start: &Start, window: &mut Window) -> Option<()> {
        if start.width > SINGLE_PIXELS {
            return self.fill_for_light(start, window);
        }
        let half = numeric::whole_usize(HALF_WINDOW * start.width);
        self.fill(start, (half, 1), window)
    }

    /// Fills the window in which the light of a second spot is searched. `None` as above.
    fn fill_for_light(&self, start: &Start, window: &mut Window) -> Option<()> {
        let block = gauss_newton::pixels_a_sample(start.width, SAMPLES_A_WIDTH);
        let half = numeric::whole_usize(HALF_WINDOW * start.width);
        let half = half.min(gauss_newton::half_window(start.width));
        self.fill(start, (half / block, block), window)
    }

    /// Fills a window with so many samples to either side, each of so many pixels. There is room for 64.
    fn fill(
        &self,
        start: &Start,
        (half, block): (usize, usize),
        window: &mut Window,
    ) -> Option<()> {
        let half = half.clamp(FEWEST, SAMPLES / 2);
        let samples = half.saturating_mul(2);
        let pixels = samples.saturating_mul(block);
        self.pay((samples / 2).saturating_add(pixels / PIXELS_IN_A_UNIT))?;
        window.fill_around((half, block), self.row, self.spot, start, self.geometry);
        Some(())
    }

    /// Takes a pass over so many samples from the budget. `None` if too little is left.
    fn pay(&self, samples: usize) -> Option<()> {
        let mut left = self.budget.get();
        left.pay(samples)?;
        self.budget.set(left);
        Some(())
    }

    /// Fits by as many steps as are needed, and no more than are allowed.
    fn fit(&self, window: &Window, at: Parameters, most: usize) -> Option<Fit> {
        let step = window.samples().len().saturating_add(WORK_OF_STEP);
        let before = self.budget.get();
        let most = most.min(before.left().checked_div(step)?);
        // A fit without a solution may have taken all steps.
        self.pay(step.saturating_mul(most))?;
        let fit = gauss_newton::fit(window.samples(), at, self.shot(), most)?;
        self.budget.set(before);
        self.pay(step.saturating_mul(fit.steps))?;
        Some(fit)
    }

    /// How the samples deviate from a spot. In place, because copies take time.
    fn residuals(&self, window: &Window, at: &Parameters, residuals: &mut Residuals) -> Option<()> {
        self.pay(window.samples().len())?;
        residuals.measure(window, at, self.shot());
        Some(())
    }

    fn shot(&self) -> f32 {
        self.spot.background.variances(self.geometry).1
    }

    /// Makes a centre of a fit, if the samples that are not masked pass the check about it.
    #[inline(never)]
    fn accept(
        &self,
        window: &Window,
        fit: &Fit,
        residuals: &Residuals,
        cause: Cause,
    ) -> Option<RowCentre> {
        let found = window.row_centre(fit);
        let found = RowCentre {
            misfit: found.width < NARROWEST_SURE_REFIT,
            ..found
        };
        let freedom = residuals.unmasked - 4.0;
        let is_noise = residuals.squares <= freedom + gauss_newton::allowed_scatter(freedom);
        let (uncertainty, width) = (found.uncertainty.to_f32(), found.width.to_f32());
        // A first centre that was more than a width off is a reason to doubt the second.
        let moved = self.found.centre.to_bits().abs_diff(found.centre.to_bits())
            > self.found.width.to_bits().unsigned_abs();
        let sound = fit.has_arrived()
            && WIDTHS.contains(&found.width)
            && width >= NARROWEST
            && window.has_centre(&fit.parameters)
            && check_uncertainty(found.amplitude, found.uncertainty, found.width).is_ok();
        if !sound || moved || !is_noise || !self.has_enough(window, fit, uncertainty, cause) {
            return None;
        }
        let masked = window.masked_pixels();
        let own = (self.profile).map(|profile| profile.at(self.row.on_sensor(found.centre)));
        let own = own.as_ref();
        let of_width = numeric::whole_usize(width).saturating_mul(WORK_OF_CHECKED_PIXEL);
        self.pay(WORK_OF_CHECK.saturating_add(of_width))?;
        let verdict = compare(self.row, self.spot, &found, self.geometry, own, &masked)?;
        verdict.is_clean().then_some(RowCentre {
            shape: verdict.shape,
            ..found
        })
    }

    /// Whether the samples that are not masked suffice for the centre.
    fn has_enough(&self, window: &Window, fit: &Fit, uncertainty: f32, cause: Cause) -> bool {
        let masked = Masked::of(window, &fit.parameters);
        // The variance of the centre if no sample were masked.
        let found = window.row_centre(fit);
        let (noise, shot) = self.spot.background.variances(self.geometry);
        let per_height = 1.0 / found.amplitude.to_f32();
        let whole = found.width.to_f32() * per_height * (1.13 * noise * per_height + 0.4 * shot);
        masked.are_few
            || (cause == Cause::Light
                && !masked.are_at_top
                && uncertainty * uncertainty <= 4.0 * whole)
    }

    /// Fits again and again, and masks the samples that deviate, the worst first, until none deviates.
    #[inline(never)]
    fn fit_without_pixels(&self, window: &mut Window, mut at: Parameters) -> Option<RowCentre> {
        let mut residuals = Residuals::NONE;
        self.residuals(window, &at, &mut residuals)?;
        for _ in 0..PIXEL_ROUNDS {
            self.pay(window.samples().len() / 2)?;
            mask_outliers(window, &residuals);
            // The next rounds mask more samples.
            if !Masked::of(window, &at).are_few {
                return None;
            }
            let fit = self.fit(window, at, STEPS_OF_ROUND)?;
            at = fit.parameters;
            self.residuals(window, &at, &mut residuals)?;
            if residuals.worst <= OUTLIER && fit.has_arrived() {
                return self.accept(window, &fit, &residuals, Cause::Pixels);
            }
        }
        None
    }

    #[inline(never)]
    fn fit_without_light(&self, window: &mut Window, mut at: Parameters) -> Option<RowCentre> {
        mask_but_top_and_dark(window, &at);
        at = self.fit(window, at, STEPS_OF_TOP)?.parameters;
        let (mut before, mut residuals) = (None, Residuals::NONE);
        for _ in 0..LIGHT_ROUNDS {
            window.unmask();
            self.pay(window.samples().len().saturating_mul(2))?;
            mask_second(window, &at, self)?;
            let masked = window.masked_pixels();
            if before == Some(masked) {
                return None;
            }
            let fit = self.fit(window, at, STEPS_OF_ROUND)?;
            before = fit.has_arrived().then_some(masked);
            at = fit.parameters;
            self.residuals(window, &at, &mut residuals)?;
            if let Some(found) = self.accept(window, &fit, &residuals, Cause::Light) {
                return Some(found);
            }
        }
        None
    }

    /// Fits the spot with one sample masked: the one without which the rest scatters least. The normal
    /// equations at the start choose the samples that are tried.
    #[inline(never)]
    fn fit_without_one(&self, window: &mut Window, at: Parameters) -> Option<RowCentre> {
        // A place before the window becomes its first sample.
        let first = numeric::whole_usize(at.centre - 3.0 * at.width);
        let end = numeric::whole_usize(at.centre + 3.0 * at.width).saturating_add(1);
        let end = end.min(window.samples().len());
        // The equations without a sample are solved in 160 instructions.
        let passes = window.samples().len().saturating_mul(2);
        let solutions = end.saturating_sub(first).saturating_mul(4);
        let work = passes.saturating_add(solutions);
        self.pay(work.saturating_add(WORK_OF_STEP))?;
        let candidates =
            gauss_newton::least_without(window.samples(), first..end, &at, self.shot());
        let mut best: Option<(f32, RowCentre)> = None;
        let mut residuals = Residuals::NONE;
        for candidate in candidates.into_iter().flatten() {
            window.unmask();
            if let Some(sample) = window.samples.get_mut(candidate) {
                sample.mask();
            }
            let Some(fit) = self.fit(window, at, gauss_newton::MAX_STEPS) else {
                continue;
            };
            self.residuals(window, &fit.parameters, &mut residuals)?;
            if residuals.worst <= OUTLIER
                && best.is_none_or(|(least, _)| residuals.squares < least)
                && let Some(found) = self.accept(window, &fit, &residuals, Cause::Pixels)
            {
                best = Some((residuals.squares, found));
            }
        }
        best.map(|(_, found)| found)
    }
}

/// What the check masked of a spot.
struct Masked {
    /// Bad pixels may be so few, and so near each other.
    are_few: bool,
    /// A masked sample is within a width of the centre.
    are_at_top: bool,
}

impl Masked {
    fn of(window: &Window, at: &Parameters) -> Self {
        let all_masked = window.bits(Sample::is_masked_by_check);
        let within = |widths: f32| {
            let reach = widths * at.width;
            let first = numeric::whole_usize(libm::ceilf(at.centre - reach)).min(SAMPLES);
            let end = numeric::whole_usize(at.centre + reach).saturating_add(1);
            let end = end.min(window.samples().len());
            let bits = all_masked & bits_below(end) & !bits_below(first);
            (end.saturating_sub(first), bits)
        };
        let (all, masked) = within(3.0);
        let (_, masked_at_top) = within(1.0);
        let masked = masked.count_ones() as usize;
        // The first sample of each run that is too long.
        let too_long = (0..=BAD_PIXELS).fold(u128::MAX, |runs, i| runs & (all_masked >> i));
        Self {
            are_few: too_long == 0 && (masked <= all / 8 || masked <= 1),
            are_at_top: masked_at_top != 0,
        }
    }
}

/// The lowest bits, so many of them.
const fn bits_below(number: usize) -> u128 {
    match 1u128.checked_shl(numeric::to_u32(number)) {
        Some(bit) => bit.wrapping_sub(1),
        None => u128::MAX,
    }
}

/// In a narrower spot than this, in pixels, each pixel in turn is masked: at most 2 * 3 * 3 + 1 of them.
const NARROW: f32 = 3.0;

/// How the samples of a window deviate from a spot.
struct Residuals {
    /// The square of each sample's deviation in standard deviations; zero where it is masked.
    deviations: [f32; SAMPLES],
    /// The largest deviation, in standard deviations.
    worst: f32,
    /// The sum of the squares of the deviations from the spot.
    squares: f32,
    unmasked: f32,
}

impl Residuals {
    const NONE: Self = Self {
        deviations: [0.0; SAMPLES],
        worst: 0.0,
        squares: 0.0,
        unmasked: 0.0,
    };

    #[inline(never)]
    fn measure(&mut self, window: &Window, at: &Parameters, shot: f32) {
        // Each place holds the spot's light over its height, until the deviation replaces it.
        gauss_newton::exponentials(at, &mut self.deviations);
        let (mut squares, mut unmasked) = (0.0, 0.0);
        let shape = SHAPE_UNCERTAINTY * at.amplitude;
        let from_spot = shape * shape;
        let neighbours = NEIGHBOUR_UNCERTAINTY / (at.width * at.width);
        let from_neighbours = if neighbours < 1.0 {
            from_spot * neighbours * neighbours
        } else {
            from_spot
        };
        // Of the sample before, and of the one before that: the deviation from the spot in counts, and its
        // variance. A masked sample has a variance beside which no deviation counts.
        let (mut last, mut middle) = ((0.0, f32::INFINITY), (0.0, f32::INFINITY));
        let (mut place, mut largest) = (&mut 0.0, 0.0f32);
        for (sample, deviation) in window.samples().iter().zip(&mut self.deviations) {
            let light = at.amplitude * *deviation;
            let residual = sample.counts - at.level - light;
            let variance = sample.variance + shot * light;
            let square = residual * residual / (variance + from_spot);
            squares += square;
            unmasked += if sample.is_masked() { 0.0 } else { 1.0 };
            // The deviation of the sample before from the mean of its neighbours.
            let bent = middle.0 - 0.5 * (last.0 + residual);
            let bent = bent * bent / (middle.1 + 0.25 * (last.1 + variance) + from_neighbours);
            if bent > *place {
                *place = bent;
            }
            if *place > largest {
                largest = *place;
            }
            *deviation = square;
            (last, middle, place) = (middle, (residual, variance), deviation);
        }
        // The last sample has one neighbour.
        if *place > largest {
            largest = *place;
        }
        (self.squares, self.unmasked) = (squares, unmasked);
        self.worst = dual_mac::square_root(largest);
    }
}

/// Masks outliers. An outlier makes its good neighbours deviate too, by half as much: these stay.
fn mask_outliers(window: &mut Window, residuals: &Residuals) {
    let least = 0.6 * residuals.worst;
    let least = if least > OUTLIER { least } else { OUTLIER };
    for (sample, square) in window.samples.iter_mut().zip(&residuals.deviations) {
        if *square > least * least {
            sample.mask();
        }
    }
}

/// The spot's top reaches this many widths from the centre.
const TOP: f32 = 2.0;

fn mask_but_top_and_dark(window: &mut Window, at: &Parameters) {
    let shape = SHAPE_UNCERTAINTY * at.amplitude;
    for (i, sample) in window.samples.iter_mut().enumerate() {
        let far = (i as f32 - at.centre).abs() > TOP * at.width;
        let dark =
            sample.counts * sample.counts < OUTLIER * OUTLIER * (sample.variance + shape * shape);
        if far && !dark {
            sample.mask();
        }
    }
}

/// Masks the second spot that stands out most beside the spot's top, wherever it has more than a thousandth
/// of the spot's height. A second spot has the spot's width, so two widths from its top less than half of it
/// is left (of a gaussian 14 %). `None` where no light falls like that: a flare is wider, a tail has no top
/// of its own, and noise does not stand out.
fn mask_second(window: &mut Window, at: &Parameters, scene: &Scene<'_>) -> Option<()> {
    let mut beside = [0.0; SAMPLES];
    gauss_newton::exponentials(at, &mut beside);
    for (sample, light) in window.samples().iter().zip(&mut beside) {
        *light = sample.counts - at.level - at.amplitude * *light;
    }
    let length = window.samples().len();
    // The light up to each sample, without it.
    let mut sums = [0.0; SAMPLES + 1];
    let mut sum = 0.0;
    for (next, light) in sums.iter_mut().skip(1).zip(beside.iter().take(length)) {
        sum += light;
        *next = sum;
    }
    // The mean over about a width, where all of it is in the window.
    let reach = numeric::whole_usize(0.5 * at.width);
    let samples = reach.saturating_mul(2).saturating_add(1);
    let per_sample = 1.0 / samples as f32;
    let sums = sums.get(..=length)?;
    let (mut most, mut place) = (0.0, 0);
    for (i, (end, from)) in (reach..SAMPLES).zip(sums.iter().skip(samples).zip(sums)) {
        let sum = end - from;
        if sum > most && (i as f32 - at.centre).abs() > NEAREST_SECOND * at.width {
            (most, place) = (sum, i);
        }
    }
    let top = most * per_sample;
    let noise = dual_mac::square_root(window.samples().get(place)?.variance * per_sample);
    let stands_out = top > OUTLIER * noise;
    if !stands_out {
        return None;
    }
    let mean = |place: usize| {
        let from = place.checked_sub(reach)?;
        let end = sums.get(from.saturating_add(samples))?;
        Some((end - sums.get(from)?) * per_sample)
    };
    // The second spot's height over the most light of it that stays unmasked.
    let ratio = top / at.amplitude * HEIGHT_OVER_UNMASKED;
    if !(1.0..HEIGHT_OVER_UNMASKED).contains(&ratio) {
        return None;
    }
    // Samples of a window: below 2^8.
    let flank = numeric::whole_i32(2.0 * at.width);
    let falls = |place: i32| {
        let inside = usize::try_from(place).ok().and_then(mean);
        // The first spot does not reach beyond the window: take the row itself.
        let mean =
            inside.or_else(|| Some(window.mean(scene.row, scene.spot, place, reach)? - at.level));
        mean.is_some_and(|mean| mean < 0.5 * top)
    };
    let place_of_top = numeric::to_i32(place);
    if !falls(place_of_top.saturating_sub(flank)) || !falls(place_of_top.saturating_add(flank)) {
        return None;
    }
    let reach = dual_mac::square_root(2.0 * libm::logf(ratio)) * at.width;
    for (i, sample) in window.samples.iter_mut().enumerate() {
        if (i as f32 - place as f32).abs() <= reach {
            sample.mask();
        }
    }
    Some(())
}

/// A second spot's top is further than this many widths from the first's.
const NEAREST_SECOND: f32 = 1.5;
/// The spot's height over the most light of a second spot that stays unmasked.
const HEIGHT_OVER_UNMASKED: f32 = 1000.0;

/// The level under the spot: the mean of the samples less the spot's light. An outlier shifts the level, but
/// by far less than its own deviation.
fn level(window: &Window, at: &Parameters) -> f32 {
    let mut light = [0.0; SAMPLES];
    gauss_newton::exponentials(at, &mut light);
    let (mut sum, mut unmasked) = (0.0, 0.0);
    for (sample, light) in window.samples().iter().zip(&light) {
        if !sample.is_masked() {
            sum += sample.counts - at.amplitude * light;
            unmasked += 1.0;
        }
    }
    if unmasked > 0.0 { sum / unmasked } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::{found_at, gaussian, hash, row, tcd1304dg};

    /// Whether a repair masks the light of a second spot of this height, six widths from a spot of 2000
    /// counts, in noise of 0 to 31 counts.
    fn masks_second(height: f32, seed: usize) -> bool {
        let light: [u16; 1000] = core::array::from_fn(|i| {
            let spots = 2000.0 * gaussian(i, 500.3, 8.0) + height * gaussian(i, 548.3, 8.0);
            (300.0 + spots) as u16 + (hash(i + 1000 * seed) >> 27) as u16
        });
        let row = row(&light);
        let (spot, budget) = crate::spot::find(&row).expect("a spot");
        let scene = Scene {
            row: &row,
            spot: &spot,
            geometry: &tcd1304dg(),
            profile: None,
            found: found_at(500.3, 8.0),
            budget: Cell::new(budget),
        };
        let start = Start::find(&row, &spot).expect("a start");
        let mut window = Window::empty();
        scene.fill_for_light(&start, &mut window).expect("work");
        let start = window.parameters(&start);
        let fit = scene.fit(&window, start, STEPS_OF_ROUND).expect("a fit");
        mask_second(&mut window, &fit.parameters, &scene).is_some()
    }

    #[test]
    fn a_second_spot_stands_out_of_noise_and_noise_does_not() {
        for seed in 0..20 {
            assert!(!masks_second(0.0, seed), "{seed}");
            assert!(masks_second(60.0, seed), "{seed}");
        }
    }
}
