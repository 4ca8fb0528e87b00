//! Measures the images of a comb on a row.

use core::ops::Range;

use heapless::Vec;

use crate::base::{Counts, Fault, Pixels, numeric};
use crate::centre::{self, Estimator, RowCentre};
use crate::frame::comb::combination::Image;
use crate::frame::comb::maxima::{self, Maxima};
use crate::frame::comb::{Assignment, Comb, FEWEST, MAX_SLITS, Scatter, assign, background};
use crate::row::{BLOCK_LOG2, Background, Row};
use crate::spot::Spot;

/// An image reaches so many pixels to both sides of its peak: half of the way to the next one.
const REACH: usize = 56;

/// Measures rows of a comb: what it keeps from row to row of a frame.
#[derive(Clone, Debug)]
pub(crate) struct CombMeasurement {
    comb: Comb,
    pub scatter: Scatter,
    /// Each slit's image in the row before.
    before: [Option<RowCentre>; MAX_SLITS],
}

/// What was found on a row before its images are measured.
#[derive(Clone, Debug)]
pub(crate) struct CombRow {
    peaks: Maxima,
    assignment: Assignment,
    /// The pixels from the first slit's image to the last one's.
    pub span: Range<usize>,
    /// Level and noise of the row away from the images.
    pub background: Background,
}

impl CombRow {
    /// The rough places of the images, in pixels.
    pub fn images(&self) -> impl Iterator<Item = usize> + '_ {
        let peaks = self.assignment.peaks.iter().flatten();
        let peaks = peaks.filter_map(|&peak| self.peaks.get(peak));
        peaks.map(|peak| numeric::whole_usize(peak.place + 0.5))
    }

    /// The candidate at the rough place of an image.
    pub fn spot(&self, centre: usize) -> Spot {
        Spot {
            centre,
            block_log2: BLOCK_LOG2,
            height: Counts::default(),
            background: self.background,
            black_level: self.background.level,
        }
    }
}

impl CombMeasurement {
    pub fn new(comb: Comb) -> Self {
        Self {
            comb,
            scatter: Scatter::default(),
            before: [None; MAX_SLITS],
        }
    }

    /// Starts the frame under way again.
    pub fn start_frame(&mut self) {
        self.scatter.clear();
        self.before = [None; MAX_SLITS];
    }

    /// Finds the images on a row, and tells which slit each belongs to.
    ///
    /// # Errors
    /// [`Fault::NoSpot`] if nothing stands out of the noise, or those of [`assign`].
    #[inline(never)]
    pub fn find(&self, row: &Row<'_>) -> Result<CombRow, Fault> {
        let nothing = Fault::NoSpot {
            amplitude: Counts::default(),
        };
        let light = row.light();
        // The images' steps make this noise too large, and only bright images have such steps.
        let whole = background(light, row.blocks(), 0..0).ok_or(nothing)?;
        let mut found = Maxima::new();
        maxima::find(row.blocks(), whole, &mut found);
        if found.is_empty() {
            return Err(nothing);
        }
        let assignment = assign(&found, &self.comb)?;
        let span = self.span(&assignment);
        let background = background(light, row.blocks(), span.clone()).ok_or(nothing)?;
        Ok(CombRow {
            peaks: found,
            assignment,
            span,
            background,
        })
    }

    fn span(&self, assignment: &Assignment) -> Range<usize> {
        let places = || {
            let slits = self.comb.slits().iter();
            slits.map(|slit| numeric::whole_usize(slit.from_axis(assignment.x0).to_f32()))
        };
        let first = places().min().unwrap_or(0);
        let last = places().max().unwrap_or(0);
        first.saturating_sub(REACH)..last.saturating_add(REACH)
    }

    /// Measures a row's images by `centre_of`, and combines them to the centre of a slit on the axis.
    /// `centre_of` gets an image and the same slit's image in the row before.
    ///
    /// Images that fail the check are left out. If more than half of them fail, or fewer than [`FEWEST`] are
    /// left, all of them count, and the row is flagged.
    ///
    /// # Errors
    /// If fewer than [`FEWEST`] images have a centre: the fault of the highest image that has none, or
    /// [`Fault::FewSlits`].
    #[inline(never)]
    pub fn measure(
        &mut self,
        on_row: &CombRow,
        black_level: Counts,
        estimator: Estimator,
        mut centre_of: impl FnMut(&Spot, Option<&RowCentre>) -> Result<RowCentre, Fault>,
    ) -> Result<RowCentre, Fault> {
        let origin = on_row.assignment.x0;
        let mut images: Vec<Image, MAX_SLITS> = Vec::new();
        let mut fault = (Counts::MIN, None);
        let slits = self.comb.slits().iter().zip(&on_row.assignment.peaks);
        for ((number, before), (slit, peak)) in (0..MAX_SLITS).zip(&mut self.before).zip(slits) {
            let Some(peak) = peak.and_then(|peak| on_row.peaks.get(peak)) else {
                *before = None;
                continue;
            };
            let spot = Spot {
                height: peak.height,
                black_level,
                ..on_row.spot(numeric::whole_usize(peak.place + 0.5))
            };
            let result = centre_of(&spot, before.as_ref());
            *before = result.ok();
            match result.and_then(|found| centre::above_black(estimator, &spot, found)) {
                Ok(found) => {
                    let x0 = slit.to_axis(found.centre);
                    let off = x0.to_bits().saturating_sub(origin.to_bits());
                    // There is room for all slits.
                    let _ = images.push(Image {
                        slit: number,
                        found,
                        off: Pixels::from_bits(off).to_f32(),
                        noise: found.uncertainty.to_f32() / slit.growth(),
                    });
                }
                Err(of_image) if peak.height > fault.0 => fault = (peak.height, Some(of_image)),
                Err(_) => {}
            }
        }
        if images.len() < FEWEST
            && let Some(fault) = fault.1
        {
            return Err(fault);
        }
        let misfits = numeric::count(images.iter().map(|image| image.found.misfit));
        let sound = images.len().saturating_sub(misfits);
        let uses_misfits = sound < FEWEST || misfits > sound;
        let mut used: Vec<Image, MAX_SLITS> = Vec::new();
        for image in &images {
            if uses_misfits || !image.found.misfit {
                // There is room for all of them.
                let _ = used.push(*image);
            }
        }
        let images = used;
        let (mean, noise) = self.scatter.add(&images)?;
        let count = images.len().max(1) as f32;
        let share = |value: fn(&RowCentre) -> f32| {
            images.iter().map(|image| value(&image.found)).sum::<f32>() / count
        };
        let mean = Pixels::from_f32(mean).to_bits();
        Ok(RowCentre {
            centre: Pixels::from_bits(origin.to_bits().saturating_add(mean)),
            uncertainty: Pixels::from_f32(noise),
            amplitude: Counts::from_f32(share(|it| it.amplitude.to_f32())),
            width: Pixels::from_f32(share(|it| it.width.to_f32())),
            misfit: uses_misfits && misfits > 0,
            // No shape: the scatter of the slits holds what the shape of an image does to its centre.
            ..RowCentre::default()
        })
    }
}
