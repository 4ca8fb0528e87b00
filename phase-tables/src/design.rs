//! The weights as real numbers.

use nalgebra::{DMatrix, DVector};

use crate::Background;

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

/// The diffraction pattern of a slit, eq. (6), sinc^2(x / (zero)), integrated over the pixel. Its first zero is at 2.66
/// widths: the width is the sigma of the gaussian that fits the pattern best.
pub fn slit(offset: f64, width: f64) -> f64 {
    /// First zero over the best gaussian's sigma.
    const ZERO: f64 = 2.66;
    /// Gauss-Legendre, five points: places in half pixels and weights that sum to one.
    const RULE: [(f64, f64); 5] = [
        (-0.906_179_845_938_664, 0.118_463_442_528_095),
        (-0.538_469_310_105_683, 0.239_314_335_249_683),
        (0.0, 0.284_444_444_444_444),
        (0.538_469_310_105_683, 0.239_314_335_249_683),
        (0.906_179_845_938_664, 0.118_463_442_528_095),
    ];
    RULE.iter()
        .map(|(place, weight)| {
            let u = std::f64::consts::PI * (offset + 0.5 * place) / (ZERO * width);
            let sinc = if u.abs() < 1e-8 { 1.0 } else { u.sin() / u };
            weight * sinc * sinc
        })
        .sum()
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

    /// A centre that is fewer pixels from its phase has none that is much nearer: half a phase, and a tenth of that for noise.
    pub fn nearest(&self) -> f64 {
        0.55 / self.phases as f64
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
    /// With q = score / slope, q - bend * q^3 = distance in pixels, over three quarters of a phase to either side and for
    /// widths 10 % off.
    pub slope: Vec<DVector<f64>>,
    /// See `slope`; in 1/pixels^2. A gaussian obeys the heat equation, so weights whose response does not change with the
    /// spot's width have a response that falls with its distance: faster than score / distance does.
    pub bend: f64,
    /// Response 1 to width * d(profile)/d(width), 0 to the profile, to a constant and to d(profile)/d(centre).
    pub stretch: Vec<DVector<f64>>,
    /// The profile at each phase.
    pub profile: Vec<DVector<f64>>,
    /// Its derivative by the centre.
    pub gradient: Vec<DVector<f64>>,
}

/// Designs the weights of one width.
///
/// On a tilted background the Jacobian has a fifth column, the pixels' places, and the tilt drops out too.
///
/// With the Jacobian J = [d/d(centre), profile, 1, d/d(width)] and the noise's covariance V = diag(profile + r), the
/// score and the stretch are rows of (J^T V^-1 J)^-1 J^T V^-1: the best linear unbiased estimates of a small shift
/// and a small stretch, with amplitude and black level projected out. They are one Gauss-Newton step of a weighted
/// four-parameter fit, taken in advance.
pub fn design(
    profile: Profile<'_>,
    shape: Shape,
    noise_ratio: f64,
    background: Background,
) -> Table {
    let mut table = Table {
        shape,
        score: vec![],
        slope: vec![],
        stretch: vec![],
        bend: 0.0,
        profile: vec![],
        gradient: vec![],
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
        let places = DVector::from_fn(shape.taps(), |i, _| {
            i as f64 - shape.half_width as f64 - centre
        });
        let columns = [&d_centre, &g, &ones, &d_width, &places];
        let columns = match background {
            Background::Level => &columns[..4],
            Background::Tilted => &columns[..],
        };
        let rows = best_linear_unbiased(columns, &inverse_noise);
        let (score, stretch) = (rows[0].clone(), rows[3].clone());
        table.score.push(score);
        table.stretch.push(stretch);
        table.profile.push(g);
        table.gradient.push(d_centre);
    }
    let fits: Vec<SlopeFit> = (0..shape.phases)
        .map(|k| SlopeFit::new(profile, shape, shape.phase(k), &table.score[k]))
        .collect();
    // One bend serves all phases of a table.
    table.bend = fits.iter().map(SlopeFit::bend).sum::<f64>() / shape.phases as f64;
    table.slope = fits.iter().map(|fit| fit.slope(table.bend)).collect();
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

/// The least-squares fit of the slope's weights, from a basis of smooth functions that sum to zero: their response to the
/// profile shifted by d shall be (1 - bend d^2) score(d) / d, for the shifts and widths that a table serves.
struct SlopeFit {
    basis: Vec<DVector<f64>>,
    /// A row for each shift and width, a column for each function of the basis.
    responses: DMatrix<f64>,
    /// score(d) / d.
    targets: DVector<f64>,
    /// d^2 score(d) / d.
    bent: DVector<f64>,
}

impl SlopeFit {
    fn new(profile: Profile<'_>, shape: Shape, centre: f64, score: &DVector<f64>) -> Self {
        const SHIFTS: usize = 9;
        const WIDTHS: [f64; 3] = [0.9, 1.0, 1.1];

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

        let (mut responses, mut targets, mut bent) = (vec![], vec![], vec![]);
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
                let target = (score.dot(&light) - at_rest) / shift;
                targets.push(target);
                bent.push(shift * shift * target);
            }
        }
        Self {
            responses: DMatrix::from_row_slice(targets.len(), basis.len(), &responses),
            basis,
            targets: DVector::from_vec(targets),
            bent: DVector::from_vec(bent),
        }
    }

    /// The bend that leaves the least residual.
    fn bend(&self) -> f64 {
        // What the basis can make of targets and bend is taken out; what is left of the one is explained by the other.
        let left = |of: &DVector<f64>| of - &self.responses * self.solve(of);
        let (targets, bent) = (left(&self.targets), left(&self.bent));
        targets.dot(&bent) / bent.norm_squared()
    }

    fn slope(&self, bend: f64) -> DVector<f64> {
        let coefficients = self.solve(&(&self.targets - bend * &self.bent));
        self.basis
            .iter()
            .zip(coefficients.iter())
            .map(|(function, &c)| function * c)
            .sum()
    }

    fn solve(&self, targets: &DVector<f64>) -> DVector<f64> {
        /// Keeps the weights small where the basis is nearly dependent; far below the least-squares residual.
        const RIDGE: f64 = 1e-10;
        let normal = self.responses.tr_mul(&self.responses);
        let ridge = RIDGE * normal.trace() / self.basis.len() as f64;
        (normal + DMatrix::identity(self.basis.len(), self.basis.len()) * ridge)
            .cholesky()
            .expect("a ridge makes the normal matrix positive definite")
            .solve(&self.responses.tr_mul(targets))
    }
}
