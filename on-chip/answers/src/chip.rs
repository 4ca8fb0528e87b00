//! All that exists only on the chip.

use core::cell::RefCell;
use core::sync::atomic::{AtomicU32, Ordering};

use answers_on_chip::answers::Estimators;
use answers_on_chip::mailbox;
use cortex_m::interrupt::{self, Mutex};

// Linked for what they define: where the log goes, and what a panic does.
use {defmt_rtt as _, panic_probe as _};

// Under names that they keep in the ELF file, by which the test finds them.

/// 1 while there are rows to answer.
#[unsafe(no_mangle)]
static ASKED: AtomicU32 = AtomicU32::new(0);

#[unsafe(no_mangle)]
static ROWS: [AtomicU32; mailbox::ROWS] = [const { AtomicU32::new(0) }; mailbox::ROWS];

// In core-coupled RAM, because the measurements of all estimators need the other RAM for the stack. Nobody
// clears it. The program writes each word before the test reads it.
#[unsafe(no_mangle)]
#[unsafe(link_section = ".ccm.answers")]
static ANSWERS: [AtomicU32; mailbox::ANSWERS] = [const { AtomicU32::new(0) }; mailbox::ANSWERS];

static ESTIMATORS: Mutex<RefCell<Estimators>> = Mutex::new(RefCell::new(Estimators::new()));

#[cortex_m_rt::entry]
fn main() -> ! {
    loop {
        if ASKED.load(Ordering::Acquire) == 1 {
            // The program has no interrupts.
            interrupt::free(|free| {
                let mut estimators = ESTIMATORS.borrow(free).borrow_mut();
                mailbox::answer(&mut estimators, &ROWS, &ANSWERS);
            });
            ASKED.store(0, Ordering::Release);
        }
    }
}
