//! The bytes of a configuration: encoding and decoding give the same configuration back, and unusable bytes
//! are refused.

use super::samples::{Size, sample};
use crate::records::{cases, records};
use crate::support::*;
use slitrange_device::store::configuration::{
    ConfigurationError, MAX_ENCODED, VERSION, decode, encode,
};

fn encoded(configuration: &Configuration) -> Vec<u8> {
    encode(&configuration.as_ref(), &mut [0; MAX_ENCODED])
        .expect("it can be used")
        .to_vec()
}

/// What stands before the record: version, length, and the settings' lines.
fn settings_bytes(configuration: &Configuration) -> usize {
    encoded(&with(configuration.clone(), |it| it.record = None)).len()
}

/// Later firmware reads these bytes, unless the version changes. The core tests the settings' lines.
#[test]
fn the_records_own_bytes_follow_the_settings() {
    let configuration = sample(Size::Middle, 5);
    let (all, from) = (encoded(&configuration), settings_bytes(&configuration));
    let own = EncodedRecord::new(configuration.record.expect("one")).expect("usable");
    assert_eq!(all[from..], *own.bytes());
}

#[test]
fn the_longest_configuration_fits_and_shorter_buffers_are_refused() {
    let longest = sample(Size::Most, 7);
    let bytes = encoded(&longest);
    let lengths = [Size::Most, Size::Middle, Size::Least].map(|it| encoded(&sample(it, 7)).len());
    println!("{lengths:?} bytes of {MAX_ENCODED}: the longest, with eq. (1), settings alone");
    assert!(bytes.len() <= MAX_ENCODED);
    let settings = settings_bytes(&longest);
    for room in (0..bytes.len()).step_by(97).chain(0..80) {
        let error = encode(&longest.as_ref(), &mut vec![0; room]).err();
        let expected = match room.checked_sub(settings) {
            None => ConfigurationError::NoRoom { bytes: room },
            Some(bytes) => RecordError::NoRoom { bytes }.into(),
        };
        assert_eq!(error, Some(expected));
    }
}

#[test]
fn errors_say_what_is_wrong_and_what_to_do() {
    let [first, last] = [-3, 4000].map(Pixels::from_int);
    let of_record = RecordError::OffTheSensor { first, last };
    let text = [
        StoreError::from(ConfigurationError::NoRoom { bytes: 100 }),
        ConfigurationError::Short { bytes: 3 }.into(),
        ConfigurationError::Version { version: 2 }.into(),
        ConfigurationError::NotText.into(),
        ConfigurationError::Setting(Setting::Rows).into(),
        ConfigurationError::Record(of_record).into(),
        StoreError::Flash,
        StoreError::Worn,
    ]
    .map(|error| error.to_string());
    insta::assert_snapshot!(text.join("\n"));
}

fn settings() -> impl Strategy<Value = Settings> {
    let lines = prop_oneof![
        "rows ([1-9]|[1-5][0-9]|6[0-4])",
        "mean (plain|weighted)",
        "black (shielded|frame|fixed [1-3]?[0-9]{1,3})",
        "exposure (auto|[1-4][0-9]{1,3}|5600)",
        "exposure limit ([1-4][0-9]{1,3}|5600)",
        "laser (on|off)",
        "ambient (subtract|off)",
        "estimator (centroid|phase-table|adaptive|gauss-newton|fraunhofer)",
    ];
    prop::collection::vec(lines, 0..8).prop_map(|lines| {
        let mut settings = Settings::default();
        for line in &lines {
            let Ok(Command::Set(value)) = parse(line.as_bytes()) else {
                panic!("no setting: {line}");
            };
            settings.set(value);
        }
        settings
    })
}

/// Settings and records of every kind but those with centres beyond the sensor, which `encode` refuses.
fn all() -> impl Strategy<Value = Configuration> {
    let records = prop::option::weighted(0.9, records()).prop_map(Option::flatten);
    let fits = |record: &Record| record::encode(record, &mut [0; record::MAX_ENCODED]).is_ok();
    (settings(), records).prop_map(move |(settings, record)| Configuration {
        settings,
        record: record.filter(fits),
    })
}

proptest! {
    #![proptest_config(cases(2000))]

    #[test]
    fn configurations_decode_to_themselves(configuration in all()) {
        let bytes = encoded(&configuration);
        prop_assert!(bytes.len() <= MAX_ENCODED);
        let again = decode(&bytes);
        prop_assert_eq!(again.as_ref(), Ok(&configuration));
    }

    /// Damaged bytes and any others: what decodes can be encoded, and decodes to itself again.
    #[test]
    fn decoded_configurations_encode_and_decode_to_themselves(
        configuration in all(),
        changes in prop::collection::vec((0..80usize, any::<u8>()), 1..4),
        any_bytes in prop::collection::vec(any::<u8>(), 0..60),
    ) {
        let mut near = encoded(&configuration);
        for (place, byte) in changes {
            if let Some(changed) = near.get_mut(place) {
                *changed = byte;
            }
        }
        let versioned = |version| -> Vec<u8> {
            [version].into_iter().chain(any_bytes.iter().copied()).collect()
        };
        for bytes in [near, versioned(VERSION), any_bytes.clone()] {
            if let Ok(configuration) = decode(&bytes) {
                prop_assert_eq!(decode(&encoded(&configuration)), Ok(configuration));
            }
        }
    }
}
