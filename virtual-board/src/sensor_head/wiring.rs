//! What the firmware sets up for the sensor head's pins: functions, speeds, pulls, and SPI's mode. The
//! emulator's models work with other values too, so they are checked here, at the first row.

use rigless::device::RegisterFile;
use rigless::mcu::Mcu as _;
use rigless::soc::stm32f427::Stm32f427;
use rigless::soc::stm32f427::generated::gpioa::Register as Port;
use rigless::soc::stm32f427::generated::spi1::{self, cr1};

use super::pins::CONVERTER_BUS;

/// Modes of a pin (RM0090 section 8.4.1).
const OUTPUT: u64 = 0b01;
const ALTERNATE: u64 = 0b10;

/// The fastest speed of an output (RM0090 section 8.4.3).
const VERY_HIGH: u64 = 0b11;

/// Pulls of a pin (RM0090 section 8.4.4).
const PULL_UP: u64 = 0b01;

/// A pin of the head and what it must be.
#[derive(Clone, Copy)]
struct Wanted {
    pin: &'static str,
    port: &'static str,
    number: u64,
    mode: u64,
    /// The alternate function (STM32F429 data sheet, table 12).
    function: Option<u64>,
    speed: Option<u64>,
    pull: Option<u64>,
}

/// The head's pins. All outputs but the laser's need the fastest speed. SCLK floats while SPI is off, and
/// DOUT if there is no converter.
const PINS: [Wanted; 7] = {
    let (fast, pulled) = (Some(VERY_HIGH), Some(PULL_UP));
    [
        wanted("PE9 (fM)", "GPIOE", 9, Some(1), fast, None),
        wanted("PF12 (ICG)", "GPIOF", 12, None, fast, None),
        wanted("PF13 (SH)", "GPIOF", 13, None, fast, None),
        wanted("PD14 (chip select)", "GPIOD", 14, None, fast, None),
        wanted("PA5 (SCLK)", "GPIOA", 5, Some(5), fast, pulled),
        wanted("PA6 (DOUT)", "GPIOA", 6, Some(5), None, pulled),
        wanted("PD15 (laser)", "GPIOD", 15, Some(2), None, None),
    ]
};

const fn wanted(
    pin: &'static str,
    port: &'static str,
    number: u64,
    function: Option<u64>,
    speed: Option<u64>,
    pull: Option<u64>,
) -> Wanted {
    Wanted {
        pin,
        port,
        number,
        mode: if function.is_some() {
            ALTERNATE
        } else {
            OUTPUT
        },
        function,
        speed,
        pull,
    }
}

impl Wanted {
    fn faults(&self, registers: &RegisterFile) -> Vec<String> {
        let two_bits = |register: Port| registers.get(register) >> (2 * self.number) & 0b11;
        let half = [Port::Afrl, Port::Afrh][usize::from(self.number >= 8)];
        let function = registers.get(half) >> (4 * (self.number % 8)) & 0b1111;
        [
            ("mode", two_bits(Port::Moder), Some(self.mode)),
            ("function", function, self.function),
            ("speed", two_bits(Port::Ospeedr), self.speed),
            ("pull", two_bits(Port::Pupdr), self.pull),
        ]
        .into_iter()
        .filter_map(|(what, found, wanted)| {
            let (pin, wanted) = (self.pin, wanted.filter(|&wanted| wanted != found)?);
            Some(format!(
                "{pin} has {what} {found}, and needs {wanted} (RM0090 section 8.4)"
            ))
        })
        .collect()
    }
}

/// Lists what is wrong with the pins and with SPI1.
pub(crate) fn faults(processor: &mut Stm32f427) -> Vec<String> {
    let mut faults: Vec<String> = Vec::new();
    for wanted in &PINS {
        match processor.bus().slot(wanted.port) {
            Ok(slot) => faults.extend(wanted.faults(processor.bus().slots()[slot].registers())),
            Err(_) => faults.push(format!("the emulator has no {}", wanted.port)),
        }
    }
    // PA7 is CRS_DV of the board's Ethernet, which drives it.
    if let Ok(slot) = processor.bus().slot("GPIOA") {
        let mode = processor.bus().slots()[slot].registers().get(Port::Moder) >> 14 & 0b11;
        if mode == OUTPUT || mode == ALTERNATE {
            faults.push("PA7 is driven, and so does the board's Ethernet (UM1974)".to_owned());
        }
    }
    let (_, registers) = processor.serial(CONVERTER_BUS);
    let control = registers.get(spi1::Register::Cr1);
    if !(cr1::CPOL.is_set(control) && cr1::CPHA.is_set(control)) {
        faults.push("SPI1 is not in mode 3 (ADC122S101, timing diagram)".to_owned());
    }
    if cr1::LSBFIRST.is_set(control) {
        faults.push("SPI1 takes the lowest bit first; the converter sends it last".to_owned());
    }
    faults
}
