//! Combines the images of a frame: over slits in each row, and over the rows for each slit.
//!
//! The variance by speckle of an image is one over its light (see [`crate::reading::uncertainty`]), so the
//! slits are weighed by their light. Their scatter about the mean is that variance, measured in this very
//! frame: with images of the heights h about their mean with these weights, e^2 = sum h r^2 / (n - 1), and
//! the mean has the variance e^2 / sum h. Noise adds its own variance to that of each image.

use core::num::NonZeroU16;

use serde::{Deserialize, Serialize};

use crate::base::numeric::{self, at_least, square};
use crate::base::{Counts, Fault, Pixels};
use crate::centre::RowCentre;
use crate::frame::comb::MAX_SLITS;
use crate::frame::comb::assignment::{self, FEWEST};

/// An image is left out if it is so many standard deviations from the mean of the others, times Student's
/// factor for the number of the others.
const OUTLIER: f32 = 4.5;
/// How much the errors of the mean exceed what the scatter of independent images says, because neighbouring
/// images share some of their speckle. Speckles of a 0.42 mm laser spot are wider than the gaps. For that
/// spot the factor is 1.05 in light of a single wavelength. A line of 1 nm, as cheap laser diodes have, draws
/// speckles out along the mask, and the factor is 1.16. With a spot of 1 mm it is 1
/// (host-tests/tests/comb.rs). Rows tell neither the spot nor the line, so this is midway between 1.05 and
/// 1.16.
pub const NEIGHBOURS: f32 = 1.10;

/// The images of a frame's rows, so far.
#[derive(Clone, Debug, Default)]
pub struct Scatter {
    slits: [OfSlit; MAX_SLITS],
}

/// The images of one slit in a frame.
#[derive(Clone, Copy, Debug, Default)]
struct OfSlit {
    /// How much the slit counts in the mean of a row: its height in the first row of the frame that has
    /// images.
    weight: f32,
    /// x0 less the row's mean, in pixels, in the latest row with an image.
    latest: f32,
    /// The sum of the same over the rows.
    sum: f32,
    /// The sum of the images' variances by noise, in pixels^2.
    variance: f32,
    /// The sum of their heights.
    height: f32,
    /// The sum of their centres on the row, in the bits of [`Pixels`].
    centre: i64,
    /// Rows with an image.
    rows: u16,
}

/// The images of one slit: their mean over a frame's rows. In 8 bytes, because a frame's result is copied
/// several times.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct SlitCentre {
    /// The centre on the row.
    pub centre: Pixels,
    /// The height in counts.
    pub height: u16,
    /// Rows with an image.
    pub rows: NonZeroU16,
}

/// The slits' centres. A slit without an image in a frame has none.
pub type SlitCentres = [Option<SlitCentre>; MAX_SLITS];

/// What the slits of a frame say together.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Combined {
    /// What to add to the frame's mean of row centres.
    pub shift: Pixels,
    /// Standard uncertainty of the centre by speckle, from the scatter of the slits.
    pub surface: Pixels,
    /// Slits used.
    pub used: u8,
    /// The centre of each slit's image.
    pub centres: SlitCentres,
}

#[derive(Clone, Copy, Debug)]
pub(super) struct Image {
    /// The number of the slit.
    pub slit: usize,
    /// The centre on the row, with its uncertainty, height and width.
    pub found: RowCentre,
    /// From the row's common origin to x0, in pixels.
    pub off: f32,
    /// The uncertainty of x0 by noise, in pixels.
    pub noise: f32,
}

impl Scatter {
    /// Forgets the rows, for the next frame.
    pub fn clear(&mut self) {
        *self = Self::default();
    }

    /// Adds a row's images. Returns their mean from the row's origin and its uncertainty by noise, both in
    /// pixels.
    ///
    /// The weights are those of the frame's first row. If a slit has no image in a row, its latest image
    /// tells how far the mean of the others is off: a target at rest then gives the same centre, whichever
    /// slits have an image. A slit that has its first image in a later row does not count in the mean of
    /// rows, but in the frame's.
    ///
    /// # Errors
    /// [`Fault::FewSlits`] if less than [`FEWEST`] of the first row's slits have an image.
    pub(super) fn add(&mut self, images: &[Image]) -> Result<(f32, f32), Fault> {
        if images.len() < FEWEST {
            return Err(assignment::few(images.len()));
        }
        if self.slits.iter().all(|slit| slit.weight <= 0.0) {
            for image in images {
                if let Some(slit) = self.slits.get_mut(image.slit) {
                    slit.weight = light(image.found.amplitude);
                }
            }
        }
        // At most 16 heights below 2^15 counts and places below 2^17 pixels.
        let (mut weights, mut sum, mut latest, mut variance) = (0.0, 0.0, 0.0, 0.0);
        let mut counted = 0;
        for image in images {
            let Some(slit) = self.slits.get(image.slit).filter(|slit| slit.weight > 0.0) else {
                continue;
            };
            counted = numeric::add_usize(counted, 1);
            weights += slit.weight;
            sum += slit.weight * image.off;
            latest += slit.weight * slit.latest;
            variance += square(slit.weight * image.noise);
        }
        if counted < FEWEST {
            return Err(assignment::few(counted));
        }
        let (mut all, mut all_latest) = (0.0, 0.0);
        for slit in &self.slits {
            all += slit.weight;
            all_latest += slit.weight * slit.latest;
        }
        // Weights are above zero: those of at least `FEWEST` images.
        let mean = (sum - latest) / weights + all_latest / all;
        for image in images {
            if let Some(slit) = self.slits.get_mut(image.slit) {
                slit.latest = image.off - mean;
                slit.sum += slit.latest;
                slit.variance += square(image.noise);
                slit.height += light(image.found.amplitude);
                let centre = image.found.centre.to_bits();
                slit.centre = slit.centre.saturating_add(centre.into());
                slit.rows = slit.rows.saturating_add(1);
            }
        }
        Ok((mean, dual_mac::square_root(variance) / weights))
    }

    /// Combines the slits of a frame.
    ///
    /// # Errors
    /// [`Fault::FewSlits`] if fewer than [`FEWEST`] slits have images and agree.
    #[inline(never)]
    pub fn combine(&self) -> Result<Combined, Fault> {
        let mut members = [Member::default(); MAX_SLITS];
        let mut centres = SlitCentres::default();
        for ((member, centre), slit) in members.iter_mut().zip(&mut centres).zip(&self.slits) {
            let Some(rows) = NonZeroU16::new(slit.rows) else {
                continue;
            };
            let per_row = 1.0 / f32::from(slit.rows);
            let height = slit.height * per_row;
            *member = Member {
                counts: true,
                off: slit.sum * per_row,
                variance: slit.variance * square(per_row),
                light: height,
            };
            *centre = Some(SlitCentre {
                // A mean lies between its values.
                centre: Pixels::from_bits(numeric::i64_to_i32(
                    slit.centre.div_euclid(slit.rows.max(1).into()),
                )),
                height: numeric::whole_u16(height + 0.5),
                rows,
            });
        }
        leave_outliers_out(&mut members);
        let used = number(&members);
        if used < FEWEST {
            return Err(assignment::few(used));
        }
        let mean = Mean::of(&members);
        Ok(Combined {
            shift: Pixels::from_f32(mean.off),
            surface: Pixels::from_f32(
                dual_mac::square_root(mean.by_speckle) * small_sample(used) * NEIGHBOURS,
            ),
            used: u8::try_from(used).unwrap_or(u8::MAX),
            centres,
        })
    }
}

#[derive(Clone, Copy, Debug, Default)]
struct Member {
    counts: bool,
    /// Its mean x0 from the frame's, in pixels: below 2^17.
    off: f32,
    /// Variance by noise, in pixels^2.
    variance: f32,
    /// Mean height in counts, at least 1.
    light: f32,
}

/// The weighted mean of the members that count.
struct Mean {
    /// The mean, in pixels.
    off: f32,
    /// The variance of the mean by speckle, in pixels^2.
    by_speckle: f32,
    /// e^2: the variance by speckle of an image of one count.
    of_one_count: f32,
    /// The whole variance of the mean.
    variance: f32,
}

impl Mean {
    /// First with weights by light, from which e^2 follows; then with weights by all of the variance.
    fn of(members: &[Member]) -> Self {
        let (mut weights, mut sum, mut explained, mut count) = (0.0, 0.0, 0.0, 0.0);
        for it in counting(members) {
            weights += it.light;
            sum += it.light * it.off;
            explained += it.light * it.variance;
            count += 1.0;
        }
        let centre = sum / weights;
        let mut scatter = 0.0;
        for it in counting(members) {
            scatter += it.light * square(it.off - centre);
            explained -= square(it.light) * it.variance / weights;
        }
        let of_one_count = at_least((scatter - explained) / (count - 1.0), 0.0);
        let (mut weights, mut sum, mut by_speckle) = (0.0, 0.0, 0.0);
        for it in counting(members) {
            let speckle = of_one_count / it.light;
            // Never a variance below that of one step of a centre, 2^-32.
            let weight = 1.0 / (it.variance + speckle + STEP);
            weights += weight;
            sum += weight * it.off;
            by_speckle += square(weight) * speckle;
        }
        Self {
            off: sum / weights,
            by_speckle: by_speckle / square(weights),
            of_one_count,
            variance: 1.0 / weights,
        }
    }
}

/// The square of the finest step of a centre, in pixels^2.
const STEP: f32 = 1.0 / (1u64 << 32) as f32;

/// Leaves out the image that is farthest from the mean of the others, as long as it is farther than
/// [`OUTLIER`] and more than [`FEWEST`] images are left.
fn leave_outliers_out(members: &mut [Member; MAX_SLITS]) {
    for _ in 0..MAX_SLITS - FEWEST {
        if number(members) <= FEWEST {
            return;
        }
        // The scatter of few others may be small by chance.
        let others = number(members).saturating_sub(1);
        let (mut worst, mut most) = (None, OUTLIER * small_sample(others));
        for place in 0..MAX_SLITS {
            let mut others = *members;
            let Some(it) = others.get_mut(place).filter(|it| it.counts) else {
                continue;
            };
            it.counts = false;
            let it = *it;
            let mean = Mean::of(&others);
            let variance = it.variance + mean.of_one_count / it.light + mean.variance + STEP;
            let off = (it.off - mean.off).abs() / dual_mac::square_root(variance);
            if off > most {
                (worst, most) = (Some(place), off);
            }
        }
        match worst.and_then(|place| members.get_mut(place)) {
            Some(worst) => worst.counts = false,
            None => return,
        }
    }
}

/// How much wider than a normal distribution's the interval is that holds 95.4 % of the errors, if their
/// variance comes from the scatter of so many values: Student's t over 2. The formula is within 2 % of the
/// tables from 3 degrees of freedom up (3: 3.31 / 2, 5: 2.65 / 2, 10: 2.28 / 2, 15: 2.18 / 2).
fn small_sample(values: usize) -> f32 {
    // At most 16.
    let freedom = values.saturating_sub(1).max(1) as f32;
    1.0 + 1.2 / freedom + 2.2 / square(freedom)
}

fn counting(members: &[Member]) -> impl Iterator<Item = &Member> {
    members.iter().filter(|it| it.counts)
}

fn number(members: &[Member]) -> usize {
    numeric::count(members.iter().map(|it| it.counts))
}

/// A height in counts, at least 1.
fn light(height: Counts) -> f32 {
    height.max(Counts::from_int(1)).to_f32()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::found_at;

    fn image(slit: usize, off: f32, noise: f32, height: f32) -> Image {
        let found = RowCentre {
            amplitude: Counts::from_f32(height),
            ..found_at(1000.0 + off, 8.0)
        };
        Image {
            slit,
            found,
            off,
            noise,
        }
    }

    /// Speckle of some pixels for each slit.
    const OFFS: [f32; 8] = [0.5, -1.0, 2.0, -0.25, 0.75, -2.0, 1.5, -0.5];

    fn light_of(slit: usize) -> f32 {
        500.0 + 100.0 * slit as f32
    }

    /// The sum over the slits, weighed by their light.
    fn weighed(value: impl Fn(usize) -> f32) -> f32 {
        (0..OFFS.len())
            .map(|slit| light_of(slit) * value(slit))
            .sum()
    }

    /// The mean of [`OFFS`] by light: 700 / 6800.
    fn mean_off() -> f32 {
        weighed(|slit| OFFS[slit]) / weighed(|_| 1.0)
    }

    /// A row of a target at rest whose mean is at `at`, without some slits.
    fn row(at: f32, but: &[usize]) -> std::vec::Vec<Image> {
        let slits = (0..OFFS.len()).filter(|slit| !but.contains(slit));
        slits
            .map(|slit| image(slit, at + OFFS[slit], 0.01, light_of(slit)))
            .collect()
    }

    #[test]
    fn images_that_are_missing_in_some_rows_do_not_move_a_target_at_rest() {
        let mut scatter = Scatter::default();
        let (first, noise) = scatter.add(&row(3.0, &[])).expect("a mean");
        assert!((first - (3.0 + mean_off())).abs() < 1e-5);
        let expected = 0.01 * weighed(light_of).sqrt() / weighed(|_| 1.0);
        assert!((noise - expected).abs() < 1e-6);
        for but in [&[0usize] as &[usize], &[2, 5], &[1, 3, 6, 7], &[]] {
            let (mean, _) = scatter.add(&row(3.0, but)).expect("a mean");
            assert!((mean - first).abs() < 1e-5, "without {but:?}: {mean}");
        }
        let few = scatter.add(&row(3.0, &[0, 1, 2, 3, 4]));
        assert_eq!(few, Err(assignment::few(3)));
    }

    #[test]
    fn a_slit_that_comes_later_does_not_move_the_rows() {
        let mut scatter = Scatter::default();
        let (first, _) = scatter.add(&row(3.0, &[5])).expect("a mean");
        let (second, _) = scatter.add(&row(3.0, &[])).expect("a mean");
        assert!((second - first).abs() < 1e-5);
        let combined = scatter.combine().expect("slits");
        assert_eq!(combined.used, 8);
        // The frame's mean counts it: the weighted mean of all eight.
        let mean = first + combined.shift.to_f32();
        assert!((mean - (3.0 + mean_off())).abs() < 1e-3, "{mean}");
        let later = combined.centres[5].expect("an image");
        assert_eq!((later.rows.get(), later.height), (1, 1000));
    }

    #[test]
    fn the_scatter_of_the_slits_is_the_uncertainty() {
        let mut scatter = Scatter::default();
        scatter.add(&row(3.0, &[])).expect("a mean");
        let combined = scatter.combine().expect("slits");
        let squares = weighed(|slit| square(OFFS[slit] - mean_off()));
        // Noise of 0.01 px is nothing beside this.
        let expected = (squares / 7.0 / weighed(|_| 1.0)).sqrt();
        let found = combined.surface.to_f32() / (small_sample(8) * NEIGHBOURS);
        assert!((found / expected - 1.0).abs() < 1e-3, "{found} {expected}");
        // Scatter that noise explains is no speckle.
        let mut noisy = Scatter::default();
        let images = [0, 1, 2, 3, 4, 5, 6, 7].map(|slit| image(slit, OFFS[slit], 3.0, 1000.0));
        noisy.add(&images).expect("a mean");
        assert_eq!(noisy.combine().expect("slits").surface, Pixels::default());
    }

    #[test]
    fn an_image_far_from_the_others_is_left_out() {
        let mut images = row(3.0, &[]);
        let combined = |images: &[Image]| {
            let mut scatter = Scatter::default();
            let (mean, _) = scatter.add(images).expect("a mean");
            (mean, scatter.combine().expect("slits"))
        };
        let (_, good) = combined(&images);
        images.push(image(12, 3.0 + 12.0, 0.01, 400.0));
        let (mean, found) = combined(&images);
        assert_eq!((found.used, good.used), (8, 8));
        assert!((found.surface.to_f32() - good.surface.to_f32()).abs() < 1e-4);
        assert!((mean + found.shift.to_f32() - (3.0 + mean_off())).abs() < 1e-3);
    }

    #[test]
    fn small_samples_widen_as_students_table_says() {
        // t at 95.45 %, over 2.
        for (values, t) in [
            (4, 3.307),
            (5, 2.869),
            (6, 2.649),
            (8, 2.429),
            (11, 2.284),
            (16, 2.181),
        ] {
            let ratio = small_sample(values) / (t / 2.0);
            assert!((ratio - 1.0).abs() < 0.02, "{values}: {ratio}");
        }
    }
}
