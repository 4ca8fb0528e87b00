//! The start values of the fit, from the half maximum.

use crate::base::numeric::{self, limited};
use crate::base::{Fault, Pixels};
use crate::centre::half_width::{self, WIDTHS};
use crate::row::Row;
use crate::spot::Spot;

/// The start values of the fit, in pixels and counts.
pub(crate) struct Start {
    pub(crate) centre: Pixels,
    pub(crate) width: f32,
    pub(crate) amplitude: f32,
    /// Whether the half maximum is on the row on both sides.
    pub(crate) is_whole: bool,
}

impl Start {
    /// Finds the start values from the half maximum. If the sensor's edge cuts off one side of the spot, uses
    /// the other.
    pub(crate) fn find(row: &Row<'_>, spot: &Spot) -> Result<Self, Fault> {
        let light = row.light();
        let half = half_width::find(light, spot)?;
        let sides = [half.left, half.right].map(|side| side.map(Pixels::to_f32));
        let (offset, half_maximum) = match sides.into() {
            (Some(left), Some(right)) => (0.5 * (right - left), 0.5 * (left + right)),
            (Some(side), None) | (None, Some(side)) => (0.0, side),
            (None, None) => return Err(Fault::SpotAtEdge { centre: half.top }),
        };
        // A place below 2^13 pixels, and an offset below 2^10.
        let centre = Pixels::from_bits(numeric::add_i32(
            half.top.to_bits(),
            Pixels::from_f32(offset).to_bits(),
        ));
        let flat = flat_top(row, half.top) as f32 * 0.5;
        let height = half.height.to_f32();
        let (width, amplitude) = if flat > 0.5 && flat < half_maximum {
            // The counts are the saturation F at `flat` and F / 2 at the half maximum.
            let squared =
                (half_maximum * half_maximum - flat * flat) / (2.0 * core::f32::consts::LN_2);
            let above = limited(flat * flat / (2.0 * squared), 0.0, 3.0);
            (dual_mac::square_root(squared), height * libm::expf(above))
        } else {
            let sigma = half.sigma(Pixels::from_f32(2.0 * half_maximum));
            (sigma.to_f32(), height)
        };
        Ok(Self {
            centre,
            width: limited(width, WIDTHS.start().to_f32(), WIDTHS.end().to_f32()),
            amplitude,
            is_whole: half.left.is_some() && half.right.is_some(),
        })
    }
}

/// How many pixels about a place are saturated without a gap.
fn flat_top(row: &Row<'_>, place: Pixels) -> usize {
    let saturation = row.saturated_from();
    let place = usize::try_from(place.to_bits() >> Pixels::FRACTION).unwrap_or_default();
    let (left, right) = row.light().split(place);
    let is_full = |count: &u16| *count >= saturation;
    let left = left.iter().rev().take_while(is_full).count();
    left.saturating_add(right.iter().take_while(is_full).count())
}
