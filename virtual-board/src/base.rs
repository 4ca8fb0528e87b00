//! Virtual time, and what the emulator's thread shares with the caller.

use std::sync::{Mutex, MutexGuard, PoisonError};

/// Nanoseconds of virtual time, counted from power-on.
pub type Nanos = u64;

/// The processor's clock in Hz: the highest of an STM32F429 without over-drive.
pub(crate) const CLOCK_HZ: u64 = 168_000_000;

/// Locks what is shared. A panic leaves the data whole, so a poisoned lock is no error.
pub(crate) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
