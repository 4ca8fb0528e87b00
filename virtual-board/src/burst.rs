//! Models of SPI1 and DMA2 that move the words of a read-out in batches, so that the emulation is faster.
//!
//! **Why.** rigless's own models wake up for each word that SPI1 receives, and each word passes through both
//! DMA controllers. A row has 3694 words, so reading row after row moves 650,000 words in a virtual second.
//! This took nine tenths of the emulation's time.
//!
//! **How.** While both DMA streams of a read-out run, the firmware does not look at single words. So
//! [`BATCH`] words at a time are taken from the sensor head and written to memory together. The head gets the
//! end of each word's time, and so gives each word the right pixel. The last [`LAST`] words of each stream
//! pass through rigless's DMA2, which ends the transfer, sets the flags and raises the interrupts.
//!
//! **What differs.** Each access to a register of SPI1 or DMA2, and each edge of a pin, first moves the words
//! that have ended by then. Two things differ from silicon in the middle of a read-out: a word may reach the
//! buffer up to [`BATCH`] words late, and a stream's memory address register holds the address of the last
//! words.
//!
//! **DMA's latency.** On silicon DMA counts a word some cycles after it ended, because other accesses come
//! first. A read of a stream's counter sees each word 0 to [`Timing::most_latency`] cycles late.
//!
//! **A gap.** [`Timing::gap`] pauses SCLK after a word, as if DMA had fed SPI1 too late.
//!
//! **Without a rate limit.** The words after the lead-in end with its last word if the head has no rate limit
//! (`Conditions::has_rate_limit`). Only the last [`LAST`] words
//! still take their time on SPI1.
//!
//! **When.** Only read-outs that are set up as the firmware's driver does it move in batches: words of 16
//! bits, no FIFO, no circular or double buffer, no interrupt half way, and one converter on the bus. rigless
//! moves all other transfers word by word.

use std::sync::{Arc, Mutex};

use rigless::device::{Device, DeviceContext as Context, RegisterFile as Registers, RequestChange};
use rigless::soc::Width;
use rigless::soc::stm32f427::generated::dma2::{Register as Dma2, s0cr, s0fcr};
use rigless::soc::stm32f427::generated::spi1::{Register as Spi1, cr1, cr2, sr};
use rigless::soc::stm32f427::peripherals::dma::Dma;
use rigless::soc::stm32f427::peripherals::rcc;
use rigless::soc::stm32f427::peripherals::spi::Spi;
use rigless::time::{EventId, VirtualNanos};

use crate::base::{CLOCK_HZ, Nanos, lock};
use crate::forward::forward;
use crate::random;
use crate::sensor_head::SharedHead;
use crate::sensor_head::limits::WORD_BITS;

/// DMA2, which serves SPI1, in rigless's order.
pub(crate) const DMA2: usize = 1;

/// SPI1's data register, where the DMA streams that serve the converter read and write.
const SPI1_DATA: u64 = 0x4001_300C;

/// Words in a batch: 0.2 ms of a read-out.
const BATCH: u64 = 128;

/// The last words of a stream, which rigless moves one by one.
const LAST: u64 = 2;

/// The shortest transfer that moves in batches, in words.
const SHORTEST: u64 = 64;

/// Marks the memory accesses of a batch. rigless's streams use small tokens.
const TOKEN: u64 = u64::MAX;

/// SPI1's channel of DMA2 (RM0090 table 44).
const CHANNEL: u64 = 3;

/// DATA SIZE: 16 bits (RM0090 section 10.5.5).
const HALF_WORD: u64 = 1;

/// Memory to peripheral (RM0090 section 10.5.5).
const TO_PERIPHERAL: u64 = 1;

struct Stream {
    control: Dma2,
    count: Dma2,
    peripheral: Dma2,
    memory: Dma2,
    second_memory: Dma2,
    fifo: Dma2,
}

/// The streams that serve SPI1 (RM0090 table 44): those that receive from it, and then those that send to it.
const STREAMS: [Stream; 4] = {
    use Dma2::*;
    [
        stream([S0cr, S0ndtr, S0par, S0m0ar, S0m1ar, S0fcr]),
        stream([S2cr, S2ndtr, S2par, S2m0ar, S2m1ar, S2fcr]),
        stream([S3cr, S3ndtr, S3par, S3m0ar, S3m1ar, S3fcr]),
        stream([S5cr, S5ndtr, S5par, S5m0ar, S5m1ar, S5fcr]),
    ]
};

const RECEIVERS: usize = 2;

const fn stream(registers: [Dma2; 6]) -> Stream {
    let [control, count, peripheral, memory, second_memory, fifo] = registers;
    Stream {
        control,
        count,
        peripheral,
        memory,
        second_memory,
        fifo,
    }
}

/// The memory addresses of the streams that serve the converter.
pub(crate) fn memory_addresses(registers: &Registers) -> Vec<u64> {
    let mut addresses = Vec::new();
    let serves = |it: &&Stream| registers.get(it.peripheral) == SPI1_DATA;
    for stream in STREAMS.iter().filter(serves) {
        addresses.push(registers.get(stream.memory));
        if s0cr::DBM.is_set(registers.get(stream.control)) {
            addresses.push(registers.get(stream.second_memory));
        }
    }
    addresses
}

#[derive(Debug)]
enum State {
    /// rigless moves every word.
    Idle,
    /// The receiving stream is on.
    Receiving(Words),
    /// Both streams are on, but SPI1 is off.
    Ready(Words),
    /// SPI1 clocks words.
    Running { words: Words, pace: Pace },
}

#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Timing {
    /// The most core cycles from the end of a word until DMA has counted it.
    pub(crate) most_latency: u64,
    /// A word of each read-out, from 0, and for how long SCLK pauses after it, ns.
    pub(crate) gap: Option<(u64, Nanos)>,
}

#[derive(Clone, Copy, Debug)]
struct Pace {
    /// SPI1 has clocked words since then.
    start: Nanos,
    bit_hz: u64,
    /// The last word that takes its time. Words after it end with it.
    last_timed: u64,
    timing: Timing,
}

impl Pace {
    fn new(start: Nanos, bit_hz: u64, head: &SharedHead, timing: Timing) -> Self {
        let last_timed = match lock(head).has_rate_limit {
            true => u64::MAX,
            // The firmware raises ICG in word 3, and word 4 shows the first pixel.
            false => 3,
        };
        Self {
            start,
            bit_hz,
            last_timed,
            timing,
        }
    }

    /// When word `done` (from 0) ends. Rounded as rigless rounds: the remainders of the division add up. A
    /// stream counts to 2^16, so the product is below 2^50.
    fn end_of_word(&self, done: u64) -> Nanos {
        let timed = done.min(self.last_timed);
        let pause = match self.timing.gap {
            Some((last, pause)) if done > last => pause,
            _ => 0,
        };
        self.start + (timed + 1) * u64::from(WORD_BITS) * 1_000_000_000 / self.bit_hz + pause
    }

    /// When DMA has counted word `done`: a random time after its end, the same in each run.
    fn count_of_word(&self, done: u64) -> Nanos {
        let random = random::mixed(self.start.wrapping_add(done));
        let cycles = random % (self.timing.most_latency + 1);
        self.end_of_word(done) + cycles * 1_000_000_000 / CLOCK_HZ
    }
}

#[derive(Clone, Copy, Debug)]
struct Words {
    address: u64,
    count: u64,
    /// How many words are in memory already.
    done: u64,
}

/// The read-out under way, which the models of SPI1 and DMA2 share.
#[derive(Debug)]
pub(crate) struct Burst {
    state: State,
    head: SharedHead,
    timing: Timing,
}

type SharedBurst = Arc<Mutex<Burst>>;

impl Burst {
    fn left(&self) -> u64 {
        match &self.state {
            State::Idle => 0,
            State::Receiving(words) | State::Ready(words) | State::Running { words, .. } => {
                words.count - words.done
            }
        }
    }

    fn catch_up(&mut self, context: &mut Context<'_>) {
        self.move_words(context, Pace::end_of_word);
    }

    /// Moves the words to memory of which the time that `due` gives has come.
    fn move_words(&mut self, context: &mut Context<'_>, due: fn(&Pace, u64) -> Nanos) {
        let State::Running { words, pace } = &mut self.state else {
            return;
        };
        let mut head = lock(&self.head);
        // Four words are written at once where the address allows it.
        let mut address = words.address + 2 * words.done;
        let (mut gathered, mut bits) = (0, 0);
        while words.done < words.count {
            if due(pace, words.done) > context.now().0 {
                break;
            }
            let end = pace.end_of_word(words.done);
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

    /// When the batch under way ends; `None` without a batch.
    fn next_end(&self) -> Option<Nanos> {
        let State::Running { words, pace } = &self.state else {
            return None;
        };
        Some(pace.end_of_word((words.done + BATCH).min(words.count) - 1))
    }
}

/// Makes the two models, which share a read-out.
pub(crate) fn pair(dma: Dma, head: &SharedHead, timing: Timing) -> (BurstSpi, BurstDma) {
    let burst = Arc::new(Mutex::new(Burst {
        state: State::Idle,
        head: Arc::clone(head),
        timing,
    }));
    let spi = BurstSpi {
        spi: Spi::with_clock(rcc::HSI_HZ),
        clock_hz: rcc::HSI_HZ,
        next: None,
        burst: Arc::clone(&burst),
    };
    let dma = BurstDma {
        dma,
        enabled: [false; 4],
        shortens: true,
        burst,
    };
    (spi, dma)
}

#[derive(Debug)]
pub(crate) struct BurstSpi {
    /// rigless's model, to which the converter is connected.
    pub(crate) spi: Spi,
    clock_hz: u64,
    /// The event that ends the batch under way.
    next: Option<EventId>,
    burst: SharedBurst,
}

impl BurstSpi {
    pub(crate) fn timing(&mut self, change: impl FnOnce(&mut Timing)) -> Timing {
        let timing = &mut lock(&self.burst).timing;
        change(timing);
        *timing
    }

    /// Calls rigless's model. While words move in batches, the model must not request DMA.
    fn inner<T>(
        &mut self,
        registers: &mut Registers,
        call: impl FnOnce(&mut Spi, &mut Registers) -> T,
    ) -> T {
        if matches!(lock(&self.burst).state, State::Idle) {
            return call(&mut self.spi, registers);
        }
        let requests = cr2::RXDMAEN.mask() | cr2::TXDMAEN.mask();
        let control = registers.get(Spi1::Cr2);
        registers.set(Spi1::Cr2, control & !requests);
        let result = call(&mut self.spi, registers);
        registers.set(Spi1::Cr2, control);
        result
    }

    /// Begins the batches when SPI1 and both streams are on, and ends them when SPI1 is off.
    fn look(&mut self, registers: &mut Registers, context: &mut Context<'_>) {
        let mut burst = lock(&self.burst);
        let runs = clocks_words(registers) && self.clock_hz > 0;
        match burst.state {
            State::Ready(words) if runs => {
                let divider = 2 << cr1::BR.get(registers.get(Spi1::Cr1));
                let bit_hz = (self.clock_hz / divider).max(1);
                let pace = Pace::new(context.now().0, bit_hz, &burst.head, burst.timing);
                burst.state = State::Running { words, pace };
                set_busy(registers, true);
                let end = burst.next_end();
                self.next = end.map(|end| context.schedule(VirtualNanos(end)));
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
fn clocks_words(registers: &Registers) -> bool {
    let (first, second) = (registers.get(Spi1::Cr1), registers.get(Spi1::Cr2));
    let needed = cr1::SPE.mask() | cr1::MSTR.mask() | cr1::DFF.mask();
    let other =
        cr1::RXONLY.mask() | cr1::CRCEN.mask() | cr1::BIDIMODE.mask() | cr1::LSBFIRST.mask();
    first & (needed | other) == needed
        && cr2::RXDMAEN.is_set(second)
        && cr2::TXDMAEN.is_set(second)
        && !cr2::FRF.is_set(second)
}

fn set_busy(registers: &mut Registers, busy: bool) {
    registers.set(Spi1::Sr, sr::BSY.set(registers.get(Spi1::Sr), busy.into()));
}

impl Device for BurstSpi {
    type Register = Spi1;

    fn on_event(&mut self, event: EventId, at: &mut Registers, context: &mut Context<'_>) {
        if self.next != Some(event) {
            self.inner(at, |spi, at| Device::on_event(spi, event, at, context));
            return;
        }
        // If SPI1 or its requests were switched off without a register access, the words stop here.
        self.look(at, context);
        let mut burst = lock(&self.burst);
        burst.catch_up(context);
        let ends = burst.left() == 0;
        let end = burst.next_end().filter(|_| !ends);
        self.next = end.map(|end| context.schedule(VirtualNanos(end)));
        if ends {
            burst.state = State::Idle;
            drop(burst);
            set_busy(at, false);
            // Now rigless's model requests DMA for the last words.
            Device::write(&mut self.spi, Spi1::Cr2, at.get(Spi1::Cr2), at, context);
        }
    }

    fn read(&mut self, what: Spi1, at: &mut Registers, context: &mut Context<'_>) -> Option<u64> {
        lock(&self.burst).catch_up(context);
        self.inner(at, |spi, at| Device::read(spi, what, at, context))
    }

    fn write(&mut self, what: Spi1, value: u64, at: &mut Registers, context: &mut Context<'_>) {
        lock(&self.burst).catch_up(context);
        self.inner(at, |spi, at| Device::write(spi, what, value, at, context));
        self.look(at, context);
    }

    fn on_request(&mut self, change: RequestChange, at: &mut Registers, context: &mut Context<'_>) {
        lock(&self.burst).catch_up(context);
        Device::on_request(&mut self.spi, change, at, context);
    }

    fn on_clock(&mut self, hz: u64, at: &mut Registers, context: &mut Context<'_>) {
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
        self.inner(at, |spi, at| Device::on_clock(spi, hz, at, context));
    }

    fn on_refused(&mut self, _: u64, _: &mut Registers, context: &mut Context<'_>) {
        context.tell("DR", "a read-out's word went where no memory is");
    }

    forward! { Device for spi:
        fn peek(&self, register: Spi1, registers: &Registers, now: VirtualNanos) -> Option<u64>;
    }

    fn reset(&mut self) {
        lock(&self.burst).state = State::Idle;
        Device::reset(&mut self.spi);
    }

    fn reset_line(&mut self, registers: &mut Registers, context: &mut Context<'_>) {
        lock(&self.burst).state = State::Idle;
        Device::reset_line(&mut self.spi, registers, context);
    }
}

#[derive(Debug)]
pub(crate) struct BurstDma {
    dma: Dma,
    enabled: [bool; 4],
    pub(crate) shortens: bool,
    burst: SharedBurst,
}

impl BurstDma {
    fn give_up(&mut self) {
        self.enabled = [false; 4];
        lock(&self.burst).state = State::Idle;
    }

    /// Shortens a stream that is being switched on by the words of the batches, so that rigless moves only
    /// the last words.
    fn shorten(
        &mut self,
        stream: &Stream,
        words: u64,
        registers: &mut Registers,
        context: &mut Context<'_>,
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

    /// A receiving stream is switched on: its words move in batches if it is a plain stream.
    fn receive(&mut self, stream: &Stream, registers: &mut Registers, context: &mut Context<'_>) {
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

    /// A sending stream is switched on: it must match the receiving stream.
    fn send(&mut self, stream: &Stream, registers: &mut Registers, context: &mut Context<'_>) {
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

/// Whether a stream that is being switched on is plain: it moves one half word between SPI1 and memory for
/// each request, and then ends.
fn is_plain(stream: &Stream, direction: u64, registers: &Registers) -> bool {
    use s0cr::{CHSEL, DIR, DMEIE, EN, MINC, MSIZE, PL, PSIZE, TCIE, TEIE};
    let free = [EN, DMEIE, TEIE, TCIE, MINC, PL];
    let free = free.iter().fold(0, |mask, field| mask | field.mask());
    let mut plain = DIR.set(CHSEL.set(0, CHANNEL), direction);
    plain = MSIZE.set(PSIZE.set(plain, HALF_WORD), HALF_WORD);
    registers.get(stream.control) & !free == plain
        && registers.get(stream.peripheral) == SPI1_DATA
        && !s0fcr::DMDIS.is_set(registers.get(stream.fifo))
}

impl Device for BurstDma {
    type Register = Dma2;

    fn write(&mut self, what: Dma2, value: u64, at: &mut Registers, context: &mut Context<'_>) {
        lock(&self.burst).catch_up(context);
        let streams = STREAMS.iter().enumerate();
        for (index, stream) in streams.filter(|(_, stream)| stream.control == what) {
            let was_enabled = std::mem::replace(&mut self.enabled[index], s0cr::EN.is_set(value));
            match (was_enabled, self.enabled[index]) {
                (false, true) if index < RECEIVERS => self.receive(stream, at, context),
                (false, true) => self.send(stream, at, context),
                // The firmware gave the read-out up.
                (true, false) => lock(&self.burst).state = State::Idle,
                _ => {}
            }
        }
        Device::write(&mut self.dma, what, value, at, context);
    }

    fn read(&mut self, what: Dma2, at: &mut Registers, context: &mut Context<'_>) -> Option<u64> {
        let mut burst = lock(&self.burst);
        burst.move_words(context, Pace::count_of_word);
        let is_on = |it: &Stream| s0cr::EN.is_set(at.get(it.control));
        if STREAMS.iter().any(|it| it.count == what && is_on(it)) {
            return Some(at.get(what) + burst.left());
        }
        drop(burst);
        Device::read(&mut self.dma, what, at, context)
    }

    fn on_access(&mut self, token: u64, value: u64, at: &mut Registers, context: &mut Context<'_>) {
        if token == TOKEN {
            return;
        }
        Device::on_access(&mut self.dma, token, value, at, context);
        for (enabled, stream) in self.enabled.iter_mut().zip(&STREAMS) {
            *enabled = s0cr::EN.is_set(at.get(stream.control));
        }
    }

    fn on_refused(&mut self, token: u64, registers: &mut Registers, context: &mut Context<'_>) {
        if token == TOKEN {
            context.tell("S0M0AR", "a read-out's word went where no memory is");
        } else {
            Device::on_refused(&mut self.dma, token, registers, context);
        }
    }

    forward! { Device for dma:
        fn on_request(&mut self, change: RequestChange, at: &mut Registers, context: &mut Context<'_>);
    }

    fn reset(&mut self) {
        self.give_up();
        Device::reset(&mut self.dma);
    }

    fn reset_line(&mut self, registers: &mut Registers, context: &mut Context<'_>) {
        self.give_up();
        Device::reset_line(&mut self.dma, registers, context);
    }
}
