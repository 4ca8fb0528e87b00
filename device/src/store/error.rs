//! Why a save fails.

use thiserror::Error;

use super::configuration::ConfigurationError;

/// Why a save fails. The configuration that was there before is still there.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum StoreError {
    /// The configuration could not be read back: a value is out of range.
    #[error(transparent)]
    Configuration(#[from] ConfigurationError),
    /// The flash refused to read, program or erase.
    #[error(
        "the flash failed to read, write or erase, the configuration saved before is unchanged: save again"
    )]
    Flash,
    /// The flash accepted the save, but does not hold what was written.
    #[error(
        "the flash does not keep what is written, the configuration saved before is unchanged: save again, \
         and if that does not help, replace the sensor's board"
    )]
    Worn,
}
