//! What stops the firmware: a panic, a HardFault, or the end of the ST-LINK's clock. Each first switches the
//! laser off, in the middle of a pulse too. Each then notes why in RAM that a reset keeps, for `info`.
//!
//! After a panic or a HardFault the firmware stands still, so that a debugger finds all as it was, and the
//! watchdog starts it again. Without its clock it starts again at once.

use core::fmt::{self, Write as _};
use core::panic::PanicInfo;
use core::sync::atomic::{AtomicBool, AtomicU8, Ordering};

use cortex_m::peripheral::SCB;
use cortex_m::peripheral::scb::VectActive;
use cortex_m_rt::{ExceptionFrame, exception};
use crc::{CRC_16_IBM_3740, Crc};
use embassy_stm32::{interrupt, pac};
use slitrange_device::protocol::status::StartCause;
use slitrange_device::text::Text;
use static_cell::StaticCell;

use super::{laser, lights};

/// A checksum, the number of stops since the power came, and the text, filled up with zeros.
type Note = [u8; 128];
const STOPS: usize = 2;
const TEXT: usize = 3;

/// After power-on, RAM holds anything: the checksum tells.
#[unsafe(link_section = ".uninit.last_stop")]
static KEPT: [AtomicU8; size_of::<Note>()] = [const { AtomicU8::new(0) }; _];

/// The number of stops since the power came, and the last one's reason.
pub fn read(started_by: StartCause) -> (u8, Option<&'static str>) {
    static NOTE: StaticCell<Note> = StaticCell::new();
    if started_by == StartCause::PowerOn {
        keep([0; _]);
        return (0, None);
    }
    let note = NOTE.init(kept());
    let stops = stops(note);
    let text = note[TEXT..].split(|&byte| byte == 0).next();
    let text = text.and_then(|text| core::str::from_utf8(text).ok());
    (stops, text.filter(|_| stops > 0))
}

fn kept() -> Note {
    core::array::from_fn(|i| KEPT[i].load(Ordering::Relaxed))
}

fn keep(note: Note) {
    for (to, byte) in KEPT.iter().zip(note) {
        to.store(byte, Ordering::Relaxed);
    }
}

/// 0 if nobody wrote the note.
fn stops(note: &Note) -> u8 {
    if note.starts_with(&checksum(note)) {
        note[STOPS]
    } else {
        0
    }
}

fn checksum(note: &Note) -> [u8; STOPS] {
    let crc = Crc::<u16, crc::Table<0>>::new(&CRC_16_IBM_3740);
    crc.checksum(&note[STOPS..]).to_le_bytes()
}

/// Notes why the firmware stops. Call it once.
fn note(why: fmt::Arguments<'_>) {
    let mut text = Text::<{ size_of::<Note>() - TEXT }>::default();
    // What does not fit is left out.
    let _ = text.write_fmt(why);
    let mut note = [0; size_of::<Note>()];
    note[STOPS] = stops(&kept()).saturating_add(1);
    for (to, &byte) in note[TEXT..].iter_mut().zip(text.as_bytes()) {
        *to = byte;
    }
    let checksum = checksum(&note);
    note[..STOPS].copy_from_slice(&checksum);
    keep(note);
}

/// Where the core was, by the number of the exception that it served.
struct Place(u32);

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        // The chip's interrupts follow the core's 16 exceptions.
        const URGENT: u32 = 16 + interrupt::UART4 as u32;
        match self.0 {
            0 => f.write_str("measuring or the serial line"),
            URGENT => f.write_str("acquisition"),
            number => write!(f, "exception {number}"),
        }
    }
}

/// As panic-probe, but for the laser and the note.
#[panic_handler]
fn panic(info: &PanicInfo<'_>) -> ! {
    static HAS_PANICKED: AtomicBool = AtomicBool::new(false);
    cortex_m::interrupt::disable();
    laser::force_off();
    // The log below may panic too.
    if HAS_PANICKED.swap(true, Ordering::Relaxed) {
        stand_still();
    }
    let place = match SCB::vect_active() {
        VectActive::ThreadMode => 0,
        VectActive::Exception(exception) => exception.irqn() as u32 & 0xF,
        VectActive::Interrupt { irqn } => 16 + u32::from(irqn),
    };
    let location = info.location();
    let (file, line) = location.map_or(("?", 0), |location| (location.file(), location.line()));
    // The end of a long path.
    let from = file.len().saturating_sub(60);
    let file = file.get(from..).unwrap_or(file);
    note(format_args!("panic at {file}:{line}, in {}", Place(place)));
    lights::stopped();
    defmt::error!("{}", defmt::Display2Format(info));
    stand_still()
}

#[exception]
unsafe fn HardFault(frame: &ExceptionFrame) -> ! {
    laser::force_off();
    // SAFETY: these registers may be read at any time.
    let scb = unsafe { &*SCB::PTR };
    let cfsr = scb.cfsr.read();
    // BFARVALID and MMARVALID say which address counts; 0: none (ARMv7-M manual, section B3.2.15).
    let address = match (cfsr >> 15 & 1, cfsr >> 7 & 1) {
        (1, _) => scb.bfar.read(),
        (_, 1) => scb.mmfar.read(),
        _ => 0,
    };
    // The core could not push its registers, so there is no frame (ARMv7-M manual, section B3.2.15).
    const STACKING_FAILED: u32 = 1 << 4 | 1 << 12;
    if cfsr & STACKING_FAILED != 0 {
        note(format_args!("the stack was full, cfsr {cfsr:#x}"));
    } else {
        note(format_args!(
            "fault at {:#x}, called from {:#x}, cfsr {cfsr:#x}, address {address:#x}, in {}",
            frame.pc(),
            frame.lr(),
            Place(frame.xpsr() & 0x1FF)
        ));
    }
    lights::stopped();
    stand_still()
}

/// The ST-LINK's clock has stopped. The chip runs by its own oscillator now, and serves this exception again
/// until the flag is cleared (RM0090 section 6.2.7).
#[exception]
unsafe fn NonMaskableInt() -> ! {
    laser::force_off();
    pac::RCC.cir().modify(|flags| flags.set_cssc(true));
    note(format_args!("the clock from outside stopped"));
    super::reset()
}

fn stand_still() -> ! {
    // No interrupt is served, so none wakes the core.
    loop {
        cortex_m::asm::wfe();
    }
}
