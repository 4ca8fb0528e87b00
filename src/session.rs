//! The shell around the core's session: brings events to it, and carries its actions to the serial line, the
//! measurement and flash.

use core::sync::atomic::Ordering;

use embassy_time::Instant;
use slitrange::protocol::info::Hardware;
use slitrange::protocol::status::StartCause;
use slitrange::session::{Actions, Event, Session};
use slitrange::store::Store;

use super::flash::CalibrationFlash;
use super::shared::{COUNTERS, PAUSED, SETTINGS};
use super::transmitter::Transmitter;
use super::{acquisition, board, tcd1304};

const HARDWARE: Hardware = Hardware {
    board: board::NAME,
    head: tcd1304::NAME,
    row_us: acquisition::ROW_PERIOD.as_micros() as u32,
};

/// See the module.
pub struct Shell {
    tx: Transmitter,
    started_at: Instant,
    store: Store<CalibrationFlash>,
    session: Session,
    actions: Actions,
}

impl Shell {
    /// Starts a session. Not inlined, so that it uses the stack only while it runs.
    #[inline(never)]
    pub fn new(tx: Transmitter, started_by: StartCause, flash: CalibrationFlash) -> Self {
        Self {
            tx,
            started_at: Instant::now(),
            store: Store::new(flash),
            session: Session::new(HARDWARE, tcd1304::geometry(), started_by),
            actions: Actions::default(),
        }
    }

    /// Loads what flash holds, sends the banner, and lets measuring begin.
    pub async fn start(&mut self) {
        let stored = self.store.read().await;
        self.update_session(Event::Started(stored));
        self.apply();
        PAUSED.store(false, Ordering::Relaxed);
        self.send().await;
    }

    /// Takes an event and carries out the actions.
    pub async fn take(&mut self, event: Event) {
        if matches!(event, Event::Frame(_)) {
            COUNTERS.results.add();
        }
        self.update_session(event);
        self.apply();
        if self.actions.save {
            PAUSED.store(true, Ordering::Relaxed);
            self.send().await;
            self.save().await;
        }
        self.send().await;
    }

    /// Passes an event to the session, which writes what must be done into `actions`.
    #[inline(never)]
    fn update_session(&mut self, event: Event) {
        let vitals = COUNTERS.vitals(self.started_at.elapsed().as_millis());
        self.session.take(event, &vitals, &mut self.actions);
    }

    fn apply(&mut self) {
        if let Some(settings) = self.actions.apply.take() {
            SETTINGS.signal(settings);
        }
    }

    async fn send(&mut self) {
        if self.actions.may_drop {
            self.tx.send_or_drop(self.actions.text.as_str());
        } else {
            self.tx.send(self.actions.text.as_str()).await;
        }
    }

    /// Writes to flash. No frame is due meanwhile, so the line may be silent for as long as the flash takes.
    async fn save(&mut self) {
        // Signs of life before and after: the first one of the flash may take half a second, and so may the
        // first frame after the save.
        COUNTERS.results.add();
        let result = match &self.session.configuration() {
            Some(configuration) => self.store.save(configuration).await,
            // The session asks for a save only with a configuration.
            None => Ok(()),
        };
        COUNTERS.results.add();
        PAUSED.store(false, Ordering::Relaxed);
        self.update_session(Event::Saved(result));
    }
}
