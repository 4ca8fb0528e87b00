//! Receives characters from the serial line, and counts those that were lost or damaged.

use core::future::poll_fn;
use core::sync::atomic::{AtomicBool, Ordering};
use core::task::Poll;

use embassy_stm32::dma::{Channel, ReadableRingBuffer, TransferOptions};
use embassy_stm32::pac::usart::regs::Sr;
use embassy_stm32::peripherals::{DMA1_CH1, USART3};
use embassy_stm32::usart::RxDma;
use embassy_stm32::{Peri, pac};
use embassy_sync::waitqueue::AtomicWaker;
use static_cell::ConstStaticCell;

use crate::board::Interrupts;
use crate::counters::COUNTERS;

/// Incoming characters: 22 ms of the line at 921600 baud, longer than any computation in thread mode.
static RECEIVED: ConstStaticCell<[u8; 2048]> = ConstStaticCell::new([0; 2048]);

/// Woken when the line falls silent. The DMA wakes at each half of [`RECEIVED`].
static SILENCE: AtomicWaker = AtomicWaker::new();

/// A character had a wrong parity. What came with it is refused, like what is lost.
static IS_DAMAGED: AtomicBool = AtomicBool::new(false);

/// Characters came faster than they were taken, or damaged: all that were not taken yet are lost.
pub struct Lost;

/// The receiver.
pub struct Receiver(ReadableRingBuffer<'static, u8>);

impl Receiver {
    pub(super) fn new(dma: Peri<'static, DMA1_CH1>) -> Self {
        let request = RxDma::<USART3>::request(&*dma);
        let channel = Channel::new(dma, Interrupts);
        let data = pac::USART3.dr().as_ptr().cast();
        let options = TransferOptions::default();
        // SAFETY: the register is that of the channel's request, and the buffer is nobody else's.
        let mut ring =
            unsafe { ReadableRingBuffer::new(channel, request, data, RECEIVED.take(), options) };
        ring.start();
        Self(ring)
    }

    /// Reads the characters that came, or waits for some, and gives their number.
    pub async fn read(&mut self, bytes: &mut [u8]) -> Result<usize, Lost> {
        poll_fn(|context| {
            SILENCE.register(context.waker());
            self.0.set_waker(context.waker());
            if IS_DAMAGED.swap(false, Ordering::Relaxed) {
                self.0.clear();
                return Poll::Ready(Err(Lost));
            }
            match self.0.read(bytes) {
                Ok((0, _)) => Poll::Pending,
                Ok((count, _)) => Poll::Ready(Ok(count)),
                Err(_) => {
                    COUNTERS.serial_overrun.add();
                    Poll::Ready(Err(Lost))
                }
            }
        })
        .await
    }
}

/// Counts receive errors, and wakes the reader when the line falls silent.
pub fn on_interrupt(flags: Sr) {
    if !(flags.idle() || flags.ne() || flags.fe() || flags.pe() || flags.ore()) {
        return;
    }
    // Reading SR and then DR clears these flags (RM0090 section 30.6.1). If a character waits, it is the DMA
    // that reads DR. A character that comes between the two reads, some 20 ns apart, is lost.
    cortex_m::interrupt::free(|_| {
        if !pac::USART3.sr().read().rxne() {
            pac::USART3.dr().read();
        }
    });
    COUNTERS.serial_noise.add_if(flags.ne());
    COUNTERS.serial_framing.add_if(flags.fe());
    COUNTERS.serial_parity.add_if(flags.pe());
    COUNTERS.serial_overrun.add_if(flags.ore());
    IS_DAMAGED.fetch_or(flags.pe(), Ordering::Relaxed);
    SILENCE.wake();
}
