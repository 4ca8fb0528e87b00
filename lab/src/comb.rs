//! What a comb of slits does to the error by speckle, and how true its u is.

use rayon::prelude::*;
use simulator::comb::{Comb, Slit};
use simulator::optics::Aperture;
use simulator::scene::{LaserSpot, Scene, Simulation, Speckle};
use slitrange::comb::{self, SlitMap, Slits};
use slitrange::distance::Calibration;
use slitrange::fault::Fault;
use slitrange::measurement::Measurement;
use slitrange::reading::Reading;
use slitrange::settings::Settings;
use slitrange::uncertainty::{CalibrationErrors, Surface};

use host_tests::frames;

use crate::surfaces::Judged;

/// Where targets are, in metres.
#[derive(Clone, Copy, Debug)]
pub enum At {
    /// All at one distance.
    One(f64),
    /// Evenly between two distances, in no order.
    Between(f64, f64),
}

impl At {
    /// The distance of a surface, by an additive recurrence with the golden ratio.
    fn distance(self, surface: u64) -> f64 {
        match self {
            Self::One(distance) => distance,
            Self::Between(first, last) => {
                let share = (surface as f64 * 0.618_033_988_749_895).fract();
                first + share * (last - first)
            }
        }
    }
}

/// A mask, and how the core brings its images together.
#[derive(Clone, Debug)]
pub struct Mask {
    /// The slits before the sensor.
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

    /// The default mask.
    pub fn nominal() -> Self {
        Self {
            comb: Comb::nominal(),
            maps: comb::Comb::nominal(),
        }
    }
}

/// A scene with another laser spot and speckle of a single wavelength.
pub fn with_speckle(scene: &Scene, waist: f64, polarisations: u8) -> Scene {
    let laser_spot = LaserSpot {
        waist,
        waist_distance: 0.8,
        wander: 0.0,
    };
    let speckle = Speckle {
        polarisations,
        linewidth: 0.0,
        path_spread: 0.0,
    };
    Scene {
        laser_spot: Some(laser_spot),
        speckle: Some(speckle),
        ..scene.clone()
    }
}

/// Readings of surfaces with numbers from `first` on, each of one frame of `rows` rows. The calibration is
/// the nominal one, which is that of the simulated head, and its tolerances do not count.
pub fn read(
    scene: &Scene,
    mask: Option<&Mask>,
    at: At,
    rows: u16,
    first: u64,
    count: u64,
) -> Vec<Result<Judged, Fault>> {
    let scene = Scene {
        comb: mask.map(|mask| mask.comb.clone()),
        ..scene.clone()
    };
    let calibration = Calibration::nominal();
    (first..first + count)
        .into_par_iter()
        .map(|surface| {
            let distance = at.distance(surface);
            let reading = reading(&scene, mask, surface, distance, rows, calibration.as_ref())?;
            Ok(Judged {
                reading,
                error: reading.distance.to_f64() - 1e6 * distance,
            })
        })
        .collect()
}

/// The reading of a surface.
fn reading(
    scene: &Scene,
    mask: Option<&Mask>,
    surface: u64,
    distance: f64,
    rows: u16,
    calibration: Option<&Calibration>,
) -> Result<Reading, Fault> {
    let mut simulation = Simulation::new(scene.clone());
    simulation.set_surface(surface);
    let geometry = scene.geometry();
    let settings = Settings {
        rows,
        slits: if mask.is_some() {
            Slits::Comb
        } else {
            Slits::One
        },
        ..Settings::default()
    };
    let mut measurement = Measurement::new(geometry.clone(), settings);
    if let Some(mask) = mask {
        measurement.set_comb(mask.maps.clone());
    }
    let first = u64::from(rows) * surface;
    let measured = (first..first + u64::from(rows)).find_map(|row| {
        let light = simulation.row(row, distance, scene.exposure);
        measurement.row(&mut frames::words(&light, &geometry))
    });
    let measured = measured.unwrap_or(Err(Fault::SensorSilent))?;
    measured.reading(calibration, &CalibrationErrors::Unknown, Surface::Auto)
}

/// The same optics with another width of the slits: that of the scene's aperture, to which the spot's height
/// belongs, in metres.
pub fn with_width(scene: &Scene, width: f64) -> Scene {
    let mut scene = scene.clone();
    if let Aperture::Slit {
        width: of_scene, ..
    } = &mut scene.optics.aperture
    {
        *of_scene = width;
    }
    scene
}
