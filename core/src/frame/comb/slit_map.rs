//! Where the images of one slit belong.

use serde::{Deserialize, Serialize};

use crate::base::drawing::{DRAWING, T};
use crate::base::{Micrometres, Pixels};

/// Coefficients of a slit's correction.
pub const CORRECTIONS: usize = 4;

/// Brings the centre of a slit's image to the place where a slit on the optical axis would show it.
///
/// A slit at the place s on the row shows a target at another baseline, b + s sin u, and with another offset,
/// d0 plus s cos u, than a slit on the axis. With y the image's place from the slit's own axis, and x0 that
/// from the optical axis of an image through a slit there, eq. (1) for both gives
///
/// ```text
/// x0 = (y - f e) / (1 + e tan u),   e = s cos u / b
/// ```
///
/// Both share D of eq. (1): a slit's own curve is d = D + K_s / (x - xp_s), with K_s = K (1 + e tan u). A
/// correction describes how the mask differs from its drawing: a polynomial of degree three that is added to
/// x0. Its argument is x0 from the axis in units of [`UNIT`] pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct SlitMap {
    /// s, from the optical axis along the row.
    place: Micrometres,
    /// The correction's coefficients, of the lowest degree first.
    correction: [Pixels; CORRECTIONS],
}

/// Pixels in a unit of the correction's argument.
pub const UNIT: f32 = 1024.0;
/// cos u of the nominal geometry: 1 / sqrt(1 + tan^2 u), tan u = 2.6.
const COS: f32 = 0.358_979_08;
/// The largest place of a slit in micrometres: half of a row of 4096 pixels of 8 um.
pub const LARGEST_PLACE_UM: i32 = 16_384;
/// The largest coefficient of a correction in pixels. x0 then always rises with the centre: t is within 1.8,
/// so a correction changes by less than 64 (1 + 2 t + 3 t^2) / 1024 = 0.9 pixels a pixel.
pub const LARGEST_CORRECTION: i32 = 64;

impl SlitMap {
    /// A slit at a place in micrometres, limited to half of the longest row.
    pub const fn nominal(place_um: i32) -> Self {
        let place_um = if place_um > LARGEST_PLACE_UM {
            LARGEST_PLACE_UM
        } else if place_um < -LARGEST_PLACE_UM {
            -LARGEST_PLACE_UM
        } else {
            place_um
        };
        Self {
            place: Micrometres::from_int(place_um),
            correction: [Pixels::from_bits(0); CORRECTIONS],
        }
    }

    /// The slit with a correction.
    pub const fn corrected(self, correction: [Pixels; CORRECTIONS]) -> Self {
        Self { correction, ..self }
    }

    /// s, from the optical axis along the row.
    pub const fn place(&self) -> Micrometres {
        self.place
    }

    /// The correction's coefficients, of the lowest degree first.
    pub const fn correction(&self) -> &[Pixels; CORRECTIONS] {
        &self.correction
    }

    /// Whether the slit's place is within [`LARGEST_PLACE_UM`].
    pub(super) fn is_on_row(&self) -> bool {
        let most = Micrometres::from_int(LARGEST_PLACE_UM);
        self.place.to_bits().unsigned_abs() <= most.to_bits().unsigned_abs()
    }

    /// Whether no coefficient is beyond [`LARGEST_CORRECTION`].
    pub(super) fn has_small_correction(&self) -> bool {
        let most = (Pixels::from_int(LARGEST_CORRECTION).to_bits()).unsigned_abs();
        let mut terms = self.correction.iter();
        terms.all(|term| term.to_bits().unsigned_abs() <= most)
    }

    /// e. Its size is below 0.02 for a place within [`LARGEST_PLACE_UM`].
    fn e(&self) -> f32 {
        self.place.to_f32() * (COS / DRAWING.baseline_um)
    }

    /// 1 + e tan u: how much farther the slit's images move than those of a slit on the axis. At least 0.5.
    pub fn growth(&self) -> f32 {
        #[expect(clippy::cast_possible_truncation, reason = "a constant, rounded")]
        let growth = 1.0 + self.e() * T as f32;
        if growth > 0.5 { growth } else { 0.5 }
    }

    /// From the axis of the sensor to the place at which y - f e is zero, in pixels.
    fn shift(&self) -> Pixels {
        let shift = self.place.to_f32() / DRAWING.pitch_um + DRAWING.focal_px * self.e();
        Pixels::from_f32(DRAWING.axis_px + shift)
    }

    /// x0 for the centre of an image.
    pub fn to_axis(&self, centre: Pixels) -> Pixels {
        let axis = Pixels::from_f32(DRAWING.axis_px).to_bits();
        let from_shift = centre.to_bits().saturating_sub(self.shift().to_bits());
        // The small part alone goes through an f32, so that the rest keeps all of its bits.
        let growth = self.growth();
        let from_shift_px = Pixels::from_bits(from_shift).to_f32();
        let less = Pixels::from_f32(from_shift_px * ((growth - 1.0) / growth)).to_bits();
        let x0 = axis.saturating_add(from_shift.saturating_sub(less));
        let correction = self.correction_at(from_shift_px / growth);
        Pixels::from_bits(x0.saturating_add(Pixels::from_f32(correction).to_bits()))
    }

    /// As [`to_axis`](Self::to_axis) in pixels, to 0.001 px: for many places in a row.
    pub(super) fn roughly_to_axis(&self) -> impl Fn(f32) -> f32 {
        let shift = self.shift().to_f32();
        let shrink = 1.0 / self.growth();
        move |place| {
            let from_axis = (place - shift) * shrink;
            DRAWING.axis_px + from_axis + self.correction_at(from_axis)
        }
    }

    /// Where the slit shows a spot whose image through a slit on the axis is at `x0`: to the correction times
    /// the square of its slope.
    pub fn from_axis(&self, x0: Pixels) -> Pixels {
        let corrected = x0.to_f32() - DRAWING.axis_px;
        let from_axis = corrected - self.correction_at(corrected);
        let from_axis = corrected - self.correction_at(from_axis);
        Pixels::from_f32(self.shift().to_f32() + from_axis * self.growth())
    }

    /// The correction in pixels, for x0 from the axis in pixels.
    fn correction_at(&self, from_axis: f32) -> f32 {
        let t = from_axis * (1.0 / UNIT);
        let terms = self.correction.iter().rev();
        terms.fold(0.0, |sum, term| sum * t + term.to_f32())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::comb::NOMINAL_PLACES_UM;

    /// Eq. (1) with its trigonometry, in f64, for a slit at a place s: the distance in micrometres.
    fn distance(place_um: f64, centre: f64) -> f64 {
        let u = T.atan();
        let baseline = f64::from(DRAWING.baseline_um) + place_um * u.sin();
        let axis = f64::from(DRAWING.axis_px) + place_um / f64::from(DRAWING.pitch_um);
        let angle = ((centre - axis) / f64::from(DRAWING.focal_px)).atan();
        place_um * u.cos() + baseline * (u - angle).tan()
    }

    #[test]
    fn images_of_all_slits_come_to_the_place_of_a_slit_on_the_axis() {
        let mut worst = 0.0f64;
        for place in NOMINAL_PLACES_UM {
            let slit = SlitMap::nominal(place);
            for x0 in (1191..=2654).step_by(if cfg!(miri) { 209 } else { 7 }) {
                let x0 = Pixels::from_int(x0);
                let centre = slit.from_axis(x0);
                let back = slit.to_axis(centre);
                worst = worst.max((back.to_f64() - x0.to_f64()).abs());
                let roughly = slit.roughly_to_axis()(centre.to_f32());
                assert!((f64::from(roughly) - back.to_f64()).abs() < 1e-3);
                let here = distance(place.into(), centre.to_f64());
                let off = here - distance(0.0, back.to_f64());
                assert!(off.abs() < 0.1, "{place} {x0}: {off}");
            }
        }
        println!("there and back: within {worst:.5} px");
        assert!(worst < 5e-4);
    }

    #[test]
    fn a_slit_on_the_axis_changes_nothing() {
        for bits in [0, 1, 77_777_777, -1, i32::MAX / 2] {
            let centre = Pixels::from_bits(bits);
            assert_eq!(SlitMap::nominal(0).to_axis(centre), centre);
        }
    }

    #[test]
    fn a_correction_is_a_polynomial_of_x0() {
        let coefficients = [0.5, -0.25, 2.0, 1.0].map(Pixels::from_f32);
        let slit = SlitMap::nominal(3000);
        let corrected = slit.corrected(coefficients);
        for centre in [1500.0, 2200.0, 2900.0].map(Pixels::from_f32) {
            let x0 = slit.to_axis(centre).to_f64();
            let t = (x0 - 1823.5) / 1024.0;
            let expected = x0 + 0.5 - 0.25 * t + 2.0 * t * t + t * t * t;
            assert!((corrected.to_axis(centre).to_f64() - expected).abs() < 1e-4);
            let back = corrected.from_axis(corrected.to_axis(centre));
            let off = back.to_f64() - centre.to_f64();
            assert!(off.abs() < 0.05, "{back} {centre}");
        }
    }

    #[test]
    fn any_place_and_any_centre_give_a_number() {
        for place in [i32::MIN, -20_000, 0, 20_000, i32::MAX] {
            let mut slit = SlitMap::nominal(0);
            slit.place = Micrometres::from_bits(place);
            let slit = slit.corrected([Pixels::MAX, Pixels::MIN, Pixels::MAX, Pixels::MIN]);
            for centre in [Pixels::MIN, Pixels::default(), Pixels::MAX] {
                let _ = (slit.to_axis(centre), slit.from_axis(centre));
                assert!(slit.growth() >= 0.5);
            }
        }
    }
}
