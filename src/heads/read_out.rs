//! A read-out by the converter at SPI1: when its words end, and whether SCLK had a gap.

use core::future::{Future, poll_fn};
use core::pin::Pin;
use core::task::Poll;

use embassy_stm32::spi;
use embassy_time::{Duration, Instant, with_timeout};

use super::WORDS;
use crate::alarm::set_alarm;
use crate::board::{self, cycles_in_ns};

/// The sensor's clock and the converter's come from one PLL: SCLK is APB2 (84 MHz) / 8, exactly. The
/// converter takes at most 16 MHz, and the next divider gives 21.
pub const SCLK_HZ: u32 = 10_500_000;

/// From the end of a word until DMA has counted it: 0 to 40 cycles, for other accesses may come first.
const DMA_LATENCY: u32 = 20;

/// A word takes 1.5 us. If none has ended after this time, none will.
const WORD_TIMEOUT: u32 = cycles_in_ns(10_000);

/// A read-out that has not ended when the next row is due has this much time left.
const READ_OUT_TIMEOUT: Duration = Duration::from_millis(20);

/// Why a read-out brought no row.
#[derive(Clone, Copy, Debug, defmt::Format)]
pub enum ReadOutError {
    /// A word came before DMA had fetched the one before: it is lost.
    WordLost,
    /// The transfer did not end in its time.
    Timeout,
    /// The program was late for an edge, or SCLK had a gap: it is not known which pixel is which word.
    Late,
}

/// Polls a transfer until it has ended or the alarm rings, which must be set. `Pending` if the alarm rang.
async fn poll_until<T>(alarm: Instant, mut transfer: Pin<&mut impl Future<Output = T>>) -> Poll<T> {
    // DMA or the alarm wakes the task.
    poll_fn(|context| match transfer.as_mut().poll(context) {
        Poll::Pending if Instant::now() < alarm => Poll::Pending,
        result => Poll::Ready(result),
    })
    .await
}

/// Ends a read-out. `result` is what the transfer's first polls gave, and `word_0` is when word 0 ended. A
/// word takes `word` core cycles. At `look`, all pixels have come and some words have not: the program then
/// looks for a gap. At `next`, the transfer should have ended, and the next exposure should end: the alarm is
/// set for it.
///
/// # Errors
/// A lost word, a transfer that does not end, or else `word_0`'s or a gap's.
#[inline]
pub async fn end_read_out(
    mut transfer: Pin<&mut impl Future<Output = Result<(), spi::Error>>>,
    mut result: Poll<Result<(), spi::Error>>,
    word_0: Result<u32, ReadOutError>,
    word: u32,
    [look, next]: [Instant; 2],
) -> Result<(), ReadOutError> {
    set_alarm(look).await;
    if result.is_pending() {
        result = poll_until(look, transfer.as_mut()).await;
    }
    let in_step = match word_0 {
        Ok(word_0) if has_gap(word_0, word) => Err(ReadOutError::Late),
        word_0 => word_0,
    };
    let has_lost_a_word = board::has_lost_a_word();
    set_alarm(next).await;
    if result.is_pending() {
        result = poll_until(next, transfer.as_mut()).await;
    }
    // DMA waits for a lost word for ever.
    if has_lost_a_word || board::has_lost_a_word() {
        return Err(ReadOutError::WordLost);
    }
    if result.is_pending() {
        let result = with_timeout(READ_OUT_TIMEOUT, transfer).await;
        // embassy's read by DMA has no error of its own (embassy-stm32 0.6.0, spi/mod.rs, `read`).
        let _ = result.map_err(|_| ReadOutError::Timeout)?;
    }
    in_step.map(|_| ())
}

/// When word 0 of the transfer under way ended, by the cycle counter. Waits for the end of the next word, and
/// subtracts the words before it: so it does not matter how many words a slow core missed. The transfer has
/// `words` words of `word` core cycles. `None` if no word ends.
///
/// The program sees the end of a word at one look, and not at the look before. The middle of the two does not
/// depend on the core's speed.
pub fn find_end_of_word_0(words: usize, word: u32) -> Option<u32> {
    let first = board::words_to_come();
    let start = board::cycles();
    let mut looked = start;
    while looked.wrapping_sub(start) < WORD_TIMEOUT {
        let looked_before = looked;
        let to_come = board::words_to_come();
        looked = board::cycles();
        if to_come != first {
            let seen = looked.wrapping_sub(looked.wrapping_sub(looked_before) / 2);
            let words_before = (words as u32 - 1).saturating_sub(to_come);
            return Some(seen.wrapping_sub(DMA_LATENCY + words_before * word));
        }
    }
    None
}

/// Whether SCLK paused since word 0 ended. A word takes `word` core cycles. Waits for the end of a word, if
/// one is still to come.
///
/// A word must not end later than three eighths of a word after SCLK would bring it: 96 cycles of 256. DMA
/// counts each of the two words after 0 to 40 cycles, and the program sees each end to half a turn of its
/// loop of at most 16 instructions. So without a gap the two differ by 56 cycles at most, and by 88 if an
/// instruction takes three cycles. A gap of 152 cycles, and of 184 on that slow core, is always seen.
/// A shorter gap, below 0.6 of a pixel, passes. embassy receives by a transfer in both directions, so SCLK
/// waits when the DMA stream that sends is late. That stream has the time of a word, 1.5 us, for each word,
/// and DMA2 serves nothing but SPI1. If the stream that receives is late, a word is lost: see
/// [`board::has_lost_a_word`].
fn has_gap(word_0_ended: u32, word: u32) -> bool {
    cortex_m::interrupt::free(|_| {
        let ended = if board::words_to_come() > 0 {
            find_end_of_word_0(WORDS, word)
        } else {
            Some(board::cycles().wrapping_sub((WORDS as u32 - 1) * word))
        };
        let later = |ended: u32| ended.wrapping_sub(word_0_ended) as i32;
        ended.is_none_or(|ended| later(ended) > (3 * word / 8) as i32)
    })
}
