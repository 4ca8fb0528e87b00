//! The rate of the serial line: the setting `baud`.

/// Bits a second.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Baud {
    /// 115,200: that of every start.
    #[default]
    B115200,
    /// 230,400.
    B230400,
    /// 460,800.
    B460800,
    /// 921,600.
    B921600,
}

impl Baud {
    /// All rates, the slowest first.
    pub const ALL: [Self; 4] = [Self::B115200, Self::B230400, Self::B460800, Self::B921600];

    /// Bits a second. A byte has ten bits.
    pub const fn bits_a_second(self) -> u32 {
        match self {
            Self::B115200 => 115_200,
            Self::B230400 => 230_400,
            Self::B460800 => 460_800,
            Self::B921600 => 921_600,
        }
    }
}
