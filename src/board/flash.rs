//! The flash of the store and of the map of the pixels: the first four sectors of bank 2.
//!
//! embassy-stm32's driver waits for the flash's interrupt while it erases and programs. Rows are taken
//! meanwhile, because the program is in bank 1. This module adds a sign of life for each operation, by which
//! the watchdog tells a save from a firmware that hangs. It also lets the other tasks run between two reads
//! of the flash.

use core::pin::pin;

use embassy_futures::select::{Either, select};
use embassy_futures::yield_now;
use embassy_stm32::flash::{Async, Bank2Region1, Error};
use embassy_stm32::gpio::{Level, Output, Speed};
use embassy_stm32::pac::gpio::vals::Pupdr;
use embassy_stm32::peripherals::PA12;
use embassy_stm32::{Peri, pac};
use embassy_time::{Duration, Timer};
use embedded_storage_async::nor_flash::{ErrorType, NorFlash, ReadNorFlash};

use crate::counters::COUNTERS;

/// Time after which an erase gives a sign of life. A sector of 16 KB takes 800 ms at most (data sheet of the
/// STM32F429, flash memory programming, by bytes: the driver does not change that).
const PART_OF_AN_ERASE: Duration = Duration::from_millis(300);

/// Two sectors for the configuration, two for the map of the pixels.
const SECTORS: usize = 4;

unsafe extern "C" {
    /// The start of the memory that `memory.x` reserves.
    static _calibration_start: u8;
    /// The end of that memory.
    static _calibration_end: u8;
}

/// See the module.
pub struct CalibrationFlash(Bank2Region1<'static, Async>);

impl CalibrationFlash {
    /// Takes the memory that `memory.x` reserves in a region: the first four sectors.
    pub fn new(region: Bank2Region1<'static, Async>) -> Self {
        let (start, end) = (
            (&raw const _calibration_start).addr(),
            (&raw const _calibration_end).addr(),
        );
        // Constants of the program: wrong ones fail at the first start.
        defmt::assert_eq!(start, region.0.base() as usize);
        defmt::assert_eq!(end - start, SECTORS * Self::ERASE_SIZE);
        Self(region)
    }
}

impl ErrorType for CalibrationFlash {
    type Error = Error;
}

impl ReadNorFlash for CalibrationFlash {
    const READ_SIZE: usize = Bank2Region1::<'static, Async>::READ_SIZE;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Error> {
        yield_now().await;
        self.0.read(offset, bytes).await
    }

    fn capacity(&self) -> usize {
        SECTORS * Self::ERASE_SIZE
    }
}

impl NorFlash for CalibrationFlash {
    const WRITE_SIZE: usize = Bank2Region1::<'static, Async>::WRITE_SIZE;
    const ERASE_SIZE: usize = Bank2Region1::<'static, Async>::ERASE_SIZE;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), Error> {
        let mut erase = pin!(self.0.erase(from, to));
        // Only one sign of life during an erase: if the flash never answers, the watchdog must start the
        // board again.
        let erased = match select(&mut erase, Timer::after(PART_OF_AN_ERASE)).await {
            Either::First(erased) => erased,
            Either::Second(()) => {
                COUNTERS.results.add();
                erase.await
            }
        };
        COUNTERS.results.add();
        erased
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Error> {
        let written = self.0.write(offset, bytes).await;
        COUNTERS.results.add();
        written
    }
}

/// Keeps PA12 low. On chips before revision 3, reading bank 2 of the flash may go wrong while PA12 changes
/// (STM32F42xx errata sheet, section 2.2.11). The pin must be an output that stays low, with its pull-down.
/// embassy-stm32's flash driver panics if it is not.
pub fn keep_pa12_low(pin: Peri<'static, PA12>) {
    // Dropping the output would make the pin an input again.
    core::mem::forget(Output::new(pin, Level::Low, Speed::Low));
    pac::GPIOA
        .pupdr()
        .modify(|pulls| pulls.set_pupdr(12, Pupdr::PULL_DOWN));
}
