//! The paper's eqs. (3) and (4): a gaussian in the plane fitted to the image of a spot, by least squares, in
//! f64.
//!
//! A exp(-|r|^2) with r = S^-1 (x - mu, y - mu'). Only S^-T S^-1 can be told from an image, which is
//! symmetric: of the paper's four terms of S three are independent. So |r|^2 = a u^2 + 2 b u v + c v^2 with u
//! = x - mu and v = y - mu' is fitted in a, b and c, whose derivatives are the simplest. The paper's method
//! (L-BFGS-B) and this one (Levenberg-Marquardt) end in the same minimum.

use nalgebra::{SMatrix, SVector};

/// A gaussian in the plane, on a level of zero.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlaneGaussian {
    pub amplitude: f64,
    /// Its centre along the rows, in pixels.
    pub x: f64,
    /// Its centre along the columns, in pixels.
    pub y: f64,
    /// a, b and c of |r|^2 = a u^2 + 2 b u v + c v^2, in 1/pixels^2.
    pub form: [f64; 3],
}

const UNKNOWNS: usize = 6;

type Matrix = SMatrix<f64, UNKNOWNS, UNKNOWNS>;
type Vector = SVector<f64, UNKNOWNS>;

const MAX_STEPS: usize = 60;

/// The fit rests where a step promises less than this share of the sum of squares. By then the centre is
/// within 1e-4 of its standard uncertainty over the square root of the pixels.
const RESTS: f64 = 1e-9;

/// Beyond exp(-40) a pixel tells nothing: 4e-18 of the height.
const FAR: f64 = 40.0;

impl PlaneGaussian {
    fn exponent(&self, u: f64, v: f64) -> f64 {
        let [a, b, c] = self.form;
        a * u * u + 2.0 * b * u * v + c * v * v
    }

    fn is_a_peak(&self) -> bool {
        let [a, b, c] = self.form;
        self.amplitude > 0.0 && a > 0.0 && a * c > b * b
    }

    /// The gaussian with the image's moments: centroid (eq. (2)), covariance, and the height that its sum and
    /// covariance give.
    /// `None` where the image has no light.
    pub fn of_moments(image: &[f32], columns: usize) -> Option<Self> {
        let (mut sum, mut moments, mut squares) = (0.0, [0.0; 2], [0.0; 3]);
        for (y, row) in (0..).zip(image.chunks_exact(columns)) {
            let y = f64::from(y);
            let (mut weight, mut by_x, mut by_xx) = (0.0, 0.0, 0.0);
            for (x, &value) in (0..).zip(row) {
                let (x, value) = (f64::from(x), f64::from(value));
                weight += value;
                by_x += value * x;
                by_xx += value * x * x;
            }
            sum += weight;
            moments[0] += by_x;
            moments[1] += weight * y;
            squares[0] += by_xx;
            squares[1] += by_x * y;
            squares[2] += weight * y * y;
        }
        if sum <= 0.0 {
            return None;
        }
        let [x, y] = moments.map(|moment| moment / sum);
        let [xx, xy, yy] = [
            squares[0] / sum - x * x,
            squares[1] / sum - x * y,
            squares[2] / sum - y * y,
        ];
        let determinant = xx * yy - xy * xy;
        let found = Self {
            amplitude: sum / (std::f64::consts::TAU * determinant.sqrt()),
            x,
            y,
            form: [yy, -xy, xx].map(|moment| 0.5 * moment / determinant),
        };
        found.is_a_peak().then_some(found)
    }

    /// Fits the image from a start. `None` where no peak is found whose centre is on the image.
    pub fn fit(image: &[f32], columns: usize, start: Self) -> Option<Self> {
        let mut best = start;
        let mut equations = NormalEquations::of(image, columns, &best);
        // Levenberg's damping, of normal equations with a unit diagonal.
        let mut damping = 1e-3;
        for _ in 0..MAX_STEPS {
            let step = equations.step(damping)?;
            // What the linear model promises.
            let promised = step.dot(&equations.right);
            let next = best.moved(&step);
            let rests = promised < RESTS * equations.squares;
            if next.is_a_peak() {
                let there = NormalEquations::of(image, columns, &next);
                if there.squares <= equations.squares {
                    (best, equations) = (next, there);
                    damping *= 0.1;
                    if rests {
                        break;
                    }
                    continue;
                }
            }
            if rests || damping > 1e9 {
                break;
            }
            damping *= 10.0;
        }
        let rows = (image.len() / columns) as f64;
        let is_on = (0.0..columns as f64).contains(&best.x) && (0.0..rows).contains(&best.y);
        is_on.then_some(best)
    }

    fn moved(&self, step: &Vector) -> Self {
        Self {
            amplitude: self.amplitude + step[0],
            x: self.x + step[1],
            y: self.y + step[2],
            form: [0, 1, 2].map(|i| self.form[i] + step[3 + i]),
        }
    }
}

struct NormalEquations {
    matrix: Matrix,
    right: Vector,
    squares: f64,
}

impl NormalEquations {
    fn of(image: &[f32], columns: usize, at: &PlaneGaussian) -> Self {
        let (mut matrix, mut right, mut squares) = (Matrix::zeros(), Vector::zeros(), 0.0);
        let [a, b, c] = at.form;
        for (y, row) in (0..).zip(image.chunks_exact(columns)) {
            let v = f64::from(y) - at.y;
            for (x, &value) in (0..).zip(row) {
                let value = f64::from(value);
                let u = f64::from(x) - at.x;
                let exponent = at.exponent(u, v);
                if exponent > FAR {
                    squares += value * value;
                    continue;
                }
                let light = (-exponent).exp();
                let height = at.amplitude * light;
                let residual = value - height;
                let gradient = [
                    light,
                    2.0 * height * (a * u + b * v),
                    2.0 * height * (b * u + c * v),
                    -height * u * u,
                    -2.0 * height * u * v,
                    -height * v * v,
                ];
                squares += residual * residual;
                // The lower triangle.
                for j in 0..UNKNOWNS {
                    right[j] += gradient[j] * residual;
                    for i in j..UNKNOWNS {
                        matrix[(i, j)] += gradient[i] * gradient[j];
                    }
                }
            }
        }
        Self {
            matrix,
            right,
            squares,
        }
    }

    /// The damped step. The equations are scaled to a unit diagonal first.
    fn step(&self, damping: f64) -> Option<Vector> {
        let scale = self.matrix.diagonal().map(|value| 1.0 / value.sqrt());
        let mut scaled = self.matrix;
        for j in 0..UNKNOWNS {
            for i in j..UNKNOWNS {
                scaled[(i, j)] *= scale[i] * scale[j];
            }
            scaled[(j, j)] += damping;
        }
        let step = scaled.cholesky()?.solve(&self.right.component_mul(&scale));
        let step = step.component_mul(&scale);
        step.iter().all(|value| value.is_finite()).then_some(step)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng as _;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution as _, StandardNormal};
    use simulator::with;
    use std::time::Instant;

    const COLUMNS: usize = 64;

    fn image(of: impl Fn(f64, f64) -> f64) -> Vec<f32> {
        (0..COLUMNS * COLUMNS)
            .map(|i| of((i % COLUMNS) as f64, (i / COLUMNS) as f64) as f32)
            .collect()
    }

    fn value(of: &PlaneGaussian, x: f64, y: f64) -> f64 {
        of.amplitude * (-of.exponent(x - of.x, y - of.y)).exp()
    }

    fn fitted(image: &[f32]) -> PlaneGaussian {
        let start = PlaneGaussian::of_moments(image, COLUMNS).expect("light");
        PlaneGaussian::fit(image, COLUMNS, start).expect("a fit")
    }

    fn turned() -> PlaneGaussian {
        PlaneGaussian {
            amplitude: 1000.0,
            x: 30.3,
            y: 34.8,
            form: [0.02, 0.006, 0.012],
        }
    }

    #[test]
    fn finds_noiseless_spots() {
        for truth in [
            turned(),
            PlaneGaussian {
                x: 20.0,
                y: 44.4,
                form: [0.1, -0.09, 0.3],
                ..turned()
            },
        ] {
            let found = fitted(&image(|x, y| value(&truth, x, y)));
            println!("{found:?}");
            // Of the f32 image: 6e-8 of each value.
            assert!((found.x - truth.x).abs() < 1e-5 && (found.y - truth.y).abs() < 1e-5);
            for (found, truth) in found.form.iter().zip(truth.form) {
                assert!((found / truth - 1.0).abs() < 1e-5);
            }
        }
    }

    /// The spot is on a slope, so its moments are mostly those of the slope. The fit still finds the spot.
    #[test]
    fn a_start_that_is_far_off_is_enough() {
        let truth = with(turned(), |it| it.form = [0.12, 0.0, 0.12]);
        let found = fitted(&image(|x, y| value(&truth, x, y) + 0.2 * x + 0.1 * y));
        println!("{found:?}");
        assert!((found.x - truth.x).abs() < 0.1 && (found.y - truth.y).abs() < 0.1);
    }

    /// The scatter in white noise is the Cramér-Rao bound. The covariance of x alone is enough, because the
    /// derivative by the centre is odd and all others are even: (sum of (dg/dx)^2)^-1 noise^2. The sum is A^2
    /// pi/2 if a = c = 1/(2 s^2) and b = 0.
    #[test]
    fn reaches_the_bound() {
        const FITS: usize = 600;
        let (amplitude, noise) = (1000.0, 20.0);
        let truth = PlaneGaussian {
            amplitude,
            x: 31.7,
            y: 32.2,
            form: [0.02, 0.0, 0.02],
        };
        let mut random = ChaCha8Rng::seed_from_u64(5);
        let clean = image(|x, y| value(&truth, x, y));
        let mut noisy = |light: &f32| {
            let normal: f32 = StandardNormal.sample(&mut random);
            light + noise as f32 * normal
        };
        let images = (0..FITS).map(|_| clean.iter().map(&mut noisy).collect());
        let images: Vec<Vec<f32>> = images.collect();
        let begun = Instant::now();
        let errors = images.iter().map(|image| {
            let found = fitted(image);
            [found.x - truth.x, found.y - truth.y]
        });
        let errors: Vec<[f64; 2]> = errors.collect();
        let each = begun.elapsed().as_secs_f64() / FITS as f64;
        let bound = noise / amplitude / std::f64::consts::FRAC_PI_2.sqrt();
        for axis in 0..2 {
            let ratio = statistics::rms(errors.iter().map(|error| error[axis])) / bound;
            println!(
                "axis {axis}: {ratio:.3} of the bound of {bound:.4} px; {:.2} ms a fit",
                each * 1e3
            );
            // 600 values: 2.9 %.
            assert!((ratio - 1.0).abs() < 0.1);
        }
    }

    #[test]
    fn darkness_has_no_spot() {
        let dark = [0.0; COLUMNS * COLUMNS];
        assert_eq!(PlaneGaussian::of_moments(&dark, COLUMNS), None);
    }
}
