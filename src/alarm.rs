//! A task's alarm, for the task that pulses the sensor.

use core::future::{Future, poll_fn};
use core::pin::pin;
use core::task::Poll;

use embassy_time::{Instant, Timer};

/// Makes embassy wake this task at `at`. A task has one alarm, and an earlier one stays.
///
/// Awaiting a timer would set the alarm anew each time that DMA wakes the task, which took more instructions
/// than all else between two rows.
pub async fn set_alarm(at: Instant) {
    poll_fn(|context| {
        let _ = pin!(Timer::at(at)).poll(context);
        Poll::Ready(())
    })
    .await;
}

/// Waits for the alarm that [`set_alarm`] set. If an earlier alarm was still set and rings, sets it anew.
pub async fn wait_for_alarm(at: Instant) {
    let mut was_polled = false;
    poll_fn(|context| {
        if Instant::now() >= at {
            return Poll::Ready(());
        }
        if was_polled {
            let _ = pin!(Timer::at(at)).poll(context);
        }
        was_polled = true;
        Poll::Pending
    })
    .await;
}
