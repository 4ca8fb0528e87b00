//! What starts a frame: the setting `trigger`.

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

impl Trigger {
    /// All.
    pub const ALL: [Self; 3] = [Self::Continuous, Self::Serial, Self::Pin];

    /// The name on the serial line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Continuous => "continuous",
            Self::Serial => "serial",
            Self::Pin => "pin",
        }
    }

    /// Finds a trigger by its [`name`](Self::name).
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|it| it.name() == name)
    }
}
