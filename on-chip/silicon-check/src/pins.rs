//! The chip, and the firmware's pins that need no wire: a port shows the level of each of its pins, outputs
//! too.

use embassy_futures::join::join;
use embassy_futures::poll_once;
use embassy_futures::yield_now;
use embassy_stm32::pac;
use embassy_stm32::pac::gpio::Gpio;
use embassy_stm32::pac::gpio::vals::{Idr, Pupdr};
use embassy_time::{Duration, Timer, with_timeout};
use slitrange::base::exposure::Exposure;
use slitrange::light::ambient::AmbientMode;
use slitrange_device::settings::serial_line::{Baud, Bits};
use slitrange_device::settings::trigger::Trigger;

use crate::board::{self, Receiver, cycles, cycles_in_ns};
use crate::counters::COUNTERS;
use crate::laser_order::LASER;
use crate::report::{Report, text};
use crate::rows::ROWS;
use crate::trigger::FRAMES;

/// The STM32F42x and F43x (RM0090 section 38.6.1).
const DEVICE: u16 = 0x419;

/// Gives the rows that came back to acquisition. Nobody reads them.
pub async fn free_rows() {
    while let Ok(row) = ROWS.full.try_receive() {
        ROWS.free.send(row.words).await;
    }
    yield_now().await;
}

fn is_high(port: Gpio, pin: usize) -> bool {
    port.idr().read().idr(pin) == Idr::HIGH
}

pub async fn check_chip(report: &mut Report) {
    let id = pac::DBGMCU.idcode().read();
    let (device, revision) = (id.dev_id(), id.rev_id());
    let found = text!("device {device:#05x}, revision {revision:#06x}");
    let look_at = "the firmware is for an STM32F429, device 0x419";
    report
        .check("chip", device == DEVICE, &found, look_at)
        .await;
}

/// Call it just after a line: it is still being sent.
pub async fn check_driver_enable(report: &mut Report) {
    const PIN: usize = 12;
    let sending = is_high(pac::GPIOD, PIN);
    report.flush().await;
    let resting = is_high(pac::GPIOD, PIN);
    let [sending, resting] = [sending, resting].map(|high| if high { "high" } else { "low" });
    let found = text!("PD12 is {sending} while the line sends, {resting} at rest");
    let passes = (sending, resting) == ("high", "low");
    let look_at = "something else drives PD12 (D29)";
    report.check("RS-485", passes, &found, look_at).await;
}

/// The pin's own pulls make the edges.
pub async fn check_trigger(report: &mut Report) {
    const PIN: usize = 3;
    const EDGES: u32 = 4;
    let pull = |way| pac::GPIOA.pupdr().modify(|pulls| pulls.set_pupdr(PIN, way));
    FRAMES.set_trigger(Trigger::Pin);
    board::listen_to_trigger(true);
    let before = COUNTERS.triggers_missed.get();
    for _ in 0..EDGES {
        pull(Pupdr::PULL_UP);
        Timer::after_millis(1).await;
        pull(Pupdr::PULL_DOWN);
        Timer::after_millis(1).await;
    }
    board::listen_to_trigger(false);
    FRAMES.set_trigger(Trigger::Continuous);
    // The first one starts a frame, which nobody takes, and the others miss it.
    let seen = COUNTERS.triggers_missed.get().wrapping_sub(before);
    let found = text!("{seen} of {} edges of PA3 by its own pulls", EDGES - 1);
    let look_at = "something is connected to PA3 (A0)";
    report
        .check("trigger", seen == EDGES - 1, &found, look_at)
        .await;
}

/// The line's port hears what it sends itself, while rows are read.
pub async fn check_reception(report: &mut Report, rx: &mut Receiver) {
    const PIECE: usize = 64;
    const PIECES: usize = 64;
    report.flush().await;
    // Between two characters, the port lets go of the pin.
    let pull = |way| pac::GPIOD.pupdr().modify(|pulls| pulls.set_pupdr(8, way));
    pull(Pupdr::PULL_UP);
    pac::USART3.cr3().modify(|control| control.set_hdsel(true));
    report.serial.set_line(Baud::B921600, Bits::N1).await;
    let mut right = 0;
    for piece in 0..PIECES {
        // No two pieces are alike, and each byte occurs.
        let sent: [u8; PIECE] = core::array::from_fn(|place| (7 * piece + 5 * place) as u8);
        let mut received = [0; PIECE];
        // What came before, or too late.
        while poll_once(rx.read(&mut received)).is_ready() {}
        let receive = async {
            let mut count = 0;
            while count < PIECE {
                let more = rx.read(&mut received[count..]).await;
                count += more.unwrap_or(PIECE - count);
            }
        };
        let transfer = join(report.serial.send(&sent), receive);
        let _ = with_timeout(Duration::from_millis(20), transfer).await;
        right += sent.iter().zip(&received).filter(|(a, b)| a == b).count();
        COUNTERS.results.add();
        free_rows().await;
    }
    report.serial.set_line(Baud::B115200, Bits::N1).await;
    pac::USART3.cr3().modify(|control| control.set_hdsel(false));
    pull(Pupdr::FLOATING);
    let found = text!(
        "{right} of {} bytes at 921600 baud came back",
        PIECE * PIECES
    );
    let look_at = "DMA1 is too slow, or something pulls at PD8";
    report
        .check("reception", right == PIECE * PIECES, &found, look_at)
        .await;
}

/// Cycles until PD15 has this level. `None`: it has not within 20 ms.
fn until_laser_is(high: bool) -> Option<u32> {
    const PIN: usize = 15;
    let start = cycles();
    loop {
        let waited = cycles().wrapping_sub(start);
        if is_high(pac::GPIOD, PIN) == high {
            return Some(waited);
        }
        if waited > cycles_in_ns(20_000_000) {
            return None;
        }
    }
}

/// The pulses of the laser. The last check of this kind: only a reset switches the laser on again.
pub async fn check_laser(report: &mut Report) {
    const US: u16 = 1000;
    const LOOK_AT: &str = "something else drives PD15 (D9), or TIM4 is wrong";
    let mut rest = is_high(pac::GPIOD, 15);
    LASER.set(Exposure::from_us(US), AmbientMode::Off);
    let (mut least, mut most) = (u32::MAX, 0);
    for _ in 0..4 {
        Timer::after_millis(6).await;
        COUNTERS.results.add();
        free_rows().await;
        // The pulse under way began before.
        until_laser_is(false);
        until_laser_is(true);
        let us = until_laser_is(false).map_or(0, |it| it / cycles_in_ns(1000));
        (least, most) = (least.min(us), most.max(us));
    }
    until_laser_is(true);
    board::laser::force_off();
    let after = until_laser_is(false).map_or(u32::MAX, |it| it / (cycles_in_ns(1000) / 10));
    rest |= until_laser_is(true).is_some();
    let found = text!("high for {least} to {most} us, of {US}");
    // An interrupt may hide an edge for the time of a row's pulses.
    let is_right = |us: u32| us.abs_diff(US.into()) <= 20;
    let passes = is_right(least) && is_right(most);
    report.check("laser", passes, &found, LOOK_AT).await;
    let level = if rest { "high" } else { "low" };
    let found = text!(
        "low {}.{} us after the order, of 20; {level} at rest",
        after / 10,
        after % 10
    );
    report
        .check("laser off", after <= 200 && !rest, &found, LOOK_AT)
        .await;
}
