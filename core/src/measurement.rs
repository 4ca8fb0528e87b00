//! Measures rows: takes the words of rows and gives the centres of frames. The whole pipeline up to the
//! calibration, pure.
//!
//! Words of a read-out -> [`Row`] -> [`Spot`] -> centre of the row -> [`Measured`], the centre of the frame.
//! A [`Calibration`](crate::distance::Calibration) turns that into a distance: [`Measured::reading`].

use core::ops::Range;

use crate::base::{Counts, Exposure, ExposureMode, Fault, Pixels, WorkBudget, numeric};
use crate::centre::tables::LOPSIDED;
use crate::centre::{self, Estimate, Estimator, RowCentre, estimate, estimate_robustly};
use crate::check::own_spot::Profile;
use crate::check::{self, judge, repair};
use crate::frame::comb::{Comb, CombMeasurement, Combined, Slits};
use crate::frame::{Frame, FrameCentre, Mean};
use crate::light::ambient::{AmbientMean, AmbientMode};
use crate::light::auto_exposure::{AutoExposure, Brightness};
use crate::light::black_level::{self, BlackLevel, BlackPixels};
use crate::reading::Measured;
use crate::row::pixels::PixelErrors;
use crate::row::pixels::map::{self, Correction, PixelMap};
use crate::row::{BLOCK, BLOCK_LOG2, Background, Blocks, Geometry, Row};
use crate::spot::choice::SpotChoice;
use crate::spot::region::Region;
use crate::spot::{self, Spot};

/// How rows are measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Options {
    /// The rows of a frame, 1 to [`frame::MAX_ROWS`](crate::frame::MAX_ROWS).
    pub rows: u16,
    /// How the centres of the rows are averaged.
    pub mean: Mean,
    /// For how long the laser is on in a row.
    pub exposure: ExposureMode,
    /// The longest exposure, whatever `exposure` is.
    pub exposure_limit: Exposure,
    /// Whether the laser may be on.
    pub laser: bool,
    /// What is done about ambient light.
    pub ambient: AmbientMode,
    /// How the black level is found.
    pub black_level: BlackLevel,
    /// How the centre of a row is found.
    pub estimator: Estimator,
    /// What is before the sensor.
    pub slits: Slits,
    /// The pixels in which the spot is searched, with one slit.
    pub region: Region,
    /// Which of several spots is measured, with one slit.
    pub peak: SpotChoice,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            rows: 16,
            mean: Mean::Weighted,
            exposure: ExposureMode::Auto,
            exposure_limit: Exposure::LONGEST,
            laser: true,
            ambient: AmbientMode::Off,
            black_level: BlackLevel::Shielded,
            estimator: Estimator::Adaptive,
            slits: Slits::One,
            region: Region::ALL,
            peak: SpotChoice::Strongest,
        }
    }
}

/// The pipeline with the state of the frame that is under way.
#[derive(Clone, Debug)]
pub struct Measurement {
    geometry: Geometry,
    /// The words of the pixels that are searched: those of the option `region`, or of these a part that has
    /// the spot that the option `peak` chooses. Pixel 0 of [`Spot`] and of `before` is the first of them.
    part: Range<usize>,
    options: Options,
    /// Whether the option `peak` has chosen a spot in the frame under way.
    is_chosen: bool,
    profile: Option<Profile>,
    /// The blocks of the row under way. They have their place here because clearing room for them would take
    /// time in each row.
    blocks: Blocks,
    frame: Frame,
    black: BlackPixels,
    comb: CombMeasurement,
    /// The result of the row before, if it is of the same frame and had a centre.
    before: Option<(Spot, RowCentre)>,
    auto_exposure: AutoExposure,
    ambient_mean: AmbientMean,
    /// By how much the background of the row became lower by subtracting the ambient light. `None` if it was
    /// not subtracted.
    subtracted: Option<Counts>,
    /// The largest [`AmbientMean::share`] that was subtracted from a row of the frame. Zero if nothing was
    /// subtracted.
    largest_share: f32,
    /// The exposure of the latest row, if it is known.
    exposure: Option<Exposure>,
    /// The background above the black level, of the latest row of the frame with a spot.
    ambient: Counts,
    /// The background with the black level, of the latest row with a spot.
    background: Counts,
    /// The spot's height above the background, of the latest row with a centre.
    height: Counts,
}

impl Measurement {
    /// Makes a pipeline for a sensor's rows.
    pub fn new(geometry: Geometry, options: Options) -> Self {
        Self {
            part: options.region.part_of(&geometry.light),
            geometry,
            options,
            is_chosen: false,
            profile: None,
            blocks: Blocks::NONE,
            frame: Frame::default(),
            black: BlackPixels::default(),
            comb: CombMeasurement::new(Comb::nominal()),
            before: None,
            auto_exposure: AutoExposure::new(),
            ambient_mean: AmbientMean::EMPTY,
            subtracted: None,
            largest_share: 0.0,
            exposure: None,
            ambient: Counts::default(),
            background: Counts::default(),
            height: Counts::default(),
        }
    }

    /// Changes the slits that rows are measured by if the option is [`Slits::Comb`], and starts the frame
    /// under way again. They are those of [`Comb::nominal`] until then.
    pub fn set_comb(&mut self, comb: Comb) {
        self.comb = CombMeasurement::new(comb);
        self.start_frame();
    }

    /// The geometry in use.
    pub const fn geometry(&self) -> &Geometry {
        &self.geometry
    }

    /// Changes the geometry, as when the front end was measured, and starts the frame under way again.
    /// Another geometry also starts the mean of the ambient light again.
    pub fn set_geometry(&mut self, geometry: Geometry) {
        if geometry != self.geometry {
            self.ambient_mean.clear();
        }
        self.geometry = geometry;
        self.start_frame();
    }

    /// The options in use.
    pub fn options(&self) -> &Options {
        &self.options
    }

    /// Changes the options and the sensor's own spot, and starts the frame under way again. Another
    /// `ambient` or `laser` also starts the mean of the ambient light again: rows of an old mean may be hours
    /// old.
    pub fn set(&mut self, options: Options, profile: Option<Profile>) {
        let of_mean = |options: &Options| (options.ambient, options.laser);
        if of_mean(&options) != of_mean(&self.options) {
            self.ambient_mean.clear();
        }
        self.options = options;
        self.profile = profile;
        self.start_frame();
    }

    /// The exposure to use from now on: that of the option, or the one that auto exposure chooses by the
    /// rows so far.
    pub fn next_exposure(&self) -> Exposure {
        let limit = self.options.exposure_limit;
        match self.options.exposure {
            ExposureMode::Auto => self.auto_exposure.next(limit),
            ExposureMode::Fixed(exposure) => exposure.min(limit),
        }
    }

    /// Takes the words of a read-out that was exposed with the laser off. Their mean is subtracted from the
    /// rows with the laser on if the option is [`AmbientMode::Subtract`]. Until the first of these rows
    /// comes, nothing is subtracted. Words that are no row are left out.
    pub fn ambient_row(&mut self, words: &[u16]) {
        if let Ok(row) =
            self.geometry
                .part_and_blocks(words, &self.geometry.light, &mut self.blocks)
        {
            self.ambient_mean.take(&row);
        }
    }

    /// Takes the words of a read-out. Returns the measurement, or a fault, when the frame is complete.
    pub fn row(&mut self, words: &mut [u16]) -> Option<Result<Measured, Fault>> {
        self.row_with(words, None, None)
    }

    /// As [`Measurement::row`]. Subtracts the ambient light, and corrects the pixels around the spot with a
    /// map, both in place. Ignores the map of a sensor with another number of pixels. All rows of a frame
    /// need the same map.
    ///
    /// `exposure` is the row's own, `None` if it is not known. By it, auto exposure chooses
    /// [`Measurement::next_exposure`]. The rows of a frame may have different exposures.
    pub fn row_with(
        &mut self,
        words: &mut [u16],
        exposure: Option<Exposure>,
        map: Option<&PixelMap>,
    ) -> Option<Result<Measured, Fault>> {
        let map = map.filter(|map| map.fits(&self.geometry));
        if exposure != self.exposure {
            // The spot has another height now, so the row is searched in full.
            self.before = None;
            self.exposure = exposure;
        }
        self.subtracted = match self.options.ambient {
            AmbientMode::Off => None,
            AmbientMode::Subtract => self.subtract(words),
        };
        match self.options.slits {
            // The two kinds of result do not meet: they would be copied.
            _ if !self.options.laser => self.frame.add(Err(Fault::LaserOff)),
            Slits::One => {
                let centre = self.centre_of_part(words, map);
                self.follow_light(&centre);
                let centre = self.on_sensor(centre);
                self.frame.add_exposed(centre, exposure);
            }
            Slits::Comb => self.add_row_of_comb(words, map),
        }
        let most = numeric::to_u16(crate::frame::MAX_ROWS as usize);
        let rows = self.options.rows.clamp(1, most);
        if self.frame.rows() < rows {
            return None;
        }
        let measured = self.measured(map);
        self.start_frame();
        Some(measured)
    }

    /// Measures one row by itself, as a frame of one row. The frame under way starts again.
    pub fn measure_alone(
        &mut self,
        words: &mut [u16],
        exposure: Option<Exposure>,
        map: Option<&PixelMap>,
    ) -> Result<Measured, Fault> {
        let rows = core::mem::replace(&mut self.options.rows, 1);
        self.start_frame();
        let measured = self.row_with(words, exposure, map);
        self.options.rows = rows;
        // A frame of one row is complete with it.
        measured.unwrap_or(Err(Fault::SensorSilent))
    }

    /// Drops the frame under way, because no row came in its time.
    pub fn silence(&mut self) -> Fault {
        self.start_frame();
        Fault::SensorSilent
    }

    /// Starts the frame under way again.
    pub fn start_frame(&mut self) {
        self.frame.clear();
        self.black = BlackPixels::default();
        self.comb.start_frame();
        self.before = None;
        self.largest_share = 0.0;
        self.is_chosen = false;
        self.part = self.options.region.part_of(&self.geometry.light);
    }

    /// Makes a place of the part that was searched a place on the sensor.
    #[inline(always)]
    fn on_sensor(&self, centre: Result<RowCentre, Fault>) -> Result<RowCentre, Fault> {
        let first = i32::from(self.geometry.first_of(&self.part));
        match centre {
            Ok(found) => Ok(RowCentre {
                centre: found.centre.moved_by(first),
                ..found
            }),
            Err(fault) => Err(self.with_exposure(fault.moved_by(first))),
        }
    }

    /// Narrows the part that is searched to the spot that the option `peak` chooses.
    #[cold]
    #[inline(never)]
    fn choose_spot(&mut self, words: &[u16]) {
        let row = self.geometry.part_of_valid(words, &self.part);
        let part = row.and_then(|row| self.options.peak.part_with_spot(&row, &self.part));
        self.is_chosen = part.is_some();
        if let Some(part) = part {
            self.part = part;
        }
    }

    /// Finds the centre in the part that is searched. The first row of a frame is searched and measured in
    /// full; its result saves most of the work for the next ones.
    #[inline(always)]
    fn centre_of_part(
        &mut self,
        words: &mut [u16],
        map: Option<&PixelMap>,
    ) -> Result<RowCentre, Fault> {
        let before = self.before.take();
        if self.options.peak != SpotChoice::Strongest && !self.is_chosen {
            self.choose_spot(words);
        }
        let (geometry, part) = (&self.geometry, &self.part);
        let Ok(row) = geometry.part_and_blocks(words, part, &mut self.blocks) else {
            self.blocks.clear();
            return Err(Fault::SensorSilent);
        };
        let blocks = row.blocks();
        let found = match &before {
            Some((spot, centre)) => spot::find_again_in(&row, blocks, spot, centre.width),
            None => spot::find_in(&row, blocks),
        };
        let how = self.options.black_level;
        let mut black = BlackPixels::default();
        black.add(how, &row, found.ok().map(|(spot, _)| spot.background));
        self.black.merge(black);
        let (found, budget) = found?;
        let spot = Spot {
            // A sensor without shielded pixels has only the background's level.
            black_level: black.level(how).unwrap_or(found.background.level),
            ..found
        };
        let (row, spot) = match map {
            None => (row, spot),
            Some(map) => {
                let black = black_level::of_shielded(&row).unwrap_or(spot.background.level);
                let width = before.as_ref().map(|(_, centre)| centre.width);
                let window = map::window(spot.centre, spot.block_log2, width);
                let first = usize::from(self.geometry.first_of(&self.part));
                let window = window.start.saturating_add(first)..window.end.saturating_add(first);
                self.correct(words, map, window, black);
                let background = self.background_with(map, spot.background);
                let spot = Spot { background, ..spot };
                // The words were a row before the correction.
                let row = geometry.part_of_valid(words, part);
                (row.ok_or(Fault::SensorSilent)?, spot)
            }
        };
        self.background = spot.background.level;
        let above_black = spot.above_black(Counts::default()).to_bits();
        self.ambient = Counts::from_bits(above_black.max(0));
        let centre = centre_of_spot(
            self.options.estimator,
            &row,
            &spot,
            before.as_ref().map(|(_, centre)| centre),
            geometry,
            self.profile.as_ref(),
            budget,
        )?;
        self.before = Some((found, centre));
        self.height = centre.amplitude;
        centre::above_black(self.options.estimator, &spot, centre)
    }

    /// Finds the centre that a slit on the axis would show, from all images of a comb.
    fn centre_of_comb(
        &mut self,
        words: &mut [u16],
        map: Option<&PixelMap>,
    ) -> Result<RowCentre, Fault> {
        let whole = &self.geometry.light;
        let Ok(row) = (self.geometry).part_and_blocks(words, whole, &mut self.blocks) else {
            self.blocks.clear();
            return Err(Fault::SensorSilent);
        };
        let mut found = self.comb.find(&row)?;
        let how = self.options.black_level;
        let mut black = BlackPixels::default();
        match how {
            BlackLevel::Frame => black.add_outside(&row, found.span.clone()),
            BlackLevel::Fixed(_) | BlackLevel::Shielded => black.add(how, &row, None),
        }
        self.black.merge(black);
        let level = found.background.level;
        let black_level = black.level(how).unwrap_or(level);
        let row = match map {
            None => row,
            Some(map) => {
                let black = black_level::of_shielded(&row).unwrap_or(level);
                // Windows overlap, and no pixel is corrected twice.
                let mut done = 0;
                for centre in found.images() {
                    let window = map::window(centre, BLOCK_LOG2, None);
                    let window = window.start.max(done)..window.end.max(done);
                    done = window.end;
                    self.correct(words, map, window, black);
                }
                found.background = self.background_with(map, found.background);
                (self.geometry.row_of_valid(words)).ok_or(Fault::SensorSilent)?
            }
        };
        self.background = level;
        let above_black = level.to_bits().saturating_sub(black_level.to_bits());
        self.ambient = Counts::from_bits(above_black.max(0));
        let estimator = self.options.estimator;
        let geometry = &self.geometry;
        // All images of a row share its budget.
        let mut budget = WorkBudget::of_row();
        (self.comb).measure(&found, black_level, estimator, |spot, before| {
            centre_of_image(estimator, &row, spot, before, geometry, &mut budget)
        })
    }

    #[inline(never)]
    fn add_row_of_comb(&mut self, words: &mut [u16], map: Option<&PixelMap>) {
        let centre = self.centre_of_comb(words, map);
        self.follow_light(&centre);
        let centre = centre.map_err(|fault| self.with_exposure(fault));
        self.frame.add_exposed(centre, self.exposure);
    }

    #[inline]
    fn follow_light(&mut self, centre: &Result<RowCentre, Fault>) {
        if let (ExposureMode::Auto, Some(exposure)) = (self.options.exposure, self.exposure) {
            let brightness = self.brightness(centre);
            let limit = self.options.exposure_limit;
            self.auto_exposure.follow_row(exposure, brightness, limit);
        }
    }

    fn brightness(&self, centre: &Result<RowCentre, Fault>) -> Brightness {
        // The sensor saturates by the light that it saw.
        let subtracted = self.subtracted.unwrap_or_default().to_bits();
        let background = self.background.to_bits().saturating_add(subtracted);
        let room = (self.geometry).height_limit(Counts::from_bits(background));
        match centre {
            Ok(_) => {
                let height = match self.options.slits {
                    Slits::One => self.height,
                    // The centre's height is the mean of all images.
                    Slits::Comb => self.highest_block(),
                };
                Brightness::of_spot(height, room)
            }
            Err(fault) => {
                let highest = self.highest_block();
                Brightness::of_fault(fault, self.saturated_pixels(), highest, room)
            }
        }
    }

    /// The height of the brightest block above the background: that of a comb's brightest image, less 4 % for
    /// a sigma of 8 pixels.
    #[inline(never)]
    fn highest_block(&self) -> Counts {
        let most = self.blocks.sums().iter().max().copied().unwrap_or_default();
        // At most 2^16 * 2^8 / 8.
        let mean = i32::from(most) * (1 << Counts::FRACTION) / numeric::to_i32(BLOCK);
        Counts::from_bits(mean.saturating_sub(self.background.to_bits()))
    }

    /// The pixels in blocks that are saturated as a whole.
    #[inline(never)]
    fn saturated_pixels(&self) -> u16 {
        let full = u32::from(self.geometry.saturated_from()) * numeric::to_u32(BLOCK);
        let sums = self.blocks.sums().iter();
        let blocks = numeric::count(sums.map(|&sum| u32::from(sum) >= full));
        // At most 512 blocks.
        numeric::to_u16(blocks).saturating_mul(numeric::to_u16(BLOCK))
    }

    /// The fault of a row, with what auto exposure knows of it.
    fn with_exposure(&self, fault: Fault) -> Fault {
        let (ExposureMode::Auto, Some(exposure)) = (self.options.exposure, self.exposure) else {
            return fault;
        };
        let is_longest = exposure >= self.options.exposure_limit;
        match fault {
            Fault::TooDim { amplitude, .. } if is_longest => Fault::DimAtLongest {
                amplitude,
                exposure,
            },
            Fault::Saturated { pixels } if exposure == Exposure::SHORTEST => {
                Fault::SaturatedAtShortest { pixels, exposure }
            }
            fault => fault,
        }
    }

    /// Corrects some pixels of the light range, in place.
    // Not inlined: sensors without a map do not pay for it.
    #[inline(never)]
    fn correct(&self, words: &mut [u16], map: &PixelMap, window: Range<usize>, black: Counts) {
        let geometry = &self.geometry;
        let words = words.get_mut(geometry.light.clone()).unwrap_or_default();
        let correction = match self.subtracted {
            None => Correction::OffsetAndGain,
            Some(_) => Correction::Gain,
        };
        map.correct(words, window, black, geometry, correction);
    }

    fn background_with(&self, map: &PixelMap, background: Background) -> Background {
        match self.subtracted {
            None => map.background_of(background),
            Some(_) => background,
        }
    }

    /// The uncertainty of a frame's centre, with the noise of the mean ambient light. The rows of a frame
    /// share this noise, so averaging rows does not lower it.
    ///
    /// The result is an upper limit, for two reasons. The uncertainty of the rows contains the noise of the
    /// spot's light, which the mean does not have. And the mean had its largest share in one row of the
    /// frame, while its share was smaller in the other rows.
    fn with_noise_of_mean(&self, uncertainty: Pixels, rows: u16) -> Pixels {
        if self.largest_share == 0.0 {
            return uncertainty;
        }
        let growth = dual_mac::square_root(1.0 + self.largest_share * f32::from(rows));
        Pixels::from_f32(uncertainty.to_f32() * growth)
    }

    /// Subtracts the ambient light of a row's words, and says by how much they became lower.
    #[inline(never)]
    fn subtract(&mut self, words: &mut [u16]) -> Option<Counts> {
        let subtracted = self.ambient_mean.subtract(words, &self.geometry)?;
        let share = self.ambient_mean.share().unwrap_or_default();
        self.largest_share = numeric::at_least(share, self.largest_share);
        Some(subtracted)
    }

    // Not inlined: its floats would make each row save the FPU's registers.
    #[inline(never)]
    fn measured(&self, map: Option<&PixelMap>) -> Result<Measured, Fault> {
        let frame = self.frame.centre(self.options.mean)?;
        let comb = match self.options.slits {
            Slits::One => None,
            Slits::Comb => Some(self.comb.scatter.combine()?),
        };
        let shift = comb.map_or(0, |comb: Combined| comb.shift.to_bits());
        let centre = Pixels::from_bits(frame.centre.to_bits().saturating_add(shift));
        let uncertainty = self.with_noise_of_mean(frame.uncertainty, frame.rows_used);
        let frame = FrameCentre {
            centre,
            uncertainty,
            ..frame
        };
        let own = (self.profile.as_ref()).map(|profile| profile.at(frame.centre));
        Ok(Measured {
            frame,
            black_level: (self.black.level(self.options.black_level)).unwrap_or_default(),
            ambient: self.ambient,
            estimator: self.options.estimator,
            by_shape: (self.options.estimator).by_shape(&frame.shape, own.as_ref()),
            pixels: map.map_or(PixelErrors::TCD1304DG, PixelMap::errors),
            comb,
        })
    }
}

/// Finds the centre of a spot.
///
/// If the row fails the check about the estimate, the repair masks samples and fits the rest. Its centre
/// replaces the first one if the row, without those samples, passes the check about it. Otherwise the first
/// one stays, because in speckle the robust fit is worse than a plain one.
///
/// `before` is the centre in the row before of the same frame.
///
/// # Errors
/// Those of [`estimate`].
#[inline(always)]
pub fn centre_of_spot(
    estimator: Estimator,
    row: &Row<'_>,
    spot: &Spot,
    before: Option<&RowCentre>,
    geometry: &Geometry,
    profile: Option<&Profile>,
    mut budget: WorkBudget,
) -> Result<RowCentre, Fault> {
    let budget = &mut budget;
    let estimate = estimate(estimator, row, spot, before, geometry, budget)?;
    let verdict = judge(&estimate, row, spot, geometry, profile, budget);
    let mut found = verdict.of(estimator, &estimate.found);
    if verdict.may_be_repaired && estimator != Estimator::GaussNewton {
        let row = estimate.row(row);
        // The repair starts from the estimator's height: where the check failed, its own may be a flaw's.
        let start = RowCentre {
            amplitude: estimate.found.amplitude,
            ..found
        };
        let repaired = repair(
            estimator, row, spot, before, geometry, profile, &start, budget,
        );
        found = repaired.unwrap_or(found);
    }
    Ok(RowCentre {
        misfit: found.misfit || check::may_be_bad_pixels(&found),
        ..found
    })
}

/// Finds the centre of one of several images on a row. There is no repair: an image that fails the check has
/// a flag, and the others take its place. Fits of flat tops are at most as many as there are images, so they
/// take nothing from the budget. An image at the sensor's edge has no centre.
///
/// # Errors
/// See [`centre::centre`]; [`Fault::Saturated`] also where the spot's top is flat.
#[inline(never)]
pub fn centre_of_image(
    estimator: Estimator,
    row: &Row<'_>,
    spot: &Spot,
    before: Option<&RowCentre>,
    geometry: &Geometry,
    budget: &mut WorkBudget,
) -> Result<RowCentre, Fault> {
    let found = centre::centre(estimator, row, spot, before, geometry)?;
    let estimate = Estimate::of(estimator, found, false, row, spot, geometry, budget)?;
    let verdict = judge(&estimate, row, spot, geometry, None, budget);
    let found = verdict.of(estimator, &estimate.found);
    Ok(RowCentre {
        misfit: found.misfit || check::may_be_bad_pixels(&found),
        ..found
    })
}

/// Finds the centre of a spot by the robust estimate and its repair, whatever the estimator.
///
/// # Errors
/// Those of [`estimate_robustly`].
pub fn robust_centre(
    row: &Row<'_>,
    spot: &Spot,
    before: Option<&RowCentre>,
    geometry: &Geometry,
    profile: Option<&Profile>,
    budget: &mut WorkBudget,
) -> Result<RowCentre, Fault> {
    let estimate = estimate_robustly(row, spot, before, geometry, budget)?;
    let row = estimate.row(row);
    let check::Verdict {
        shape,
        is_clean,
        may_be_repaired,
        ..
    } = check::by_symmetry(row, spot, &estimate.found, geometry, profile);
    let repaired = match may_be_repaired {
        true => repair::repair(row, spot, geometry, profile, &estimate.found, budget),
        false => None,
    };
    Ok(repaired.unwrap_or(RowCentre {
        shape,
        misfit: !is_clean,
        ..estimate.found
    }))
}

/// The repaired centre, if the row is symmetric about it. The table class stays that of the estimator, but
/// for the weights of a lopsided spot.
#[cold]
#[inline(never)]
#[expect(
    clippy::too_many_arguments,
    reason = "a step's inputs, each of its own"
)]
fn repair(
    estimator: Estimator,
    row: &Row<'_>,
    spot: &Spot,
    before: Option<&RowCentre>,
    geometry: &Geometry,
    profile: Option<&Profile>,
    found: &RowCentre,
    budget: &mut WorkBudget,
) -> Option<RowCentre> {
    let repaired = match estimator {
        // Its centre is the one from which a repair starts, and has failed the check.
        Estimator::Adaptive => repair::repair(row, spot, geometry, profile, found, budget),
        _ => robust_centre(row, spot, before, geometry, profile, budget).ok(),
    };
    let other = repaired?;
    let counts = !other.misfit || other.width < repair::NARROWEST_SURE_REFIT;
    counts.then_some(RowCentre {
        // What made the spot lopsided is repaired.
        class: match found.class.set == LOPSIDED.number {
            true => centre::WidthClass::default(),
            false => found.class,
        },
        ..other
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::{gaussian, hash, row, tcd1304dg};

    /// A spot of 60 pixels, in the row's middle or cut by its end. The budget is used up before its estimate.
    #[test]
    fn without_budget_a_wide_spot_has_a_flag_and_a_cut_spot_a_fault() {
        for (centre, is_cut) in [(900.0f32, false), (20.0, true)] {
            let light: [u16; 2000] = core::array::from_fn(|i| {
                let spot = (300.0 + 2000.0 * gaussian(i, centre, 60.0)) as u16;
                spot + (hash(i) >> 30) as u16
            });
            let row = row(&light);
            let (spot, budget) = crate::spot::find(&row).expect("a spot");
            let measure = |budget| {
                let estimator = Estimator::PhaseTable;
                centre_of_spot(estimator, &row, &spot, None, &tcd1304dg(), None, budget)
            };
            let found = measure(budget).expect("a centre");
            assert!((found.centre.to_f32() - centre).abs() < 1.0, "{found:?}");
            assert!(!found.misfit, "{found:?}");
            let mut nothing = budget;
            assert_eq!(nothing.pay(budget.left()), Some(()));
            match measure(nothing) {
                Err(Fault::SpotAtEdge { .. }) if is_cut => {}
                Ok(found) if !is_cut => assert!(found.misfit),
                found => panic!("{found:?}"),
            }
        }
    }
}
