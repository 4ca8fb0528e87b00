//! Rows in, centres of frames out: the whole pipeline up to the calibration, pure.
//!
//! Words of a read-out -> [`Row`] -> [`Spot`] -> centre of the row -> [`Measured`], the centre of the frame. What that means is a
//! [`Calibration`](crate::distance::Calibration)'s to say: [`Measured::reading`].

use crate::black_level::BlackPixels;
use crate::centre::RowCentre;
use crate::check;
use crate::fault::Fault;
use crate::frame::Frame;
use crate::reading::Measured;
use crate::row::{Geometry, Row};
pub use crate::settings::Settings;
use crate::spot::{self, Spot};

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
    /// Gives what was measured, or a fault, when the frame is complete.
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
        let centre = check::centre(
            self.settings.estimator,
            row,
            &spot,
            before.as_ref().map(|(_, centre)| centre),
            &self.geometry,
        )?;
        self.before = Some((spot, centre));
        Ok(centre)
    }

    fn measured(&self) -> Result<Measured, Fault> {
        let frame = self.frame.centre(self.settings.mean)?;
        Ok(Measured {
            frame,
            black_level: self.black.level(self.settings.black_level),
            estimator: self.settings.estimator,
        })
    }
}
