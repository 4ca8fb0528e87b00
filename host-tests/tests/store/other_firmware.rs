//! A whole item of later firmware that this firmware cannot use: the configuration before it is used, and
//! without one the later version is reported.

use super::flash::{Flash, SECTOR};
use super::samples::{HEADER, NUMBER, Size, item_bytes, read, sample, save_and_check};
use crate::support::*;
use crc::{CRC_32_ISO_HDLC, Crc};
use slitrange_device::store::configuration::VERSION;

/// The library's checksum of an item, from its definition: CRC-32C from another start.
fn sum(bytes: &[u8]) -> u32 {
    reflected_crc(0xeeee_eeee, 0x82f6_3b78, bytes)
}

#[test]
fn an_item_of_later_firmware_is_passed_over() {
    let [first, second, third] = [0, 1, 2].map(|i| sample(Size::Least, i));
    let length = item_bytes(Size::Least);
    // Items follow the word that marks the sector as used.
    let start = |i: usize| 4 + i * length.next_multiple_of(4);
    let mut flash = Flash::erased();
    save_and_check(&mut flash, &first);
    save_and_check(&mut flash, &second);
    let item = &mut flash.bytes[start(1)..][..length];
    let whole = sum(&item[HEADER..]).to_le_bytes();
    assert_eq!(item[..4], whole, "the sum is that of its definition");
    // A configuration begins with its version.
    let version = &mut item[HEADER + NUMBER];
    assert_eq!(*version, VERSION);
    *version += 1;
    let whole = sum(&item[HEADER..]).to_le_bytes();
    item[..4].copy_from_slice(&whole);
    assert_eq!(read(&mut flash), Stored::Older(first.clone()));
    // The next save has the highest number, so it is the newest for the later firmware too.
    save_and_check(&mut flash, &third);
    let numbers: Vec<u8> = (0..3).map(|i| flash.bytes[start(i) + HEADER]).collect();
    assert_eq!(numbers, [1, 2, 3]);
    // Alone, the item is of a later version. A save leaves the item there.
    flash.bytes.copy_within(start(1)..start(2), start(0));
    flash.bytes[start(1)..start(3)].fill(0xff);
    assert_eq!(read(&mut flash), Stored::Later(VERSION + 1));
    // In the second sector it is later as well, and damaged it is unusable.
    let mut moved = flash.clone();
    moved.bytes.copy_within(..SECTOR, SECTOR);
    moved.bytes[..SECTOR].fill(0xff);
    let mut damaged = flash.clone();
    damaged.bytes[start(0) + HEADER + NUMBER + 1] ^= 1;
    assert_eq!(read(&mut damaged), Stored::Unusable);
    for (mut flash, later) in [(flash, 0), (moved, SECTOR)] {
        assert_eq!(read(&mut flash), Stored::Later(VERSION + 1));
        let kept = later..later + SECTOR;
        let before = flash.bytes[kept.clone()].to_vec();
        save_and_check(&mut flash, &third);
        let is_kept = flash.bytes[kept] == before;
        assert!(is_kept, "the save of later firmware is gone");
    }
}

#[test]
fn a_record_of_a_later_version_is_reported() {
    let mut flash = Flash::erased();
    let saved = sample(Size::Middle, 0);
    save_and_check(&mut flash, &saved);
    let own = EncodedRecord::new(saved.record.expect("a record")).expect("usable");
    let length = own.bytes().len();
    let item = &mut flash.bytes[4..][..item_bytes(Size::Middle)];
    let from = item.len() - length;
    assert_eq!(item[from], record::VERSION);
    item[from] += 1;
    let end = item.len() - 4;
    let crc = Crc::<u32>::new(&CRC_32_ISO_HDLC).checksum(&item[from..end]);
    item[end..].copy_from_slice(&crc.to_le_bytes());
    let whole = sum(&item[HEADER..]).to_le_bytes();
    item[..4].copy_from_slice(&whole);
    assert_eq!(read(&mut flash), Stored::Later(record::VERSION + 1));
}

/// The library's checksum of an item's length, from its definition: CRC-16, reflected polynomial 0x1a2e.
fn length_sum(length: u16) -> u16 {
    reflected_crc(0xffff, 0x1a2e, &length.to_le_bytes()) as u16
}

/// Records of later firmware may be longer.
#[test]
fn an_item_that_is_too_long_is_passed_over() {
    let [first, second, third] = [0, 1, 2].map(|i| sample(Size::Middle, i));
    let start = 4 + item_bytes(Size::Middle).next_multiple_of(4);
    let mut flash = Flash::erased();
    save_and_check(&mut flash, &first);
    // The header is right for an item of this firmware: so it is for the long one.
    let length = (item_bytes(Size::Middle) - HEADER) as u16;
    assert_eq!(flash.bytes[8..10], length.to_le_bytes());
    assert_eq!(flash.bytes[10..12], length_sum(length).to_le_bytes());
    let mut data = vec![0x55; NUMBER + 2651];
    data[..NUMBER].copy_from_slice(&2u32.to_le_bytes());
    data[NUMBER] = VERSION;
    let length = data.len() as u16;
    let mut item = sum(&data).to_le_bytes().to_vec();
    item.extend(length.to_le_bytes());
    item.extend(length_sum(length).to_le_bytes());
    item.extend(data);
    flash.bytes[start..start + item.len()].copy_from_slice(&item);
    assert_eq!(read(&mut flash), Stored::Older(first));
    save_and_check(&mut flash, &second);
    save_and_check(&mut flash, &third);
}
