//! Laser, slit and sensor of a design, and eq. (1) with its trigonometry. Lengths are in millimetres.

use slitrange::frame::comb::{NOMINAL_PLACES_UM, SLIT_WIDTH_UM};

/// Where the parts of a sensor are: [`Geometry::distance`] is eq. (1).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Geometry {
    /// d0: from the laser's origin to where distances begin.
    pub offset: f64,
    /// b: from the laser's beam to the slit.
    pub baseline: f64,
    /// f: from the slit to the sensor.
    pub focal: f64,
    /// u: the angle between the baseline and the optical axis, in radians.
    pub angle: f64,
    /// From pixel to pixel.
    pub pitch: f64,
    /// The pixels of the sensor.
    pub pixels: usize,
    /// The pixel on the optical axis.
    pub axis: f64,
}

impl Geometry {
    /// A sensor whose optical axis hits the middle of its pixels, and looks along the middle of the angles to
    /// `near` and `far`: then both are equally far from the middle of the row.
    pub fn new(
        baseline: f64,
        focal: f64,
        (pitch, pixels): (f64, usize),
        near: f64,
        far: f64,
    ) -> Self {
        Self {
            offset: 0.0,
            baseline,
            focal,
            angle: 0.5 * ((near / baseline).atan() + (far / baseline).atan()),
            pitch,
            pixels,
            axis: (pixels as f64 - 1.0) / 2.0,
        }
    }

    /// Eq. (1): the distance for a centre in pixels.
    pub fn distance(&self, centre: f64) -> f64 {
        let x = (centre - self.axis) * self.pitch;
        self.offset + self.baseline * (self.angle - (x / self.focal).atan()).tan()
    }

    /// The centre in pixels for a distance.
    pub fn centre(&self, distance: f64) -> f64 {
        self.centre_of(0.0, distance)
    }

    /// The centre in pixels of a target that is `away` from the beam towards the slit, and `along` the beam.
    pub fn centre_of(&self, away: f64, along: f64) -> f64 {
        let alpha = self.angle - (along - self.offset).atan2(self.baseline - away);
        self.axis + self.focal * alpha.tan() / self.pitch
    }

    /// By how much the distance changes for a pixel, without sign.
    pub fn mm_a_pixel(&self, distance: f64) -> f64 {
        let x = (self.centre(distance) - self.axis) * self.pitch;
        let along = distance - self.offset;
        (self.baseline * self.baseline + along * along) / self.baseline * self.focal
            / (self.focal * self.focal + x * x)
            * self.pitch
    }

    /// From the target to the slit.
    pub fn range(&self, distance: f64) -> f64 {
        self.baseline.hypot(distance - self.offset)
    }

    /// The angle between the beam and the light to the slit, in radians.
    pub fn viewing_angle(&self, distance: f64) -> f64 {
        (self.baseline / (distance - self.offset)).atan()
    }

    /// D, K in mm pixels and xp: eq. (1) as d = D + K/(x - xp).
    pub fn eq1(&self) -> (f64, f64, f64) {
        let t = self.angle.tan();
        let f = self.focal / self.pitch;
        (
            self.offset - self.baseline / t,
            self.baseline * f * (1.0 + t * t) / (t * t),
            self.axis - f / t,
        )
    }

    /// The same sensor with its slit `place` along the row, in the direction in which pixels count.
    pub fn behind(&self, place: f64) -> Self {
        Self {
            offset: self.offset + place * self.angle.cos(),
            baseline: self.baseline + place * self.angle.sin(),
            axis: self.axis + place / self.pitch,
            ..*self
        }
    }

    /// By how much each wrong dimension moves the distance, in mm, without a calibration.
    pub fn tolerances(&self, distance: f64) -> [(&'static str, f64); 5] {
        let turn = 0.1f64.to_radians();
        let (focal, baseline) = (self.focal + 0.1, self.baseline + 0.1);
        let angle = self.angle - turn;
        let beam = self.centre_of(distance * turn.sin(), distance * turn.cos());
        let of = |built: Self| built.centre(distance);
        [
            ("slit 0.1 mm along the row", of(self.behind(0.1))),
            ("slit to sensor 0.1 mm", of(Self { focal, ..*self })),
            ("baseline 0.1 mm", of(Self { baseline, ..*self })),
            ("slit and sensor 0.1 degrees", of(Self { angle, ..*self })),
            ("beam 0.1 degrees", beam),
        ]
        .map(|(name, centre)| (name, (self.distance(centre) - distance).abs()))
    }

    /// The pixels of the farthest and of the nearest distance. With a comb: of its outer slits.
    pub fn ends(&self, near: f64, far: f64, comb: bool) -> (f64, f64) {
        let [first, last] = self.outer_slits(comb);
        (first.centre(far), last.centre(near))
    }

    /// The nearest and the farthest distance at which the spot, with `reach` pixels on both sides, is on the
    /// row. Infinite if the sensor sees beyond any distance. With a comb: the spots of all slits. Nothing if
    /// there is no such distance.
    pub fn usable(&self, reach: f64, comb: bool) -> Option<(f64, f64)> {
        let [first, last] = self.outer_slits(comb);
        let end = self.pixels as f64 - 1.0 - reach;
        let [pole, pole_of_last] = [first, last].map(|it| it.eq1().2);
        if end <= pole_of_last {
            return None;
        }
        let near = last.distance(end).max(0.0);
        let far = match reach > pole {
            true => first.distance(reach),
            false => f64::INFINITY,
        };
        (near < far).then_some((near, far))
    }

    /// The same sensor behind the first and the last slit of a comb, or behind its only slit.
    fn outer_slits(&self, comb: bool) -> [Self; 2] {
        [0, COMB_SLITS - 1].map(|slit| match comb {
            true => self.behind(f64::from(NOMINAL_PLACES_UM[slit]) / 1000.0),
            false => *self,
        })
    }
}

/// The width of the slits of a comb, in micrometres.
pub const COMB_SLIT_UM: f64 = SLIT_WIDTH_UM as f64;
/// The slits of a comb.
pub const COMB_SLITS: usize = NOMINAL_PLACES_UM.len();
