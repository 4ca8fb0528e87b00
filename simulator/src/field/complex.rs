//! Phase factors, and products of complex matrices: where the time goes.
//!
//! Sums are written out in lanes that the compiler turns into vector instructions. Their order is fixed, no
//! fused operations are used, and sine and cosine are our own, so that results are the same on every machine.

use std::f32::consts::PI;

/// exp(2 pi i turns) as (real, imaginary), within 4e-7 for any number of turns below 2^40.
///
/// The whole turns go in f64; then cos and sin of half the angle by Taylor's series up to the thirteenth
/// power, and the formulas of the double angle.
#[inline]
pub fn phasor(turns: f64) -> (f32, f32) {
    // Adding 1.5 * 2^52 leaves no fraction: rounding without a function call, so that it can be vectorised.
    const ROUND: f64 = 6_755_399_441_055_744.0;
    let half = PI * (turns - ((turns + ROUND) - ROUND)) as f32;
    let q = half * half;
    let sin = half
        * (1.0
            + q * (-1.0 / 6.0
                + q * (1.0 / 120.0
                    + q * (-1.0 / 5040.0
                        + q * (1.0 / 362_880.0
                            + q * (-1.0 / 39_916_800.0 + q / 6_227_020_800.0))))));
    let cos = 1.0
        + q * (-0.5
            + q * (1.0 / 24.0
                + q * (-1.0 / 720.0
                    + q * (1.0 / 40_320.0 + q * (-1.0 / 3_628_800.0 + q / 479_001_600.0)))));
    (cos * cos - sin * sin, 2.0 * sin * cos)
}

/// Numbers that are summed side by side.
pub const LANES: usize = 8;

/// A complex matrix, row by row, real and imaginary parts apart; rows are filled up with zeros to whole
/// [`LANES`].
#[derive(Clone, Debug, Default)]
pub struct Matrix {
    /// Rows.
    pub rows: usize,
    /// Columns without the filling.
    pub columns: usize,
    /// Columns with the filling.
    pub stride: usize,
    /// Real parts.
    pub re: Vec<f32>,
    /// Imaginary parts.
    pub im: Vec<f32>,
}

impl Matrix {
    /// Zeros.
    pub fn zeros(rows: usize, columns: usize) -> Self {
        let stride = columns.next_multiple_of(LANES);
        Self {
            rows,
            columns,
            stride,
            re: vec![0.0; rows * stride],
            im: vec![0.0; rows * stride],
        }
    }

    /// The matrix of a function of row and column.
    pub fn from_fn(
        rows: usize,
        columns: usize,
        mut value: impl FnMut(usize, usize) -> (f32, f32),
    ) -> Self {
        let mut matrix = Self::zeros(rows, columns);
        for row in 0..rows {
            for column in 0..columns {
                let at = row * matrix.stride + column;
                (matrix.re[at], matrix.im[at]) = value(row, column);
            }
        }
        matrix
    }

    /// Real and imaginary parts of a row.
    pub fn row(&self, row: usize) -> (&[f32], &[f32]) {
        let range = row * self.stride..(row + 1) * self.stride;
        (&self.re[range.clone()], &self.im[range])
    }

    /// Rows and columns exchanged.
    pub fn transposed(&self) -> Self {
        Self::from_fn(self.columns, self.rows, |row, column| {
            let at = column * self.stride + row;
            (self.re[at], self.im[at])
        })
    }

    /// sum |element|^2 of each row.
    pub fn row_sums(&self) -> Vec<f64> {
        let sum = |row| {
            let (re, im) = self.row(row);
            let squares = re.iter().zip(im).map(|(re, im)| re * re + im * im);
            squares.map(f64::from).sum()
        };
        (0..self.rows).map(sum).collect()
    }

    /// Becomes the product of a and b: as many rows as a, as many columns as b.
    pub fn set_product(&mut self, a: &Matrix, b: &Matrix) {
        assert_eq!(
            (self.rows, self.stride, a.columns),
            (a.rows, b.stride, b.rows)
        );
        let mut panel = vec![([0.0; LANES], [0.0; LANES]); b.rows];
        for column in (0..b.stride).step_by(LANES) {
            // The columns that are in work, one after the other in memory.
            for (row, (re, im)) in panel.iter_mut().enumerate() {
                let at = row * b.stride + column;
                re.copy_from_slice(&b.re[at..at + LANES]);
                im.copy_from_slice(&b.im[at..at + LANES]);
            }
            let mut row = 0;
            while row < a.rows {
                // Two rows share what is loaded of the panel; a last single one is done twice.
                let rows = [row, (row + 1).min(a.rows - 1)];
                let products = two_rows(rows.map(|row| a.row(row)), &panel);
                for (row, (re, im)) in rows.into_iter().zip(products) {
                    let at = row * self.stride + column;
                    self.re[at..at + LANES].copy_from_slice(&re);
                    self.im[at..at + LANES].copy_from_slice(&im);
                }
                row += 2;
            }
        }
    }

    /// Adds `weight` |element|^2 to an image without filling, row by row.
    pub fn add_light(&self, weight: f32, light: &mut [f32]) {
        for (row, light) in light.chunks_exact_mut(self.columns).enumerate() {
            let (re, im) = self.row(row);
            for (light, (re, im)) in light.iter_mut().zip(re.iter().zip(im)) {
                *light += weight * (re * re + im * im);
            }
        }
    }

    /// Multiplies every element with that of another matrix of the same size.
    pub fn multiply_elements(&mut self, other: &Matrix) {
        let elements = self.re.iter_mut().zip(&mut self.im);
        for ((re, im), (x, y)) in elements.zip(other.re.iter().zip(&other.im)) {
            (*re, *im) = (*re * x - *im * y, *re * y + *im * x);
        }
    }
}

/// Real and imaginary parts of [`LANES`] elements.
type Lanes = ([f32; LANES], [f32; LANES]);

/// The products of two rows with a panel of columns.
#[inline]
fn two_rows(rows: [(&[f32], &[f32]); 2], panel: &[Lanes]) -> [Lanes; 2] {
    let [(a_re, a_im), (b_re, b_im)] = rows;
    let mut sums: [Lanes; 2] = Default::default();
    let factors = a_re.iter().zip(a_im).zip(b_re.iter().zip(b_im));
    for (((&a, &b), (&c, &d)), (re, im)) in factors.zip(panel) {
        for i in 0..LANES {
            sums[0].0[i] += a * re[i] - b * im[i];
            sums[0].1[i] += a * im[i] + b * re[i];
            sums[1].0[i] += c * re[i] - d * im[i];
            sums[1].1[i] += c * im[i] + d * re[i];
        }
    }
    sums
}

/// sum a b for each of two a (real and imaginary parts) and two b: [a0 b0, a1 b0, a2 b1, a3 b1]. All of the
/// same length, in whole [`LANES`].
#[inline]
pub fn four_sums(a: [&[f32]; 4], b: [&[f32]; 2]) -> [f32; 4] {
    let mut sums = [[0.0f32; LANES]; 4];
    let a = a.map(|values| values.as_chunks::<LANES>().0);
    let b = b.map(|values| values.as_chunks::<LANES>().0);
    for chunk in 0..b[0].len() {
        let (a, b) = (a.map(|values| values[chunk]), b.map(|values| values[chunk]));
        for i in 0..LANES {
            sums[0][i] += a[0][i] * b[0][i];
            sums[1][i] += a[1][i] * b[0][i];
            sums[2][i] += a[2][i] * b[1][i];
            sums[3][i] += a[3][i] * b[1][i];
        }
    }
    sums.map(|lanes| lanes.iter().sum())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn phasors_are_cosine_and_sine() {
        let mut worst = 0.0f64;
        for step in -20_000..20_000 {
            let turns = f64::from(step) * 0.013_7 + f64::from(step % 7) * 1000.0;
            let angle = std::f64::consts::TAU * turns.rem_euclid(1.0);
            let (re, im) = phasor(turns);
            worst = worst
                .max((f64::from(re) - angle.cos()).abs())
                .max((f64::from(im) - angle.sin()).abs());
        }
        println!("largest error of a phasor: {worst:.1e}");
        assert!(worst < 4e-7);
    }

    #[test]
    fn a_product_is_the_sum_over_columns() {
        let value = |seed: usize| {
            move |row: usize, column: usize| {
                phasor((row * 31 + column * 17 + seed) as f64 * 0.381_966)
            }
        };
        let (a, b) = (
            Matrix::from_fn(5, 11, value(1)),
            Matrix::from_fn(11, 19, value(2)),
        );
        let mut product = Matrix::zeros(5, 19);
        product.set_product(&a, &b);
        for row in 0..5 {
            for column in 0..19 {
                let (mut re, mut im) = (0.0, 0.0);
                for i in 0..11 {
                    let (x, y) = value(1)(row, i);
                    let (p, q) = value(2)(i, column);
                    re += x * p - y * q;
                    im += x * q + y * p;
                }
                let at = row * product.stride + column;
                assert!((product.re[at] - re).abs() < 1e-5);
                assert!((product.im[at] - im).abs() < 1e-5);
            }
        }
    }
}
