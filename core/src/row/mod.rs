//! A row: one read-out of the sensor, in counts.

pub mod background;
mod blocks;
pub mod front_end;
mod geometry;
mod light_pixels;
pub mod pixels;
pub mod sensor_heads;

use core::ops::Range;

use crate::base::Pixels;

pub(crate) use background::Background;
pub(crate) use blocks::{BLOCK, BLOCK_LOG2, Blocks};
pub use geometry::{Geometry, Polarity, RowError};
pub use light_pixels::{Extremes, Light};

/// The largest count of a row: that of a 12-bit converter. The arithmetic of the core is proven for counts up
/// to this.
pub const LARGEST_COUNT: u16 = 4095;
/// The most pixels in the light range of a row, and the most in its shielded range.
pub const MAX_PIXELS: usize = 4096;

/// One read-out of the sensor, light positive: at most [`MAX_PIXELS`] counts of at most [`LARGEST_COUNT`].
#[derive(Clone, Copy, Debug)]
pub struct Row<'a> {
    light: Light<'a>,
    /// The sums over the light pixels' blocks. Empty where nobody summed them.
    blocks: &'a [u16],
    shielded: Light<'a>,
    saturation: u16,
    /// The sensor's pixel that is pixel 0 of `light`, if this is a part of a row.
    first: u16,
}

impl<'a> Row<'a> {
    /// Makes a row from its parts, light positive. A pixel of the count `saturation` or more is saturated:
    /// see [`Geometry::saturated_from`]. [`Geometry::row`] makes a row from a sensor's words.
    ///
    /// # Errors
    /// A count is above [`LARGEST_COUNT`], or there are more than [`MAX_PIXELS`].
    pub fn new(light: &'a [u16], shielded: &'a [u16], saturation: u16) -> Result<Self, RowError> {
        if light.len() > MAX_PIXELS || shielded.len() > MAX_PIXELS {
            return Err(RowError::Length {
                words: light.len().max(shielded.len()),
            });
        }
        let bits = (light.iter().chain(shielded)).fold(0, |bits, &count| bits | count);
        if bits > LARGEST_COUNT {
            return Err(RowError::Impossible { bits });
        }
        Ok(Self {
            light: light.into(),
            blocks: &[],
            shielded: shielded.into(),
            saturation,
            first: 0,
        })
    }

    /// As this row, with another count from which a pixel is saturated.
    pub const fn with_saturation(self, saturation: u16) -> Self {
        Self { saturation, ..self }
    }

    /// The least count of a saturated pixel.
    #[inline]
    pub const fn saturated_from(&self) -> u16 {
        self.saturation
    }

    /// Whether any of these pixels is saturated. Pixels off the row do not count.
    #[inline]
    pub fn reaches_saturation(&self, pixels: Range<usize>) -> bool {
        let end = pixels.end.min(self.light.len());
        let near = self.light.slice(pixels.start.min(end)..end);
        near.is_some_and(|near| near.extremes(self.saturation).saturated)
    }

    /// The pixels that see light.
    #[inline]
    pub const fn light(&self) -> Light<'a> {
        self.light
    }

    /// The place on the sensor of a place on this row: they differ if this is a part of a row.
    #[inline(always)]
    pub(crate) fn on_sensor(&self, place: Pixels) -> Pixels {
        place.moved_by(self.first.into())
    }

    /// The sums over blocks of 8 of them. Empty where nobody summed them.
    #[inline]
    pub(crate) const fn blocks(&self) -> &'a [u16] {
        self.blocks
    }

    /// The pixels under metal.
    #[inline]
    pub const fn shielded(&self) -> Light<'a> {
        self.shielded
    }
}
