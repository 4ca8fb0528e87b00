//! What the chip's flags and option bytes say about its starts.

use embassy_stm32::pac;
use slitrange_device::protocol::info::BrownOut;
use slitrange_device::protocol::status::StartCause;

/// Reads the reset flags and clears them for the next start. Every reset raises its own flag and the pin's,
/// because the chip pulls its reset pin itself. So the pin is the cause only if no other flag is raised. A
/// power-on raises PORRSTF and BORRSTF, a dip of the supply BORRSTF only (RM0090 section 6.3.21).
pub fn start_cause() -> StartCause {
    let flags = pac::RCC.csr().read();
    pac::RCC.csr().modify(|csr| csr.set_rmvf(true));
    if flags.wdgrstf() || flags.wwdgrstf() {
        StartCause::Watchdog
    } else if flags.sftrstf() {
        StartCause::Software
    } else if flags.porrstf() {
        StartCause::PowerOn
    } else if flags.borrstf() {
        StartCause::SupplyDip
    } else {
        StartCause::ResetPin
    }
}

/// The supply below which the chip resets itself, as its option bytes say (RM0090 section 3.9.10). The
/// firmware never writes them.
pub fn brown_out() -> BrownOut {
    match pac::FLASH.optcr().read().bor_lev() {
        0 => BrownOut::Below(2700),
        1 => BrownOut::Below(2400),
        2 => BrownOut::Below(2100),
        _ => BrownOut::Off,
    }
}
