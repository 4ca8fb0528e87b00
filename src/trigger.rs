//! What starts a frame: nothing, a command, or an edge at the trigger's pin.

use core::cell::Cell;

use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use slitrange_device::settings::trigger::Trigger;

use crate::counters::COUNTERS;

/// What starts frames.
pub static FRAMES: Frames = Frames(Mutex::new(Cell::new((
    Trigger::Continuous,
    TriggeredFrame::None,
))));

/// See [`FRAMES`].
pub struct Frames(Mutex<CriticalSectionRawMutex, Cell<(Trigger, TriggeredFrame)>>);

/// The frame that a trigger started.
#[derive(Clone, Copy)]
enum TriggeredFrame {
    /// There is none.
    None,
    /// No row of it has come yet. So many pulses were given before the trigger.
    Triggered { pulses: u32 },
    /// Some of its rows have come.
    Begun,
}

impl Frames {
    /// Changes what starts frames. A frame that the trigger before started is dropped.
    pub fn set_trigger(&self, trigger: Trigger) {
        self.update(|state| {
            if state.0 != trigger {
                *state = (trigger, TriggeredFrame::None);
            }
        });
    }

    /// Starts a frame at a command, unless frames start by themselves.
    pub fn start(&self) {
        self.start_if(|trigger| trigger != Trigger::Continuous);
    }

    /// Starts a frame at an edge, if edges start frames.
    pub fn take_edge(&self) {
        self.start_if(|trigger| trigger == Trigger::Pin);
    }

    fn start_if(&self, is_trigger: impl Fn(Trigger) -> bool) {
        // Read first: a pulse in between makes the frame late rather than early.
        let pulses = COUNTERS.pulses.get();
        self.update(|(trigger, frame)| match *frame {
            _ if !is_trigger(*trigger) => {}
            TriggeredFrame::None => *frame = TriggeredFrame::Triggered { pulses },
            _ => COUNTERS.triggers_missed.add(),
        });
    }

    /// Whether a triggered frame begins with a row, which ended with the pulse of this number.
    pub fn begins_with(&self, pulses: u32) -> bool {
        self.update(|(_, frame)| match *frame {
            // The row began with the pulse before, which must have come after the trigger. A difference of
            // numbers that wrap.
            TriggeredFrame::Triggered { pulses: before }
                if (pulses.wrapping_sub(before) as i32) >= 2 =>
            {
                *frame = TriggeredFrame::Begun;
                true
            }
            _ => false,
        })
    }

    /// Whether the result of the frame that ends now is wanted.
    pub fn end(&self) -> bool {
        self.update(|(trigger, frame)| match (*trigger, *frame) {
            (Trigger::Continuous, _) => true,
            (_, TriggeredFrame::Begun) => {
                *frame = TriggeredFrame::None;
                true
            }
            _ => false,
        })
    }

    /// Whether a result is wanted although the sensor brings no rows. A frame that waits for its first row
    /// ends.
    pub fn end_in_silence(&self) -> bool {
        self.update(|(_, frame)| {
            if let TriggeredFrame::Triggered { .. } = frame {
                *frame = TriggeredFrame::Begun;
            }
        });
        self.end()
    }

    fn update<T>(&self, change: impl FnOnce(&mut (Trigger, TriggeredFrame)) -> T) -> T {
        self.0.lock(|cell| {
            let mut state = cell.get();
            let result = change(&mut state);
            cell.set(state);
            result
        })
    }
}
