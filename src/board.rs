//! The NUCLEO-F429ZI: clocks, pins, interrupts and their priorities. The one file to change for another
//! board.
//!
//! | pin | | to |
//! |---|---|---|
//! | PE9 | TIM1 channel 1 | sensor, fM |
//! | PF12 | output | sensor, ICG |
//! | PF13 | output | sensor, SH |
//! | PD14 | output | converter, chip select |
//! | PD15 | TIM4 channel 4 | laser |
//! | PA5, PA6 | SPI1 | converter, SCLK, DOUT |
//! | PE11 (D5) | output, low after a reset | the switching output of the setting `limits` |
//! | PD8, PD9 | USART3 | ST-LINK's serial port, TX, RX |
//! | PA3 | input, EXTI3, pulled down | the trigger: a rising edge starts a frame (setting `trigger pin`) |
//! | PD12 | output | an RS-485 driver: high while the sensor sends |
//! | PA12 | output, low | nothing (see `keep_pa12_low`) |
//!
//! # Priorities
//!
//! From the most urgent down, each a level above the next:
//! 1. DMA and TIM5 (the clock of embassy-time). Their handlers only wake tasks, and say when a row is due.
//! 2. UART4, which carries the urgent executor: only the handlers above interrupt it from the tick to the
//!    pulses.
//! 3. USART3, a character every 87 us, or every 11 us at 921600 baud. It may wait 10 us for the pulses,
//!    because the hardware holds one character until the next has come. A slow core takes longer for the
//!    pulses, and may then lose characters at 921600 baud (docs/hardware.md).
//! 4. FLASH, after each word of a save. It only wakes the task that saves, which has no deadline. EXTI3, the
//!    trigger's edge, which notes how many pulses were given before it.
//! 5. Thread mode: computation and text. Whatever it does, rows are taken on time.

use core::arch::global_asm;
use core::sync::atomic::{AtomicU32, Ordering};

use cortex_m::peripheral::DWT;
use embassy_executor::{InterruptExecutor, SendSpawner};
use embassy_stm32::flash::{self, Flash};
use embassy_stm32::gpio::{Input, Level, Output, OutputType, Pull, Speed};
use embassy_stm32::interrupt::typelevel::Handler;
use embassy_stm32::interrupt::{InterruptExt, Priority};
use embassy_stm32::mode::Async;
use embassy_stm32::pac::gpio::vals::Pupdr;
use embassy_stm32::pac::iwdg;
use embassy_stm32::pac::usart::regs::Sr;
use embassy_stm32::spi::mode::Master;
use embassy_stm32::time::Hertz;
use embassy_stm32::timer::low_level::CountingMode;
use embassy_stm32::timer::simple_pwm::{PwmPin, SimplePwm};
use embassy_stm32::usart::{self, BufferedUart};
use embassy_stm32::wdg::IndependentWatchdog;
use embassy_stm32::{Config, Peri, bind_interrupts, dma, interrupt, pac, peripherals, rcc, spi};
use slitrange_device::protocol::MAX_ANSWER;
use slitrange_device::protocol::info::{BrownOut, Clock, Hardware};
use slitrange_device::protocol::status::StartCause;
use slitrange_device::settings::serial_line::Baud;
use static_cell::ConstStaticCell;

use super::flash::CalibrationFlash;
use super::laser::Laser;
use super::sensor_head::{
    self, LONGEST_EXPOSURE, MASTER_CLOCK_HZ, Pins, ROW_PERIOD, SCLK_HZ, SensorHead,
};
use super::shared::{COUNTERS, FRAMES};

/// The board's name.
const NAME: &str = "NUCLEO-F429ZI";

/// Core and TIM1 run at 168 MHz.
pub const CORE_HZ: u32 = 168_000_000;

/// Core cycles in a period of the sensor's master clock.
pub const CYCLES_A_MASTER_CLOCK: u32 = CORE_HZ / MASTER_CLOCK_HZ;

/// The interrupt of the serial line.
const SERIAL_INTERRUPT: interrupt::Interrupt = interrupt::USART3;

/// Outgoing characters: the longest answer, and as many characters of the readings that come meanwhile if a
/// frame is one row. With less, lines are dropped after `help estimator`. In core-coupled memory, because no
/// DMA needs it, and the stack has the room.
#[unsafe(link_section = ".ccm.to_send")]
static TO_SEND: ConstStaticCell<[u8; 2 * MAX_ANSWER]> = ConstStaticCell::new([0; 2 * MAX_ANSWER]);

/// Incoming characters: 44 ms of the line, longer than any computation in thread mode.
static RECEIVED: ConstStaticCell<[u8; RECEIVER]> = ConstStaticCell::new([0; RECEIVER]);
const RECEIVER: usize = 512;

/// How many characters wait in that buffer. embassy drops those that come to a full buffer, and tells nobody.
static WAITING: AtomicU32 = AtomicU32::new(0);

/// Notes that so many incoming characters were taken from the buffer. A character that comes to a full buffer
/// just before this is counted as lost, although it found room.
pub fn note_taken(characters: usize) {
    // A character that came between two reads of the interrupt's flags was not noted, so this must not wrap.
    let taken = characters as u32;
    let _ = WAITING.fetch_update(Ordering::Relaxed, Ordering::Relaxed, |waiting| {
        Some(waiting.saturating_sub(taken))
    });
}

static URGENT: InterruptExecutor = InterruptExecutor::new();

bind_interrupts!(struct Interrupts {
    // The order matters. The first handler notes the flags before the second clears them, and does no more:
    // a flag that is set between the two is not seen. The driver of RS-485 is switched off after the second
    // has seen the end of the last bit.
    USART3 => NoteFlags, usart::BufferedInterruptHandler<peripherals::USART3>, CountSerialErrors, ReleaseLine;
    DMA2_STREAM0 => dma::InterruptHandler<peripherals::DMA2_CH0>;
    DMA2_STREAM3 => dma::InterruptHandler<peripherals::DMA2_CH3>;
    FLASH => flash::InterruptHandler;
});

/// The board, ready.
pub struct Board {
    /// The sensor head.
    pub sensor: SensorHead,
    /// The serial line.
    pub serial: BufferedUart<'static>,
    /// The switching output of the setting `limits`.
    pub switch: Output<'static>,
    /// Where the store keeps the configuration.
    pub flash: CalibrationFlash,
    /// The watchdog. It runs already: if the start hangs before the first pet, the board starts again.
    pub watchdog: IndependentWatchdog<'static, peripherals::IWDG>,
    /// What made the board start.
    pub started_by: StartCause,
    /// What `info` says about it.
    pub hardware: Hardware,
}

// Clears the statics in core-coupled RAM before anything else runs. cortex-m-rt calls this function, and
// clears the statics in the other RAM only. memory.x gives both addresses, which are multiples of 4.
global_asm!(
    ".section .text.__pre_init, \"ax\"",
    ".global __pre_init",
    ".type __pre_init, %function",
    ".thumb_func",
    "__pre_init:",
    "movs r0, #0",
    "ldr r1, =_ccm_start",
    "ldr r2, =_ccm_end",
    "2:",
    "cmp r1, r2",
    "beq 3f",
    "str r0, [r1], #4",
    "b 2b",
    "3:",
    "bx lr",
    ".ltorg",
    ".size __pre_init, . - __pre_init",
);

/// Enables caches and prefetch, which hide most of flash's five wait states (RM0090 section 3.5).
/// embassy-stm32 0.6.0 sets the wait states only.
fn enable_flash_accelerator() {
    embassy_stm32::pac::FLASH.acr().modify(|acr| {
        acr.set_icen(true);
        acr.set_dcen(true);
        acr.set_prften(true);
    });
}

/// Sets up clocks and peripherals. Call once, first.
pub fn init() -> Board {
    start_watchdog();
    set_up_core();
    let clock = start_clock();
    let p = init_chip(clock);
    enable_flash_accelerator();
    let started_by = start_cause();
    defmt::info!(
        "slitrange started by {}",
        defmt::Display2Format(&started_by)
    );

    for (interrupt, priority) in [
        (interrupt::TIM5, Priority::P1),
        (interrupt::UART4, Priority::P2),
        (SERIAL_INTERRUPT, Priority::P3),
        (interrupt::FLASH, Priority::P4),
        (interrupt::EXTI3, Priority::P4),
    ] {
        interrupt.set_priority(priority);
    }
    let mut watchdog = IndependentWatchdog::new(p.IWDG, super::watchdog::TIMEOUT_US);
    watchdog.unleash();

    let pin = PwmPin::new(p.PE9, OutputType::PushPull);
    let mut master_clock = SimplePwm::new(
        p.TIM1,
        Some(pin),
        None,
        None,
        None,
        Hertz(MASTER_CLOCK_HZ),
        CountingMode::EdgeAlignedUp,
    );
    master_clock.ch1().set_duty_cycle_fraction(1, 2);
    master_clock.ch1().enable();

    let mut config = spi::Config::default();
    config.frequency = Hertz(SCLK_HZ);
    config.mode = spi::MODE_3;
    // Words of an absent converter are then all ones, which no row is.
    config.miso_pull = Pull::Up;
    let sensor = SensorHead::new(
        spi::Spi::new_rxonly(
            p.SPI1, p.PA5, p.PA6, p.DMA2_CH3, p.DMA2_CH0, Interrupts, config,
        ),
        Pins::new(
            p.PF12.into(),
            p.PF13.into(),
            p.PD14.into(),
            Laser::new(p.TIM4, p.PD15),
        ),
        master_clock,
    );

    let mut config = usart::Config::default();
    config.baudrate = Baud::default().bits_a_second();
    let serial = BufferedUart::new(
        p.USART3,
        p.PD9,
        p.PD8,
        TO_SEND.take(),
        RECEIVED.take(),
        Interrupts,
        config,
    );
    // The configuration is constant: a wrong one fails at the first start.
    let serial = defmt::unwrap!(serial);

    // Dropping the output would make the pin an input again.
    core::mem::forget(Output::new(p.PD12, Level::Low, Speed::Low));
    watch_trigger(p.PA3);
    keep_pa12_low(p.PA12);
    let flash = Flash::new(p.FLASH, Interrupts).into_regions();

    Board {
        sensor,
        serial,
        switch: Output::new(p.PE11, Level::Low, Speed::Low),
        flash: CalibrationFlash::new(flash.bank2_region1),
        watchdog,
        started_by,
        hardware: Hardware {
            board: NAME,
            head: sensor_head::NAME,
            row_us: ROW_PERIOD.as_micros() as u32,
            longest_exposure: LONGEST_EXPOSURE,
            clock,
            brown_out: brown_out(),
        },
    }
}

/// Starts the watchdog, which no bug after this can stop. Its first timeout is that of every start, 0.3 to
/// 1 s.
fn start_watchdog() {
    // A breakpoint stops the watchdog too.
    pac::DBGMCU.apb1fzr().modify(|freeze| freeze.set_iwdg(true));
    pac::IWDG
        .kr()
        .write(|kr| kr.set_key(iwdg::vals::Key::START));
}

/// How long the ST-LINK's clock may take to come: it comes some 2 s after the power if the board is not
/// powered by the ST-LINK.
const CLOCK_TIMEOUT_MS: u32 = 3000;

/// The chip starts with its own oscillator, in kHz.
const OWN_CLOCK_KHZ: u32 = 16_000;

/// Waits for the clock from the ST-LINK. embassy would wait for ever.
fn start_clock() -> Clock {
    pac::RCC.cr().modify(|cr| {
        cr.set_hsebyp(true);
        cr.set_hseon(true);
    });
    let start = cycles();
    while cycles().wrapping_sub(start) < CLOCK_TIMEOUT_MS * OWN_CLOCK_KHZ {
        if pac::RCC.cr().read().hserdy() {
            return Clock::External;
        }
        pac::IWDG
            .kr()
            .write(|kr| kr.set_key(iwdg::vals::Key::RESET));
        cortex_m::asm::delay(OWN_CLOCK_KHZ);
    }
    pac::RCC.cr().modify(|cr| cr.set_hseon(false));
    Clock::Internal
}

/// The supply below which the chip resets itself, as its option bytes say (RM0090 section 3.9.10). The
/// firmware never writes them.
fn brown_out() -> BrownOut {
    match pac::FLASH.optcr().read().bor_lev() {
        0 => BrownOut::Below(2700),
        1 => BrownOut::Below(2400),
        2 => BrownOut::Below(2100),
        _ => BrownOut::Off,
    }
}

/// Sets up embassy, and clears the flags that its set-up raises in TIM5.
///
/// embassy-stm32 0.6.0 generates an update while compare register 1 is still 0, which counts as a match. Its
/// interrupt would then count half a wrap of TIM5 that has not passed. From then on, time would fall back by
/// 65 ms for a moment at each wrap, from the wrap to its interrupt. An alarm due in that moment would ring 65
/// ms late, and the pulses that it should have brought would follow at once, 5 us apart.
fn init_chip(clock: Clock) -> embassy_stm32::Peripherals {
    cortex_m::interrupt::free(|_| {
        let p = embassy_stm32::init(config(clock));
        pac::TIM5.sr().write(|_| ());
        interrupt::TIM5.unpend();
        p
    })
}

/// Keeps PA12 low. On chips before revision 3, reading bank 2 of the flash may go wrong while PA12 changes
/// (STM32F42xx errata sheet, section 2.2.11). The pin must be an output that stays low, with its pull-down.
/// embassy-stm32's flash driver panics if it is not.
fn keep_pa12_low(pin: Peri<'static, peripherals::PA12>) {
    // Dropping the output would make the pin an input again.
    core::mem::forget(Output::new(pin, Level::Low, Speed::Low));
    pac::GPIOA
        .pupdr()
        .modify(|pulls| pulls.set_pupdr(12, Pupdr::PULL_DOWN));
}

/// The pin of port D that enables the line's driver, with RS-485.
const DRIVER_ENABLE: usize = 12;

/// Hands bytes over to embassy's transmitter by `write`, with the line's driver enabled from before the first
/// bit on. [`ReleaseLine`] disables it after the last one.
pub fn hand_over_bytes<T>(write: impl FnOnce() -> T) -> T {
    // Without the serial line's interrupt, nothing releases the line before the bytes have come.
    SERIAL_INTERRUPT.disable();
    pac::GPIOD
        .bsrr()
        .write(|pins| pins.set_bs(DRIVER_ENABLE, true));
    let written = write();
    SERIAL_INTERRUPT.pend();
    // SAFETY: the interrupt was enabled before, and nothing here depends on its absence.
    unsafe { SERIAL_INTERRUPT.enable() };
    written
}

/// Disables the line's driver once the last bit has left.
struct ReleaseLine;

impl Handler<interrupt::typelevel::USART3> for ReleaseLine {
    unsafe fn on_interrupt() {
        // embassy's handler, which ran before, waits for TXE while bytes wait, and for TC from the last byte
        // on.
        let control = pac::USART3.cr1().read();
        if !control.txeie() && !control.tcie() {
            pac::GPIOD
                .bsrr()
                .write(|pins| pins.set_br(DRIVER_ENABLE, true));
        }
    }
}

/// The trigger's line of EXTI. After a reset, line 3 is that of PA3 (RM0090 section 9.2.3).
const TRIGGER: usize = 3;

/// Lets rising edges of the trigger interrupt.
fn watch_trigger(pin: Peri<'static, peripherals::PA3>) {
    // Dropping the input would take its pull-down away.
    core::mem::forget(Input::new(pin, Pull::Down));
    pac::EXTI
        .rtsr(0)
        .modify(|rising| rising.set_line(TRIGGER, true));
    // SAFETY: the handler below needs nothing that is not ready.
    unsafe { interrupt::EXTI3.enable() };
}

/// Lets edges at the trigger's pin interrupt, or not: noise at a pin that nobody uses takes no time.
pub fn listen_to_trigger(listens: bool) {
    // An edge of before counts no more. Writing a one clears the line's flag, and no other.
    pac::EXTI.pr(0).write(|edges| edges.set_line(TRIGGER, true));
    pac::EXTI
        .imr(0)
        .modify(|enabled| enabled.set_line(TRIGGER, listens));
}

/// An edge at the trigger's pin.
#[interrupt]
fn EXTI3() {
    // Writing a one clears the line's flag, and no other.
    pac::EXTI.pr(0).write(|edges| edges.set_line(TRIGGER, true));
    FRAMES.take_edge();
}

/// The sensor's converter.
pub type Converter = spi::Spi<'static, Async, Master>;

/// The sensor's master clock.
pub type MasterClock = SimplePwm<'static, peripherals::TIM1>;

/// When the master clock rose last, by the cycle counter. TIM1 counts at the core's speed, and its output
/// rises as it wraps.
pub fn master_clock_rose() -> u32 {
    let since = pac::TIM1.cnt().read().0 & 0xFFFF;
    cycles().wrapping_sub(since)
}

/// Waits until the cycle counter is `due`, and raises ICG: 3 to 6 instructions later, because ICG must rise
/// within 32 cycles. Returns the core cycles since the master clock rose, read after the edge.
pub fn raise_icg_at(due: u32) -> u32 {
    let since_master_clock_rose: u32;
    // SAFETY: reads two counters, and sets a pin that only the owner of the sensor head calls for.
    unsafe {
        core::arch::asm!(
            "2:",
            "ldr {counter}, [{cycles}]",
            "subs {counter}, {counter}, {due}",
            "bmi 2b",
            "str {icg}, [{port}]",
            "ldr {counter}, [{timer}]",
            cycles = in(reg) &raw const (*DWT::PTR).cyccnt,
            due = in(reg) due,
            icg = in(reg) 1 << 12,
            port = in(reg) pac::GPIOF.bsrr().as_ptr(),
            timer = in(reg) pac::TIM1.cnt().as_ptr(),
            counter = out(reg) since_master_clock_rose,
            options(nostack),
        );
    }
    since_master_clock_rose & 0xFFFF
}

/// Words that the read-out under way still has to bring: the count of the DMA stream that receives.
pub fn words_to_come() -> u32 {
    u32::from(pac::DMA2.st(0).ndtr().read().ndt())
}

/// Starts the executor for what must be on time.
pub fn start_urgent_executor() -> SendSpawner {
    URGENT.start(interrupt::UART4)
}

/// The urgent executor runs in the interrupt of UART4. The port itself is not used.
#[interrupt]
unsafe fn UART4() {
    // SAFETY: this is the interrupt of the executor, and nothing else calls `on_interrupt`. The interrupt
    // comes only after `start` enabled it.
    unsafe { URGENT.on_interrupt() }
}

/// 8 MHz from the ST-LINK or 16 MHz from the chip's own oscillator, 168 MHz for the core, 84 MHz for SPI1
/// (APB2), 42 MHz for USART3 (APB1).
fn config(clock: Clock) -> Config {
    let mut config = Config::default();
    let (source, divider) = match clock {
        Clock::External => {
            config.rcc.hse = Some(rcc::Hse {
                freq: Hertz(8_000_000),
                mode: rcc::HseMode::Bypass,
            });
            (rcc::PllSource::HSE, rcc::PllPreDiv::DIV4)
        }
        Clock::Internal => (rcc::PllSource::HSI, rcc::PllPreDiv::DIV8),
    };
    config.rcc.pll_src = source;
    // 2 MHz * 168 / 2 = 168 MHz. / 7 = 48 MHz, which nothing uses, but the PLL must be within its limits.
    config.rcc.pll = Some(rcc::Pll {
        prediv: divider,
        mul: rcc::PllMul::MUL168,
        divp: Some(rcc::PllPDiv::DIV2),
        divq: Some(rcc::PllQDiv::DIV7),
        divr: None,
    });
    config.rcc.sys = rcc::Sysclk::PLL1_P;
    config.rcc.ahb_pre = rcc::AHBPrescaler::DIV1;
    config.rcc.apb1_pre = rcc::APBPrescaler::DIV4;
    config.rcc.apb2_pre = rcc::APBPrescaler::DIV2;
    config.dma_interrupt_priority = Priority::P1;
    config
}

/// Reads the reset flags and clears them for the next start. Every reset raises its own flag and the pin's,
/// because the chip pulls its reset pin itself. So the pin is the cause only if no other flag is raised. A
/// power-on raises PORRSTF and BORRSTF, a dip of the supply BORRSTF only (RM0090 section 6.3.21).
fn start_cause() -> StartCause {
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

/// Resets the chip: it starts as after power-on.
pub fn reset() -> ! {
    cortex_m::peripheral::SCB::sys_reset()
}

unsafe extern "C" {
    /// The end of the statics. The stack grows down towards it.
    static __sheap: u8;
}

/// Bytes of the guard between stack and statics: more than most functions take at a time.
const STACK_GUARD: usize = 4096;

/// Sets up what belongs to the core: the cycle counter, by which the sensor's pulses are timed, and two
/// safeguards.
fn set_up_core() {
    // SAFETY: called once, before anything else could use these registers.
    let mut core = unsafe { cortex_m::Peripherals::steal() };
    core.DCB.enable_trace();
    core.DWT.enable_cycle_counter();

    // Erratum 838869 of the core, in all revisions of the chip: a store that is buffered may let an interrupt
    // come twice (errata sheet ES0206, section 2.1.3). DISDEFWBUF switches the buffer off.
    const DISDEFWBUF: u32 = 1 << 1;
    // SAFETY: the bit changes the order in which stores reach memory, and no program depends on that order.
    unsafe { core.ICB.actlr.modify(|actlr| actlr | DISDEFWBUF) };

    // An access to the guard is a fault, after which the watchdog starts the board again. Region 0, no
    // access, no code; elsewhere the memory is as without a guard (ARMv7-M manual, section B3.5).
    let guard = (&raw const __sheap).addr().next_multiple_of(STACK_GUARD) as u32;
    const VALID_REGION_0: u32 = 1 << 4;
    const NO_CODE: u32 = 1 << 28;
    const SIZE: u32 = (STACK_GUARD.ilog2() - 1) << 1;
    const ENABLE: u32 = 1;
    const ELSEWHERE_AS_BEFORE: u32 = 1 << 2;
    // SAFETY: nothing but a stack that is too deep uses the memory of the guard.
    unsafe {
        core.MPU.rbar.write(guard | VALID_REGION_0);
        core.MPU.rasr.write(NO_CODE | SIZE | ENABLE);
        core.MPU.ctrl.write(ELSEWHERE_AS_BEFORE | ENABLE);
    }
    cortex_m::asm::dsb();
    cortex_m::asm::isb();
}

/// The core's cycle counter. It wraps every 25 s; differences of shorter times are right.
pub fn cycles() -> u32 {
    DWT::cycle_count()
}

/// The serial line's flags at the begin of its interrupt.
static FLAGS: AtomicU32 = AtomicU32::new(0);

/// Notes the flags.
struct NoteFlags;

impl Handler<interrupt::typelevel::USART3> for NoteFlags {
    unsafe fn on_interrupt() {
        // Reading SR alone clears nothing.
        FLAGS.store(pac::USART3.sr().read().0, Ordering::Relaxed);
    }
}

/// Counts receive errors, and characters that find the buffer full. embassy's driver clears the errors and
/// logs them, but tells nobody.
struct CountSerialErrors;

impl Handler<interrupt::typelevel::USART3> for CountSerialErrors {
    unsafe fn on_interrupt() {
        let flags = Sr(FLAGS.load(Ordering::Relaxed));
        if flags.rxne() {
            let is_full = WAITING.load(Ordering::Relaxed) >= RECEIVER as u32;
            COUNTERS.serial_overrun.add_if(is_full);
            WAITING.fetch_add(u32::from(!is_full), Ordering::Relaxed);
        }
        // Nearly always there is no error, and an interrupt comes for each character.
        if !(flags.ne() || flags.fe() || flags.ore()) {
            return;
        }
        COUNTERS.serial_noise.add_if(flags.ne());
        COUNTERS.serial_framing.add_if(flags.fe());
        COUNTERS.serial_overrun.add_if(flags.ore());
    }
}
