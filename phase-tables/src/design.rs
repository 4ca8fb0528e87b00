//! The weights as real numbers.

use nalgebra::{DMatrix, DVector};

/// A spot's profile: (offset of a pixel's centre from the spot's, the spot's width), both in pixels, to the light that the
/// pixel gathers, where a pixel at the peak of a very wide spot gathers 1.
pub type Profile<'a> = &'a dyn Fn(f64, f64) -> f64;

/// The gaussian of eq. (5), exp(-x^2 / (2 width^2)), integrated over the pixel.
pub fn gaussian(offset: f64, width: f64) -> f64 {
    let scale = 1.0 / (std::f64::consts::SQRT_2 * width);
    width
        * (std::f64::consts::PI / 2.0).sqrt()
        * (libm::erf((offset + 0.5) * scale) - libm::erf((offset - 0.5) * scale))
}

/// What a table is for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shape {
    /// The spot's width (a gaussian's sigma) in pixels.
    pub width: f64,
    /// Pixels to either side of the middle one.
    pub half_width: usize,
    /// Number of sub-pixel phases.
    pub phases: usize,
}

impl Shape {
    /// Where phase `k` has its spot, in pixels from the middle pixel's centre: (k - (phases - 1)/2) / phases.
    pub fn phase(&self, k: usize) -> f64 {
        (k as f64 - (self.phases as f64 - 1.0) / 2.0) / self.phases as f64
    }

    /// Weights in a row: 2 half widths and the middle.
    pub fn taps(&self) -> usize {
        2 * self.half_width + 1
    }

    fn sample(&self, profile: Profile<'_>, centre: f64, width: f64) -> DVector<f64> {
        DVector::from_fn(self.taps(), |i, _| {
            profile(i as f64 - self.half_width as f64 - centre, width)
        })
    }
}

/// The weights of one width: `score[k]`, `slope[k]` and `stretch[k]` for each phase k.
#[derive(Clone, Debug)]
pub struct Table {
    /// What the table is for.
    pub shape: Shape,
    /// Response 1 to d(profile)/d(centre), 0 to the profile, to a constant and to d(profile)/d(width).
    pub score: Vec<DVector<f64>>,
    /// score / slope = distance in pixels, over three quarters of a phase to either side and for widths 10 % off.
    pub slope: Vec<DVector<f64>>,
    /// Response 1 to width * d(profile)/d(width), 0 to the profile, to a constant and to d(profile)/d(centre).
    pub stretch: Vec<DVector<f64>>,
    /// The profile at each phase.
    pub profile: Vec<DVector<f64>>,
}

/// Designs the weights of one width.
///
/// With the Jacobian J = [d/d(centre), profile, 1, d/d(width)] and the noise's covariance V = diag(profile + r), the
/// score and the stretch are rows of (J^T V^-1 J)^-1 J^T V^-1: the best linear unbiased estimates of a small shift
/// and a small stretch, with amplitude and black level projected out. They are one Gauss-Newton step of a weighted
/// four-parameter fit, taken in advance.
pub fn design(profile: Profile<'_>, shape: Shape, noise_ratio: f64) -> Table {
    let mut table = Table {
        shape,
        score: vec![],
        slope: vec![],
        stretch: vec![],
        profile: vec![],
    };
    for k in 0..shape.phases {
        let centre = shape.phase(k);
        let g = shape.sample(profile, centre, shape.width);
        let h = 1e-4 * shape.width;
        let d_centre = (shape.sample(profile, centre + h, shape.width)
            - shape.sample(profile, centre - h, shape.width))
            / (2.0 * h);
        let d_width = (shape.sample(profile, centre, shape.width + h)
            - shape.sample(profile, centre, shape.width - h))
            / (2.0 * h)
            * shape.width;
        let ones = DVector::from_element(shape.taps(), 1.0);
        let inverse_noise = g.map(|light| {
            if noise_ratio.is_finite() {
                1.0 / (light + noise_ratio)
            } else {
                1.0
            }
        });
        let rows = best_linear_unbiased(&[&d_centre, &g, &ones, &d_width], &inverse_noise);
        let (score, stretch) = (rows[0].clone(), rows[3].clone());
        table.slope.push(slope(profile, shape, centre, &score));
        table.score.push(score);
        table.stretch.push(stretch);
        table.profile.push(g);
    }
    table
}

/// (J^T V^-1 J)^-1 J^T V^-1 with J's columns given and V^-1 diagonal. Columns are scaled to unit length first, which keeps
/// the 4 x 4 system well conditioned.
fn best_linear_unbiased(
    columns: &[&DVector<f64>],
    inverse_noise: &DVector<f64>,
) -> Vec<DVector<f64>> {
    let lengths: Vec<f64> = columns
        .iter()
        .map(|c| {
            c.iter()
                .zip(inverse_noise)
                .map(|(c, v)| c * c * v)
                .sum::<f64>()
                .sqrt()
        })
        .collect();
    let taps = inverse_noise.len();
    let jacobian = DMatrix::from_fn(taps, columns.len(), |i, j| columns[j][i] / lengths[j]);
    let weighted = DMatrix::from_fn(columns.len(), taps, |j, i| {
        jacobian[(i, j)] * inverse_noise[i]
    });
    let normal = &weighted * &jacobian;
    let inverse = normal
        .try_inverse()
        .expect("the derivatives of a profile by centre, height, level and width are independent");
    let rows = inverse * weighted;
    (0..columns.len())
        .map(|j| rows.row(j).transpose() / lengths[j])
        .collect()
}

/// Weights whose response to the profile shifted by d is score(d) / d, by least squares over the shifts and widths for
/// which the ratio must be straight, from a basis of smooth functions that sum to zero.
fn slope(profile: Profile<'_>, shape: Shape, centre: f64, score: &DVector<f64>) -> DVector<f64> {
    const SHIFTS: usize = 9;
    const WIDTHS: [f64; 3] = [0.9, 1.0, 1.1];
    /// Keeps the weights small where the basis is nearly dependent; far below the least-squares residual.
    const RIDGE: f64 = 1e-10;

    let span = 0.75 / shape.phases as f64;
    let g = shape.sample(profile, centre, shape.width);
    let half = 0.5 * shape.width;
    let curvature = shape.sample(profile, centre + half, shape.width) - 2.0 * &g
        + shape.sample(profile, centre - half, shape.width);
    let h = 1e-4 * shape.width;
    let d_width = (shape.sample(profile, centre, shape.width + h)
        - shape.sample(profile, centre, shape.width - h))
        / (2.0 * h)
        * shape.width;
    let u = DVector::from_fn(shape.taps(), |i, _| {
        (i as f64 - shape.half_width as f64 - centre) / shape.width
    });
    let basis: Vec<DVector<f64>> = [
        g.clone(),
        curvature.clone(),
        g.component_mul(&u),
        d_width,
        curvature.component_mul(&u),
        g.component_mul(&u.map(|u| u.powi(4))),
    ]
    .into_iter()
    .map(|function| function.add_scalar(-function.mean()))
    .collect();

    let mut responses = vec![];
    let mut targets = vec![];
    for width in WIDTHS.map(|w| w * shape.width) {
        let at_rest = score.dot(&shape.sample(profile, centre, width));
        for step in 0..SHIFTS {
            let fraction = step as f64 / (SHIFTS - 1) as f64 * 2.0 - 1.0;
            // At rest the ratio is 0/0: a shift too small to matter stands for it.
            let shift = if fraction == 0.0 {
                1e-3
            } else {
                fraction * span
            };
            let light = shape.sample(profile, centre + shift, width);
            responses.extend(basis.iter().map(|function| function.dot(&light)));
            targets.push((score.dot(&light) - at_rest) / shift);
        }
    }
    let responses = DMatrix::from_row_slice(targets.len(), basis.len(), &responses);
    let normal = responses.tr_mul(&responses);
    let ridge = RIDGE * normal.trace() / basis.len() as f64;
    let right = responses.tr_mul(&DVector::from_vec(targets));
    let coefficients = (normal + DMatrix::identity(basis.len(), basis.len()) * ridge)
        .cholesky()
        .expect("a ridge makes the normal matrix positive definite")
        .solve(&right);
    basis
        .iter()
        .zip(coefficients.iter())
        .map(|(function, &c)| function * c)
        .sum()
}
