//! What stands on the paper's table: laser, camera, slit or lens. Lengths in metres.

use crate::paper::camera::{COLUMNS, PITCH};
use crate::paper::lens_effects::DISTORTION;
use simulator::field::{Laser, LensAperture, SlitAperture};
use simulator::optics::Optics;
use simulator::scene::Sensor;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Aperture {
    /// A slit of 200 um x 3 mm.
    Slit,
    Lens,
}

impl Aperture {
    /// Both, in the paper's order.
    pub const ALL: [Self; 2] = [Self::Lens, Self::Slit];

    pub const fn name(self) -> &'static str {
        match self {
            Self::Slit => "slit",
            Self::Lens => "lens",
        }
    }
}

pub const BASELINE: f64 = 0.3;

/// The table's first and last position: distances along the laser's beam.
pub const TABLE: (f64, f64) = (0.60, 1.02);

/// From one position to the next.
pub const STEP: f64 = 25e-6;

pub const POSITIONS: usize = 16_800;

pub const CAPTURES: usize = 5;

/// The laser: 650 nm as in the paper. Chosen: a linewidth of a cheap multimode diode; a waist in the middle
/// of the table, of the size that keeps the beam narrowest over it (0.42 to 0.59 mm between the 1/e^2
/// points).
pub const LASER: Laser = Laser {
    wavelength: 650e-9,
    linewidth: 1e-9,
    wavelengths: 5,
    waist_diameter: 0.42e-3,
    waist_distance: 0.81,
};

/// Chosen: the angle between the laser's beam and the table, in radians, by which the spot wanders over the
/// target.
pub const WANDER: f64 = 2e-3;

/// The slit, 50 mm in front of the sensor.
pub const SLIT: SlitAperture = SlitAperture {
    width: 200e-6,
    height: 3e-3,
    to_sensor: 0.05,
};

/// The lens. It is focused in the middle of the table (chosen), and its coma is chosen: a quarter of a wave
/// at the edge of the pupil and of the field, where a lens is still called diffraction-limited.
pub fn lens() -> LensAperture {
    LensAperture {
        diameter: 0.05 / 12.0,
        focal_length: 0.05,
        focus_distance: BASELINE.hypot(0.5 * (TABLE.0 + TABLE.1)),
        coma: 0.25,
        full_field: 0.5 * COLUMNS as f64 * PITCH,
        pixel: PITCH,
        samples: 2,
    }
}

/// Tangent of u, the angle between the laser's beam and the camera's axis. Chosen: it puts the table's range
/// in the middle of the sensor to within 66 pixels.
pub const TAN_ANGLE: f64 = 2.6;

/// Eq. (1) of the apparatus without aberrations.
pub fn optics(aperture: Aperture) -> Optics {
    Optics {
        baseline: BASELINE,
        focal_length: match aperture {
            Aperture::Slit => SLIT.to_sensor,
            Aperture::Lens => lens().to_sensor(),
        },
        angle: TAN_ANGLE.atan(),
        pitch: PITCH,
        axis: AXIS,
        ..Optics::nominal_on(Sensor::Camera)
    }
}

/// The pixel on the optical axis.
pub const AXIS: f64 = (COLUMNS as f64 - 1.0) / 2.0;

/// The spot's place on the sensor in pixels: eq. (1), and the lens's distortion.
pub fn centre(aperture: Aperture, distance: f64) -> f64 {
    let ideal = optics(aperture).centre(distance);
    match aperture {
        Aperture::Slit => ideal,
        Aperture::Lens => DISTORTION.displaced(ideal, AXIS, PITCH),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::paper::{lens_path, slit_path};

    #[test]
    fn the_spot_is_on_the_sensor_all_over_the_table() {
        // Half of the simulated columns to spare at either end.
        for (aperture, half) in [
            (Aperture::Slit, slit_path::COLUMNS / 2),
            (Aperture::Lens, lens_path::SIZE / 2),
        ] {
            let ends = [TABLE.0, TABLE.1].map(|distance| centre(aperture, distance));
            println!("{}: {ends:.1?}", aperture.name());
            let whole = half as f64..(COLUMNS - half) as f64;
            assert!(ends.iter().all(|end| whole.contains(end)));
        }
    }
}
