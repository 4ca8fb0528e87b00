//! What a lens does to the spot's image beside diffraction, defocus and coma, which are in its field:
//! distortion and flare.

use crate::paper::apparatus::AXIS;
use crate::paper::camera::{COLUMNS, PITCH};
use simulator::scene::Distortion;

/// Chosen: 0.2 % of barrel at the sensor's edge. Makers of 50 mm C-mount lenses give 0.1 to 0.5 % for their
/// largest image.
pub const DISTORTION: Distortion = Distortion {
    share: -0.002,
    field: 0.5 * COLUMNS as f64 * PITCH,
};

/// A reflection sensor - lens - sensor: a disc of light that is out of focus and moves against the spot.
///
/// Light that the sensor throws back leaves through the lens and comes back from a surface of it, or from the
/// filter in front. Its path is longer than the laser's coherence length by far, so it adds to the spot's
/// light without interference.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ghost {
    pub share: f64,
    /// Where it is: at -`magnification` times the spot's distance from the axis.
    pub magnification: f64,
    /// Radius of the disc in metres.
    pub radius: f64,
}

/// Light that the lens scatters and reflects many times over: a broad glare about the axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Veil {
    pub share: f64,
    /// Standard deviation of its gaussian in metres.
    pub width: f64,
}

/// Lens flare: what the paper blames for the lens's errors near the middle of the image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Flare {
    pub ghost: Ghost,
    pub veil: Veil,
}

impl Flare {
    /// Chosen. A bare sensor reflects some 30 %, the flat band-pass filter in front of the lens some per
    /// cent: 2 % of the light comes back. A flat mirror in front of the lens sends it to the other side of
    /// the axis, magnification 1, and it would be in focus if the lens were focused at infinity. Focused at
    /// 0.86 m, the lens has an image distance of 47.2 mm for light that comes back (1/f + 1/R) in place of
    /// 53.1 mm: at f/12, a disc of 6 mm/12.7, 0.24 mm in radius.
    pub const CHOSEN: Self = Self {
        ghost: Ghost {
            share: 0.02,
            magnification: 1.0,
            radius: 0.24e-3,
        },
        veil: Veil {
            share: 0.02,
            width: 1.5e-3,
        },
    };

    /// Adds flare to the image of a spot, whose first pixel is at `column` and `row`, and whose centre is at
    /// `centre`, pixels all.
    /// The sensor's axis is at ([`AXIS`], `axis_row`).
    pub fn add(
        &self,
        image: &mut [f32],
        columns: usize,
        first: Place,
        centre: Place,
        axis_row: f64,
    ) {
        let energy: f64 = image.iter().map(|&light| f64::from(light)).sum();
        let ghost = Place {
            column: AXIS - self.ghost.magnification * (centre.column - AXIS),
            row: axis_row - self.ghost.magnification * (centre.row - axis_row),
        };
        let radius = self.ghost.radius / PITCH;
        let ghost_light = self.ghost.share * energy / (std::f64::consts::PI * radius * radius);
        let width = self.veil.width / PITCH;
        let veil_light = self.veil.share * energy / (std::f64::consts::TAU * width * width);
        for (y, row) in (0..).zip(image.chunks_exact_mut(columns)) {
            let y = first.row + f64::from(y);
            for (x, light) in (0..).zip(row) {
                let x = first.column + f64::from(x);
                // The disc's edge is a pixel wide.
                let inside = radius - (x - ghost.column).hypot(y - ghost.row);
                let from_axis = (x - AXIS).powi(2) + (y - axis_row).powi(2);
                *light += (ghost_light * (inside + 0.5).clamp(0.0, 1.0)
                    + veil_light * (-0.5 * from_axis / (width * width)).exp())
                    as f32;
            }
        }
    }
}

/// A place on the sensor in pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    pub column: f64,
    pub row: f64,
}

#[cfg(test)]
mod tests {
    use super::*;
    use simulator::with;

    /// If the ghost and the veil are wholly on the image, they have their shares of the light. The ghost is
    /// on the other side of the axis.
    #[test]
    fn flare_holds_its_share() {
        const SIZE: usize = 600;
        let first = Place {
            column: AXIS - 300.0,
            row: 0.0,
        };
        let centre = Place {
            column: AXIS + 70.0,
            row: 310.0,
        };
        let of = |flare: Flare| {
            let mut image = vec![0.0f32; SIZE * SIZE];
            image[310 * SIZE + 370] = 1000.0;
            flare.add(&mut image, SIZE, first, centre, 300.0);
            image[310 * SIZE + 370] = 0.0;
            let sum: f64 = image.iter().map(|&light| f64::from(light)).sum();
            let by_column = (0..)
                .zip(&image)
                .map(|(i, &light)| (f64::from(i) % SIZE as f64) * f64::from(light));
            (sum, by_column.sum::<f64>() / sum)
        };
        let chosen = Flare::CHOSEN;
        let none = |share| Veil {
            share,
            width: 0.2e-3,
        };
        let (ghost, at) = of(with(chosen, |it| it.veil = none(0.0)));
        println!("ghost {ghost:.2} at {at:.2}");
        assert!((ghost - 1000.0 * chosen.ghost.share).abs() < 0.2);
        // The axis is at 300, the spot at 370.
        assert!((at - 230.0).abs() < 0.1);
        let (veil, at) = of(Flare {
            ghost: Ghost {
                share: 0.0,
                ..chosen.ghost
            },
            veil: none(0.03),
        });
        println!("veil {veil:.2} at {at:.2}");
        assert!((veil - 30.0).abs() < 0.1 && (at - 300.0).abs() < 0.1);
    }
}
