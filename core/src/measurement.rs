//! Measures rows: takes the words of rows and gives the centres of frames. The whole pipeline up to the
//! calibration, pure.
//!
//! Words of a read-out -> [`Row`] -> [`Spot`] -> centre of the row -> [`Measured`], the centre of the frame.
//! A [`Calibration`](crate::distance::Calibration) turns that into a distance: [`Measured::reading`].

use crate::black_level::BlackPixels;
use crate::centre::{Estimator, RowCentre};
use crate::check;
use crate::fault::Fault;
use crate::frame::Frame;
use crate::pixels::PixelErrors;
use crate::reading::Measured;
use crate::row::{Geometry, Row};
use crate::settings::Settings;
use crate::spot::{self, Spot};
use crate::units::Counts;

/// The pipeline with the state of the frame that is under way.
#[derive(Clone, Debug)]
pub struct Measurement {
    geometry: Geometry,
    settings: Settings,
    frame: Frame,
    black: BlackPixels,
    /// The result of the row before, if it is of the same frame and had a centre.
    before: Option<(Spot, RowCentre)>,
    /// The background above the black level, of the latest row of the frame with a spot.
    ambient: Counts,
}

impl Measurement {
    /// Makes a pipeline for a sensor's rows.
    pub fn new(geometry: Geometry, settings: Settings) -> Self {
        Self {
            geometry,
            settings,
            frame: Frame::default(),
            black: BlackPixels::default(),
            before: None,
            ambient: Counts::default(),
        }
    }

    /// The settings in use.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Changes the settings, and starts the frame under way again.
    pub fn set(&mut self, settings: Settings) {
        self.settings = settings;
        self.start_frame();
    }

    /// Takes the words of a read-out. Where words fall with light, subtracts them from full scale in place.
    /// Returns the measurement, or a fault, when the frame is complete.
    pub fn row(&mut self, words: &mut [u16]) -> Option<Result<Measured, Fault>> {
        let centre = match self.geometry.row(words) {
            Ok(row) => self.centre(&row),
            Err(_) => {
                self.before = None;
                Err(Fault::SensorSilent)
            }
        };
        self.frame.add(centre);
        let rows = self.settings.rows.clamp(1, crate::frame::MAX_ROWS as u16);
        (self.frame.rows() >= rows).then(|| {
            let measured = self.measured();
            self.start_frame();
            measured
        })
    }

    /// Drops the frame under way, because no row came in its time.
    pub fn silence(&mut self) -> Fault {
        self.start_frame();
        Fault::SensorSilent
    }

    fn start_frame(&mut self) {
        self.frame = Frame::default();
        self.black = BlackPixels::default();
        self.before = None;
    }

    /// Finds the centre of a row. The first row of a frame is searched and measured in full; its result saves
    /// most of the work for the next ones.
    fn centre(&mut self, row: &Row<'_>) -> Result<RowCentre, Fault> {
        let before = self.before.take();
        let spot = match &before {
            Some((spot, centre)) => spot::find_again(row, spot, centre.width),
            None => spot::find(row),
        };
        let how = self.settings.black_level;
        let mut black = BlackPixels::default();
        black.add(how, row, spot.ok().map(|spot| spot.background));
        self.black.merge(black);
        let spot = spot?;
        let spot = Spot {
            // A sensor without shielded pixels has only the background's level.
            black_level: black.level(how).unwrap_or(spot.background.level),
            ..spot
        };
        let above_black = spot.above_black(Counts::default()).to_bits();
        self.ambient = Counts::from_bits(above_black.max(0));
        let centre = check::centre(
            self.settings.estimator,
            row,
            &spot,
            before.as_ref().map(|(_, centre)| centre),
            &self.geometry,
        )?;
        self.before = Some((spot, centre));
        if self.settings.estimator != Estimator::Centroid {
            // The other estimators fit or cancel the level under the spot, and measure the height above it.
            return Ok(centre);
        }
        let amplitude = spot.above_black(centre.amplitude);
        if amplitude <= Counts::default() {
            return Err(spot.no_spot());
        }
        Ok(RowCentre {
            amplitude,
            ..centre
        })
    }

    fn measured(&self) -> Result<Measured, Fault> {
        let frame = self.frame.centre(self.settings.mean)?;
        Ok(Measured {
            frame,
            black_level: self
                .black
                .level(self.settings.black_level)
                .unwrap_or_default(),
            ambient: self.ambient,
            estimator: self.settings.estimator,
            pixels: PixelErrors::TCD1304DG,
        })
    }
}
