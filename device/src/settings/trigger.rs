//! What starts a frame: the setting `trigger`.

use slitrange::named;

/// What starts a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Trigger {
    /// The end of the frame before.
    #[default]
    Continuous,
    /// A command: `measure`, or one that shows a frame's result.
    Serial,
    /// A rising edge at the trigger's pin, or a command as with [`Trigger::Serial`].
    Pin,
}

named! { Trigger { Continuous: "continuous", Serial: "serial", Pin: "pin" } }
