//! The weights as integers.

use std::fmt::Write as _;

use dual_mac::{Pair, Pairs};
use nalgebra::DVector;

use crate::design::{Shape, Table};

/// The largest sample that a table is proven for: eight pixels of a 12-bit converter, 8 * 4095. Sums of more
/// pixels are halved.
pub const LARGEST_SAMPLE: i64 = 32_760;

/// A table in 16-bit integers. Weights are stored phase after phase, `2 * half_width + 1` a phase and a zero
/// to make them pairs.
#[derive(Clone, Debug)]
pub struct IntegerTable {
    /// What the table is for.
    pub shape: Shape,
    /// Weights of the score and of its slope.
    pub weights: Vec<Pairs>,
    /// Weights of the stretch.
    pub stretch: Vec<Pair>,
    /// The width in samples, Q16.
    pub width: i32,
    /// One over the width in samples, Q30.
    pub per_width: i32,
    /// [`Shape::near_limit`] in samples, Q26.
    pub near_limit: i32,
    /// Distance in samples where (integer) score / slope = 1, Q25.
    pub centre_per_ratio: i32,
    /// Correction of the distance, in 1/samples^2, Q31: if the ratio says q samples, the distance is q - bend
    /// * q^3.
    pub bend: i32,
    /// Relative excess of the spot's width where stretch / slope = 1, Q25.
    pub stretch_per_ratio: i32,
    /// Height of the spot in counts where slope = 1, Q42.
    pub height_per_slope: i32,
    /// Standard deviation of the centre in samples, times slope, for noise of one count in every sample, Q13.
    pub deviation_per_noise: i32,
    /// The centre's variance by the shot noise of a spot one electron high, in counts of one electron, over
    /// that by noise of one count in every sample, Q28.
    pub shot_share: i32,
}

/// The nearest integer to value * 2^`fraction`.
#[expect(clippy::cast_possible_truncation, reason = "the assertion comes first")]
fn fixed(value: f64, fraction: i32) -> i32 {
    let scaled = (value * f64::from(fraction).exp2()).round();
    assert!(
        scaled.abs() < f64::from(i32::MAX),
        "{value} is too large for Q{fraction}"
    );
    scaled as i32
}

impl Table {
    /// Rounds to integers with one scale a kind of weight, as large as the proof of no overflow allows:
    /// sum |weight| * [`LARGEST_SAMPLE`] < 2^31 and |weight| < 2^15. Rows still sum to zero exactly.
    ///
    /// # Panics
    /// If a scale leaves its Q format. Widths of 0.7 to 20 pixels do not.
    pub fn quantise(&self) -> IntegerTable {
        let (score, score_scale) = integers(&self.score, &self.profile);
        let (slope, slope_scale) = integers(&self.slope, &self.profile);
        let (stretch, stretch_scale) = integers(&self.stretch, &self.profile);
        let taps = self.shape.taps();
        let phases = self.shape.phases as f64;
        let (mut per_noise, mut per_height, mut response) = (0.0, 0.0, 0.0);
        // Rounding changes the gain of the score against the slope a little: these say by how much.
        let (mut gain, mut rounded_gain) = (Gain::default(), Gain::default());
        for (k, profile) in self.profile.iter().enumerate() {
            for (i, light) in profile.iter().enumerate() {
                let weight = f64::from(score[k * taps + i]) / score_scale;
                let slope_weight = f64::from(slope[k * taps + i]) / slope_scale;
                per_noise += weight * weight / phases;
                per_height += weight * weight * light / phases;
                response += slope_weight * slope_scale * light / phases;
                let gradient = self.gradient[k][i];
                gain.add(self.score[k][i], self.slope[k][i], gradient, *light);
                rounded_gain.add(weight, slope_weight, gradient, *light);
            }
        }
        let centre_per_ratio = slope_scale / score_scale * gain.ratio() / rounded_gain.ratio();
        IntegerTable {
            shape: self.shape,
            weights: pairs(&score, taps)
                .zip(pairs(&slope, taps))
                .map(|(score, slope)| Pairs(score, slope))
                .collect(),
            stretch: pairs(&stretch, taps).collect(),
            width: fixed(self.shape.width, 16),
            per_width: fixed(1.0 / self.shape.width, 30),
            near_limit: fixed(self.shape.near_limit(), 26),
            centre_per_ratio: fixed(centre_per_ratio, 25),
            bend: fixed(self.bend, 31),
            stretch_per_ratio: fixed(slope_scale / stretch_scale, 25),
            height_per_slope: fixed(1.0 / response, 42),
            deviation_per_noise: fixed(per_noise.sqrt() * slope_scale, 13),
            shot_share: fixed(per_height / per_noise, 28),
        }
    }
}

/// The response of the score to a small shift of the profile, and of the slope to the profile.
#[derive(Default)]
struct Gain {
    score: f64,
    slope: f64,
}

impl Gain {
    fn add(&mut self, score: f64, slope: f64, gradient: f64, light: f64) {
        self.score += score * gradient;
        self.slope += slope * light;
    }

    fn ratio(&self) -> f64 {
        self.score / self.slope
    }
}

/// Rows of weights as pairs, the last of each row with a zero.
fn pairs(weights: &[i16], taps: usize) -> impl Iterator<Item = Pair> {
    weights.chunks(taps).flat_map(|row| {
        row.chunks(2)
            .map(|two| Pair(two[0], two.get(1).copied().unwrap_or(0)))
    })
}

/// Rounds rows of weights to integers, and returns the scale that was used.
fn integers(rows: &[DVector<f64>], profiles: &[DVector<f64>]) -> (Vec<i16>, f64) {
    let largest_sum = rows.iter().map(|row| row.lp_norm(1)).fold(0.0, f64::max);
    let largest = rows.iter().map(|row| row.amax()).fold(0.0, f64::max);
    let bound = f64::from(i32::MAX) / LARGEST_SAMPLE as f64;
    // A thousandth of the scale is left for the rounding.
    let scale = (bound / largest_sum).min(f64::from(i16::MAX) / largest) * 0.999;
    let mut weights = vec![];
    for (row, profile) in rows.iter().zip(profiles) {
        let exact: Vec<f64> = row.iter().map(|weight| weight * scale).collect();
        #[expect(clippy::cast_possible_truncation, reason = "scaled to fit 16 bits")]
        let mut rounded: Vec<i64> = exact.iter().map(|weight| weight.round() as i64).collect();
        make_sum_zero(&mut rounded, &exact);
        restore_response(&mut rounded, &exact, profile);
        // Rounding leaves at most half a unit a weight.
        assert_eq!(rounded.iter().sum::<i64>(), 0);
        let magnitudes: i64 = rounded.iter().map(|weight| weight.abs()).sum();
        assert!(magnitudes * LARGEST_SAMPLE <= i64::from(i32::MAX));
        let narrow = |weight| i16::try_from(weight).expect("scaled to fit 16 bits");
        weights.extend(rounded.into_iter().map(narrow));
    }
    (weights, scale)
}

/// Makes the sum of a row zero where it costs least: at the weights whose rounding went furthest the other
/// way.
fn make_sum_zero(rounded: &mut [i64], exact: &[f64]) {
    let excess: i64 = rounded.iter().sum();
    let step = excess.signum();
    let mut order: Vec<usize> = (0..rounded.len()).collect();
    let error = |i: usize| (rounded[i] as f64 - exact[i]) * step as f64;
    order.sort_by(|&a, &b| error(b).total_cmp(&error(a)));
    for (i, _) in order.into_iter().zip(0..excess.unsigned_abs()) {
        rounded[i] -= step;
    }
}

/// Restores the response to a spot at the phase itself. Otherwise the score would have a bias, and the slope
/// a wrong scale. Moves one unit from a weight to another, which keeps the sum, as long as that helps. No
/// weight is moved twice.
fn restore_response(rounded: &mut [i64], exact: &[f64], profile: &DVector<f64>) {
    let mut free = vec![true; rounded.len()];
    loop {
        let excess: f64 = rounded
            .iter()
            .zip(exact)
            .zip(profile)
            .map(|((&weight, exact), light)| (weight as f64 - exact) * light)
            .sum();
        let best = (0..rounded.len())
            .flat_map(|up| (0..rounded.len()).map(move |down| (up, down)))
            .filter(|&(up, down)| up != down && free[up] && free[down])
            .map(|(up, down)| ((excess + profile[up] - profile[down]).abs(), up, down))
            .min_by(|a, b| a.0.total_cmp(&b.0));
        match best {
            Some((left, up, down)) if left < excess.abs() => {
                rounded[up] += 1;
                rounded[down] -= 1;
                (free[up], free[down]) = (false, false);
            }
            _ => return,
        }
    }
}

/// Rust source of an array of the core's `Table`s.
pub fn rust_source(tables: &[IntegerTable]) -> String {
    let mut source = String::from("[\n");
    for table in tables {
        // Writing to a String cannot fail.
        let _ = writeln!(
            source,
            "Table {{ half_width: {}, phases: {}, weights: &{:?}, stretch: &{:?}, width: {}, per_width: {}, \
             near_limit: {}, centre_per_ratio: {}, bend: {}, stretch_per_ratio: {}, height_per_slope: {}, \
             deviation_per_noise: {}, shot_share: {} }},",
            table.shape.half_width,
            table.shape.phases,
            table.weights,
            table.stretch,
            table.width,
            table.per_width,
            table.near_limit,
            table.centre_per_ratio,
            table.bend,
            table.stretch_per_ratio,
            table.height_per_slope,
            table.deviation_per_noise,
            table.shot_share,
        );
    }
    source.push(']');
    source
}

impl IntegerTable {
    /// Bytes of weights.
    pub fn bytes(&self) -> usize {
        size_of_val(self.weights.as_slice()) + size_of_val(self.stretch.as_slice())
    }

    /// The rows of weights: of the score, the slope and the stretch of each phase.
    pub fn rows(&self) -> Vec<[Vec<i16>; 3]> {
        let pairs = self.shape.taps().div_ceil(2);
        let flat = |pairs: &mut dyn Iterator<Item = Pair>| -> Vec<i16> {
            pairs.flat_map(|pair| [pair.0, pair.1]).collect()
        };
        self.weights
            .chunks(pairs)
            .zip(self.stretch.chunks(pairs))
            .map(|(weights, stretch)| {
                [
                    flat(&mut weights.iter().map(|pairs| pairs.0)),
                    flat(&mut weights.iter().map(|pairs| pairs.1)),
                    flat(&mut stretch.iter().copied()),
                ]
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use crate::{COARSE, DEFAULT, Plan, gaussian, set};

    #[test]
    fn every_row_of_weights_sums_to_zero_and_cannot_overflow() {
        for (noise_ratio, widths) in [
            (DEFAULT.noise_ratio, DEFAULT.widths),
            (f64::INFINITY, COARSE),
            (0.006, COARSE),
        ] {
            let mut bytes = 0;
            let plan = Plan {
                noise_ratio,
                widths,
                ..DEFAULT
            };
            for table in set(&gaussian, plan) {
                bytes += table.bytes();
                let rows = table.rows();
                assert_eq!(rows.len(), table.shape.phases);
                for kind in 0..3 {
                    let (mut largest_sum, mut largest) = (0, 0);
                    for row in rows.iter().map(|rows| &rows[kind]) {
                        assert_eq!(row.len(), table.shape.taps() + 1);
                        assert_eq!(row.last(), Some(&0));
                        assert_eq!(row.iter().map(|&weight| i64::from(weight)).sum::<i64>(), 0);
                        let magnitudes = || row.iter().map(|&weight| i64::from(weight).abs());
                        largest_sum = largest_sum.max(magnitudes().sum::<i64>());
                        largest = largest.max(magnitudes().max().unwrap_or(0));
                    }
                    assert!(largest_sum * super::LARGEST_SAMPLE <= i64::from(i32::MAX));
                    // A scale that wastes bits would pass the proof and lose accuracy.
                    let largest_product = (largest_sum * super::LARGEST_SAMPLE) as f64;
                    let of_sums = largest_product / f64::from(i32::MAX);
                    let used = of_sums.max(largest as f64 / f64::from(i16::MAX));
                    assert!(used > 0.99, "width {}: {used}", table.shape.width);
                }
            }
            println!("r = {noise_ratio}: {bytes} bytes of weights");
            assert!(bytes <= 10_000);
        }
    }

    /// On a noiseless spot of the table's width, and of widths as far off as a table serves, the bent ratio
    /// is the distance.
    #[test]
    fn ratio_is_the_distance() {
        for table in set(&gaussian, DEFAULT) {
            let mut worst = 0.0f64;
            for (k, [score, slope, _]) in table.rows().iter().enumerate() {
                for step in -10..=10 {
                    for mismatch in [0.95, 1.0, 1.05] {
                        let shift = f64::from(step) / 10.0 * table.shape.near_limit();
                        let dot = |weights: &[i16]| {
                            let response = |(i, &weight): (usize, &i16)| {
                                let place = i as f64 - table.shape.half_width as f64;
                                let offset = place - table.shape.phase(k) - shift;
                                f64::from(weight) * gaussian(offset, mismatch * table.shape.width)
                            };
                            weights.iter().enumerate().map(response).sum::<f64>()
                        };
                        let [per_ratio, bend] = [(table.centre_per_ratio, 25), (table.bend, 31)]
                            .map(|(bits, fraction)| libm::ldexp(bits.into(), -fraction));
                        let ratio = dot(score) / dot(slope) * per_ratio;
                        let distance = ratio - bend * ratio.powi(3);
                        worst = worst.max((distance - shift).abs());
                    }
                }
            }
            let width = table.shape.width;
            println!("width {width:.2}: off by {worst:.1e} px at most");
            // Narrower than a pixel, what the pixels leave of a spot changes with its phase.
            let limit = if width < 1.0 { 3e-4 } else { 2.5e-4 };
            assert!(worst < limit, "width {width}: {worst}");
        }
    }
}
