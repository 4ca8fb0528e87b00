//! SPI1 and DMA2 that move a read-out's words in batches.
//!
//! rigless wakes its models for each word that SPI1 receives, and each word passes through both DMA controllers. A row
//! has 3694 words, so a sensor that reads rows one after the other has 650,000 of them in a virtual second: nine tenths
//! of what the emulation cost. While both DMA streams of a read-out run, the firmware sees none of that. So here the
//! words that a stream still has to move are asked of the sensor head [`BATCH`] at a time, each with the instant at
//! which it would have ended, and go to memory together. The last two words of each stream are rigless's: its DMA2 ends
//! the transfer, sets the flags and raises the interrupts.
//!
//! An access to a register of SPI1 or DMA2 and an edge of any pin bring the words up to date first. What differs from
//! silicon is memory alone: in the middle of a read-out, a word may be [`BATCH`] words late in the buffer.
//!
//! Only a read-out as the firmware's driver sets it up is served like this: words of 16 bits, no FIFO, no circular or
//! double buffer, no interrupt half way, and one converter on the bus. All else is rigless's, word by word.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use rigless::device::{Device, DeviceContext, RegisterFile, RequestChange};
use rigless::soc::Width;
use rigless::soc::stm32f427::generated::dma2::{self, s0cr, s0fcr};
use rigless::soc::stm32f427::generated::spi1::{self, cr1, cr2, sr};
use rigless::soc::stm32f427::peripherals::dma::Dma;
use rigless::soc::stm32f427::peripherals::rcc;
use rigless::soc::stm32f427::peripherals::spi::Spi;
use rigless::time::{EventId, VirtualNanos};

use crate::Nanos;
use crate::sensor_head::limits::WORD_BITS;
use crate::sensor_head::pins::{SPI1_DATA, SharedHead};

/// Words between two looks at the head, 0.2 ms.
const BATCH: u64 = 128;

/// The words of a stream that rigless moves.
const LAST: u64 = 2;

/// A shorter transfer is not worth a batch.
const SHORTEST: u64 = 64;

/// The token of the accesses that bring a batch to memory. rigless's streams have small ones.
const TOKEN: u64 = u64::MAX;

/// SPI1's channel of DMA2 (RM0090 table 44).
const CHANNEL: u64 = 3;

/// DATA SIZE: 16 bits (RM0090 section 10.5.5).
const HALF_WORD: u64 = 1;

/// Memory to peripheral (RM0090 section 10.5.5).
const TO_PERIPHERAL: u64 = 1;

/// The registers of a stream.
struct Stream {
    control: dma2::Register,
    count: dma2::Register,
    peripheral: dma2::Register,
    memory: dma2::Register,
    fifo: dma2::Register,
}

/// The streams that receive from SPI1 (RM0090 table 44).
const RECEIVERS: [Stream; 2] = {
    use dma2::Register::{S0cr, S0fcr, S0m0ar, S0ndtr, S0par, S2cr, S2fcr, S2m0ar, S2ndtr, S2par};
    [
        Stream {
            control: S0cr,
            count: S0ndtr,
            peripheral: S0par,
            memory: S0m0ar,
            fifo: S0fcr,
        },
        Stream {
            control: S2cr,
            count: S2ndtr,
            peripheral: S2par,
            memory: S2m0ar,
            fifo: S2fcr,
        },
    ]
};

/// The streams that send to SPI1 (RM0090 table 44).
const SENDERS: [Stream; 2] = {
    use dma2::Register::{S3cr, S3fcr, S3m0ar, S3ndtr, S3par, S5cr, S5fcr, S5m0ar, S5ndtr, S5par};
    [
        Stream {
            control: S3cr,
            count: S3ndtr,
            peripheral: S3par,
            memory: S3m0ar,
            fifo: S3fcr,
        },
        Stream {
            control: S5cr,
            count: S5ndtr,
            peripheral: S5par,
            memory: S5m0ar,
            fifo: S5fcr,
        },
    ]
};

/// How far a read-out is.
#[derive(Debug)]
enum State {
    /// Every word is rigless's.
    Idle,
    /// The receiving stream is on.
    Receiving(Words),
    /// Both streams are on, and SPI1 is not.
    Ready(Words),
    /// SPI1 clocks words since `start`, with `bit_hz`.
    Running {
        words: Words,
        start: Nanos,
        bit_hz: u64,
    },
}

/// The words that come in batches.
#[derive(Clone, Copy, Debug)]
struct Words {
    /// Where the first one goes.
    address: u64,
    count: u64,
    /// How many of them are in memory.
    done: u64,
}

/// What SPI1 and DMA2 share.
#[derive(Debug)]
pub(crate) struct Burst {
    state: State,
    head: Arc<SharedHead>,
}

type SharedBurst = Arc<Mutex<Burst>>;

fn lock(burst: &SharedBurst) -> MutexGuard<'_, Burst> {
    burst.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Burst {
    /// Words that are still to come in batches.
    fn left(&self) -> u64 {
        match &self.state {
            State::Idle => 0,
            State::Receiving(words) | State::Ready(words) | State::Running { words, .. } => {
                words.count - words.done
            }
        }
    }

    /// Moves the words that have ended by now.
    fn catch_up(&mut self, context: &mut DeviceContext<'_>) {
        let State::Running {
            words,
            start,
            bit_hz,
        } = &mut self.state
        else {
            return;
        };
        let mut head = self.head.lock();
        // What is gathered for memory, from `address` on.
        let mut address = words.address + 2 * words.done;
        let (mut gathered, mut bits) = (0, 0);
        while words.done < words.count {
            let end = end_of_word(*start, words.done, *bit_hz);
            if end > context.now().0 {
                break;
            }
            gathered |= u64::from(head.converted(WORD_BITS, end)) << bits;
            bits += 16;
            words.done += 1;
            let next = words.address + 2 * words.done;
            if bits == 64 {
                context.write_to(address, Width::W64, gathered, TOKEN);
            } else if !address.is_multiple_of(8) {
                context.write_to(address, Width::W16, gathered, TOKEN);
            } else {
                continue;
            }
            (address, gathered, bits) = (next, 0, 0);
        }
        for part in 0..bits / 16 {
            let word = gathered >> (16 * part) & 0xFFFF;
            context.write_to(address + 2 * part, Width::W16, word, TOKEN);
        }
    }

    /// When the batch under way ends; nothing if no batch is.
    fn next_end(&self) -> Option<Nanos> {
        let State::Running {
            words,
            start,
            bit_hz,
        } = &self.state
        else {
            return None;
        };
        let last = (words.done + BATCH).min(words.count) - 1;
        Some(end_of_word(*start, last, *bit_hz))
    }
}

/// The end of the word that `done` words precede, with the remainder carried from word to word as rigless does.
fn end_of_word(start: Nanos, done: u64, bit_hz: u64) -> Nanos {
    start + (done + 1) * u64::from(WORD_BITS) * 1_000_000_000 / bit_hz
}

/// Puts both peripherals' models together.
pub(crate) fn pair(dma: Dma, head: &Arc<SharedHead>) -> (BurstSpi, BurstDma) {
    let burst = Arc::new(Mutex::new(Burst {
        state: State::Idle,
        head: Arc::clone(head),
    }));
    let spi = BurstSpi {
        spi: Spi::with_clock(rcc::HSI_HZ),
        clock_hz: rcc::HSI_HZ,
        next: None,
        silent: false,
        burst: Arc::clone(&burst),
    };
    (
        spi,
        BurstDma {
            dma,
            enabled: [false; 4],
            shortens: true,
            burst,
        },
    )
}

/// SPI1.
#[derive(Debug)]
pub(crate) struct BurstSpi {
    /// rigless's model, which the converter hangs on.
    pub(crate) spi: Spi,
    clock_hz: u64,
    /// The event that ends the batch under way.
    next: Option<EventId>,
    silent: bool,
    burst: SharedBurst,
}

impl BurstSpi {
    /// Takes over the chips of the model from before a reset.
    pub(crate) fn inherit(&mut self, before: &mut Self) {
        self.spi.inherit(&mut before.spi);
        self.silent = before.silent;
    }

    /// Cuts the nth chip off, or connects it again: [`Spi::silence`].
    pub(crate) fn silence(&mut self, nth: usize, silent: bool) -> bool {
        self.silent = silent;
        self.spi.silence(nth, silent)
    }

    /// Whether the converter alone answers.
    pub(crate) fn has_only_the_converter(&self) -> bool {
        !self.silent && self.spi.peers().count() == 1
    }

    /// Calls rigless's model, without its requests for DMA while words come in batches.
    fn inner<T>(
        &mut self,
        registers: &mut RegisterFile,
        call: impl FnOnce(&mut Spi, &mut RegisterFile) -> T,
    ) -> T {
        if matches!(lock(&self.burst).state, State::Idle) {
            return call(&mut self.spi, registers);
        }
        let requests = cr2::RXDMAEN.mask() | cr2::TXDMAEN.mask();
        let control = registers.get(spi1::Register::Cr2);
        registers.set(spi1::Register::Cr2, control & !requests);
        let result = call(&mut self.spi, registers);
        registers.set(spi1::Register::Cr2, control);
        result
    }

    /// Begins the batches once SPI1 and both streams are on, and ends them when SPI1 is not.
    fn look(&mut self, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        let mut burst = lock(&self.burst);
        let runs = clocks_words(registers) && self.clock_hz > 0;
        match burst.state {
            State::Ready(words) if runs => {
                let bit_hz = self.clock_hz / (2 << cr1::BR.get(registers.get(spi1::Register::Cr1)));
                burst.state = State::Running {
                    words,
                    start: context.now().0,
                    bit_hz,
                };
                set_busy(registers, true);
                self.next = burst
                    .next_end()
                    .map(|end| context.schedule(VirtualNanos(end)));
            }
            State::Running { .. } if !runs => {
                burst.state = State::Idle;
                set_busy(registers, false);
            }
            _ => {}
        }
    }
}

/// Whether SPI1 is on as a master of plain 16-bit words, both ways by DMA.
fn clocks_words(registers: &RegisterFile) -> bool {
    let (first, second) = (
        registers.get(spi1::Register::Cr1),
        registers.get(spi1::Register::Cr2),
    );
    let needed = cr1::SPE.mask() | cr1::MSTR.mask() | cr1::DFF.mask();
    let other =
        cr1::RXONLY.mask() | cr1::CRCEN.mask() | cr1::BIDIMODE.mask() | cr1::LSBFIRST.mask();
    first & (needed | other) == needed
        && cr2::RXDMAEN.is_set(second)
        && cr2::TXDMAEN.is_set(second)
        && !cr2::FRF.is_set(second)
}

fn set_busy(registers: &mut RegisterFile, busy: bool) {
    let status = registers.get(spi1::Register::Sr);
    registers.set(spi1::Register::Sr, sr::BSY.set(status, busy.into()));
}

impl Device for BurstSpi {
    type Register = spi1::Register;

    fn on_event(
        &mut self,
        event: EventId,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        if self.next != Some(event) {
            self.inner(registers, |spi, registers| {
                Device::on_event(spi, event, registers, context)
            });
            return;
        }
        // Whoever switched SPI1 or its requests off without an access stops the words here.
        self.look(registers, context);
        let mut burst = lock(&self.burst);
        burst.catch_up(context);
        let ends = burst.left() == 0;
        self.next = burst
            .next_end()
            .filter(|_| !ends)
            .map(|end| context.schedule(VirtualNanos(end)));
        if ends {
            burst.state = State::Idle;
            drop(burst);
            set_busy(registers, false);
            // rigless's model asks DMA2 for its last words.
            let control = registers.get(spi1::Register::Cr2);
            Device::write(
                &mut self.spi,
                spi1::Register::Cr2,
                control,
                registers,
                context,
            );
        }
    }

    fn read(
        &mut self,
        register: spi1::Register,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) -> Option<u64> {
        lock(&self.burst).catch_up(context);
        self.inner(registers, |spi, registers| {
            Device::read(spi, register, registers, context)
        })
    }

    fn write(
        &mut self,
        register: spi1::Register,
        value: u64,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        lock(&self.burst).catch_up(context);
        self.inner(registers, |spi, registers| {
            Device::write(spi, register, value, registers, context);
        });
        self.look(registers, context);
    }

    fn on_request(
        &mut self,
        change: RequestChange,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        lock(&self.burst).catch_up(context);
        Device::on_request(&mut self.spi, change, registers, context);
    }

    fn on_clock(&mut self, hz: u64, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        let mut burst = lock(&self.burst);
        burst.catch_up(context);
        if matches!(burst.state, State::Running { .. }) {
            context.tell(
                "CR1",
                "the clock changed in a read-out, which is not modelled",
            );
        }
        drop(burst);
        self.clock_hz = hz;
        self.inner(registers, |spi, registers| {
            Device::on_clock(spi, hz, registers, context)
        });
    }

    fn on_refused(&mut self, _: u64, _: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        context.tell("DR", "a read-out's word went where no memory is");
    }

    fn peek(
        &self,
        register: spi1::Register,
        registers: &RegisterFile,
        now: VirtualNanos,
    ) -> Option<u64> {
        Device::peek(&self.spi, register, registers, now)
    }

    fn reset(&mut self) {
        lock(&self.burst).state = State::Idle;
        Device::reset(&mut self.spi);
    }

    fn reset_line(&mut self, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        lock(&self.burst).state = State::Idle;
        Device::reset_line(&mut self.spi, registers, context);
    }
}

/// DMA2.
#[derive(Debug)]
pub(crate) struct BurstDma {
    dma: Dma,
    /// Whether each of [`RECEIVERS`] and [`SENDERS`] is on.
    enabled: [bool; 4],
    /// Whether words may come in batches now.
    pub(crate) shortens: bool,
    burst: SharedBurst,
}

impl BurstDma {
    /// Leaves the batches' words out of a stream that is being switched on, so that rigless moves the last ones only.
    fn shorten(
        &mut self,
        stream: &Stream,
        words: u64,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        let control = registers.get(stream.control);
        registers.set(stream.control, s0cr::EN.set(control, 0));
        registers.set(stream.count, LAST);
        Device::write(&mut self.dma, stream.count, LAST, registers, context);
        if s0cr::MINC.is_set(control) {
            let last = registers.get(stream.memory) + 2 * words;
            registers.set(stream.memory, last);
            Device::write(&mut self.dma, stream.memory, last, registers, context);
        }
        registers.set(stream.control, control);
    }

    /// A receiving stream goes on: its words come in batches if it is a plain one.
    fn receive(
        &mut self,
        stream: &Stream,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        let count = registers.get(stream.count);
        let control = registers.get(stream.control);
        if self.shortens
            && count >= SHORTEST
            && s0cr::MINC.is_set(control)
            && is_plain(stream, 0, registers)
        {
            let words = Words {
                address: registers.get(stream.memory),
                count: count - LAST,
                done: 0,
            };
            lock(&self.burst).state = State::Receiving(words);
            self.shorten(stream, words.count, registers, context);
        }
    }

    /// A sending stream goes on: it must fit the receiving one.
    fn send(
        &mut self,
        stream: &Stream,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        let mut burst = lock(&self.burst);
        let State::Receiving(words) = burst.state else {
            return;
        };
        if registers.get(stream.count) != words.count + LAST
            || !is_plain(stream, TO_PERIPHERAL, registers)
        {
            context.tell(
                "S3CR",
                "SPI1 sends and receives in different ways, which is not modelled",
            );
            return;
        }
        burst.state = State::Ready(words);
        drop(burst);
        self.shorten(stream, words.count, registers, context);
    }
}

/// Whether a stream that is being switched on moves half words between SPI1 and memory, one a request, and then ends.
fn is_plain(stream: &Stream, direction: u64, registers: &RegisterFile) -> bool {
    let free = [
        s0cr::EN,
        s0cr::DMEIE,
        s0cr::TEIE,
        s0cr::TCIE,
        s0cr::MINC,
        s0cr::PL,
    ];
    let free = free.iter().fold(0, |mask, field| mask | field.mask());
    let mut plain = s0cr::CHSEL.set(0, CHANNEL);
    plain = s0cr::DIR.set(plain, direction);
    plain = s0cr::PSIZE.set(plain, HALF_WORD);
    plain = s0cr::MSIZE.set(plain, HALF_WORD);
    registers.get(stream.control) & !free == plain
        && registers.get(stream.peripheral) == SPI1_DATA
        && !s0fcr::DMDIS.is_set(registers.get(stream.fifo))
}

impl Device for BurstDma {
    type Register = dma2::Register;

    fn write(
        &mut self,
        register: dma2::Register,
        value: u64,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        lock(&self.burst).catch_up(context);
        let streams = RECEIVERS.iter().chain(&SENDERS).enumerate();
        for (index, stream) in streams.filter(|(_, stream)| stream.control == register) {
            let was_enabled = std::mem::replace(&mut self.enabled[index], s0cr::EN.is_set(value));
            match (was_enabled, self.enabled[index]) {
                (false, true) if index < RECEIVERS.len() => {
                    self.receive(stream, registers, context)
                }
                (false, true) => self.send(stream, registers, context),
                // Given up.
                (true, false) => lock(&self.burst).state = State::Idle,
                _ => {}
            }
        }
        Device::write(&mut self.dma, register, value, registers, context);
    }

    fn read(
        &mut self,
        register: dma2::Register,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) -> Option<u64> {
        let mut burst = lock(&self.burst);
        burst.catch_up(context);
        if RECEIVERS.iter().chain(&SENDERS).any(|stream| {
            stream.count == register && s0cr::EN.is_set(registers.get(stream.control))
        }) {
            return Some(registers.get(register) + burst.left());
        }
        drop(burst);
        Device::read(&mut self.dma, register, registers, context)
    }

    fn on_access(
        &mut self,
        token: u64,
        value: u64,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        if token == TOKEN {
            return;
        }
        Device::on_access(&mut self.dma, token, value, registers, context);
        for (enabled, stream) in self
            .enabled
            .iter_mut()
            .zip(RECEIVERS.iter().chain(&SENDERS))
        {
            *enabled = s0cr::EN.is_set(registers.get(stream.control));
        }
    }

    fn on_refused(
        &mut self,
        token: u64,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        if token == TOKEN {
            context.tell("S0M0AR", "a read-out's word went where no memory is");
        } else {
            Device::on_refused(&mut self.dma, token, registers, context);
        }
    }

    // From here on everything is rigless's.

    fn on_request(
        &mut self,
        change: RequestChange,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        Device::on_request(&mut self.dma, change, registers, context);
    }

    fn reset(&mut self) {
        self.enabled = [false; 4];
        Device::reset(&mut self.dma);
    }

    fn reset_line(&mut self, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        self.enabled = [false; 4];
        Device::reset_line(&mut self.dma, registers, context);
    }
}
