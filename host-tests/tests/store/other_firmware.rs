//! A whole item of later or earlier firmware that this firmware cannot use: the configuration before it is
//! used.

use slitrange::base::units::Counts;
use slitrange::centre::Estimator;
use slitrange::frame::Mean;
use slitrange::light::black_level::BlackLevel;
use slitrange_device::settings::Settings;
use slitrange_device::store::Stored;
use slitrange_device::store::configuration::VERSION;

use super::flash::Flash;
use super::samples::{HEADER, NUMBER, Size, item_bytes, read, sample, save_and_check};

/// The library's checksum of an item, from its definition: CRC-32C from another start.
fn sum(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(0xeeee_eeee, |sum, &byte| {
        (0..8).fold(sum ^ u32::from(byte), |sum, _| {
            (sum >> 1) ^ if sum & 1 == 1 { 0x82f6_3b78 } else { 0 }
        })
    })
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
    // Alone, the unknown item is unusable, not nothing.
    flash.bytes.copy_within(start(1)..start(2), start(0));
    flash.bytes[start(1)..start(3)].fill(0xff);
    assert_eq!(read(&mut flash), Stored::Unusable);
    save_and_check(&mut flash, &third);
}

/// The library's checksum of an item's length, from its definition: CRC-16 with the reflected polynomial
/// 0x1a2e.
fn length_sum(length: u16) -> u16 {
    !length.to_le_bytes().iter().fold(0xffff, |sum, &byte| {
        (0..8).fold(sum ^ u16::from(byte), |sum, _| {
            (sum >> 1) ^ if sum & 1 == 1 { 0x1a2e } else { 0 }
        })
    })
}

/// Earlier firmware had records of up to 2641 bytes: tables with straight lines.
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

/// What the first firmware left in flash after two saves: `rows 7`, `mean plain`, `black fixed 300` and
/// `estimator robust`, each with the nominal calibration under another serial number.
const VERSION_1: &str = "\
00000000a89de3de45006dfa01000000010700707278002c010001ffffffff0fea0f0b15ee1c121f22e21c010c9a3374\
0080e00300bbe2951c869fffb0d09240bbe2a2248080b84a8080f0a50184da68dd000000\
14fded5845006dfa02000000010700707278002c010001fcffffff0fea0f0b15ee1c121f22e21c010c9a3374\
0080e00300bbe2951c869fffb0d09240bbe2a2248080b84a8080f0a501d6f64a8a000000";

#[test]
fn a_configuration_of_the_first_firmware_is_the_newest_until_a_change() {
    let mut flash = Flash::erased();
    for (i, place) in (0..VERSION_1.len()).step_by(2).zip(&mut flash.bytes) {
        *place = u8::from_str_radix(&VERSION_1[i..i + 2], 16).expect("a byte");
    }
    let Stored::Newest(found) = read(&mut flash) else {
        panic!("{:?}", read(&mut flash));
    };
    let expected = Settings {
        rows: 7,
        mean: Mean::Plain,
        // The successor of `robust`.
        estimator: Estimator::Adaptive,
        black_level: BlackLevel::Fixed(Counts::from_int(300)),
        ..Settings::default()
    };
    assert_eq!(found.settings, expected);
    let serial_number = found.record.as_ref().map(|record| record.serial_number);
    assert_eq!(serial_number, Some(u32::MAX - 3));
    // Saved again, it is written in today's form, once. A change is the newest.
    save_and_check(&mut flash, &found);
    let before = flash.bytes.clone();
    save_and_check(&mut flash, &found);
    assert!(flash.bytes == before);
    save_and_check(&mut flash, &sample(Size::Middle, 1));
}
