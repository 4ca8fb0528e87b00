//! The memory through which rows and answers go: a test writes and reads it while the program waits.

use core::sync::atomic::{AtomicU32, Ordering};

use slitrange::row::MAX_PIXELS;

use crate::answers::Estimators;

/// Words of the rows: each as two words of its [`Header`] and a word for two pixels; and a word of 0 after
/// the last one. [`Estimators`] and the stack need the memory that is left.
pub const ROWS: usize = 8 * 1024;

/// Words of the answers, one after the other, the first being how many there are.
pub const ANSWERS: usize = 8 * 1024;

/// What a row is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Header {
    /// Pixels that see light, 1 to [`MAX_PIXELS`].
    pub pixels: u16,
    /// Bits of the converter.
    pub bits: u8,
    /// Whether nothing is known of the row before.
    pub first: bool,
    /// As [`slitrange::row::Geometry`] has it.
    pub shot_variance_per_count_q16: u16,
}

impl Header {
    /// As two words.
    pub fn to_words(self) -> [u32; 2] {
        let [low, high] = self.pixels.to_le_bytes();
        [
            u32::from_le_bytes([low, high, self.bits, u8::from(self.first)]),
            u32::from(self.shot_variance_per_count_q16),
        ]
    }

    /// From two words.
    pub fn from_words([first, second]: [u32; 2]) -> Self {
        let [low, high, bits, is_first] = first.to_le_bytes();
        Self {
            pixels: u16::from_le_bytes([low, high]),
            bits,
            first: is_first != 0,
            shot_variance_per_count_q16: second as u16,
        }
    }
}

/// A row as words.
pub fn words(header: Header, light: &[u16]) -> impl Iterator<Item = u32> {
    let pixels = light.chunks(2).map(|two| {
        let [low, high] =
            [two.first(), two.get(1)].map(|pixel| u32::from(pixel.copied().unwrap_or_default()));
        low | high << 16
    });
    header.to_words().into_iter().chain(pixels)
}

/// Answers all rows.
pub fn answer(estimators: &mut Estimators, rows: &[AtomicU32], answers: &[AtomicU32]) {
    let mut words = rows.iter().map(|word| word.load(Ordering::Relaxed));
    let mut said = 0;
    let mut say = |_, word| {
        said += 1;
        if let Some(place) = answers.get(said) {
            place.store(word, Ordering::Relaxed);
        }
    };
    let mut buffer = [0u16; MAX_PIXELS];
    while let (Some(first @ 1..), Some(second)) = (words.next(), words.next()) {
        let header = Header::from_words([first, second]);
        let Some(light) = buffer.get_mut(..usize::from(header.pixels)) else {
            break;
        };
        for pixels in light.chunks_mut(2) {
            let word = words.next().unwrap_or_default();
            for (pixel, half) in pixels.iter_mut().zip([word, word >> 16]) {
                *pixel = half as u16;
            }
        }
        if header.first {
            estimators.start(light.len(), header.bits, header.shot_variance_per_count_q16);
        }
        estimators.ask(light, &mut say);
    }
    if let Some(count) = answers.first() {
        count.store(said as u32, Ordering::Relaxed);
    }
}
