//! The watchdog: starts the board again if a part of the firmware has stopped.
//!
//! The watchdog is petted while two counters move. The first counts the sensor's pulses, and shows that
//! acquisition lives. A sensor that brings no rows is no reason to start again, because a start would not
//! bring it back. It becomes a fault, every 100 ms, and a fault shows life as well as a reading does. The
//! second counts the results that the serial line took. It shows that measuring and serial line live, and
//! that what one sends reaches the other. While a save or `row` pauses results, each operation
//! of the save on the flash, or each line of the row, counts instead. A panic stops the pulses with the rest.

use embassy_time::{Duration, Ticker};

use crate::board::{Lights, Watchdog};
use crate::counters::{COUNTERS, Counter};

/// Time between two checks of the counters.
const CHECK_PERIOD: Duration = Duration::from_millis(100);

/// A counter that has not changed in this many checks counts as stopped. The longest frame, 64 rows of which
/// each follows a row of ambient light, lasts 730 ms. The serial line may be up to 100 ms into an answer when
/// it ends. 1200 ms leave room for lost rows.
const MAX_CHECKS_WITHOUT_CHANGE: u32 = 12;

/// Watches for ever.
#[embassy_executor::task]
pub async fn watch(mut watchdog: Watchdog, mut lights: Lights) {
    let mut signs = [Sign::of(&COUNTERS.pulses), Sign::of(&COUNTERS.results)];
    let mut check = Ticker::every(CHECK_PERIOD);
    loop {
        check.next().await;
        let mut alive = true;
        for sign in &mut signs {
            alive &= sign.is_moving();
        }
        if alive {
            watchdog.pet();
        }
        lights.update(alive);
    }
}

/// A counter that moves as long as the tasks that count live.
struct Sign {
    counter: &'static Counter,
    seen: u32,
    checks_without_change: u32,
}

impl Sign {
    fn of(counter: &'static Counter) -> Self {
        Self {
            counter,
            seen: counter.get(),
            checks_without_change: 0,
        }
    }

    /// Checks the counter, and returns whether the counter still moves.
    fn is_moving(&mut self) -> bool {
        let count = self.counter.get();
        if count == self.seen {
            self.checks_without_change = self.checks_without_change.saturating_add(1);
        } else {
            self.seen = count;
            self.checks_without_change = 0;
        }
        self.checks_without_change < MAX_CHECKS_WITHOUT_CHANGE
    }
}
