//! What a comb of slits does to the error by speckle, and how true its u is.

use simulator::scene::comb::{Comb, Slit};
use simulator::scene::{LaserSpot, Speckle};
use slitrange::Options;
use slitrange::frame::comb::{self, SlitMap};

use judges::frames;

use crate::prelude::*;
use crate::surfaces::{Judged, POINTS, calibrate, distance_within};

/// A mask, and how the core brings its images together.
#[derive(Clone, Debug)]
pub struct Mask {
    pub comb: Comb,
    /// The same for the core.
    maps: comb::Comb,
}

impl Mask {
    /// A mask of slits at places in micrometres, all of one width in micrometres. `None` if they are no comb.
    pub fn new(places_um: &[i32], width_um: i32) -> Option<Self> {
        let slits = places_um.iter().map(|&place| Slit {
            place: 1e-6 * f64::from(place),
            width: 1e-6 * f64::from(width_um),
        });
        let maps: Vec<SlitMap> = places_um.iter().map(|&um| SlitMap::nominal(um)).collect();
        Some(Self {
            comb: Comb {
                slits: slits.collect(),
            },
            maps: comb::Comb::new(&maps)?,
        })
    }

    pub fn nominal() -> Self {
        Self {
            comb: Comb::nominal(),
            maps: comb::Comb::nominal(),
        }
    }
}

/// A scene with another laser spot and speckle of a single wavelength.
pub fn with_speckle(scene: &Scene, waist: f64, polarisations: u8) -> Scene {
    with(scene.clone(), |it| {
        it.laser_spot = Some(LaserSpot::new(waist, 0.8));
        it.speckle = Some(Speckle::of_one_wavelength(polarisations));
    })
}

#[derive(Clone, Debug)]
pub struct Sensor {
    /// `None`: one slit.
    mask: Option<Mask>,
    calibration: Option<Calibration>,
    errors: CalibrationErrors,
}

impl Sensor {
    /// A sensor with the nominal calibration, which is that of the simulated head, so that its tolerances do
    /// not count.
    pub fn nominal(mask: Option<Mask>) -> Self {
        Self {
            mask,
            calibration: Calibration::nominal(),
            errors: CalibrationErrors::Unknown,
        }
    }

    /// A sensor with the default mask that is calibrated on a scene's material. `first` is the number of the
    /// first surface that it sees.
    pub fn calibrated(scene: &Scene, first: u64) -> Result<Self> {
        let comb = Comb::nominal();
        let scene = with(scene.clone(), |it| it.comb = Some(comb.clone()));
        let record = calibrate(&scene, POINTS, first)?;
        let maps = record.comb.context("the calibration found no slits")?;
        Ok(Self {
            mask: Some(Mask { comb, maps }),
            calibration: Some(record.calibration),
            errors: record.errors,
        })
    }

    /// Readings of surfaces with numbers from `first` on, each of one frame of `rows` rows, at distances that
    /// are spread over a range in metres.
    pub fn read(
        &self,
        scene: &Scene,
        range: [f64; 2],
        rows: u16,
        first: u64,
        count: u64,
    ) -> Vec<Result<Judged, Fault>> {
        let scene = Scene {
            comb: self.mask.as_ref().map(|mask| mask.comb.clone()),
            ..scene.clone()
        };
        let geometry = scene.geometry();
        let slits = match self.mask {
            Some(_) => Slits::Comb,
            None => Slits::One,
        };
        let options = with(Options::default(), |it| (it.rows, it.slits) = (rows, slits));
        let judged = |surface| -> Result<Judged, Fault> {
            let distance = distance_within(range, surface);
            let simulation = Simulation::on_surface(scene.clone(), surface);
            let mut measurement = Measurement::new(geometry.clone(), options);
            if let Some(mask) = &self.mask {
                measurement.set_comb(mask.maps.clone());
            }
            let first = u64::from(rows) * surface;
            let measured = (first..first + u64::from(rows)).find_map(|row| {
                let light = simulation.row(row, distance, scene.exposure);
                measurement.row(&mut frames::words(&light, &geometry))
            });
            let measured = measured.unwrap_or(Err(Fault::SensorSilent))?;
            let calibration = self.calibration.as_ref();
            let reading = measured.reading(calibration, &self.errors, Surface::Auto)?;
            Ok(Judged {
                reading,
                error: reading.distance.to_f64() - 1e6 * distance,
            })
        };
        let surfaces = first..first + count;
        surfaces.into_par_iter().map(judged).collect()
    }
}

/// The same optics with another width of the slits: that of the scene's aperture, to which the spot's height
/// belongs, in metres.
pub fn with_width(mut scene: Scene, metres: f64) -> Scene {
    if let Aperture::Slit { width, .. } = &mut scene.optics.aperture {
        *width = metres;
    }
    scene
}
