//! What a row is made of, in a few words of memory.

/// The most shapes on a row.
pub const SHAPES: usize = 12;

/// Words of a description.
pub const WORDS: usize = 2 + 3 * SHAPES;

/// A row and the row before it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Description {
    /// The counts of an unlit pixel.
    pub black: u16,
    /// The standard deviation of the noise, in counts of Q8.8.
    pub noise: u16,
    /// Which noise.
    pub seed: u32,
    /// What is on the row, in this order.
    pub shapes: [Shape; SHAPES],
}

/// A part of a row.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Shape {
    /// What it is.
    pub kind: Kind,
    /// The rows that have it: bit 0 is the row before, bit 1 the row itself.
    pub rows: u8,
    /// Where it is, in pixels of Q12.4.
    pub place: u16,
    /// How wide it is, in pixels of Q8.8.
    pub width: u16,
    /// How high it is, in counts.
    pub height: i16,
    /// What else its kind needs.
    pub more: u16,
}

/// What a shape is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(u8)]
pub enum Kind {
    /// Nothing.
    #[default]
    Nothing,
    /// A gaussian of this sigma.
    Spot,
    /// A gaussian of 8 times this sigma.
    WideSpot,
    /// A gaussian of this sigma to the left, and of `more` / 256 times this sigma to the right.
    SkewedSpot,
    /// Two-sided exponential flanks of this length.
    Peak,
    /// So much light in all pixels within a width.
    Block,
    /// One pixel with this count.
    Pixel,
    /// Light that rises from the place on, by the height within 16 widths, and stays.
    Ramp,
    /// `more` / 256 spots of this sigma and height in steps of `more` % 256 + 1 pixels.
    Comb,
    /// Noise that multiplies the light within 8 widths: `more` / 65536 of the light, the same for a width.
    Speckle,
    /// Every other pixel within 16 widths has so many counts more.
    OddPixels,
}

impl Kind {
    /// All kinds.
    pub const ALL: [Self; 11] = [
        Self::Nothing,
        Self::Spot,
        Self::WideSpot,
        Self::SkewedSpot,
        Self::Peak,
        Self::Block,
        Self::Pixel,
        Self::Ramp,
        Self::Comb,
        Self::Speckle,
        Self::OddPixels,
    ];
}

impl Description {
    /// As words, of which [`Self::from_words`] makes the same description.
    pub fn to_words(&self) -> [u32; WORDS] {
        let two = |low: u16, high: u16| u32::from(low) | u32::from(high) << 16;
        let mut words = [0; WORDS];
        words[0] = two(self.black, self.noise);
        words[1] = self.seed;
        for (words, shape) in words[2..].as_chunks_mut().0.iter_mut().zip(&self.shapes) {
            let kind = u16::from_le_bytes([shape.kind as u8, shape.rows]);
            *words = [
                two(kind, shape.more),
                two(shape.place, shape.width),
                u32::from(shape.height as u16),
            ];
        }
        words
    }

    /// From words. A kind that does not exist is nothing.
    pub fn from_words(words: &[u32; WORDS]) -> Self {
        let halves = |word: u32| (word as u16, (word >> 16) as u16);
        let (black, noise) = halves(words[0]);
        let mut shapes = [Shape::default(); SHAPES];
        for (shape, [kind, place, height]) in shapes.iter_mut().zip(words[2..].as_chunks().0) {
            let ((kind, more), (place, width)) = (halves(*kind), halves(*place));
            let [kind, rows] = kind.to_le_bytes();
            *shape = Shape {
                kind: Kind::ALL
                    .get(usize::from(kind))
                    .copied()
                    .unwrap_or_default(),
                rows,
                place,
                width,
                height: *height as u16 as i16,
                more,
            };
        }
        Self {
            black,
            noise,
            seed: words[1],
            shapes,
        }
    }
}
