//! Makes the words of a row.

use slitrange::row::sensor_heads;
use slitrange::row::{Geometry, LARGEST_COUNT};

use crate::description::{Description, Kind, Shape};

/// Pixels that see light: those of the TCD1304DG.
pub const PIXELS: usize = 3648;

/// Words of its read-out.
pub const WORDS: usize = 3694;

/// What the words mean.
pub fn geometry() -> Geometry {
    sensor_heads::tcd1304dg()
}

/// Which of the two rows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Turn {
    /// The row before.
    Before,
    /// The row itself.
    Now,
}

/// Numbers of the noise that is repeated along a row.
const NOISE: usize = 1 << 10;

/// Makes rows.
pub struct Maker {
    /// Numbers of nearly normal distribution, mean 0 and standard deviation 1.
    noise: [f32; NOISE],
    /// The light of a row, in counts.
    light: [f32; PIXELS],
}

impl Default for Maker {
    fn default() -> Self {
        // Sums of four bytes, each of variance (256^2 - 1)/12, from Knuth's generator MMIX.
        let mut state = 1u64;
        let noise = core::array::from_fn(|_| {
            state = (state.wrapping_mul(6_364_136_223_846_793_005))
                .wrapping_add(1_442_695_040_888_963_407);
            let [.., a, b, c, d] = state.to_le_bytes();
            let sum: i32 = [a, b, c, d].into_iter().map(i32::from).sum();
            (sum - 510) as f32 / 147.8
        });
        Self {
            noise,
            light: [0.0; PIXELS],
        }
    }
}

impl Maker {
    /// Writes the words of a read-out.
    pub fn write(&mut self, description: &Description, turn: Turn, words: &mut [u16; WORDS]) {
        self.light.fill(f32::from(description.black));
        // Another part of the noise for each row, and in other steps.
        let (start, of) = match turn {
            Turn::Before => (description.seed.wrapping_add(517), 1),
            Turn::Now => (description.seed, 2),
        };
        let step = 2 * (description.seed >> 10) as usize + 1;
        let noise = |i: usize| (start as usize).wrapping_add(i.wrapping_mul(step)) % NOISE;
        for shape in &description.shapes {
            if shape.rows & of != 0 {
                self.add(shape);
            }
            if shape.rows & of != 0 && shape.kind == Kind::Speckle {
                let (first, end) = reach(shape, 8.0);
                let grain = usize::from(shape.width >> 8).max(1);
                let contrast = f32::from(shape.more) / 65536.0;
                for (i, light) in self.light.iter_mut().enumerate().take(end).skip(first) {
                    *light *= 1.0 + contrast * self.noise[noise(i / grain)];
                }
            }
        }
        let geometry = geometry();
        let word = |count: f32| geometry.full_scale() - count as u16;
        words.fill(word(f32::from(description.black.min(LARGEST_COUNT))));
        let sigma = f32::from(description.noise) / 256.0;
        let light = words[geometry.light.clone()].iter_mut().zip(&self.light);
        for (i, (to, light)) in light.enumerate() {
            let count = light + sigma * self.noise[noise(i)] + 0.5;
            *to = word(count.clamp(0.0, f32::from(LARGEST_COUNT)));
        }
    }

    fn add(&mut self, shape: &Shape) {
        let width = f32::from(shape.width.max(16)) / 256.0;
        let (centre, height) = (f32::from(shape.place) / 16.0, f32::from(shape.height));
        match shape.kind {
            Kind::Nothing | Kind::Speckle => {}
            Kind::Spot => self.add_spot(centre, [width, width], height),
            Kind::WideSpot => self.add_spot(centre, [8.0 * width; 2], height),
            Kind::SkewedSpot => {
                let right = width * f32::from(shape.more.max(32)) / 256.0;
                self.add_spot(centre, [width, right], height);
            }
            Kind::Peak => {
                let (first, end) = reach(shape, 12.0);
                let falls = libm::expf(-1.0 / width);
                let middle = (usize::from(shape.place >> 4)).clamp(first, end);
                let mut light = height;
                for i in middle..end {
                    self.light[i] += light;
                    light *= falls;
                }
                let mut light = height * falls;
                for i in (first..middle).rev() {
                    self.light[i] += light;
                    light *= falls;
                }
            }
            Kind::Block => {
                let (first, end) = reach(shape, 1.0);
                for light in &mut self.light[first..end] {
                    *light += height;
                }
            }
            Kind::Pixel => {
                if let Some(light) = self.light.get_mut(usize::from(shape.place >> 4)) {
                    *light = height;
                }
            }
            Kind::Ramp => {
                let first = usize::from(shape.place >> 4).min(PIXELS);
                let slope = height / (16.0 * width);
                let mut light = 0.0;
                for pixel in &mut self.light[first..] {
                    *pixel += light;
                    if libm::fabsf(light) < libm::fabsf(height) {
                        light += slope;
                    }
                }
            }
            Kind::Comb => {
                let [step, spots] = shape.more.to_le_bytes();
                let step = f32::from(step) + 1.0;
                for i in 0..spots.min(64) {
                    self.add_spot(centre + f32::from(i) * step, [width, width], height);
                }
            }
            Kind::OddPixels => {
                let (first, end) = reach(shape, 16.0);
                for light in self.light[first..end].iter_mut().step_by(2) {
                    *light += height;
                }
            }
        }
    }

    /// Adds a gaussian of these widths to the left and to the right, up to four widths from its centre.
    fn add_spot(&mut self, centre: f32, [left, right]: [f32; 2], height: f32) {
        let first = (centre - 4.0 * left).clamp(0.0, PIXELS as f32) as usize;
        let end = (centre + 4.0 * right).clamp(0.0, PIXELS as f32) as usize;
        let middle = ((centre + 1.0) as usize).clamp(first, end.max(first));
        for (range, width) in [(first..middle, left), (middle..end, right)] {
            // Each step multiplies the light by `ratio`, and `ratio` by `falls`.
            let u = (range.start as f32 - centre) / width;
            let pitch = 1.0 / width;
            let mut light = height * libm::expf(-0.5 * u * u);
            let mut ratio = libm::expf(-pitch * (u + 0.5 * pitch));
            let falls = libm::expf(-pitch * pitch);
            for i in range {
                self.light[i] += light;
                light *= ratio;
                ratio *= falls;
            }
        }
    }
}

/// The pixels within so many widths of a shape: the first, and one past the last.
fn reach(shape: &Shape, widths: f32) -> (usize, usize) {
    let (centre, width) = (
        f32::from(shape.place) / 16.0,
        f32::from(shape.width) / 256.0,
    );
    let reach = widths * width + 0.5;
    let end = ((centre + reach + 0.5) as usize).min(PIXELS);
    (((centre - reach + 0.5) as usize).min(end), end)
}
