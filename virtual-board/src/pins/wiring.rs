//! What the firmware sets up for its pins: functions, speeds, pulls, and SPI's mode. The
//! emulator's models work with other values too, so they are checked here, at the first row.

use rigless::mcu::Mcu as _;
use rigless::soc::stm32f427::Stm32f427;
use rigless::soc::stm32f427::generated::dbg;
use rigless::soc::stm32f427::generated::spi1::{self, cr1};

use super::CONVERTER_BUS;
use crate::port_pin::{ALTERNATE, OUTPUT, Pin};

/// The fastest speed of an output (RM0090 section 8.4.3).
const VERY_HIGH: u64 = 0b11;

/// Pulls of a pin (RM0090 section 8.4.4).
const PULL_UP: u64 = 0b01;

/// A pin of the head and what it must be: its name, port and number, the alternate function (STM32F429 data
/// sheet, table 12) or `None` for a plain output, the speed and the pull.
type Wanted = (&'static str, &'static str, u64, [Option<u64>; 3]);

/// The head's pins and the serial line's. All outputs but the laser's need the fastest speed. SCLK floats
/// while SPI is off, DOUT if there is no converter, and RX while a driver of RS-485 sends.
const PINS: [Wanted; 8] = {
    let (fast, pulled) = (Some(VERY_HIGH), Some(PULL_UP));
    [
        ("PE9 (fM)", "GPIOE", 9, [Some(1), fast, None]),
        ("PF12 (ICG)", "GPIOF", 12, [None, fast, None]),
        ("PF13 (SH)", "GPIOF", 13, [None, fast, None]),
        ("PD14 (chip select)", "GPIOD", 14, [None, fast, None]),
        ("PA5 (SCLK)", "GPIOA", 5, [Some(5), fast, pulled]),
        ("PA6 (DOUT)", "GPIOA", 6, [Some(5), None, pulled]),
        ("PD9 (RX)", "GPIOD", 9, [Some(7), None, pulled]),
        ("PD15 (laser)", "GPIOD", 15, [Some(2), None, None]),
    ]
};

pub(crate) fn faults(processor: &mut Stm32f427) -> Vec<String> {
    let mut faults: Vec<String> = Vec::new();
    for (name, port, number, [function, speed, pull]) in PINS {
        let pin = Pin::of(processor, port, number);
        let mode = function.map_or(OUTPUT, |_| ALTERNATE);
        for (what, found, wanted) in [
            ("mode", pin.mode, Some(mode)),
            ("function", pin.function, function),
            ("speed", pin.speed, speed),
            ("pull", pin.pull, pull),
        ] {
            if let Some(wanted) = wanted.filter(|&wanted| wanted != found) {
                let needs = format!("and needs {wanted} (RM0090 section 8.4)");
                faults.push(format!("{name} has {what} {found}, {needs}"));
            }
        }
    }
    // PA7 is CRS_DV of the board's Ethernet, which drives it.
    if matches!(Pin::of(processor, "GPIOA", 7).mode, OUTPUT | ALTERNATE) {
        faults.push("PA7 is driven, and so does the board's Ethernet (UM1974)".to_owned());
    }
    let debug = (processor.bus().slot("DBG")).expect("the part has this peripheral");
    let debug = processor.bus().slots()[debug].registers();
    if dbg::dbgmcu_apb1_fz::DBG_TIM4_STOP.is_set(debug.get(dbg::Register::DbgmcuApb1Fz)) {
        faults.push("a breakpoint stops TIM4 and leaves the laser on (RM0090 38.16.4)".to_owned());
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
