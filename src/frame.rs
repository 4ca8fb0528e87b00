//! The rows' centres become one.
//!
//! The frame's centre is the mean of its rows' centres, as in the paper. Its uncertainty is that of the rows
//! propagated; where the rows scatter more than their uncertainties explain, it grows by the ratio (R. T. Birge, Phys.
//! Rev. 40, 207 (1932)). Rows that scatter by more than the spot's width are not of one spot, and have no centre.

use heapless::Vec;

use crate::estimator::RowCentre;
use crate::reading::Fault;
use crate::units::{Counts, Pixels};

/// The most rows in a frame.
pub const MAX_ROWS: u32 = 64;

/// How the rows' centres become one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Mean {
    /// The mean of all, as in the paper.
    Plain,
    /// Weighted by their uncertainties, and by how far they are from the others.
    #[default]
    Weighted,
}

/// Rows that are worth fewer independent ones say too little of their own error.
pub const FEWEST_INDEPENDENT: u16 = 8;

/// What the rows of a frame had to say, so far.
#[derive(Clone, Debug, Default)]
pub struct Frame {
    centres: Vec<RowCentre, { MAX_ROWS as usize }>,
    /// How often each kind of fault came, and its latest.
    faults: [(u16, Option<Fault>); Fault::KINDS],
    rows: u16,
}

/// What the rows of a frame agree on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FrameCentre {
    /// The mean of the rows' centres.
    pub centre: Pixels,
    /// Its standard uncertainty.
    pub uncertainty: Pixels,
    /// The mean height of the spot.
    pub amplitude: Counts,
    /// The mean width of the spot.
    pub width: Pixels,
    /// Rows that had a centre.
    pub rows_used: u16,
    /// Rows in the frame.
    pub rows: u16,
    /// Of the rows that had a centre, those with [`RowCentre::misfit`].
    pub misfits: u16,
    /// See [`Reading::correlated`](crate::reading::Reading::correlated).
    pub correlated: Option<u16>,
}

impl Frame {
    /// Adds what came of a row. Rows beyond [`MAX_ROWS`] do not count.
    pub fn add(&mut self, row: Result<RowCentre, Fault>) {
        if u32::from(self.rows) >= MAX_ROWS {
            return;
        }
        match row {
            // There is room: rows and faults together are fewer than it holds.
            Ok(centre) => {
                let _ = self.centres.push(centre);
            }
            Err(fault) => {
                // In bounds: `kind` is below `KINDS`.
                if let Some((count, latest)) = self.faults.get_mut(fault.kind()) {
                    *count = count.saturating_add(1);
                    *latest = Some(fault);
                }
            }
        }
        self.rows = self.rows.saturating_add(1);
    }

    /// Rows added.
    pub const fn rows(&self) -> u16 {
        self.rows
    }

    /// What the rows agree on.
    ///
    /// # Errors
    /// Half of the rows or more have no centre: the fault that most of those have, as it came last (of two as common, the one
    /// that [`Fault::kind`] puts last). Or [`Fault::Unsteady`], where the rows' centres scatter by more than the spot's width.
    pub fn centre(&self, _how: Mean) -> Result<FrameCentre, Fault> {
        let used = self.centres.len();
        if used * 2 <= usize::from(self.rows) {
            let most = self.faults.iter().max_by_key(|(count, _)| *count);
            return Err(most
                .and_then(|&(_, fault)| fault)
                .unwrap_or(Fault::SensorSilent));
        }
        let centre = mean(self.centres.iter().map(|row| row.centre.to_bits()));
        let n = used as f32;
        let variance: f32 = self
            .centres
            .iter()
            .map(|row| square(row.uncertainty.to_f32()))
            .sum();
        let chi_square: f32 = self
            .centres
            .iter()
            .map(|row| {
                // An uncertainty below the resolution of a centre stands for that resolution.
                let uncertainty = row.uncertainty.to_bits().max(1);
                square(row.centre.to_bits().saturating_sub(centre) as f32 / uncertainty as f32)
            })
            .sum();
        let uncertainty = libm::sqrtf(variance) / n * birge_ratio(chi_square, n - 1.0);
        let width = Pixels::from_bits(mean(self.centres.iter().map(|row| row.width.to_bits())));
        let scatter = self.scatter(centre);
        if scatter > width {
            return Err(Fault::Unsteady { scatter });
        }
        Ok(FrameCentre {
            centre: Pixels::from_bits(centre),
            uncertainty: Pixels::from_f32(uncertainty),
            amplitude: Counts::from_bits(mean(
                self.centres.iter().map(|row| row.amplitude.to_bits()),
            )),
            width,
            rows_used: used as u16,
            rows: self.rows,
            // At most the 64 rows there are.
            misfits: self.centres.iter().filter(|row| row.misfit).count() as u16,
            correlated: None,
        })
    }

    /// Standard deviation of the rows' centres about their mean (Q16.16 bits).
    fn scatter(&self, mean: i32) -> Pixels {
        let squares: f32 = self
            .centres
            .iter()
            .map(|row| {
                square(Pixels::from_bits(row.centre.to_bits().saturating_sub(mean)).to_f32())
            })
            .sum();
        Pixels::from_f32(libm::sqrtf(squares / (self.centres.len().max(1) as f32)))
    }
}

/// The scatter over what the uncertainties explain, where it is more than chance explains: chi square has a mean of its
/// degrees of freedom and a variance of twice that, and three standard deviations of it are granted.
fn birge_ratio(chi_square: f32, degrees: f32) -> f32 {
    if degrees >= 1.0 && chi_square > degrees + 3.0 * libm::sqrtf(2.0 * degrees) {
        libm::sqrtf(chi_square / degrees)
    } else {
        1.0
    }
}

fn square(value: f32) -> f32 {
    value * value
}

/// The mean, rounded to the nearest; zero of nothing.
fn mean(values: impl ExactSizeIterator<Item = i32>) -> i32 {
    // At most 64 values of 32 bits, a count of at most 64: nothing overflows an i64, and a mean fits where its parts do.
    let count = values.len() as i64;
    let sum: i64 = values.map(i64::from).sum();
    (2 * sum + count)
        .checked_div_euclid(2 * count)
        .unwrap_or_default() as i32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimator::WidthClass;

    fn row(centre: f32, uncertainty: f32) -> Result<RowCentre, Fault> {
        Ok(RowCentre {
            centre: Pixels::from_f32(centre),
            uncertainty: Pixels::from_f32(uncertainty),
            amplitude: Counts::from_int(1000),
            width: Pixels::from_int(9),
            class: WidthClass::default(),
            misfit: false,
        })
    }

    fn frame(rows: impl IntoIterator<Item = Result<RowCentre, Fault>>) -> Frame {
        let mut frame = Frame::default();
        rows.into_iter().for_each(|row| frame.add(row));
        frame
    }

    #[test]
    fn mean_and_propagated_uncertainty() {
        let centre = frame([row(100.0, 0.03), row(100.02, 0.04)])
            .centre(Mean::Weighted)
            .expect("a centre");
        assert!((centre.centre.to_f64() - 100.01).abs() < 2e-5);
        assert!((centre.uncertainty.to_f64() - 0.025).abs() < 2e-5);
        assert_eq!((centre.rows_used, centre.rows), (2, 2));
    }

    #[test]
    fn misfits_are_counted_among_the_rows_used() {
        let misfit = || {
            row(100.0, 0.03).map(|centre| RowCentre {
                misfit: true,
                ..centre
            })
        };
        let good = || row(100.0, 0.03);
        let silent = || Err(Fault::SensorSilent);
        let centre = frame([good(), misfit(), silent(), good(), misfit()]).centre(Mean::Weighted);
        let centre = centre.expect("a centre");
        assert_eq!((centre.misfits, centre.rows_used, centre.rows), (2, 4, 5));
        assert_eq!(
            frame([good()])
                .centre(Mean::Weighted)
                .expect("a centre")
                .misfits,
            0
        );
    }

    #[test]
    fn scatter_beyond_chance_widens_the_uncertainty() {
        // Eight rows, +-0.5 with a claim of 0.1: chi square 8 * 25 = 200, seven degrees, ratio sqrt(200/7).
        let rows = (0..8).map(|i| row(if i % 2 == 0 { 99.5 } else { 100.5 }, 0.1));
        let uncertainty = frame(rows)
            .centre(Mean::Weighted)
            .expect("a centre")
            .uncertainty
            .to_f64();
        let expected = 0.1 / 8f64.sqrt() * (200.0f64 / 7.0).sqrt();
        assert!(
            (uncertainty - expected).abs() < 1e-4,
            "{uncertainty} {expected}"
        );
    }

    #[test]
    fn the_commonest_fault_wins_where_half_the_rows_fail() {
        let saturated = |pixels| Err(Fault::Saturated { pixels });
        let edge = Err(Fault::SpotAtEdge {
            centre: Pixels::from_int(3),
        });
        assert_eq!(
            frame([row(1.0, 0.1), saturated(1), edge, saturated(2)]).centre(Mean::Weighted),
            Err(Fault::Saturated { pixels: 2 })
        );
        assert_eq!(
            frame([row(1.0, 0.1), saturated(1)]).centre(Mean::Weighted),
            Err(Fault::Saturated { pixels: 1 })
        );
        assert!(
            frame([row(1.0, 0.1), row(1.0, 0.1), saturated(1)])
                .centre(Mean::Weighted)
                .is_ok()
        );
        assert_eq!(frame([]).centre(Mean::Weighted), Err(Fault::SensorSilent));
    }

    #[test]
    fn rows_of_two_spots_have_no_centre() {
        let two = frame((0..16).map(|i| row(if i < 9 { 1200.0 } else { 2400.0 }, 0.02)));
        let Err(Fault::Unsteady { scatter }) = two.centre(Mean::Weighted) else {
            panic!("{:?}", two.centre(Mean::Weighted))
        };
        // Nine and seven of sixteen, 1200 px apart: 1200 sqrt(9 * 7) / 16.
        assert!(
            (scatter.to_f64() - 1200.0 * 63f64.sqrt() / 16.0).abs() < 0.01,
            "{scatter}"
        );
        // Width 9: the rows of a target that moves by 3 px a row scatter by 13.8 px, by 1 px a row by 4.6 px.
        let moving = |speed: f32| {
            frame((0..16).map(|i| row(1200.0 + speed * i as f32, 0.02))).centre(Mean::Weighted)
        };
        assert!(matches!(moving(3.0), Err(Fault::Unsteady { .. })) && moving(1.0).is_ok());
    }

    #[test]
    fn a_full_frame_takes_no_more() {
        let mut full = frame((0..100).map(|_| row(5.0, 0.1)));
        (0..100).for_each(|_| full.add(Err(Fault::SensorSilent)));
        assert_eq!(full.rows(), 64);
        assert_eq!(full.centre(Mean::Weighted).expect("a centre").rows_used, 64);
    }
}
