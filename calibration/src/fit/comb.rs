//! The slits of a comb: brings the images of all slits to one centre for each point.
//!
//! Each slit's image lies on a straight line over x0, the image that a slit on the optical axis would show
//! ([`SlitMap`]). The mask's drawing gives that line. What the mask and the optics do otherwise shows as
//! differences between the slits at the same point. For each slit a polynomial of x0 takes them away.
//!
//! ```text
//! images -> x0 by the drawing -> corrections of all slits at once -> x0 of each point -> eq. (1), residuals
//!                                 weights by light, without outliers  and its scatter
//! ```
//!
//! **Corrections.** The light h of an image weighs it, because its variance by speckle is one over its light
//! (see the core's `combination`). The corrections c and the points' x0 make the weighted sum of
//! (x0 by the drawing + c - x0 of the point)^2 least. The points' x0 are weighted means, so only the
//! polynomials are unknown: a linear system of at most 64.
//!
//! **What is free.** If the same polynomial is added to all corrections, nothing changes but x0, and the
//! curve of distance over x0 takes that in. So the corrections' coefficients are made to add up to zero.
//!
//! **Few points.** A slit with fewer than twelve points, or whose points lie on a part of the range, gets a
//! polynomial of a lower degree, or none. A slit without a polynomial is where the mask's drawing says. The
//! points' x0 are those of the other slits.

use anyhow::Context as _;
use nalgebra::{DMatrix, DVector};
use serde::Serialize;
use slitrange::base::drawing::DRAWING;
use slitrange::frame::comb::{CORRECTIONS, Comb, FEWEST, MAX_SLITS, NEIGHBOURS, SlitMap, UNIT};
use statistics::{least_and_most, median, rms};

use crate::fixed::pixels;
use crate::points::{Point, SlitImages};

/// The comb that points tell, and their x0. A report has all but `comb` and `points`.
#[derive(Clone, Debug, Serialize)]
pub struct FittedComb {
    /// As the sensor holds it.
    #[serde(skip)]
    pub comb: Comb,
    /// The points, with x0 for their centres. Their uncertainties hold the scatter of the slits.
    #[serde(skip)]
    pub points: Vec<Point>,
    /// What the points tell of each slit.
    pub slits: Vec<FittedSlit>,
    /// Images that count.
    pub images: usize,
    /// Images that do not, because they lie far from the others of their point.
    pub rejected: usize,
    /// Root mean square over the points of an x0's standard uncertainty by the scatter of the slits, in
    /// pixels.
    pub scatter_px: f64,
}

/// What the points tell of a slit.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct FittedSlit {
    /// From the optical axis along the row, in micrometres, by the mask's drawing.
    pub place_um: f64,
    /// Points with an image of the slit that counts.
    pub points: usize,
    /// The degree of the correction. None if the slit has too few points.
    pub degree: Option<usize>,
    /// The correction in the middle of the points, in pixels.
    pub correction_px: f64,
    /// Root mean square of the slit's x0 less the points', in pixels.
    pub residual_px: f64,
}

/// The fewest points for a correction of degree 0, 1, 2 and 3.
const FEWEST_POINTS: [usize; CORRECTIONS] = [2, 4, 8, 12];
/// The least part of the points' range that the slit's points must cover, for each degree.
const LEAST_SPAN: [f64; CORRECTIONS] = [0.0, 0.25, 0.5, 0.75];
/// An image is left out if it is so many standard deviations from its point's x0.
const OUTLIER: f64 = 5.0;
/// No image is left out that is nearer than this to its point's x0, in pixels: a correction of degree three
/// may leave so much of a bent window.
const LEAST_OFF: f64 = 0.25;
/// The same for slits with few points: five times what 5 um of a mask move an image.
const LEAST_OFF_OF_FEW: f64 = 3.0;
/// In the first rounds, an image so many standard deviations off counts less, in proportion.
const LESS: f64 = 2.5;
/// Rounds with smaller weights for images that are far off, and rounds without them.
const SOFT_ROUNDS: usize = 4;
const ROUNDS: usize = 8;
/// Points to both sides whose scatter is averaged with a point's own.
const BESIDE: usize = 3;

#[derive(Clone, Copy, Debug)]
struct Image {
    slit: usize,
    point: usize,
    /// x0 by the drawing.
    x0: f64,
    /// x0 by the drawing from the axis, in units of the correction's argument.
    t: f64,
    /// Height in counts.
    light: f64,
    /// What the image counts, 0 to 1, beside its light.
    trust: f64,
    /// Whether the image counts in the x0 of its point: that of a slit with few points does not.
    is_common: bool,
}

impl Image {
    fn weight(&self) -> f64 {
        self.light * self.trust
    }

    fn counts(&self) -> bool {
        self.is_common && self.trust > 0.0
    }

    /// The lowest powers of t, so many.
    fn terms(&self, count: usize) -> DVector<f64> {
        DVector::from_fn(count, |power, _| self.t.powi(power as i32))
    }

    fn corrected(&self, corrections: &Corrections) -> f64 {
        let terms = corrections[self.slit].iter().rev();
        self.x0 + terms.fold(0.0, |sum, term| sum * self.t + term)
    }
}

type Corrections = [[f64; CORRECTIONS]; MAX_SLITS];

/// The images of all points, and the corrections and x0 that are fitted to the images.
struct Fit {
    images: Vec<Image>,
    corrections: Corrections,
    /// The coefficients of each slit's correction: its degree and one, or none.
    freedoms: [usize; MAX_SLITS],
    /// The most that at least [`FEWEST`] slits have.
    most: usize,
    x0s: Vec<f64>,
}

/// Finds the corrections of the slits, and the points' x0. `None` for points of a sensor with one slit.
///
/// # Errors
/// A point has no image of any slit, or a correction is beyond what a record holds.
pub fn fit(points: &[Point]) -> anyhow::Result<Option<FittedComb>> {
    if points.iter().all(|point| point.slits.is_none()) {
        return Ok(None);
    }
    let nominal = Comb::nominal();
    let mut images = Vec::new();
    for (number, point) in points.iter().enumerate() {
        let of_point = point.slits.as_ref();
        let of_point = of_point.and_then(|it| images_of(number, it, &nominal));
        images.extend(of_point.with_context(|| {
            let line = point.line;
            format!(
                "line {line} has no image of any slit: take the point again, or remove the line"
            )
        })?);
    }
    let mut fit = Fit {
        images,
        corrections: Corrections::default(),
        freedoms: [0; MAX_SLITS],
        most: 0,
        x0s: vec![0.0; points.len()],
    };
    fit.x0s = fit.means(&fit.corrections);
    for round in 0..ROUNDS {
        fit.mark_common();
        let solved = fit.solve();
        fit.corrections = solved.context("the slits' corrections have no solution")?;
        fit.x0s = fit.means(&fit.corrections);
        fit.trust(round >= SOFT_ROUNDS);
    }
    // As the sensor holds them.
    let slits = nominal.slits().iter().zip(&fit.corrections);
    let slits = slits.map(|(slit, terms)| slit.corrected(terms.map(pixels)));
    let slits: Vec<SlitMap> = slits.collect();
    let comb = Comb::new(&slits).context("the mask's drawing has no slits")?;
    comb.check()?;
    fit.corrections = std::array::from_fn(|slit| {
        slits.get(slit).map_or([0.0; CORRECTIONS], |it| {
            it.correction().map(|term| term.to_f64())
        })
    });
    fit.mark_common();
    fit.x0s = fit.means(&fit.corrections);
    let sigmas = fit.sigmas();
    let all = slits.iter().enumerate();
    Ok(Some(FittedComb {
        comb,
        slits: all.map(|(number, slit)| fit.slit(number, slit)).collect(),
        points: (points.iter().zip(&fit.x0s).zip(&sigmas))
            .map(|((point, &x_px), &sigma)| Point {
                x_px,
                // The scatter of the slits holds their noise.
                sigma_px: Some(sigma.max(point.sigma_px.unwrap_or(sigma)).max(LEAST_PX)),
                ..*point
            })
            .collect(),
        scatter_px: rms(&sigmas),
        images: fit.images.iter().filter(|image| image.trust > 0.0).count(),
        rejected: fit.images.iter().filter(|image| image.trust <= 0.0).count(),
    }))
}

/// The finest step of a centre, in pixels.
const LEAST_PX: f64 = 1e-5;

fn images_of(point: usize, images: &SlitImages, nominal: &Comb) -> Option<Vec<Image>> {
    let found: Vec<Image> = (nominal.slits().iter().zip(images).enumerate())
        .filter_map(|(slit, (map, image))| {
            let image = (*image)?;
            let x0 = map.to_axis(pixels(image.x_px)).to_f64();
            Some(Image {
                slit,
                point,
                x0,
                t: (x0 - f64::from(DRAWING.axis_px)) / f64::from(UNIT),
                light: image.height_counts.max(1.0),
                trust: 1.0,
                is_common: true,
            })
        })
        .collect();
    (!found.is_empty()).then_some(found)
}

/// The length of the range of images, in units of the correction's argument.
fn span<'a>(images: impl Iterator<Item = &'a Image>) -> f64 {
    let (least, most) = least_and_most(images.map(|image| image.t));
    most - least
}

impl Fit {
    /// The images of a slit that count.
    fn of_slit(&self, slit: usize) -> impl Iterator<Item = &Image> {
        let is_of_slit = move |image: &&Image| image.slit == slit && image.trust > 0.0;
        self.images.iter().filter(is_of_slit)
    }

    /// How far an image is from its point's x0, in pixels.
    fn off(&self, image: &Image) -> f64 {
        image.corrected(&self.corrections) - self.x0s[image.point]
    }

    /// The weighted means of the points' images. If no image of a point counts, all of its images count.
    fn means(&self, corrections: &Corrections) -> Vec<f64> {
        let mut sums = vec![(0.0, 0.0); self.x0s.len()];
        let mut all = sums.clone();
        for image in &self.images {
            let x0 = image.corrected(corrections);
            let weight = if image.counts() { image.weight() } else { 0.0 };
            for (sums, weight) in [(&mut sums, weight), (&mut all, image.light)] {
                let (sum, weights) = &mut sums[image.point];
                *sum += weight * x0;
                *weights += weight;
            }
        }
        let mean = |(sum, weights): (f64, f64)| (weights > 0.0).then(|| sum / weights);
        (sums.into_iter().zip(all))
            .map(|(sums, all)| mean(sums).or(mean(all)).unwrap_or_default())
            .collect()
    }

    /// Finds the degree of each slit's correction. The images of the slits with the highest degree that at
    /// least [`FEWEST`] slits have count in the x0 of their points.
    fn mark_common(&mut self) {
        let whole = span(self.images.iter());
        let freedoms: [usize; MAX_SLITS] = std::array::from_fn(|slit| {
            let count = self.of_slit(slit).count();
            let part = span(self.of_slit(slit)) / whole;
            let degree = (0..CORRECTIONS).rev().find(|&degree| {
                // All points may be at one place.
                count >= FEWEST_POINTS[degree] && (degree == 0 || part >= LEAST_SPAN[degree])
            });
            degree.map_or(0, |degree| degree + 1)
        });
        let mut sorted = freedoms;
        sorted.sort_unstable();
        self.most = sorted[MAX_SLITS - FEWEST];
        for image in &mut self.images {
            image.is_common = freedoms[image.slit] >= self.most;
        }
        self.freedoms = freedoms.map(|freedoms| freedoms.min(self.most));
    }

    /// The corrections, for the trust that each image has.
    ///
    /// The slits with the most freedoms that at least [`FEWEST`] slits have are solved for at once, with the
    /// x0 of the points as their means. The others follow from these x0.
    fn solve(&self) -> Option<Corrections> {
        let (most, freedoms) = (self.most, &self.freedoms);
        let mut corrections = Corrections::default();
        if most == 0 {
            return Some(corrections);
        }
        let slits = 0..MAX_SLITS;
        let together: Vec<usize> = slits.filter(|&slit| freedoms[slit] >= most).collect();
        let place: [Option<usize>; MAX_SLITS] =
            std::array::from_fn(|slit| together.iter().position(|&other| other == slit));
        let size = most * together.len();
        let (mut normal, mut right) = (DMatrix::zeros(size, size), DVector::zeros(size));
        for (point, &about) in self.x0s.iter().enumerate() {
            let of_point: Vec<(usize, DVector<f64>, &Image)> = (self.images.iter())
                .filter(|image| image.point == point && image.trust > 0.0)
                .filter_map(|image| Some((place[image.slit]? * most, image.terms(most), image)))
                .collect();
            let weights: f64 = of_point.iter().map(|(.., image)| image.weight()).sum();
            if of_point.len() < 2 {
                continue;
            }
            let weighted = |(.., it): &(_, _, &Image)| it.weight() * (it.x0 - about);
            let mean = of_point.iter().map(weighted).sum::<f64>() / weights;
            // The sum of w (y + c - mean of (y + c))^2.
            for (row, own, image) in &of_point {
                let (off, block) = (image.x0 - about - mean, (most, most));
                (right.rows_mut(*row, most)).axpy(-image.weight() * off, own, 1.0);
                (normal.view_mut((*row, *row), block)).ger(image.weight(), own, own, 1.0);
                for (column, others, other) in &of_point {
                    let weight = image.weight() * other.weight() / weights;
                    (normal.view_mut((*row, *column), block)).ger(-weight, own, others, 1.0);
                }
            }
        }
        let scale = normal.trace() / size as f64;
        for i in 0..size {
            for j in (i % most..size).step_by(most) {
                // The coefficients of each degree add up to zero.
                normal[(i, j)] += scale;
            }
            // Points that do not tell some coefficient leave it zero.
            normal[(i, i)] += 1e-10 * scale;
        }
        let solution = normal.cholesky()?.solve(&right);
        for (terms, &slit) in solution.as_slice().chunks(most).zip(&together) {
            corrections[slit][..most].copy_from_slice(terms);
        }
        let reference = self.means(&corrections);
        let has_reference = |image: &&Image| {
            let is_reference = |other: &Image| other.point == image.point && other.counts();
            self.images.iter().any(is_reference)
        };
        for slit in (0..MAX_SLITS).filter(|&slit| freedoms[slit] < most && freedoms[slit] > 0) {
            let of_slit: Vec<&Image> = self.of_slit(slit).filter(has_reference).collect();
            if let Some(terms) = alone(&of_slit, freedoms[slit], &reference) {
                corrections[slit] = terms;
            }
        }
        Some(corrections)
    }

    /// Finds the images that are too far from their points' x0. An image's deviation is in proportion to one
    /// over the square root of its light.
    fn trust(&mut self, rejects: bool) {
        let off = |image: &Image| self.off(image).abs() * image.light.sqrt();
        let offs: Vec<f64> = self.images.iter().map(off).collect();
        // 1.4826 median deviations are a gaussian's sigma.
        let deviation = 1.4826 * median(&offs);
        for (image, off) in self.images.iter_mut().zip(offs) {
            let least = if image.is_common {
                LEAST_OFF
            } else {
                LEAST_OFF_OF_FEW
            };
            let outlier = (OUTLIER * deviation).max(least * image.light.sqrt());
            image.trust = match rejects {
                true if off > outlier => 0.0,
                true => 1.0,
                false if off > LESS * deviation => LESS * deviation / off,
                false => 1.0,
            };
        }
    }

    /// The standard uncertainty of each point's x0 by the scatter of its slits. Few slits tell their scatter
    /// to a fifth, and so its square is averaged with those of the neighbours.
    fn sigmas(&self) -> Vec<f64> {
        #[derive(Clone, Copy, Default)]
        struct OfPoint {
            /// The sum of h r^2.
            squares: f64,
            light: f64,
            images: f64,
        }
        let mut of_points = vec![OfPoint::default(); self.x0s.len()];
        for image in self.images.iter().filter(|image| image.counts()) {
            let point = &mut of_points[image.point];
            let off = self.off(image);
            point.squares += image.light * off * off;
            point.light += image.light;
            point.images += 1.0;
        }
        let freedom = |it: &OfPoint| (it.images - 1.0).max(0.0);
        let free: f64 = of_points.iter().map(freedom).sum();
        let fitted: usize = self.freedoms.iter().filter(|it| **it == self.most).sum();
        // The corrections follow the images, so the residuals are smaller than the errors.
        let left = (free - fitted as f64).max(1.0);
        let by_fit = (free / left).max(1.0);
        let mut order: Vec<usize> = (0..self.x0s.len()).collect();
        order.sort_by(|&a, &b| self.x0s[a].total_cmp(&self.x0s[b]));
        let mut sigmas = vec![0.0; self.x0s.len()];
        for (rank, &point) in order.iter().enumerate() {
            let near = rank.saturating_sub(BESIDE)..order.len().min(rank + BESIDE + 1);
            let near = || order[near.clone()].iter().map(|&it| &of_points[it]);
            let squares: f64 = near().map(|it| it.squares).sum();
            let free: f64 = near().map(freedom).sum();
            let of_one_count = by_fit * squares / free.max(1.0);
            let variance = of_one_count / of_points[point].light.max(1.0);
            sigmas[point] = f64::from(NEIGHBOURS) * variance.sqrt();
        }
        sigmas
    }

    fn slit(&self, number: usize, slit: &SlitMap) -> FittedSlit {
        let (least, most) = least_and_most(&self.x0s);
        let t = (0.5 * (least + most) - f64::from(DRAWING.axis_px)) / f64::from(UNIT);
        let terms = self.corrections[number].iter().rev();
        let offs: Vec<f64> = self.of_slit(number).map(|it| self.off(it)).collect();
        let squares = offs.iter().map(|off| off * off).sum::<f64>();
        FittedSlit {
            place_um: slit.place().to_f64(),
            points: offs.len(),
            degree: self.freedoms[number].checked_sub(1),
            correction_px: terms.fold(0.0, |sum, term| sum * t + term),
            residual_px: (squares / offs.len().max(1) as f64).sqrt(),
        }
    }
}

/// The correction of one slit to x0 that are known. `None` if there are too few points.
fn alone(images: &[&Image], freedoms: usize, reference: &[f64]) -> Option<[f64; CORRECTIONS]> {
    if images.len() < FEWEST_POINTS[freedoms - 1] {
        return None;
    }
    let (mut normal, mut right) = (DMatrix::zeros(freedoms, freedoms), DVector::zeros(freedoms));
    for image in images {
        let (terms, off) = (image.terms(freedoms), reference[image.point] - image.x0);
        right.axpy(image.weight() * off, &terms, 1.0);
        normal.ger(image.weight(), &terms, &terms, 1.0);
    }
    let solution = normal.cholesky()?.solve(&right);
    let mut terms = [0.0; CORRECTIONS];
    terms[..freedoms].copy_from_slice(solution.as_slice());
    Some(terms)
}
