//! Designs the weights of the phase tables, as real numbers.

use nalgebra::{DMatrix, DVector};

/// The background under the spot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Background {
    /// The black level.
    Level,
    /// A black level that rises or falls along the row.
    Tilted,
}

/// A spot's profile. Takes the offset of a pixel's centre from the spot's, and the spot's width, both in
/// pixels. Returns the light that the pixel gathers; a pixel at the peak of a very wide spot gathers 1.
pub type Profile<'a> = &'a dyn Fn(f64, f64) -> f64;

/// The gaussian of eq. (5), exp(-x^2 / (2 width^2)), integrated over the pixel.
pub fn gaussian(offset: f64, width: f64) -> f64 {
    /// From here on, `libm::erf` is 1 to the last bit.
    const ERF_IS_ONE: f64 = 6.0;

    let scale = 1.0 / (std::f64::consts::SQRT_2 * width);
    let (from, to) = ((offset - 0.5) * scale, (offset + 0.5) * scale);
    if from >= ERF_IS_ONE || to <= -ERF_IS_ONE {
        return 0.0;
    }
    width * (std::f64::consts::PI / 2.0).sqrt() * (libm::erf(to) - libm::erf(from))
}

/// The diffraction pattern of a slit, eq. (6), sinc^2(x / (zero)), integrated over the pixel. Its first zero
/// is at 2.66 widths: the width is the sigma of the gaussian that fits the pattern best.
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
    /// The place of the spot at phase `k`, in pixels from the middle pixel's centre: (k - (phases - 1)/2) /
    /// phases.
    pub fn phase(&self, k: usize) -> f64 {
        (k as f64 - (self.phases as f64 - 1.0) / 2.0) / self.phases as f64
    }

    /// A centre within this many pixels of its phase needs no second measurement from a nearer phase. It is
    /// the larger of two limits. One is half the distance between two phases, plus 10 % for noise. The other
    /// is a tenth of the width: up to there, score / slope is a straight line to within 4e-6 of the width.
    pub fn near_limit(&self) -> f64 {
        (0.55 / self.phases as f64).max(0.1 * self.width)
    }

    /// Weights in a row: 2 half widths and the middle.
    pub fn taps(&self) -> usize {
        2 * self.half_width + 1
    }

    /// d(profile)/d(centre).
    fn by_centre(&self, profile: Profile<'_>, centre: f64) -> DVector<f64> {
        let h = 1e-4 * self.width;
        let sample = |centre| self.sample(profile, centre, self.width);
        (sample(centre + h) - sample(centre - h)) / (2.0 * h)
    }

    /// width * d(profile)/d(width).
    fn by_width(&self, profile: Profile<'_>, centre: f64) -> DVector<f64> {
        let h = 1e-4;
        let sample = |factor: f64| self.sample(profile, centre, factor * self.width);
        (sample(1.0 + h) - sample(1.0 - h)) / (2.0 * h)
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
    /// -d(score)/d(centre), less a part of the score where the profile is not symmetric. The score's response
    /// is zero wherever a spot is centred. So the slope's response is that of the score to a shift, whatever
    /// the profile: score / slope is a small distance in pixels for any symmetric spot.
    pub slope: Vec<DVector<f64>>,
    /// The distance is q - bend * q^3 with q = score / slope, over three quarters of a phase to either side;
    /// in 1/pixels^2. With a larger distance the score grows too slowly, and its derivative three times as
    /// much so.
    pub bend: f64,
    /// Response 1 to width * d(profile)/d(width), 0 to the profile, to a constant and to
    /// d(profile)/d(centre).
    pub stretch: Vec<DVector<f64>>,
    /// The profile at each phase.
    pub profile: Vec<DVector<f64>>,
    /// The derivative of the profile by the centre, at each phase.
    pub gradient: Vec<DVector<f64>>,
}

/// The least noise ratio for which the stretch is designed: that of [`crate::DEFAULT`]. With a smaller ratio,
/// the flanks decide the width. A slit has brighter flanks than a gaussian: at a Fresnel number of 0.55, a
/// ratio of 0.006 finds 1.5 times the width, and this ratio 1.0 times.
const LEAST_STRETCH_RATIO: f64 = 0.23;
/// A narrower table, in pixels, keeps the stretch for its own noise ratio. Such a spot has few pixels: if one
/// at its top is dead, only the flanks tell the width.
const NARROW: f64 = 2.0;

/// Designs the weights of one width.
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
    let stretch_ratio = if shape.width < NARROW {
        noise_ratio
    } else {
        noise_ratio.max(LEAST_STRETCH_RATIO)
    };
    let weights = |noise_ratio, centre| weights(profile, shape, noise_ratio, background, centre);
    let mut fit = BendFit::default();
    for k in 0..shape.phases {
        let centre = shape.phase(k);
        let [score, _] = weights(noise_ratio, centre);
        let [_, stretch] = weights(stretch_ratio, centre);
        let h = 0.01 * shape.width;
        let [before, _] = weights(noise_ratio, centre - h);
        let [after, _] = weights(noise_ratio, centre + h);
        let derivative = (before - after) / (2.0 * h);
        let spots = sample_spots(profile, shape, centre, &score);
        let slope = &derivative - fit_asymmetry(&spots, &score, &derivative) * &score;
        fit.add(&spots, &slope);
        table.score.push(score);
        table.slope.push(slope);
        table.stretch.push(stretch);
        let light = shape.sample(profile, centre, shape.width);
        table.profile.push(light);
        table.gradient.push(shape.by_centre(profile, centre));
    }
    table.bend = fit.bend();
    table
}

/// Computes the weights of the score and of the stretch for a spot anywhere in the window.
///
/// With the Jacobian J = [d/d(centre), profile, 1, d/d(width)] and the noise's covariance V = diag(profile +
/// r), they are rows of (J^T V^-1 J)^-1 J^T V^-1: the best linear unbiased estimates of a small shift and a
/// small stretch, with amplitude and black level projected out. They are one Gauss-Newton step of a weighted
/// four-parameter fit, taken in advance. On a tilted background the Jacobian has a fifth column, the pixels'
/// places, and the tilt drops out too.
fn weights(
    profile: Profile<'_>,
    shape: Shape,
    noise_ratio: f64,
    background: Background,
    centre: f64,
) -> [DVector<f64>; 2] {
    let g = shape.sample(profile, centre, shape.width);
    let d_centre = shape.by_centre(profile, centre);
    let d_width = shape.by_width(profile, centre);
    let ones = DVector::from_element(shape.taps(), 1.0);
    let half_width = shape.half_width as f64;
    let places = DVector::from_fn(shape.taps(), |i, _| i as f64 - half_width - centre);
    let inverse_noise = g.zip_map(&places, |light, place| {
        // The window reaches as far to one side of the centre as to the other, so its last pixels count in
        // part. Otherwise light at the ends that the profile does not have would pull at the centre.
        let inside = (half_width + 0.5 - place.abs()).clamp(0.0, 1.0);
        if noise_ratio.is_finite() {
            inside / (light + noise_ratio)
        } else {
            inside
        }
    });
    let columns = [&d_centre, &g, &ones, &d_width, &places];
    let columns = match background {
        Background::Level => &columns[..4],
        Background::Tilted => &columns[..],
    };
    let rows = best_linear_unbiased(columns, &inverse_noise);
    [rows[0].clone(), rows[3].clone()]
}

/// (J^T V^-1 J)^-1 J^T V^-1 with J's columns given and V^-1 diagonal. Columns are scaled to unit length
/// first, which keeps the 4 x 4 system well conditioned.
fn best_linear_unbiased(
    columns: &[&DVector<f64>],
    inverse_noise: &DVector<f64>,
) -> Vec<DVector<f64>> {
    let square =
        |c: &DVector<f64>| -> f64 { c.iter().zip(inverse_noise).map(|(c, v)| c * c * v).sum() };
    let lengths: Vec<f64> = columns.iter().map(|c| square(c).sqrt()).collect();
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

/// A spot that is off its phase.
struct Shifted {
    shift: f64,
    light: DVector<f64>,
    /// The score's response divided by the shift.
    straight: f64,
}

/// Samples of spots within a table's limits: shifted, narrower and wider.
fn sample_spots(
    profile: Profile<'_>,
    shape: Shape,
    centre: f64,
    score: &DVector<f64>,
) -> Vec<Shifted> {
    const SHIFTS: i32 = 4;
    const WIDTHS: [f64; 3] = [0.9, 1.0, 1.1];

    let span = 0.75 / shape.phases as f64;
    let mut spots = vec![];
    for width in WIDTHS.map(|w| w * shape.width) {
        let at_rest = score.dot(&shape.sample(profile, centre, width));
        for step in (-SHIFTS..=SHIFTS).filter(|&step| step != 0) {
            let shift = f64::from(step) / f64::from(SHIFTS) * span;
            let light = shape.sample(profile, centre + shift, width);
            spots.push(Shifted {
                shift,
                straight: (score.dot(&light) - at_rest) / shift,
                light,
            });
        }
    }
    spots
}

/// How much of the score to subtract from its derivative, by least squares. If the profile is not symmetric,
/// the score is shift + s shift^2, and its derivative 1 + 2 s shift. The derivative less s times the score is
/// score / shift.
fn fit_asymmetry(spots: &[Shifted], score: &DVector<f64>, derivative: &DVector<f64>) -> f64 {
    let (mut product, mut square) = (0.0, 0.0);
    for spot in spots {
        let response = score.dot(&spot.light);
        product += response * (derivative.dot(&spot.light) - spot.straight);
        square += response * response;
    }
    product / square
}

/// The least-squares fit of the bend: one serves all phases of a table.
#[derive(Default)]
struct BendFit {
    product: f64,
    square: f64,
}

impl BendFit {
    fn add(&mut self, spots: &[Shifted], slope: &DVector<f64>) {
        for spot in spots {
            // Where slope = (1 - bend shift^2) score / shift, this is what bend = 1 takes away.
            let bent = spot.shift * spot.shift * spot.straight;
            self.product += bent * (spot.straight - slope.dot(&spot.light));
            self.square += bent * bent;
        }
    }

    fn bend(&self) -> f64 {
        self.product / self.square
    }
}
