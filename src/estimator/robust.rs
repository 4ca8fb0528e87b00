//! The adaptive phase-table score with a second look: pixels that do not belong to the spot are found and left out.
//!
//! The first look is [`adaptive`]'s. The second compares the row with the spot that it found. Where all pixels agree, which is
//! usual, the first look's centre stands. Where some do not (hot
//! and dead pixels, a second spot, a reflection), they are masked, the worst first, and [`gauss_newton`] fits what is left, until
//! no more pixels leave. A spot whose top is at full scale goes there at once.
//!
//! **Outliers.** A pixel is one if it deviates by more than four standard deviations, and by at least half of what the worst
//! one does: an outlier bends the fit, and makes good pixels look bad until it is gone. The spot's own shape is trusted to 2 % of
//! its height (an exact Fresnel pattern lies up to 7 % from the gaussian that fits it best).
//!
//! **Flag.** `misfit` is set where pixels were left out that make up more than an eighth of the spot's within three widths, or where
//! what was kept still scatters more than noise explains: the sum of squares beyond five of its standard deviations.

use crate::estimator::gauss_newton::{self, Parameters, SAMPLES, Sample, Start, Window};
use crate::estimator::half_width::WIDTHS;
use crate::estimator::plausible::{certain, variances};
use crate::estimator::tables::{NARROWEST, TILTED};
use crate::estimator::{RowCentre, adaptive};
use crate::reading::Fault;
use crate::row::{Geometry, Row};
use crate::spot::Spot;

/// Standard deviations from which on a pixel is an outlier: of 128 good ones, one does so in a row of a hundred.
const OUTLIER: f32 = 4.0;

/// The share of the spot's height to which its shape is known.
const SHAPE: f32 = 0.02;

/// Fits at most, each with more pixels masked. An outlier and what it hides take two or three.
const ROUNDS: usize = 6;

/// The centre of a spot.
///
/// # Errors
/// See [`crate::estimator::centre`]; [`Fault::Saturated`] only where the pixels below full scale are too few.
pub fn centre(
    row: &Row<'_>,
    spot: &Spot,
    before: Option<&RowCentre>,
    geometry: &Geometry,
) -> Result<RowCentre, Fault> {
    let found = match adaptive::centre(row, spot, before, geometry) {
        // A tilt is nothing to these tables, and would be an outlier to what follows.
        Ok(found) if found.class.set == TILTED.number() => return Ok(found),
        Ok(found) => found,
        Err(Fault::Saturated { .. }) => {
            return gauss_newton::centre(row, spot, before, geometry);
        }
        // Where the first look sees no spot there is none: what the second would make of a hot pixel is not to be trusted.
        Err(fault) => return Err(fault),
    };
    let start = Start {
        centre: found.centre,
        width: found.width.to_f32(),
        amplitude: found.amplitude.to_f32(),
    };
    let (_, shot) = variances(&spot.background, geometry);
    let window = Window::around(row.light(), spot, &start, geometry);
    let mut at = window.parameters(&start);
    at.level = level(&window, &at);
    let look = Look::at(&window, &at, shot);
    if look.worst <= OUTLIER {
        return Ok(RowCentre {
            misfit: look.scatters(),
            ..found
        });
    }
    // An outlier among the spot's pixels leads the first fits astray: the worst go first, the others may be good ones.
    let mut refit = without_outliers(window.clone(), at, shot, Leave::Worst);
    if !refit.is_some_and(|refit| refit.fits) {
        // What lies beside the spot leads it astray from the start: from its top outwards.
        let start = Start::find(row.light(), spot, geometry).unwrap_or(start);
        let mut window = Window::around(row.light(), spot, &start, geometry);
        let at = window.parameters(&start);
        window.mask_beyond(CORE, &at);
        let from_the_top = without_outliers(window, at, shot, Leave::All);
        refit = from_the_top.filter(|other| other.fits).or(refit);
    }
    if at.width < NARROW && !refit.is_some_and(|refit| refit.fits && !refit.centre.misfit) {
        // Among the few pixels of a narrow spot one bad pixel makes all of them look bad: each in turn.
        refit = without_one(&window, &at, shot).or(refit);
    }
    let refit = refit.filter(|refit| WIDTHS.contains(&refit.centre.width.to_f32()));
    let Some(Refit { centre, .. }) = refit else {
        // Too little is left, or what is left is no spot: the first look is all there is, and it does not fit.
        return Ok(RowCentre {
            misfit: true,
            ..found
        });
    };
    // A first look that was far off is a reason to doubt the second.
    let moved = found.centre.to_bits().abs_diff(centre.centre.to_bits())
        > found.width.to_bits().unsigned_abs();
    let (uncertainty, width) = (centre.uncertainty.to_f32(), centre.width.to_f32());
    certain(centre.amplitude.to_f32(), uncertainty, width)?;
    Ok(RowCentre {
        class: found.class,
        misfit: centre.misfit || moved,
        ..centre
    })
}

/// Whether a fit is of what can be a spot: a hot pixel alone is narrower than any.
fn is_sound(window: &Window, fit: &gauss_newton::Fit) -> bool {
    let found = window.row_centre(fit);
    found.width.to_f32() >= NARROWEST && window.holds(&fit.parameters)
}

/// A fit of what was left.
#[derive(Clone, Copy)]
struct Refit {
    centre: RowCentre,
    /// Whether what was left does fit.
    fits: bool,
}

/// A fit from the top starts from the samples within this many widths.
const CORE: f32 = 2.5;

/// Which outliers a round leaves out.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Leave {
    /// The worst, and those that are at least half as bad; they stay out.
    Worst,
    /// All, and each round looks at all pixels anew.
    All,
}

/// Narrower spots than this, in pixels, are tried without each of their pixels in turn: at most twice 3 * 3 and one.
const NARROW: f32 = 3.0;

/// The fit without the one sample whose absence leaves the least scatter. `None` where that scatters too.
#[inline(never)]
fn without_one(window: &Window, at: &Parameters, shot: f32) -> Option<Refit> {
    // `as` saturates: a place beyond the window is at its end.
    let first = (at.centre - 3.0 * at.width) as usize;
    let end = ((at.centre + 3.0 * at.width) as usize).saturating_add(1);
    let mut best: Option<(f32, RowCentre)> = None;
    for left_out in first..end.min(window.samples().len()) {
        let mut window = window.clone();
        if let Some(sample) = window.samples.get_mut(left_out) {
            sample.mask();
        }
        let Some(fit) = gauss_newton::fit(window.samples(), *at, shot) else {
            continue;
        };
        let look = Look::at(&window, &fit.parameters, shot);
        if is_sound(&window, &fit)
            && look.fits()
            && best.is_none_or(|(least, _)| look.squares < least)
        {
            let found = RowCentre {
                misfit: false,
                ..window.row_centre(&fit)
            };
            best = Some((look.squares, found));
        }
    }
    best.map(|(_, centre)| Refit { centre, fits: true })
}

/// Fits, leaves out the outliers, and fits again, until there are none. `None` where too little is left.
#[inline(never)]
fn without_outliers(
    mut window: Window,
    mut at: Parameters,
    shot: f32,
    leave: Leave,
) -> Option<Refit> {
    let mut found = None;
    let mut look = Look::at(&window, &at, shot);
    if leave == Leave::Worst {
        mask(&mut window, &look, &at, leave);
    }
    let mut sound = false;
    for _ in 0..ROUNDS {
        let fit = gauss_newton::fit(window.samples(), at, shot)?;
        sound = is_sound(&window, &fit);
        at = fit.parameters;
        if leave == Leave::All {
            window.unmask();
        }
        look = Look::at(&window, &at, shot);
        found = Some(window.row_centre(&fit));
        if look.worst <= OUTLIER {
            break;
        }
        mask(&mut window, &look, &at, leave);
    }
    let found = found?;
    look = Look::at(&window, &at, shot);
    let fits = sound && look.fits();
    Some(Refit {
        centre: RowCentre {
            misfit: !fits || window.masks_the_spot(&at),
            ..found
        },
        fits,
    })
}

/// How the samples of a window deviate from a spot.
struct Look {
    /// The square of each sample's deviation in standard deviations; zero where it is masked.
    deviations: [f32; SAMPLES],
    /// The largest deviation, in standard deviations.
    worst: f32,
    /// The sum of their squares.
    squares: f32,
    /// Samples that are not masked.
    kept: f32,
}

impl Look {
    #[inline(never)]
    fn at(window: &Window, at: &Parameters, shot: f32) -> Self {
        let mut look = Self {
            deviations: [0.0; SAMPLES],
            worst: 0.0,
            squares: 0.0,
            kept: 0.0,
        };
        let light = gauss_newton::exponentials(at);
        let shape = SHAPE * at.amplitude;
        let pixels = window.samples().iter().zip(&light);
        for ((sample, light), deviation) in pixels.zip(&mut look.deviations) {
            if sample.is_masked() {
                continue;
            }
            let light = at.amplitude * light;
            let residual = sample.counts - at.level - light;
            let variance = sample.variance + shot * light;
            let square = residual * residual / (variance + shape * shape);
            *deviation = square;
            look.worst = if square > look.worst {
                square
            } else {
                look.worst
            };
            look.squares += square;
            look.kept += 1.0;
        }
        look.worst = dual_mac::square_root(look.worst);
        look
    }

    /// Whether there is neither an outlier nor more scatter than noise explains.
    fn fits(&self) -> bool {
        self.worst <= OUTLIER && !self.scatters()
    }

    /// Whether the squares add up to more than noise explains.
    fn scatters(&self) -> bool {
        let freedom = self.kept - 4.0;
        self.squares > freedom + gauss_newton::allowed_scatter(freedom)
    }
}

/// Masks outliers.
fn mask(window: &mut Window, look: &Look, at: &Parameters, leave: Leave) {
    let least = match leave {
        Leave::Worst if look.worst > 2.0 * OUTLIER => 0.5 * look.worst,
        _ => OUTLIER,
    };
    for (sample, square) in window.samples.iter_mut().zip(&look.deviations) {
        if *square > least * least {
            sample.mask();
        }
    }
    if leave == Leave::All || look.worst <= 2.0 * OUTLIER {
        // Three outliers side by side are light, whose flanks are there too where they do not stand out.
        let flank = (FLANK * at.width) as usize;
        for (i, three) in look.deviations.windows(3).enumerate() {
            if three.iter().all(|square| *square > least * least) {
                let flanks = window.samples.iter_mut().skip(i.saturating_sub(flank));
                flanks
                    .take(flank.saturating_mul(2).saturating_add(3))
                    .for_each(Sample::mask);
            }
        }
    }
}

/// How far the flanks of a second spot reach beyond where it stands out, in widths.
const FLANK: f32 = 1.5;

/// The level under the spot: the mean of what is left of the samples without it. An outlier shifts it, but deviates by far more
/// than that makes the others deviate.
fn level(window: &Window, at: &Parameters) -> f32 {
    let light = gauss_newton::exponentials(at);
    let (mut sum, mut kept) = (0.0, 0.0);
    for (sample, light) in window.samples().iter().zip(&light) {
        if !sample.is_masked() {
            sum += sample.counts - at.amplitude * light;
            kept += 1.0;
        }
    }
    if kept > 0.0 { sum / kept } else { 0.0 }
}
