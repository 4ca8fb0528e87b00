//! The watchdog: a firmware of which a part has stopped starts again.
//!
//! It is petted while two counters move. The sensor's pulses show that acquisition lives; a sensor that
//! brings no rows
//! is no reason to start again, because that would not bring it back: it becomes a fault, every 100 ms, and a
//! fault
//! shows life as well as a reading does. The results that the serial line took show that measuring and serial
//! line live
//! and that what one sends reaches the other; while a save pauses them, so does each thing that it did to the
//! flash. A panic
//! stops the pulses with the rest.

use embassy_stm32::peripherals;
use embassy_stm32::wdg::IndependentWatchdog;
use embassy_time::{Duration, Ticker};

use super::shared::{COUNTERS, Counter};

/// The watchdog's patience by its own clock, which may run between 17 and 47 kHz instead of 32 (data sheet of
/// the
/// STM32F429, LSI): 0.7 to 1.9 s.
pub const TIMEOUT_US: u32 = 1_000_000;

/// How often the counters are looked at.
const LOOK: Duration = Duration::from_millis(100);

/// Looks without a change until a counter counts as stopped. The longest frame, 64 rows, lasts 365 ms, and
/// the serial
/// line may be up to 100 ms into an answer when it ends: 800 ms leave room for lost rows.
const PATIENCE: u32 = 8;

/// Watches for ever.
#[embassy_executor::task]
pub async fn watch(mut watchdog: IndependentWatchdog<'static, peripherals::IWDG>) {
    let mut signs = [Sign::of(&COUNTERS.pulses), Sign::of(&COUNTERS.results)];
    let mut look = Ticker::every(LOOK);
    loop {
        look.next().await;
        let mut alive = true;
        for sign in &mut signs {
            alive &= sign.moves();
        }
        if alive {
            watchdog.pet();
        }
    }
}

/// A counter that moves as long as those who count live.
struct Sign {
    counter: &'static Counter,
    seen: u32,
    looks_without_change: u32,
}

impl Sign {
    fn of(counter: &'static Counter) -> Self {
        Self {
            counter,
            seen: counter.get(),
            looks_without_change: 0,
        }
    }

    fn moves(&mut self) -> bool {
        let count = self.counter.get();
        if count == self.seen {
            self.looks_without_change = self.looks_without_change.saturating_add(1);
        } else {
            self.seen = count;
            self.looks_without_change = 0;
        }
        self.looks_without_change < PATIENCE
    }
}
