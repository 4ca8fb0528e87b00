//! The six jumper wires of `cargo silicon-check`, and faults to put into them. See
//! `on-chip/silicon-check/src/wires.rs` for the pins.
//!
//! rigless's timers capture the edges of ICG, SH and chip select. Edges of fM and SCLK come five and ten
//! million times a second, which would take most of the time of a run. So they are not driven one by one: the
//! count at the latest edge of fM is computed while the program captures fM, and a row's edges of SCLK are
//! counted as its words, when chip select rises. Interrupts, flags and polarities of the captures are
//! rigless's.

use rigless::device::Device;
use rigless::mcu::{Mcu as _, Operate};
use rigless::soc::Width;
use rigless::soc::stm32f427::Stm32f427;
use rigless::soc::stm32f427::generated::{gpioa, tim1, tim2};
use rigless::soc::stm32f427::peripherals::gpio::Pin as PortPin;
use rigless::soc::stm32f427::peripherals::tim::Channel;
use rigless::time::VirtualNanos;

use crate::base::Nanos;
use crate::port_pin::{OUTPUT, Pin};
use crate::sensor_head::{OpenLine, SensorHead, limits};
use crate::stm32f429::Stm32f429;

/// The wires. By default all are there, without faults.
#[derive(Clone, Copy, Debug, Default)]
pub struct Jumpers {
    /// fM's is missing.
    pub lacks_fm: bool,
    /// ICG's is missing.
    pub lacks_icg: bool,
    /// SH's is missing.
    pub lacks_sh: bool,
    /// SCLK's is missing.
    pub lacks_sclk: bool,
    /// Chip select's is missing.
    pub lacks_chip_select: bool,
    /// What becomes of MISO.
    pub miso: Miso,
    /// By how many core cycles an edge comes late.
    pub late: Late,
    /// Edges of SCLK that are missing in each row.
    pub lost_edges: u32,
    /// By how much the laser's pin falls late.
    pub laser_falls_late: Nanos,
    /// The trigger's pin, PA3, is at ground.
    pub trigger_at_ground: bool,
    /// How many bytes of a thousand the serial port does not hear of those that it sends itself.
    pub bytes_unheard: u8,
}

/// See [`Jumpers::late`].
#[derive(Clone, Copy, Debug, Default)]
pub struct Late {
    /// The fall of ICG.
    pub icg_falls: u64,
    /// The rise of ICG.
    pub icg_rises: u64,
    /// The rise of SH.
    pub sh_rises: u64,
    /// The fall of SH.
    pub sh_falls: u64,
}

/// MISO's wire.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Miso {
    /// It is there.
    #[default]
    Wired,
    /// It is missing.
    Missing,
    /// MISO is at ground.
    StuckLow,
    /// MISO is at the supply.
    StuckHigh,
    /// It is there, and the processor's pull-up does not work.
    NoPullUp,
    /// It is there, and SPI1 misses a bit now and then.
    Slips,
    /// It is there, and SPI1 reads the last bit of each word too early.
    Stale,
}

#[derive(Clone, Copy, Debug)]
pub(crate) enum Edge {
    /// ICG went high, or low.
    Icg(bool),
    /// SH went high, or low.
    Sh(bool),
    ChipSelectFell,
    /// Chip select rose after so many words, the first and the last of which ended at these instants.
    ChipSelectRose {
        words: usize,
        first: Nanos,
        last: Nanos,
    },
}

/// The timers in rigless's order.
const TIM2: usize = 0;
const TIM3: usize = 1;
const TIM8: usize = 1;

/// Port D in rigless's order.
const PORT_D: usize = 3;

const TIM3_COUNTER: u64 = 0x4000_0424;

/// Pins, their ports and the functions that connect them to their timers (STM32F429 data sheet, table 12).
const ICG: (&str, u64, u64) = ("GPIOC", 6, 3);
const FM: (&str, u64, u64) = ("GPIOC", 7, 3);
const SH: (&str, u64, u64) = ("GPIOC", 8, 3);
const SCLK: (&str, u64, u64) = ("GPIOA", 0, 1);
const CHIP_SELECT: (&str, u64, u64) = ("GPIOB", 5, 2);

/// fM's period in TIM8's steps.
const PERIOD: u64 = 64;

/// The processor's clock beside TIM2's.
const TIM2_HZ: u64 = 84_000_000;

impl Jumpers {
    pub(crate) fn drive(&self, edge: Edge, processor: &mut Stm32f429, now: Nanos) {
        let part = &mut processor.part;
        match edge {
            Edge::Icg(high) if !self.lacks_icg && is_connected(part, ICG) => {
                let late = [self.late.icg_falls, self.late.icg_rises][usize::from(high)];
                let captured = [tim1::Register::Ccr2, tim1::Register::Ccr1][usize::from(high)];
                drive_tim8(part, 1, high, captured, late, now);
            }
            Edge::Sh(high) if !self.lacks_sh && is_connected(part, SH) => {
                let late = [self.late.sh_falls, self.late.sh_rises][usize::from(high)];
                let captured = [tim1::Register::Ccr4, tim1::Register::Ccr3][usize::from(high)];
                drive_tim8(part, 3, high, captured, late, now);
            }
            Edge::ChipSelectFell if !self.lacks_chip_select && is_connected(part, CHIP_SELECT) => {
                drive_tim3(part, false, now);
            }
            Edge::ChipSelectRose { words, first, last } => {
                if !self.lacks_sclk && is_connected(part, SCLK) && counts_sclk(part) {
                    let bits = u64::from(limits::WORD_BITS);
                    let edges = (words as u64 * bits).saturating_sub(self.lost_edges.into());
                    let counter = part.timer(TIM3).1.get(tim2::Register::Cnt);
                    let counter = (counter + edges) & 0xFFFF;
                    // A write to a register that the model has.
                    let _ = part.write(VirtualNanos(now), TIM3_COUNTER, Width::W32, counter);
                    // Word 0 has 15 periods between its first edge and its last.
                    let periods = 15 * TIM2_HZ / 10_500_000;
                    let time = (last - first) as f64 * TIM2_HZ as f64 / 1e9;
                    let (_, registers) = part.timer(TIM2);
                    registers.set(tim2::Register::Ccr1, time.round() as u64 + periods);
                }
                if !self.lacks_chip_select && is_connected(part, CHIP_SELECT) {
                    drive_tim3(part, true, now);
                }
            }
            _ => {}
        }
    }

    /// Drives the pins that `silicon-check` reads without a wire. Call it after each access.
    pub(crate) fn drive_own_pins(&self, processor: &mut Stm32f429, head: &SensorHead, now: Nanos) {
        let now_or_before = now.saturating_sub(self.laser_falls_late);
        let is_on = head
            .laser_pulses()
            .any(|pulse| pulse.start <= now && now_or_before < pulse.end);
        let (pin, level) = (
            PortPin::new(15).expect("one of sixteen"),
            Some(is_on.into()),
        );
        let at = VirtualNanos(now);
        processor
            .part
            .drive_port(at, PORT_D, |port, registers, context| {
                port.drive_function(pin, level, registers, context);
            });
        let (_, registers) = processor.part.port(0);
        let pulls_up = gpioa::pupdr::PUPDR3.get(registers.get(gpioa::Register::Pupdr)) == 1;
        processor.drive_trigger(pulls_up && !self.trigger_at_ground, at);
    }

    /// Lets TIM8 capture fM, if the program waits for that. Call it after each access.
    pub(crate) fn drive_master_clock(&self, processor: &mut Stm32f429, now: Nanos) {
        use tim1::{Register, ccer, ccmr1_output, sr};
        if self.lacks_fm {
            return;
        }
        let (_, registers) = processor.part.advanced_timer(TIM8);
        let enable = registers.get(Register::Ccer);
        let takes_fm = ccer::CC2E.is_set(enable)
            && ccmr1_output::CC2S.get(registers.get(Register::Ccmr1Output)) == 1
            && !sr::CC2IF.is_set(registers.get(Register::Sr));
        let falls = ccer::CC2P.is_set(enable);
        if !takes_fm || !is_connected(&processor.part, FM) {
            return;
        }
        let Some(part_of_period) = processor.part_of_master_clock(now) else {
            return;
        };
        let since_rise = (part_of_period * PERIOD as f64).round() as u64;
        let since = match falls {
            false => since_rise,
            true => (since_rise + PERIOD / 2) % PERIOD,
        };
        let (timer, registers) = processor.part.advanced_timer(TIM8);
        let Some(count) = Device::peek(timer, Register::Cnt, registers, VirtualNanos(now)) else {
            return;
        };
        registers.set(Register::Ccr2, count.wrapping_sub(since) & 0xFFFF);
        registers.set(Register::Sr, sr::CC2IF.set(registers.get(Register::Sr), 1));
    }

    /// What SPI1 reads while MISO (PA6) is driven by its wire (from PB13).
    pub(crate) fn miso(&self, part: &Stm32f427) -> OpenLine {
        let driver = Pin::of(part, "GPIOB", 13);
        if driver.has_function(1) && complements_fm(part) {
            match self.miso {
                Miso::Wired | Miso::NoPullUp => return OpenLine::Clock,
                Miso::Slips => return OpenLine::SlippingClock,
                Miso::Stale => return OpenLine::StaleClock,
                _ => {}
            }
        }
        let pulls_up = Pin::of(part, "GPIOA", 6).pull == 1;
        let is_high = match self.miso {
            Miso::StuckLow => false,
            Miso::StuckHigh => true,
            Miso::Wired | Miso::NoPullUp | Miso::Slips | Miso::Stale if driver.mode == OUTPUT => {
                driver.is_high
            }
            Miso::NoPullUp => false,
            Miso::Wired | Miso::Missing | Miso::Slips | Miso::Stale => pulls_up,
        };
        [OpenLine::Zeros, OpenLine::Ones][usize::from(is_high)]
    }
}

/// Drives a channel of TIM8. `captured`, in which the edge is captured, is corrected by `late` cycles.
fn drive_tim8(
    part: &mut Stm32f427,
    channel: u8,
    high: bool,
    captured: tim1::Register,
    late: u64,
    now: Nanos,
) {
    let channel = Channel::new(channel).expect("1 to 4");
    part.drive_advanced_timer(VirtualNanos(now), TIM8, |timer, registers, context| {
        timer.drive_input(channel, high.into(), registers, context);
        registers.set(captured, (registers.get(captured) + late) & 0xFFFF);
    });
}

fn drive_tim3(part: &mut Stm32f427, high: bool, now: Nanos) {
    let channel = Channel::new(2).expect("1 to 4");
    part.drive_timer(VirtualNanos(now), TIM3, |timer, registers, context| {
        timer.drive_input(channel, high.into(), registers, context);
    });
}

/// Whether TIM2 starts at SCLK's first rise and captures each, and TIM3 counts the captures.
fn counts_sclk(part: &mut Stm32f427) -> bool {
    use tim2::{Register, ccer, ccmr1_output, cr2, smcr};
    let (_, registers) = part.timer(TIM2);
    let captures = ccmr1_output::CC1S.get(registers.get(Register::Ccmr1Output)) == 1
        && ccer::CC1E.is_set(registers.get(Register::Ccer))
        && cr2::MMS.get(registers.get(Register::Cr2)) == 0b011;
    let slave = registers.get(Register::Smcr);
    let starts = smcr::SMS.get(slave) == 0b110 && smcr::TS.get(slave) == 0b101;
    let (_, registers) = part.timer(TIM3);
    let slave = registers.get(Register::Smcr);
    captures && starts && smcr::SMS.get(slave) == 0b111 && smcr::TS.get(slave) == 0b001
}

/// Whether TIM1 gives the complement of fM.
fn complements_fm(part: &Stm32f427) -> bool {
    let slot = part.bus().slot("TIM1").expect("the part has it");
    let registers = part.bus().slots()[slot].registers();
    tim1::ccer::CC1NE.is_set(registers.get(tim1::Register::Ccer))
}

fn is_connected(part: &Stm32f427, (port, pin, function): (&'static str, u64, u64)) -> bool {
    Pin::of(part, port, pin).has_function(function)
}
