//! Text of a bounded length. Writing it cannot panic, while `heapless::String` has a panic that the compiler
//! cannot exclude.

use core::fmt;

/// Up to `N` bytes of text. What does not fit is cut off, and writing it is an error.
#[derive(Clone, Debug)]
pub struct Text<const N: usize> {
    bytes: [u8; N],
    length: usize,
}

impl<const N: usize> Default for Text<N> {
    fn default() -> Self {
        Self {
            bytes: [0; N],
            length: 0,
        }
    }
}

impl<const N: usize> Text<N> {
    /// The text so far. Empty where a character was cut in two; the core writes ASCII.
    pub fn as_str(&self) -> &str {
        core::str::from_utf8(self.as_bytes()).unwrap_or_default()
    }

    /// Its bytes.
    pub fn as_bytes(&self) -> &[u8] {
        self.bytes.get(..self.length).unwrap_or_default()
    }

    /// Empties it.
    pub fn clear(&mut self) {
        self.length = 0;
    }
}

impl<const N: usize> fmt::Write for Text<N> {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        add(&mut self.bytes, &mut self.length, text)
    }

    fn write_char(&mut self, character: char) -> fmt::Result {
        add_character(&mut self.bytes, &mut self.length, character)
    }
}

#[inline(never)]
fn add_character(bytes: &mut [u8], length: &mut usize, character: char) -> fmt::Result {
    add(bytes, length, character.encode_utf8(&mut [0; 4]))
}

/// Not inlined, so that flash does not hold a copy for each `N`.
#[inline(never)]
fn add(bytes: &mut [u8], length: &mut usize, text: &str) -> fmt::Result {
    let most = bytes.len();
    let room = bytes.get_mut(*length..).unwrap_or_default();
    for (place, byte) in room.iter_mut().zip(text.bytes()) {
        *place = byte;
    }
    let fits = text.len() <= room.len();
    *length = length.saturating_add(text.len()).min(most);
    if fits { Ok(()) } else { Err(fmt::Error) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::fmt::Write as _;

    #[test]
    fn text_is_cut_off_where_it_does_not_fit() {
        let mut text = Text::<5>::default();
        assert_eq!(write!(text, "ab{}", 3), Ok(()));
        assert_eq!(text.as_str(), "ab3");
        assert!(write!(text, "cdef").is_err());
        assert_eq!(text.as_bytes(), b"ab3cd");
        text.clear();
        assert_eq!(text.as_str(), "");
    }
}
