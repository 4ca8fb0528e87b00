//! How the sensor sends: in which format, with which pixels, and at which rate.

/// How the sensor writes what it sends: the setting `format`. The order is that of the
/// numbers in a holding register.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Format {
    /// Lines of text.
    #[default]
    Text,
    /// Packets.
    Binary,
    /// Modbus RTU, in both directions: [`crate::protocol::modbus`].
    Modbus,
    /// Lines of text, in which results are comma-separated values.
    Csv,
}

names! {
    Format: Text "text", Binary "binary", Modbus "modbus", Csv "csv";
    PixelStream: None "none", Window "window", Rows "rows";
}

/// Which pixels the sensor sends beside its results: the setting `pixels`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PixelStream {
    /// None.
    #[default]
    None,
    /// Those around the spot, of the last row of each frame.
    Window,
    /// Whole rows, as fast as the line takes them, each with its own result. Frames have no results then.
    Rows,
}

/// The rate of the serial line: the setting `baud`, in bits a second.
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
