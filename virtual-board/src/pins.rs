//! Connects the sensor head to the emulated processor's pins.
//!
//! The emulator reports edges only of a chip's chip select, and any port pin can be a chip select. So the
//! converter is on SPI1 with its chip select. Two more chips without wires are on SPI2: their "chip selects"
//! are ICG and SH. On SPI2 they cannot disturb the converter's words.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};

use rigless::chip::{Timeline, spi};
use rigless::snapshot::store;
use rigless::soc::stm32f427::generated::spi1;
use rigless::soc::stm32f427::generated::usart6::{self, cr3};
use rigless::soc::stm32f427::peripherals::gpio::Pin as PortPin;
use rigless::soc::stm32f427::peripherals::rcc::Apb;
use rigless::soc::stm32f427::peripherals::spi::Select;

use crate::base::{Nanos, lock};
use crate::burst;
use crate::jumpers::{Edge, Jumpers};
use crate::laser;
use crate::sensor_head::{Clocks, Level, SensorHead, SharedHead};
use crate::serial_line::{DriverEnable, SERIAL_PORT, SerialLine};
use crate::stm32f429::Stm32f429;

mod wiring;

/// SPI1, which serves the converter, in rigless's order.
const CONVERTER_BUS: usize = 0;
/// SPI2, on which the edges of ICG and SH arrive. The firmware does not use it.
const EDGE_BUS: usize = 1;

/// The head, and what the edges of its pins leave to do.
#[derive(Debug)]
pub(crate) struct Pins {
    pub(crate) head: SharedHead,
    /// True after an edge at which the processor's clocks must be read.
    look: AtomicBool,
    icg_rose: AtomicBool,
    /// The wires of `cargo silicon-check`, if they are there, and the edges that they have not seen yet.
    jumpers: Option<Jumpers>,
    edges: Mutex<Vec<Edge>>,
    line: Arc<Mutex<SerialLine>>,
}

impl Pins {
    pub(crate) fn new(
        head: SensorHead,
        jumpers: Option<Jumpers>,
        line: Arc<Mutex<SerialLine>>,
    ) -> Arc<Self> {
        Arc::new(Self {
            head: Arc::new(Mutex::new(head)),
            look: AtomicBool::new(false),
            icg_rose: AtomicBool::new(false),
            jumpers,
            edges: Mutex::default(),
            line,
        })
    }

    fn drive_jumpers(&self, processor: &mut Stm32f429, now: Nanos) {
        let Some(jumpers) = self.jumpers else {
            return;
        };
        jumpers.drive_master_clock(processor, now);
        jumpers.drive_own_pins(processor, &lock(&self.head), now);
        let (_, registers) = processor.part.serial_port(SERIAL_PORT);
        let is_half_duplex = cr3::HDSEL.is_set(registers.get(usart6::Register::Cr3));
        lock(&self.line).echo = is_half_duplex.then_some(jumpers.bytes_unheard);
        let edges = std::mem::take(&mut *lock(&self.edges));
        for edge in edges {
            jumpers.drive(edge, processor, now);
            lock(&self.head).open_line = Some(jumpers.miso(&processor.part));
        }
    }

    /// Tells the head the clocks and the DMA buffers, if an edge asked for them. A chip cannot read the
    /// processor's registers, so this is called after each access of the processor.
    pub(crate) fn look_at(&self, processor: &mut Stm32f429, now: Nanos) {
        self.drive_jumpers(processor, now);
        if self.look.swap(false, Ordering::Relaxed) {
            let clocks = clocks(processor);
            let (_, registers) = processor.part.controller(burst::DMA2);
            let buffers = burst::memory_addresses(registers);
            let laser_pin = laser::is_pin_connected(&processor.part);
            let icg_rose = self.icg_rose.swap(false, Ordering::Relaxed);
            let part = processor.part_of_master_clock(now);
            let mut head = lock(&self.head);
            if let Some(part) = part.filter(|_| icg_rose) {
                head.icg_rose_at(part, now);
            }
            if head.wants_wiring() {
                for fault in wiring::faults(&mut processor.part) {
                    head.violated(now, fault);
                }
            }
            head.clocks(clocks, now);
            head.laser_pin = laser_pin;
            for address in buffers {
                head.dma_address(address, now);
            }
        }
    }
}

fn select(port: &'static str, number: u8, active: Level) -> Select {
    let pin = PortPin::new(number).expect("a port has sixteen pins");
    Select { port, pin, active }
}

/// Connects the enable pin of the serial line's driver, PD12.
pub(crate) fn attach_driver(processor: &mut Stm32f429, line: Arc<Mutex<SerialLine>>) {
    let (driver, pin) = (DriverEnable { line }, select("GPIOD", 12, Level::High));
    processor.part.spi[EDGE_BUS].attach_selected(driver, pin);
}

pub(crate) fn attach(processor: &mut Stm32f429, pins: &Arc<Pins>) {
    let chip = |pin| HeadPin {
        pin,
        pins: Arc::clone(pins),
    };
    let chip_select = select("GPIOD", 14, Level::Low);
    let converter = processor.converter_bus();
    converter.attach_selected(chip(HeadPinName::ChipSelect), chip_select);
    let edges = &mut processor.part.spi[EDGE_BUS];
    edges.attach_selected(chip(HeadPinName::Icg), select("GPIOF", 12, Level::High));
    edges.attach_selected(chip(HeadPinName::Sh), select("GPIOF", 13, Level::High));
}

#[derive(Clone, Copy, Debug)]
enum HeadPinName {
    ChipSelect,
    Icg,
    Sh,
}

/// One pin of the head, as a chip with a chip select.
#[derive(Debug)]
struct HeadPin {
    pin: HeadPinName,
    pins: Arc<Pins>,
}
store! { HeadPin { values: [], parts: [], built: [pin, pins] } }

impl HeadPin {
    fn edge(&self, selected: bool, now: Nanos) {
        let mut head = lock(&self.pins.head);
        let edge = match (self.pin, selected) {
            (HeadPinName::Icg, high) => Edge::Icg(high),
            (HeadPinName::Sh, high) => Edge::Sh(high),
            (HeadPinName::ChipSelect, true) => Edge::ChipSelectFell,
            (HeadPinName::ChipSelect, false) => {
                let (words, first, last) = head.clocked();
                Edge::ChipSelectRose { words, first, last }
            }
        };
        if self.pins.jumpers.is_some() {
            lock(&self.pins.edges).push(edge);
        }
        // Only the converter's chip select is active low.
        let is_high = selected != matches!(self.pin, HeadPinName::ChipSelect);
        let level = Level::from(is_high);
        match self.pin {
            HeadPinName::ChipSelect => head.chip_select(level, now),
            HeadPinName::Icg => {
                head.icg(level, now);
                let rose = &self.pins.icg_rose;
                rose.fetch_or(is_high, Ordering::Relaxed);
            }
            HeadPinName::Sh => head.sh(level, now),
        }
        if !matches!(self.pin, HeadPinName::Sh) {
            self.pins.look.store(true, Ordering::Relaxed);
        }
    }
}

impl spi::Peer for HeadPin {
    fn transfer(&mut self, _mosi: u32, bits: u8, context: &mut Timeline<'_, '_>) -> u32 {
        match self.pin {
            HeadPinName::ChipSelect => lock(&self.pins.head).word(bits, context.now().0).into(),
            HeadPinName::Icg | HeadPinName::Sh => 0,
        }
    }

    fn select(&mut self, context: &mut Timeline<'_, '_>) {
        self.edge(true, context.now().0);
    }

    fn deselect(&mut self, context: &mut Timeline<'_, '_>) {
        self.edge(false, context.now().0);
    }

    fn restarted(&mut self, context: &mut Timeline<'_, '_>) {
        lock(&self.pins.head).restarted(context.now().0);
    }
}

/// Computes the head's clocks from the processor's registers. rigless gives a pulse's period in whole
/// nanoseconds, which is too coarse to compare two rates.
fn clocks(processor: &mut Stm32f429) -> Clocks {
    let master_ticks = processor.master_clock();
    let (_, registers) = processor.part.serial(CONVERTER_BUS);
    let divider = 2_u64 << spi1::cr1::BR.get(registers.get(spi1::Register::Cr1));
    let (tree, registers) = processor.part.clocks();
    let (timer_hz, bus_hz) = (tree.timer_clock(registers, Apb::Two), tree.pclk2(registers));
    Clocks {
        master_hz: master_ticks.map_or(0.0, |ticks| timer_hz as f64 / ticks as f64),
        serial_hz: bus_hz as f64 / divider as f64,
    }
}
