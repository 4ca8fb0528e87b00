//! What the one at the other end of the serial line set, asked for and was told.

use core::sync::atomic::Ordering;

use embassy_time::Instant;
use slitrange::distance::Calibration;
use slitrange::fault::Fault;
use slitrange::measurement::Settings;
use slitrange::protocol::answer::HELP;
use slitrange::protocol::calibration::Shown;
use slitrange::protocol::command::{Command, Error};
use slitrange::protocol::info::{Banner, Hardware, Info};
use slitrange::protocol::ladder::Ladder;
use slitrange::protocol::piece::Piece;
use slitrange::protocol::refusal::Refusal;
use slitrange::protocol::status::{SerialErrors, StartCause, Status};
use slitrange::protocol::upload::{Step, Upload};
use slitrange::reading::Measured;
use slitrange::record::encoded::EncodedRecord;
use slitrange::store::Store;

use super::flash::CalibrationFlash;
use super::in_use::InUse;
use super::shared::{COUNTERS, PAUSED, SETTINGS};
use super::transmitter::Transmitter;
use super::{acquisition, board, tcd1304};

const HARDWARE: Hardware = Hardware {
    board: board::NAME,
    head: tcd1304::NAME,
    row_us: acquisition::ROW_PERIOD.as_micros() as u32,
};

/// What is in use, what is under way, and what was reported.
pub struct Session {
    tx: Transmitter,
    started_by: StartCause,
    started_at: Instant,
    store: Store<CalibrationFlash>,
    in_use: InUse,
    /// Whether distances are wanted.
    calibration_on: bool,
    upload: Upload,
    stream: bool,
    distance_wanted: bool,
    centre_wanted: bool,
    readings: u32,
    faults: [u32; Fault::KINDS],
}

impl Session {
    /// One that begins. Not inlined, for the reason that [`InUse`] names.
    #[inline(never)]
    pub fn new(tx: Transmitter, started_by: StartCause, flash: CalibrationFlash) -> Self {
        Self {
            tx,
            started_by,
            started_at: Instant::now(),
            store: Store::new(flash),
            in_use: InUse::new(),
            calibration_on: true,
            upload: Upload::none(),
            stream: true,
            distance_wanted: false,
            centre_wanted: false,
            readings: 0,
            faults: [0; Fault::KINDS],
        }
    }

    /// Takes over what was saved, says what this is, and lets measuring begin.
    pub async fn start(&mut self) {
        let kept = self.store.read().await;
        self.in_use.set_kept(kept);
        self.apply();
        PAUSED.store(false, Ordering::Relaxed);
        let banner = Banner(&HARDWARE, self.started_by);
        self.tx.send(&banner).await;
    }

    /// Counts a result, and says it where it is wanted.
    pub async fn report(&mut self, measured: Result<Measured, Fault>) {
        let result = measured.and_then(|measured| measured.reading(self.calibration_wanted()));
        COUNTERS.results.add();
        match &result {
            Ok(_) => self.readings = self.readings.wrapping_add(1),
            Err(fault) => {
                let count = &mut self.faults[fault.kind()];
                *count = count.wrapping_add(1);
            }
        }
        if !self.distance_wanted && !self.centre_wanted {
            if self.stream {
                match &result {
                    Ok(reading) => self.tx.offer(reading),
                    Err(fault) => self.tx.offer(fault),
                }
            }
            return;
        }
        if core::mem::take(&mut self.distance_wanted) {
            match &result {
                Ok(reading) => self.tx.send(reading).await,
                Err(fault) => self.advise(fault).await,
            }
        }
        if core::mem::take(&mut self.centre_wanted) {
            match &measured {
                Ok(measured) => self.tx.send(measured).await,
                Err(fault) => self.advise(fault).await,
            }
        }
    }

    async fn advise(&mut self, fault: &Fault) {
        let advice = fault.advice();
        self.tx.send(&format_args!("{fault}\r\n({advice})")).await;
    }

    /// Does what was asked for and answers.
    pub async fn answer(&mut self, command: Result<Command, Error>) {
        match command {
            Ok(command) => {
                if let Err(refusal) = self.obey(command).await {
                    self.tx.send(&refusal).await;
                }
            }
            Err(error) => self.tx.send(&error).await,
        }
    }

    async fn obey(&mut self, command: Command) -> Result<(), Refusal> {
        match command {
            Command::Nothing => {}
            Command::Help => self.tx.send(&HELP).await,
            Command::HelpEstimator => self.tx.send(&Ladder).await,
            Command::Info => {
                let geometry = tcd1304::geometry();
                let info = Info {
                    hardware: &HARDWARE,
                    geometry: &geometry,
                    settings: &self.in_use.settings,
                    record: self.in_use.calibration.as_ref().map(EncodedRecord::record),
                    on: self.calibration_on,
                };
                self.tx.send(&info).await;
            }
            Command::Status => {
                let status = self.status();
                self.tx.send(&status).await;
            }
            // The reading, or the centre, is the answer.
            Command::Distance => self.distance_wanted = true,
            Command::Centre => self.centre_wanted = true,
            Command::Stream(on) => {
                self.stream = on.unwrap_or(self.stream);
                self.tx.send(&Command::Stream(Some(self.stream))).await;
            }
            Command::Rows(rows) => {
                if let Some(rows) = rows {
                    self.set(Settings {
                        rows,
                        ..self.in_use.settings
                    });
                }
                self.tx
                    .send(&Command::Rows(Some(self.in_use.settings.rows)))
                    .await;
            }
            Command::Black(black_level) => {
                if let Some(black_level) = black_level {
                    self.set(Settings {
                        black_level,
                        ..self.in_use.settings
                    });
                }
                let black = Command::Black(Some(self.in_use.settings.black_level));
                self.tx.send(&black).await;
            }
            Command::Mean(mean) => {
                if let Some(mean) = mean {
                    self.set(Settings {
                        mean,
                        ..self.in_use.settings
                    });
                }
                self.tx
                    .send(&Command::Mean(Some(self.in_use.settings.mean)))
                    .await;
            }
            Command::Estimator(estimator) => {
                if let Some(estimator) = estimator {
                    self.set(Settings {
                        estimator,
                        ..self.in_use.settings
                    });
                }
                let estimator = Command::Estimator(Some(self.in_use.settings.estimator));
                self.tx.send(&estimator).await;
            }
            Command::Calibration(None) => {
                let shown = Shown {
                    written: self.in_use.calibration.as_ref(),
                    on: self.calibration_on,
                    stored: self.in_use.stored,
                };
                self.tx.send(&shown).await;
            }
            Command::Calibration(Some(on)) => {
                if on && self.in_use.calibration.is_none() {
                    return Err(Refusal::NoCalibration);
                }
                self.calibration_on = on;
                self.tx.send(&command).await;
            }
            Command::Data(offset) => {
                let piece = self.piece(offset)?;
                self.tx.send(&piece).await;
            }
            Command::Upload(step) => {
                self.take(step)?;
                self.tx.send(&command).await;
            }
            Command::Defaults => {
                self.in_use.set_defaults();
                self.calibration_on = true;
                self.apply();
                self.tx.send(&command).await;
            }
            Command::Save => self.save().await?,
        }
        Ok(())
    }

    /// What centres mean, where that is known and wanted.
    fn calibration_wanted(&self) -> Option<&Calibration> {
        let written = self
            .in_use
            .calibration
            .as_ref()
            .filter(|_| self.calibration_on)?;
        Some(&written.record().calibration)
    }

    fn set(&mut self, settings: Settings) {
        self.in_use.settings = settings;
        self.apply();
    }

    fn apply(&self) {
        SETTINGS.signal(self.in_use.settings);
    }

    fn piece(&self, offset: u16) -> Result<Piece, Refusal> {
        let written = self
            .in_use
            .calibration
            .as_ref()
            .ok_or(Refusal::NoCalibration)?;
        let bytes = written.bytes();
        Piece::of(bytes, offset).ok_or(Refusal::NoPiece {
            offset,
            bytes: bytes.len(),
        })
    }

    /// Not inlined, for the reason that [`InUse`] names.
    #[inline(never)]
    fn take(&mut self, step: Step) -> Result<(), Refusal> {
        if let Some(record) = self.upload.take(step, &tcd1304::geometry())? {
            self.in_use.set_calibration(record);
            self.apply();
        }
        Ok(())
    }

    /// Keeps what is in use. No reading is due meanwhile, so that the line can be silent for as long as the flash takes.
    async fn save(&mut self) -> Result<(), Refusal> {
        let Some(saved) = &self.in_use.to_save() else {
            return Err(Refusal::NoCalibration);
        };
        PAUSED.store(true, Ordering::Relaxed);
        self.tx.send(&"save pauses the stream").await;
        // Signs of life: from one of the flash to the next may take half a second, and so may the first frame after them.
        COUNTERS.results.add();
        let result = self.store.save(saved).await;
        COUNTERS.results.add();
        PAUSED.store(false, Ordering::Relaxed);
        result.map_err(Refusal::NotSaved)?;
        self.in_use.note_saved();
        self.tx.send(&Command::Save).await;
        Ok(())
    }

    fn status(&self) -> Status {
        Status {
            started_by: self.started_by,
            uptime_ms: self.started_at.elapsed().as_millis(),
            rows: COUNTERS.rows.get(),
            rows_lost: COUNTERS.rows_lost.get(),
            rows_failed: COUNTERS.rows_failed.get(),
            row_cycles: COUNTERS.row_cycles.get(),
            readings: self.readings,
            faults: self.faults,
            lines_dropped: COUNTERS.lines_dropped.get(),
            serial_errors: SerialErrors {
                noise: COUNTERS.serial_noise.get(),
                framing: COUNTERS.serial_framing.get(),
                overrun: COUNTERS.serial_overrun.get(),
            },
        }
    }
}
