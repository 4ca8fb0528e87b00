//! How the sensor sends: in which format, with which pixels, at which rate, in which characters.

use slitrange::named;

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

named! { Format { Text: "text", Binary: "binary", Modbus: "modbus", Csv: "csv" } }
named! { PixelStream { None: "none", Window: "window", Rows: "rows" } }
named! { Bits { N1: "8n1", E1: "8e1", N2: "8n2" } }

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
    /// 9600.
    B9600,
    /// 19,200.
    B19200,
    /// 115,200: that of the factory.
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
    pub const ALL: [Self; 6] = [
        Self::B9600,
        Self::B19200,
        Self::B115200,
        Self::B230400,
        Self::B460800,
        Self::B921600,
    ];

    /// Bits a second.
    pub const fn bits_a_second(self) -> u32 {
        match self {
            Self::B9600 => 9600,
            Self::B19200 => 19_200,
            Self::B115200 => 115_200,
            Self::B230400 => 230_400,
            Self::B460800 => 460_800,
            Self::B921600 => 921_600,
        }
    }
}

/// What a character on the serial line has around its eight data bits: the setting `bits`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Bits {
    /// No parity, one stop bit.
    #[default]
    N1,
    /// Even parity, one stop bit: the default of Modbus.
    E1,
    /// No parity, two stop bits.
    N2,
}

/// How the sensor speaks on its line. The default is that of the factory.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Connection {
    /// See [`Format`].
    pub format: Format,
    /// See [`Baud`].
    pub baud: Baud,
    /// See [`Bits`].
    pub bits: Bits,
    /// The sensor's number; 0 if it is alone on its line.
    pub address: u16,
}

impl Connection {
    /// How long half characters last, with start and stop bits, in us.
    pub const fn half_characters_us(self, count: u8) -> u64 {
        let bits = match self.bits {
            Bits::N1 => 10,
            Bits::E1 | Bits::N2 => 11,
        };
        // At most 255 * 11 * 500,000.
        let us = count as u32 * bits * 500_000;
        (us / self.baud.bits_a_second()) as u64
    }

    /// The silence that ends a Modbus request, in us: 3.5 characters, and 1750 us above 19,200 baud (Modbus
    /// over serial line V1.02, section 2.5.1.1).
    pub const fn modbus_silence_us(self) -> u64 {
        match self.baud {
            Baud::B9600 | Baud::B19200 => self.half_characters_us(7),
            _ => 1750,
        }
    }
}
