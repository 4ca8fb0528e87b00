//! Rows in, readings out: the whole pipeline, pure.
//!
//! Words of a read-out -> [`Row`] -> [`Spot`] -> centre of the row -> centre of the frame -> distance.

use crate::black_level::{BlackLevel, BlackPixels};
use crate::calibration::Calibration;
use crate::estimator::{Estimator, RowCentre, second_look};
use crate::frame::{Frame, Mean};
use crate::reading::{Fault, Reading};
use crate::row::{Geometry, Row};
use crate::spot::{self, Spot};
use crate::units::Micrometres;

/// What a person can set.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Settings {
    /// Rows in a frame, 1 to [`MAX_ROWS`](crate::frame::MAX_ROWS); less counts as 1, more as that.
    pub rows: u16,
    /// How they become one.
    pub mean: Mean,
    /// How the centre of a row is found.
    pub estimator: Estimator,
    /// How the black level is found.
    pub black_level: BlackLevel,
    /// From the centre to the distance, where the sensor is calibrated.
    pub calibration: Option<Calibration>,
}

/// The pipeline with the state of the frame that is under way.
#[derive(Clone, Debug)]
pub struct Measurement {
    geometry: Geometry,
    settings: Settings,
    frame: Frame,
    black: BlackPixels,
    /// The row before, where it is of the same frame and had a centre.
    before: Option<(Spot, RowCentre)>,
}

impl Measurement {
    /// A pipeline for a sensor's rows.
    pub fn new(geometry: Geometry, settings: Settings) -> Self {
        Self {
            geometry,
            settings,
            frame: Frame::default(),
            black: BlackPixels::default(),
            before: None,
        }
    }

    /// The settings in use.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Takes other settings; the frame under way starts again.
    pub fn set(&mut self, settings: Settings) {
        self.settings = settings;
        self.start_frame();
    }

    /// Takes the words of a read-out (and turns them over in place, where the sensor's fall with light).
    /// Gives a reading or a fault when the frame is complete.
    pub fn row(&mut self, words: &mut [u16]) -> Option<Result<Reading, Fault>> {
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
            let reading = self.reading();
            self.start_frame();
            reading
        })
    }

    /// No row came in its time: the frame under way is dropped.
    pub fn silence(&mut self) -> Fault {
        self.start_frame();
        Fault::SensorSilent
    }

    fn start_frame(&mut self) {
        self.frame = Frame::default();
        self.black = BlackPixels::default();
        self.before = None;
    }

    /// The first row of a frame is searched and measured in full; what it says spares the next ones most of the work.
    fn centre(&mut self, row: &Row<'_>) -> Result<RowCentre, Fault> {
        let before = self.before.take();
        let spot = match &before {
            Some((spot, centre)) => spot::find_again(row, spot, centre.width),
            None => spot::find(row),
        };
        self.black.add(
            self.settings.black_level,
            row,
            spot.ok().map(|spot| spot.background),
        );
        let spot = spot?;
        let centre = second_look::centre(
            self.settings.estimator,
            row,
            &spot,
            before.as_ref().map(|(_, centre)| centre),
            &self.geometry,
        )?;
        self.before = Some((spot, centre));
        Ok(centre)
    }

    fn reading(&self) -> Result<Reading, Fault> {
        let frame = self.frame.centre(self.settings.mean)?;
        let Some(calibration) = &self.settings.calibration else {
            return Err(Fault::NotCalibrated {
                centre: frame.centre,
                uncertainty: frame.uncertainty,
            });
        };
        let (distance, slope) = calibration.distance_at(frame.centre)?;
        Ok(Reading {
            distance,
            // Never zero: the finest step stands for less.
            uncertainty: Micrometres::from_f32(frame.uncertainty.to_f32() * slope.abs())
                .max(Micrometres::from_bits(1)),
            centre: frame.centre,
            centre_uncertainty: frame.uncertainty,
            amplitude: frame.amplitude,
            width: frame.width,
            rows_used: frame.rows_used,
            rows: frame.rows,
            black_level: self.black.level(self.settings.black_level),
            estimator: self.settings.estimator,
            misfits: frame.misfits,
            correlated: frame.correlated,
        })
    }
}
