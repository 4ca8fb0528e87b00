//! Light along a row about the spot's geometric centre.
//!
//! All that spreads a spot - diffraction, the size of the laser's spot, its texture, aberrations, a pixel's
//! width - is a sum of shifted patterns, each with its weight: a convolution.

/// A part of the light, and how far it is shifted along the row.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Part {
    /// Metres on the sensor.
    pub shift: f64,
    /// Its light over that of the whole.
    pub weight: f64,
}

impl Part {
    /// A part of this weight, shifted by so many metres.
    pub const fn new(shift: f64, weight: f64) -> Self {
        Self { shift, weight }
    }
}

/// Light along a row, tabulated at even steps.
#[derive(Clone, Debug, PartialEq)]
pub struct Pattern {
    /// From knot to knot, in metres on the sensor.
    step: f64,
    /// The light at the knots, the middle one of which is at the geometric centre.
    light: Vec<f64>,
}

impl Pattern {
    /// The pattern of a function of the place in metres, within `reach` metres.
    pub fn new(step: f64, reach: f64, light: impl Fn(f64) -> f64) -> Self {
        let half = (reach / step).ceil() as i64;
        Self {
            step,
            light: (-half..=half).map(|i| light(i as f64 * step)).collect(),
        }
    }

    /// A pattern that is the same on both sides, whose light is given from the middle on.
    pub fn symmetric(step: f64, light: &[f64]) -> Self {
        Self {
            step,
            light: light[1..].iter().rev().chain(light).copied().collect(),
        }
    }

    /// A pattern whose light is given from one end to the other: an odd number of knots.
    pub fn from_knots(step: f64, light: Vec<f64>) -> Self {
        assert!(light.len() % 2 == 1, "a middle knot");
        Self { step, light }
    }

    /// Its farthest knot, in metres; there is no light beyond.
    pub fn reach(&self) -> f64 {
        (self.light.len() / 2) as f64 * self.step
    }

    /// The light at a place in metres: by the cubic through the four knots about it.
    ///
    /// A wave of n knots is off by (2 pi / n)^4 / 43 of its height at most, which is 4e-5 at 32.
    pub fn at(&self, place: f64) -> f64 {
        let knots = place / self.step + (self.light.len() / 2) as f64;
        let below = knots.floor();
        let t = knots - below;
        let first = below as i64 - 1;
        let weights = cubic(t);
        match usize::try_from(first) {
            Ok(first) if first + 4 <= self.light.len() => {
                let near = &self.light[first..first + 4];
                near.iter().zip(weights).map(|(a, b)| a * b).sum()
            }
            // At the ends, where there is next to no light.
            _ => {
                let light = |i| self.light.get(usize::try_from(i).ok()?);
                let near = (first..).zip(weights);
                near.filter_map(|(i, weight)| Some(light(i)? * weight))
                    .sum()
            }
        }
    }

    /// The sum of shifted patterns.
    pub fn spread(&self, parts: &[Part]) -> Self {
        let shifts = parts.iter().map(|part| part.shift.abs());
        let more = (shifts.fold(0.0, f64::max) / self.step).ceil() as usize + 2;
        let mut light = vec![0.0; self.light.len() + 2 * more];
        for part in parts {
            // The knot at i - shift lies between two knots, at the same place between them for all i.
            let knots = more as f64 + part.shift / self.step;
            let above = knots.ceil();
            let weights = cubic(above - knots).map(|weight| weight * part.weight);
            // The light of knot k goes to the places from which k is one of the four next: k + 1, k, k - 1
            // and k - 2 knots on.
            let first = above as usize - 2;
            for (k, weight) in weights.into_iter().rev().enumerate() {
                let targets = &mut light[first + k..];
                for (target, light) in targets.iter_mut().zip(&self.light) {
                    *target += weight * light;
                }
            }
        }
        Self {
            step: self.step,
            light,
        }
    }

    /// What pixels of a pitch in metres gather, at the places of their middles: the mean over the pixel.
    pub fn gathered(&self, pitch: f64) -> Self {
        // Gauss and Legendre's three places.
        let outer = 0.6f64.sqrt() * 0.5 * pitch;
        let parts = [(-outer, 5.0), (0.0, 8.0), (outer, 5.0)];
        self.spread(&parts.map(|(shift, weight)| Part::new(shift, weight / 18.0)))
    }

    /// The same, brighter.
    pub fn scaled(mut self, factor: f64) -> Self {
        self.light.iter_mut().for_each(|light| *light *= factor);
        self
    }
}

/// Weights of the knots at -1, 0, 1 and 2 for a place between 0 and 1 (Lagrange).
fn cubic(t: f64) -> [f64; 4] {
    let (a, b, c, d) = (t + 1.0, t, t - 1.0, t - 2.0);
    [
        -b * c * d / 6.0,
        a * c * d / 2.0,
        -a * b * d / 2.0,
        a * b * c / 6.0,
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gaussian(place: f64, sigma: f64) -> f64 {
        (-0.5 * (place / sigma).powi(2)).exp()
    }

    #[test]
    fn between_the_knots_is_the_function() {
        let pattern = Pattern::new(0.1, 7.0, |x| gaussian(x, 1.0));
        let mut worst = 0.0f64;
        for i in -900..900 {
            let place = f64::from(i) * 0.01;
            worst = worst.max((pattern.at(place) - gaussian(place, 1.0)).abs());
        }
        println!("off by {worst:.1e}");
        // h^4 / 42.7 times the largest fourth derivative, which is 3.
        assert!(worst < 3.0 * 1e-4 / 42.6);
    }

    /// A sum of shifted patterns is that sum, wherever between the knots the shifts lie.
    #[test]
    fn spreading_adds_shifted_patterns() {
        let pattern = Pattern::new(0.1, 7.0, |x| gaussian(x, 1.0));
        let parts = [(-2.53, 0.3), (0.0, 0.5), (0.7, 1.5), (4.08, -0.2)]
            .map(|(shift, weight)| Part { shift, weight });
        let spread = pattern.spread(&parts);
        for i in -1200..1200 {
            let place = f64::from(i) * 0.01;
            let sum: f64 = (parts.iter())
                .map(|part| part.weight * gaussian(place - part.shift, 1.0))
                .sum();
            assert!((spread.at(place) - sum).abs() < 3e-5, "{place}");
        }
        // At the knots themselves a shift by knots is exact.
        assert!((pattern.spread(&[Part::new(0.3, 1.0)]).at(0.3) - 1.0).abs() < 1e-12);
    }

    /// A pixel adds the variance of its width: pitch^2 / 12.
    #[test]
    fn a_pixel_gathers_over_its_width() {
        let pattern = Pattern::new(0.05, 7.0, |x| gaussian(x, 1.0));
        let gathered = pattern.gathered(0.9);
        // Both have their centres of mass in the middle.
        let [(energy, variance), (gathered_energy, gathered_variance)] =
            [&pattern, &gathered].map(|it| {
                let (half, energy) = ((it.light.len() / 2) as f64, it.light.iter().sum::<f64>());
                let places = (0..it.light.len()).map(|i| (i as f64 - half) * it.step);
                let all = places.zip(&it.light);
                let moments = all.map(|(place, light)| place * place * light);
                (energy, moments.sum::<f64>() / energy)
            });
        let more = gathered_variance - variance;
        println!("{more:.6} for {:.6}", 0.81 / 12.0);
        assert!((more - 0.81 / 12.0).abs() < 1e-6);
        assert!((gathered_energy / energy - 1.0).abs() < 1e-9);
    }
}
