//! What the owner of the serial line must do after an event.

use core::fmt::{self, Write as _};

use crate::protocol::MAX_ANSWER;
use crate::protocol::packet::FrameResult;
use crate::protocol::row_lines::RowPart;
use crate::session::flat;
use crate::settings::Settings;
use crate::text::Text;
use slitrange::check::own_spot::Profile;
use slitrange::frame::comb::Comb;
use slitrange::row::Geometry;

/// What the owner of the serial line must do, in this order.
#[derive(Debug, Default)]
pub struct Actions {
    /// Text to send, each line with CR LF. Empty if there is nothing to say.
    pub text: Text<MAX_ANSWER>,
    /// If it is not 0, this address goes before each line of the text, as
    /// [`AddressPrefix`](super::AddressPrefix).
    pub address: u16,
    /// The text or [`Self::result`] is one of a stream: drop it if the line is busy. Any other text must
    /// arrive.
    pub may_drop: bool,
    /// Send this result, as a packet. Only with
    /// [`Format::Binary`](crate::settings::serial_line::Format::Binary), and without a text.
    pub result: Option<FrameResult>,
    /// What the measurement must use from now on.
    pub apply: Option<Applied>,
    /// Write [`Session::configuration`](super::Session::configuration) to flash, and then take the event
    /// [`Event::Saved`](super::Event::Saved). No frame is due before that.
    pub save: bool,
    /// Send these pixels of the next row, in the lines of [`crate::protocol::row_lines`]. No frame is due
    /// meanwhile.
    pub row: Option<RowPart>,
    /// Do this with the map of the pixels, and then take the event [`Event::Flat`](super::Event::Flat).
    pub flat: Option<flat::Job>,
    /// Look at the next row, and then take the event [`Event::Tested`](super::Event::Tested). No frame is due
    /// meanwhile.
    pub test: bool,
    /// Start a frame: its rows are exposed from now on. Only if [`Settings::trigger`] is not continuous. A
    /// frame that is under way or waits for its first row goes on, and counts as a missed trigger.
    pub trigger: bool,
    /// Start again, once all text has left.
    pub reset: bool,
}

/// What the measurement takes from settings and calibration.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Applied {
    /// The settings.
    pub settings: Settings,
    /// The geometry of the rows, with what was measured of the front end.
    pub geometry: Geometry,
    /// The sensor's own spot, if the calibration knows it.
    pub profile: Option<Profile>,
    /// The slits of the comb, if the calibration knows them. Otherwise they are those of [`Comb::nominal`].
    pub comb: Option<Comb>,
}

impl Actions {
    /// Makes them those of an event that needs nothing. In place, because the text is large.
    pub(super) fn start(&mut self, of_sensor: u16) {
        let Self {
            text,
            address,
            may_drop,
            result,
            apply,
            save,
            row,
            flat,
            test,
            trigger,
            reset,
        } = self;
        text.clear();
        *address = of_sensor;
        (*may_drop, *result, *apply, *save) = (false, None, None, false);
        (*row, *flat, *test) = (None, None, false);
        (*trigger, *reset) = (false, false);
    }

    pub(super) fn add_line(&mut self, line: &dyn fmt::Display) {
        // An answer that does not fit is cut off; the protocol's tests check that all fit.
        let _ = write!(self.text, "{line}\r\n");
    }
}
