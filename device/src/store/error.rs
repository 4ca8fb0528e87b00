//! Why a save fails.

use core::fmt;

use super::configuration::ConfigurationError;

/// Why a save fails. The configuration that was there before is still there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StoreError {
    /// The configuration could not be read back: a value is out of range.
    Configuration(ConfigurationError),
    /// The flash refused to read, program or erase.
    Flash,
    /// The flash accepted the save, but does not hold what was written.
    Worn,
}

impl From<ConfigurationError> for StoreError {
    fn from(error: ConfigurationError) -> Self {
        Self::Configuration(error)
    }
}

impl fmt::Display for StoreError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Configuration(error) => error.fmt(f),
            Self::Flash => f.write_str(
                "the flash failed to read, write or erase, the configuration saved before is unchanged: \
                save again",
            ),
            Self::Worn => f.write_str(
                "the flash does not keep what is written, the configuration saved before is unchanged: save \
                 again, and if that does not help, replace the sensor's board",
            ),
        }
    }
}

impl core::error::Error for StoreError {}
