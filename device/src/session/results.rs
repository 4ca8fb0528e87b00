//! A result's way: through the filters to the commands that wait for it, the registers and the stream.

use core::mem;

use crate::filters::Held;
use crate::filters::zero::Zero;
use crate::protocol::advice::advice;
use crate::protocol::csv::CsvLine;
use crate::protocol::line::{CentreLine, FaultLine, PartsOf, ResultLine};
use crate::protocol::packet::FrameResult;
use crate::protocol::status::Vitals;
use crate::session::{Actions, Session, Wanted};
use crate::settings::serial_line::Format;
use crate::settings::trigger::Trigger;
use slitrange::frame::comb::Slits;
use slitrange::light::ambient::AmbientMode;
use slitrange::{CalibrationErrors, Fault, Measured, Micrometres, Reading};

/// A result on its way through the filters to the line.
struct Filtered {
    /// What commands and registers show. Relative to `zero`, but not in the answer to `zero` itself.
    result: Result<Reading, Fault>,
    /// What the stream gives: the same, or a reading that is held after a fault.
    held: Result<Held, Fault>,
    is_difference: bool,
}

impl Session {
    /// Takes a frame's result through the filters to who wants it: commands, registers, the stream.
    pub(super) fn report(
        &mut self,
        measured: Result<Measured, Fault>,
        vitals: &Vitals,
        actions: &mut Actions,
    ) {
        self.note_pixels(&measured);
        let result = measured.and_then(|measured| self.reading(&measured));
        let result = self.filters.spikes.take(self.settings.spike_filter, result);
        self.count(&result);
        let wanted = mem::take(&mut self.wanted);
        let filtered = self.filter(result, wanted.zero);
        self.latest = Some((vitals.results, filtered.result));
        let settings = self.settings;
        let line = ResultLine {
            number: vitals.results,
            us: vitals.result_us,
            result: &filtered.result,
            is_difference: filtered.is_difference,
            held: 0,
            settings: &settings,
        };
        self.answer(&wanted, &measured, &line, actions);
        let is_due = wanted.result || self.is_due_in_stream(vitals);
        if actions.text.as_str().is_empty() && is_due {
            self.stream(&line, &filtered.held, actions);
        }
    }

    /// Forgets the readings before, if the frame's rows had another map of the pixels: two readings then do
    /// not share the pixels' errors.
    fn note_pixels(&mut self, measured: &Result<Measured, Fault>) {
        if let Ok(measured) = measured {
            if measured.pixels != self.pixels {
                self.forget_readings();
            }
            self.pixels = measured.pixels;
        }
    }

    fn count(&mut self, result: &Result<Reading, Fault>) {
        let count = match result {
            Ok(_) => Some(&mut self.readings),
            Err(fault) => self.faults.get_mut(fault.kind()),
        };
        if let Some(count) = count {
            *count = count.wrapping_add(1);
        }
    }

    /// Averages and holds a result, switches the output, and makes the result relative to `zero`. A reading
    /// becomes the new zero if it `is_to_show` a distance.
    fn filter(
        &mut self,
        result: Result<Reading, Fault>,
        is_to_show: Option<Micrometres>,
    ) -> Filtered {
        let settings = &self.settings;
        let is_subtracted = settings.ambient == AmbientMode::Subtract;
        let result = (self.filters.average).take(settings.average, is_subtracted, result);
        let held = self.filters.hold.take(settings.hold, result);
        if let (Some(value), Ok(reading)) = (is_to_show, result) {
            self.zero = Some(Zero { reading, value });
        }
        // The answer to `zero` shows the distance from the laser. The output takes the distance from the new
        // zero.
        let distance = held.ok().map(|held| match &self.zero {
            Some(zero) => zero.distance(held.reading.distance),
            None => held.reading.distance,
        });
        self.filters.is_within = (settings.limits).is_on(self.filters.is_within, distance);
        let zero = self.zero.filter(|_| is_to_show.is_none());
        let relative = |now: Reading| match &zero {
            Some(zero) => zero.relative(&now),
            None => now,
        };
        Filtered {
            result: result.map(relative),
            held: held.map(|held| Held {
                reading: relative(held.reading),
                ..held
            }),
            is_difference: zero.is_some(),
        }
    }

    /// Answers the commands that wait for a result.
    fn answer(
        &self,
        wanted: &Wanted,
        measured: &Result<Measured, Fault>,
        line: &ResultLine<'_>,
        actions: &mut Actions,
    ) {
        let format = self.connection().format;
        if wanted.distance || wanted.zero.is_some() {
            answer(line, format, actions);
        }
        if wanted.centre {
            match measured {
                Ok(measured) => actions.add_line(&CentreLine(measured)),
                Err(fault) => {
                    actions.add_line(&FaultLine(fault, self.settings.searched()));
                    advise(fault, actions);
                }
            }
        }
        if wanted.parts {
            answer(line, format, actions);
            if let Ok(reading) = line.result {
                actions.add_line(&PartsOf(&reading.parts, self.settings.units));
            }
        }
    }

    fn is_due_in_stream(&mut self, vitals: &Vitals) -> bool {
        self.settings.stream
            && self.is_alone()
            && (self.settings.trigger != Trigger::Continuous
                || (self.filters.rate).is_due(self.settings.rate, vitals.result_us))
    }

    /// Gives a result to the stream, as a line or as a packet.
    fn stream(&mut self, line: &ResultLine<'_>, held: &Result<Held, Fault>, actions: &mut Actions) {
        // The answer to `measure` at an address must arrive.
        actions.may_drop = self.is_alone();
        match self.sends_packets() {
            false => {
                let line = ResultLine {
                    result: &held.map(|it| it.reading),
                    held: held.map_or(0, |it| it.results),
                    ..*line
                };
                let format = self.connection().format;
                if format == Format::Csv && self.lines_to_header == 0 {
                    self.add_header(actions);
                }
                self.lines_to_header = self.lines_to_header.saturating_sub(1);
                add_result(&line, format, actions);
            }
            // Each row has its own result.
            true if self.streams_rows() => {}
            true => {
                actions.result = Some(FrameResult {
                    counter: line.number,
                    time_us: line.us,
                    is_difference: line.is_difference,
                    result: *line.result,
                });
            }
        }
    }

    /// Converts a frame's centre by the record, if there is one and it is on.
    fn reading(&self, measured: &Measured) -> Result<Reading, Fault> {
        let Some(record) = self.record().filter(|_| self.calibration_on) else {
            return measured.reading(None, &CalibrationErrors::Unknown, self.settings.surface);
        };
        let calibration = Some(&record.calibration);
        let reading = measured.reading(calibration, &record.errors, self.settings.surface)?;
        let is_as_calibrated = reading.is_nominal
            || record.estimator == self.settings.estimator
                && record.black_level == self.settings.black_level
                && (record.slits() == Slits::Comb) == measured.comb.is_some();
        Ok(Reading {
            has_other_settings: !is_as_calibrated,
            ..reading
        })
    }
}

/// Answers with a result, and with what to do about a fault. Among comma-separated values there is no advice.
fn answer(line: &ResultLine<'_>, format: Format, actions: &mut Actions) {
    add_result(line, format, actions);
    if let Err(fault) = line.result
        && format != Format::Csv
    {
        advise(fault, actions);
    }
}

fn add_result(line: &ResultLine<'_>, format: Format, actions: &mut Actions) {
    match format {
        Format::Csv => actions.add_line(&CsvLine(line)),
        Format::Text | Format::Binary | Format::Modbus => actions.add_line(line),
    }
}

fn advise(fault: &Fault, actions: &mut Actions) {
    actions.add_line(&format_args!("({})", advice(fault)));
}
