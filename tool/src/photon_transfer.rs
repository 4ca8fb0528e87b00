//! Photon transfer: the gain and the read noise of a front end, from rows of a target at rest.
//!
//! Light of m counts above the dark has a variance of v = v0 + m / gain, with v0 the variance in the dark and
//! the gain in electrons a count (J. R. Janesick, "Photon Transfer", SPIE 2007; EMVA standard 1288). A line
//! through the pairs (m, v) of many pixels and exposures gives both.
//!
//! The laser's power, the spot's place and the lamps' light may change from row to row. These changes are no
//! noise of the pixels. So each row is compared with the mean row after the mean row's level, height and
//! place have been fitted to it.

use nalgebra::{DMatrix, DVector};

/// The variance of a pixel, or of many pixels together, beside its mean.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Point {
    /// The mean above the dark, in counts.
    pub signal: f64,
    /// The variance from row to row, in counts squared.
    pub variance: f64,
    /// Degrees of freedom of the variance: of n values with a common mean, n - 1.
    pub freedom: f64,
}

/// v = `dark` + `per_count` m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Line {
    /// The variance without light, in counts squared.
    pub dark: f64,
    /// By how much a count of light raises it, in counts: one over the gain.
    pub per_count: f64,
    /// The standard uncertainty of `dark`.
    pub dark_u: f64,
    /// The standard uncertainty of `per_count`.
    pub per_count_u: f64,
    /// How far the points lie off the line, over what chance allows: 1 if the line is true.
    pub scatter: f64,
}

impl Line {
    /// The variance at a signal, in counts squared. Above zero, so that it can weigh.
    pub fn at(&self, signal: f64) -> f64 {
        (self.dark + self.per_count * signal).max(VARIANCE_OF_ROUNDING)
    }
}

/// The variance of rounding to whole counts, in counts squared. No sensor has less.
pub const VARIANCE_OF_ROUNDING: f64 = 1.0 / 12.0;
/// Fits of the line, each weighed by the one before. From a first line that is wrong by a factor of ten, the
/// third fit differs from the second by less than a thousandth.
const FITS: usize = 4;

/// The variance of the pixels of rows with the laser off, all pixels together. Their common level may change
/// from row to row.
pub fn dark_point(rows: &[Vec<f64>]) -> Option<Point> {
    let pixels = rows.first()?.len();
    let mean = mean_row(rows)?;
    let mut squares = 0.0;
    for row in rows {
        let off: Vec<f64> = row.iter().zip(&mean).map(|(a, b)| a - b).collect();
        let level = statistics::mean(&off);
        squares += off.iter().map(|off| (off - level).powi(2)).sum::<f64>();
    }
    let freedom = (rows.len() as f64 - 1.0) * (pixels as f64 - 1.0);
    (freedom > 0.0).then(|| Point {
        signal: 0.0,
        variance: squares / freedom,
        freedom,
    })
}

/// The mean of rows, pixel by pixel. `None` without a row, or if a row is shorter than the first.
pub fn mean_row(rows: &[Vec<f64>]) -> Option<Vec<f64>> {
    let pixels = rows.first()?.len();
    let is_whole = rows.iter().all(|row| row.len() >= pixels);
    let mean = |pixel: usize| statistics::mean(rows.iter().map(|row| row[pixel]));
    is_whole.then(|| (0..pixels).map(mean).collect())
}

/// Rows of one exposure, with what does not change between them.
struct Lit<'a> {
    rows: &'a [Vec<f64>],
    mean: Vec<f64>,
    /// The mean less the mean in the dark.
    signal: Vec<f64>,
    /// A column for each way in which a row may differ as a whole: by a level, a factor, and a shift.
    modes: DMatrix<f64>,
}

impl<'a> Lit<'a> {
    fn new(rows: &'a [Vec<f64>], dark: &[f64]) -> Option<Self> {
        let mean = mean_row(rows)?;
        let signal: Vec<f64> = mean.iter().zip(dark).map(|(a, b)| a - b).collect();
        let slope = |pixel: usize| {
            let at = |pixel: usize| signal[pixel.min(signal.len() - 1)];
            at(pixel + 1) - at(pixel.saturating_sub(1))
        };
        let modes = DMatrix::from_fn(signal.len(), 3, |pixel, mode| match mode {
            0 => 1.0,
            1 => signal[pixel],
            _ => slope(pixel),
        });
        Some(Self {
            rows,
            mean,
            signal,
            modes,
        })
    }

    /// The variance of each pixel. The fit of the modes is weighed by a line that is nearly right.
    fn points(&self, line: &Line) -> Option<Vec<Point>> {
        let weight = |pixel: usize| 1.0 / line.at(self.signal[pixel]);
        let pixels = self.signal.len();
        let weighed = DMatrix::from_fn(pixels, 3, |pixel, mode| {
            weight(pixel) * self.modes[(pixel, mode)]
        });
        let inverse = (self.modes.transpose() * &weighed).try_inverse()?;
        let mut squares = vec![0.0; pixels];
        for row in self.rows {
            let off = DVector::from_fn(pixels, |pixel, _| row[pixel] - self.mean[pixel]);
            let as_a_whole = &self.modes * (&inverse * (weighed.transpose() * &off));
            for (pixel, square) in squares.iter_mut().enumerate() {
                *square += (off[pixel] - as_a_whole[pixel]).powi(2);
            }
        }
        // The modes take a part of each pixel's noise: its leverage.
        let taken = &weighed * &inverse;
        let points = (0..pixels).map(|pixel| {
            let of_mode = |mode| taken[(pixel, mode)] * self.modes[(pixel, mode)];
            let leverage: f64 = (0..3).map(of_mode).sum();
            let freedom = (self.rows.len() as f64 - 1.0) * (1.0 - leverage);
            Point {
                signal: self.signal[pixel],
                variance: squares[pixel] / freedom,
                freedom,
            }
        });
        // A pixel that the modes fit exactly tells nothing.
        Some(points.filter(|point| point.freedom > 1.0).collect())
    }
}

/// What photon transfer gives.
#[derive(Clone, Debug)]
pub struct Transfer {
    /// The line.
    pub line: Line,
    /// A point for each pixel and exposure, and last the one in the dark.
    pub points: Vec<Point>,
}

/// Fits the line to rows of several exposures and to the variance in the dark. `dark` is the mean row in the
/// dark, of the same pixels. `None` if the rows tell no gain: there are too few, or there is no light.
pub fn transfer(exposures: &[Vec<Vec<f64>>], dark: &[f64], in_the_dark: Point) -> Option<Transfer> {
    let lit: Vec<Lit<'_>> = (exposures.iter())
        .map(|rows| Lit::new(rows, dark))
        .collect::<Option<_>>()?;
    let mut line = Line {
        dark: in_the_dark.variance,
        per_count: 0.1,
        dark_u: 0.0,
        per_count_u: 0.0,
        scatter: 1.0,
    };
    let mut points = vec![];
    for _ in 0..FITS {
        points.clear();
        for lit in &lit {
            points.extend(lit.points(&line)?);
        }
        points.push(in_the_dark);
        line = fit(&points, &line)?;
    }
    (line.per_count > 0.0).then_some(Transfer { line, points })
}

/// Fits a line. Each point weighs by the variance of a variance, 2 v^2 / freedom, with v of the line before:
/// weights from the point's own v would favour the points that are low by chance.
fn fit(points: &[Point], before: &Line) -> Option<Line> {
    let weight = |point: &Point| point.freedom / (2.0 * before.at(point.signal).powi(2));
    let sum = |of: fn(&Point) -> f64| -> f64 {
        points.iter().map(|point| weight(point) * of(point)).sum()
    };
    let all = sum(|_| 1.0);
    let (m, mm) = (sum(|it| it.signal), sum(|it| it.signal * it.signal));
    let (v, mv) = (sum(|it| it.variance), sum(|it| it.signal * it.variance));
    let determinant = all * mm - m * m;
    let is_solvable = determinant > 0.0;
    if !is_solvable {
        return None;
    }
    let dark = (mm * v - m * mv) / determinant;
    let per_count = (all * mv - m * v) / determinant;
    // If the points scatter more than chance lets them, the uncertainties grow by as much.
    let off = |point: &Point| point.variance - dark - per_count * point.signal;
    let chi_squared: f64 = points.iter().map(|it| weight(it) * off(it).powi(2)).sum();
    let scatter = (chi_squared / (points.len() as f64 - 2.0).max(1.0)).sqrt();
    let excess = scatter.max(1.0).powi(2);
    Some(Line {
        dark,
        per_count,
        dark_u: (excess * mm / determinant).sqrt(),
        per_count_u: (excess * all / determinant).sqrt(),
        scatter,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    const PIXELS: usize = 90;
    const NOISE: f64 = 4.0;
    const GAIN: f64 = 7.5;

    /// Rows of a spot of some height. `power` and `place` are the standard deviations from row to row of the
    /// laser's power, as a share of it, and of the spot's place in pixels.
    fn rows(random: &mut ChaCha8Rng, height: f64, power: f64, place: f64) -> Vec<Vec<f64>> {
        let mut normal = || -> f64 { StandardNormal.sample(random) };
        let row = |_| {
            let (factor, shift) = (1.0 + power * normal(), place * normal());
            let count = |pixel: usize| {
                let off = (pixel as f64 - 44.3 - shift) / 10.0;
                let light = height * factor * (-0.5 * off * off).exp();
                300.0 + light + (NOISE * NOISE + light / GAIN).sqrt() * normal()
            };
            (0..PIXELS).map(count).collect()
        };
        (0..40).map(row).collect()
    }

    fn measure(seed: u64, power: f64, place: f64) -> Transfer {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let dark = rows(&mut random, 0.0, 0.0, 0.0);
        let in_the_dark = dark_point(&dark).expect("rows");
        let mut exposure = |step| rows(&mut random, 200.0 * f64::from(step), power, place);
        let exposures: Vec<_> = (1..=12).map(&mut exposure).collect();
        transfer(&exposures, &mean_row(&dark).expect("rows"), in_the_dark).expect("a line")
    }

    /// Of 100 measurements: the mean is right, and the uncertainties are those of the scatter. A laser whose
    /// power changes by 2 % and a spot that trembles by 0.05 pixels have no effect.
    #[test]
    fn gain_and_noise_are_found_with_true_uncertainties() {
        for (power, place) in [(0.0, 0.0), (0.02, 0.05)] {
            let line = |seed| measure(seed, power, place).line;
            let lines: Vec<Line> = (0..100).map(line).collect();
            let gain: [fn(&Line) -> f64; 2] = [|it| it.per_count, |it| it.per_count_u];
            let dark: [fn(&Line) -> f64; 2] = [|it| it.dark, |it| it.dark_u];
            for (name, truth, [value, u]) in [
                ("one over the gain", 1.0 / GAIN, gain),
                ("dark", NOISE * NOISE, dark),
            ] {
                let mean = statistics::mean(lines.iter().map(value));
                let pulls = lines.iter().map(|line| (value(line) - truth) / u(line));
                let (pull, claimed) = (statistics::rms(pulls), u(&lines[0]));
                println!(
                    "{name}: {truth:.4}, mean {mean:.4}, u {:.2} %, pull {pull:.2}",
                    100.0 * claimed / truth
                );
                // The mean of 100 is known to a tenth of u; the pull of 100 to 7 %.
                assert!((mean - truth).abs() < 0.4 * claimed, "{name}");
                assert!((0.75..1.25).contains(&pull), "{name}");
            }
        }
    }

    #[test]
    fn without_light_there_is_no_gain() {
        let mut random = ChaCha8Rng::seed_from_u64(1);
        let dark = rows(&mut random, 0.0, 0.0, 0.0);
        let in_the_dark = dark_point(&dark).expect("rows");
        assert!((in_the_dark.variance / (NOISE * NOISE) - 1.0).abs() < 0.1);
        let mean = mean_row(&dark).expect("rows");
        assert!(transfer(&[], &mean, in_the_dark).is_none());
        assert!(dark_point(&dark[..1]).is_none());
        assert!(dark_point(&[]).is_none());
        assert!(mean_row(&[]).is_none());
        assert!(mean_row(&[vec![1.0, 2.0], vec![1.0]]).is_none());
    }
}
