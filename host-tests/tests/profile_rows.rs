//! Seeded rows of a spot of any profile.

use crate::support::*;

/// Pixels of a row that is long enough for the spot and as much background: the noise is not known well on
/// it, but the centre does not depend on that where the tables are given.
pub fn pixels(width: f64) -> usize {
    (64.0 + 24.0 * width) as usize
}

/// Seeded rows of a spot of any profile.
#[derive(Clone, Copy, Debug)]
pub struct Rows<'a> {
    pub curve: &'a Curve,
    /// The spot and its noise, number of rows, and seed.
    pub cell: Cell,
}

impl Rows<'_> {
    /// The sensor's geometry: [`pixels`] of light.
    pub fn geometry(&self) -> Geometry {
        self.cell.scene_of(pixels(self.cell.width)).geometry()
    }

    /// A row's counts, light positive, and where its spot is: evenly over 16 pixels and their phases.
    pub fn row(&self, row: u64) -> (Vec<u16>, f64) {
        self.row_of(pixels(self.cell.width), row)
    }

    /// As [`Self::row`], with so many pixels.
    pub fn row_of(&self, pixels: usize, row: u64) -> (Vec<u16>, f64) {
        const GOLDEN: f64 = 0.618_033_988_749_895;
        let middle = pixels as f64 / 2.0;
        let centre = middle - 8.0 + 16.0 * (row as f64 * GOLDEN).fract();
        let mut random = random(!self.cell.seed);
        random.set_stream(row);
        let mut scene = self.cell.scene_of(pixels);
        scene.spot = None;
        let mut counts = scene.row_with_centre(row, centre, 1.0);
        let light = |i| self.curve.at(i as f64 - centre, self.cell.width) * self.cell.amplitude;
        let mut light: Vec<f32> = (0..counts.len()).map(|i| light(i) as f32).collect();
        if let Some(noise) = scene.shot_noise {
            noise.apply(&mut light, &mut random);
        }
        for (count, light) in counts.iter_mut().zip(light) {
            *count += light;
        }
        (quantise(&counts, 4095), centre)
    }

    /// The errors in pixels of the centres that a function finds on each row.
    ///
    /// # Errors
    /// That of a row without a centre.
    pub fn errors<const N: usize>(
        &self,
        centres: impl Fn(&[u16]) -> Result<[f64; N], Fault> + Sync,
    ) -> Result<Vec<[f64; N]>, Fault> {
        (0..self.cell.rows)
            .into_par_iter()
            .map(|row| {
                let (counts, truth) = self.row(row);
                Ok(centres(&counts)?.map(|centre| centre - truth))
            })
            .collect()
    }
}
