//! Something whole that this firmware does not know: what was saved before it holds.

use slitrange::store::Stored;

use crate::flash::Flash;
use crate::samples::{Size, keep, read, sample};

/// Of an item: the library's header, the number, and what is saved, which begins with its version.
const NUMBER: usize = 8;
const VERSION: usize = NUMBER + 4;
const LENGTH: usize = 4 + 10;

/// The library's sum of an item, from its definition: CRC-32C from another start.
fn sum(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(0xeeee_eeee, |sum, &byte| {
        (0..8).fold(sum ^ u32::from(byte), |sum, _| {
            (sum >> 1) ^ if sum & 1 == 1 { 0x82f6_3b78 } else { 0 }
        })
    })
}

#[test]
fn saved_over_what_was_here() {
    let [first, second, third] = [0, 1, 2].map(|i| sample(Size::Least, i));
    let mut flash = Flash::erased();
    keep(&mut flash, &first);
    let at = 4 + NUMBER + (LENGTH + 2);
    keep(&mut flash, &second);
    let item = &mut flash.bytes[at..at + NUMBER + LENGTH];
    let whole = sum(&item[NUMBER..]).to_le_bytes();
    assert_eq!(item[..4], whole, "the sum is that of its definition");
    assert_eq!(item[VERSION], 1);
    item[VERSION] = 2;
    let whole = sum(&item[NUMBER..]).to_le_bytes();
    item[..4].copy_from_slice(&whole);
    assert_eq!(read(&mut flash), Stored::Older(first.clone()));
    // What is saved over it is newer for the later firmware too.
    keep(&mut flash, &third);
    let numbers: Vec<u8> = (0..3)
        .map(|i| flash.bytes[4 + i * (NUMBER + LENGTH + 2) + NUMBER])
        .collect();
    assert_eq!(numbers, [1, 2, 3]);
    // Alone it is unusable, not nothing.
    flash.bytes[4..28].fill(0xff);
    flash.bytes[52..76].fill(0xff);
    flash.bytes.copy_within(28..52, 4);
    flash.bytes[28..52].fill(0xff);
    assert_eq!(read(&mut flash), Stored::Unusable);
    keep(&mut flash, &third);
}
