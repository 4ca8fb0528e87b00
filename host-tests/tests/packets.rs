//! Packets of `format binary`: written and read, cut anywhere, with flipped, lost and added bytes.

use crate::support::*;
use slitrange::base::units::Units;
use slitrange_device::protocol::csv::{CsvLine, Header};
use slitrange_device::protocol::line::ResultLine;
use slitrange_device::protocol::packet::{
    COUNTS_A_PACKET, Decoder, MAX_PACKET, Message, Packed, Packet, PacketError, Packets, RowHead,
    RowWords, TEXT_PART, parts_of_text, unpack,
};
use slitrange_device::protocol::row_lines::{self, RowExposure, RowPart};
use slitrange_device::settings::columns::{Column, Columns};

fn words_message(number: u32, first: u16, words: &[u8]) -> Message<'_> {
    Message::Words {
        number,
        first,
        words,
    }
}

fn exposure() -> impl Strategy<Value = Option<Exposure>> {
    prop::option::of((10..=5600u16).prop_map(|us| Exposure::from_us(us).expect("in range")))
}

prop_compose! {
    fn reading()(
        [distance, uncertainty, centre, u, amplitude, width, black] in any::<[i32; 7]>(),
        bits in any::<[i32; 7]>(),
        exposure in exposure(),
        estimator in prop::sample::select(&Estimator::ALL[..]),
        ([rows_used, rows, misfits], correlated, slits_used, [is_nominal, has_other_settings])
            in any::<([u16; 3], Option<u16>, u8, [bool; 2])>(),
    ) -> Reading {
        Reading {
            distance: Micrometres::from_bits(distance),
            uncertainty: Micrometres::from_bits(uncertainty),
            parts: parts(bits.map(Micrometres::from_bits)),
            centre: Pixels::from_bits(centre),
            centre_uncertainty: Pixels::from_bits(u),
            amplitude: Counts::from_bits(amplitude),
            width: Pixels::from_bits(width),
            black_level: Counts::from_bits(black),
            exposure, estimator, rows_used, rows, misfits, correlated, slits_used, is_nominal,
            has_other_settings,
        }
    }
}

fn fault() -> impl Strategy<Value = Fault> {
    let numbers = (any::<[i32; 2]>(), any::<[u16; 2]>(), 0..Fault::KINDS);
    numbers.prop_map(|(bits, counts, kind)| frames::faults(bits, counts)[kind])
}

prop_compose! {
    fn measured()((bits, counts, is_comb) in any::<([i32; 17], [u16; 5], bool)>()) -> Measured {
        frame_of(bits, counts, is_comb.then_some(counts[0].max(1)))
    }
}

prop_compose! {
    fn row_head()(
        result in prop_oneof![measured().prop_map(Ok), fault().prop_map(Err)],
        exposure in exposure(),
        (number, skipped, time_us, words) in any::<(u32, u32, u64, u16)>(),
    ) -> RowHead {
        RowHead { number, skipped, time_us, exposure, words, result }
    }
}

prop_compose! {
    fn frame_result()(
        result in prop_oneof![reading().prop_map(Ok), fault().prop_map(Err)],
        (counter, time_us, is_difference) in any::<(u32, u64, bool)>(),
    ) -> FrameResult {
        FrameResult { counter, time_us, is_difference, result }
    }
}

/// A frame of these numbers. With a comb, all of its slits have an image in so many rows.
fn frame_of(bits: [i32; 17], counts: [u16; 5], rows_of_comb: Option<u16>) -> Measured {
    let px = bits.map(Pixels::from_bits);
    let slit = |rows: u16| SlitCentre {
        centre: px[15],
        height: counts[4],
        rows: rows.try_into().expect("rows"),
    };
    Measured {
        frame: FrameCentre {
            centre: px[0],
            uncertainty: px[1],
            amplitude: Counts::from_bits(bits[2]),
            exposure: Some(Exposure::LONGEST),
            width: px[3],
            rows_used: counts[0],
            rows: counts[1],
            misfits: counts[2],
            shape: SpotShape {
                components: [px[4], px[5], px[6], px[7], px[8]],
                noise: px[9],
                width: px[10],
                rest: px[11],
            },
            correlated: Some(counts[3]),
            spread: px[12],
            motion: px[13],
        },
        black_level: Counts::from_bits(bits[14]),
        ambient: Counts::from_bits(bits[14]),
        estimator: Estimator::Fraunhofer,
        by_shape: px[16],
        pixels: pixel_errors(counts[4], bits[15]),
        comb: rows_of_comb.map(|rows| Combined {
            shift: px[15],
            surface: px[16],
            used: 16,
            centres: [Some(slit(rows)); MAX_SLITS],
        }),
    }
}

fn message() -> impl Strategy<Value = Message<'static>> {
    let text = |bytes: Vec<u8>| Message::Text(bytes.leak());
    let packed = || {
        let counts = prop::collection::vec(0..=4095u16, 0..=COUNTS_A_PACKET);
        counts.prop_map(|it| &*Packed::new(it.into_iter()).bytes().to_vec().leak())
    };
    prop_oneof![
        // Runs without a zero, and runs of zeros.
        prop::collection::vec(any::<u8>(), 0..=TEXT_PART).prop_map(text),
        prop::collection::vec(1..=255u8, 0..=TEXT_PART).prop_map(text),
        prop::collection::vec(0..=1u8, 0..=TEXT_PART).prop_map(text),
        row_head().prop_map(Message::Row),
        (any::<(u32, u16)>(), packed()).prop_map(|((counter, first), counts)| Message::Window {
            counter,
            first,
            counts
        }),
        (any::<(u32, u16)>(), packed())
            .prop_map(|((of, first), bytes)| words_message(of, first, bytes)),
        frame_result().prop_map(Message::Result),
    ]
}

fn written(messages: &[Message<'_>]) -> (Vec<u8>, Vec<usize>) {
    let (mut packets, mut bytes, mut starts) = (Packets::default(), vec![], vec![]);
    for message in messages {
        starts.push(bytes.len());
        let packet = packets.encode(*message);
        assert!((8..=MAX_PACKET).contains(&packet.len()), "{}", packet.len());
        assert_eq!((packet[0], packet[packet.len() - 1]), (0, 0));
        assert!(packet[1..packet.len() - 1].iter().all(|&byte| byte != 0));
        bytes.extend_from_slice(packet);
    }
    (bytes, starts)
}

/// A packet's number, and its message to the last bit: as text, which outlives the packet.
type Read = (u16, String);

/// What a reader makes of bytes: the packets, and the errors.
fn read(bytes: &[u8]) -> (Vec<Read>, Vec<PacketError>) {
    let (mut decoder, mut packets, mut errors) = (Decoder::new(), vec![], vec![]);
    for &byte in bytes {
        match decoder.take(byte) {
            Some(Ok(Packet { sequence, message })) => {
                packets.push((sequence, format!("{message:?}")))
            }
            Some(Err(error)) => errors.push(error),
            None => {}
        }
    }
    (packets, errors)
}

fn numbered(messages: &[Message<'_>]) -> Vec<Read> {
    let texts = messages.iter().map(|message| format!("{message:?}"));
    (0..).zip(texts).collect()
}

#[derive(Clone, Copy, Debug)]
enum Noise {
    Flip(u8),
    Lose,
    Add(u8),
}

fn noise() -> impl Strategy<Value = Noise> {
    let flip = (0..8u8).prop_map(Noise::Flip);
    prop_oneof![flip, Just(Noise::Lose), any::<u8>().prop_map(Noise::Add)]
}

proptest! {
    #[test]
    fn packets_are_read_as_they_are_written(messages in prop::collection::vec(message(), 1..20)) {
        let (bytes, _) = written(&messages);
        prop_assert_eq!(read(&bytes), (numbered(&messages), vec![]));
    }

    /// The reference is the crate `cobs`.
    #[test]
    fn the_stuffing_is_cobs(message in message()) {
        let (bytes, _) = written(std::slice::from_ref(&message));
        let between_zeros = &bytes[1..bytes.len() - 1];
        let mut body = vec![0; bytes.len()];
        let length = cobs::decode(between_zeros, &mut body).expect("COBS");
        let (packet, sum) = body[..length].split_last_chunk().expect("a CRC");
        let crc = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC);
        prop_assert_eq!(u32::from_le_bytes(*sum), crc.checksum(packet));
        let mut again = vec![0; cobs::max_encoding_length(length)];
        let length = cobs::encode(&body[..length], &mut again);
        prop_assert_eq!(&again[..length], between_zeros);
    }

    #[test]
    fn a_reader_that_joins_anywhere_is_in_step_within_one_packet(
        messages in prop::collection::vec(message(), 2..8),
        place in any::<prop::sample::Index>(),
    ) {
        let (bytes, starts) = written(&messages);
        let cut = place.index(bytes.len());
        let first_whole = starts.iter().filter(|&&start| start < cut).count();
        let (packets, errors) = read(&bytes[cut..]);
        // Without its first zero a packet is whole all the same.
        let missing = match starts.iter().any(|&start| start + 1 == cut) {
            true => first_whole - 1,
            false => first_whole,
        };
        prop_assert_eq!(packets, numbered(&messages)[missing..].to_vec());
        prop_assert!(errors.len() <= 1, "{:?}", errors);
    }

    /// The CRC accepts a damaged packet with a probability of 2^-32: never in these few thousand.
    #[test]
    fn no_wrong_packet_is_accepted(
        messages in prop::collection::vec(message(), 1..8),
        noise in prop::collection::vec((any::<prop::sample::Index>(), noise()), 1..12),
    ) {
        let (mut bytes, _) = written(&messages);
        let places = noise.len();
        for (place, noise) in noise {
            if bytes.is_empty() {
                break;
            }
            let place = place.index(bytes.len());
            match noise {
                Noise::Flip(bit) => bytes[place] ^= 1 << bit,
                Noise::Lose => _ = bytes.remove(place),
                Noise::Add(byte) => bytes.insert(place, byte),
            }
        }
        let (packets, _) = read(&bytes);
        let sent = numbered(&messages);
        for packet in &packets {
            prop_assert!(sent.contains(packet), "{:?}", packet);
        }
        // Each place damages a packet at most, or the zeros between two packets.
        prop_assert!(packets.len() + 2 * places >= sent.len(), "{} of {}", packets.len(), sent.len());
    }

    #[test]
    fn any_bytes_are_no_packet(bytes in prop::collection::vec(any::<u8>(), 0..2000)) {
        prop_assert_eq!(read(&bytes).0, vec![]);
    }

    /// Two numbers of twelve bits take three bytes.
    #[test]
    fn counts_are_unpacked_as_they_were_packed(
        counts in prop::collection::vec(0..=4095u16, 0..=COUNTS_A_PACKET),
    ) {
        let packed = Packed::new(counts.iter().copied());
        prop_assert_eq!(packed.bytes().len(), (counts.len() * 3).div_ceil(2));
        prop_assert_eq!(unpack(packed.bytes()).collect::<Vec<u16>>(), counts);
    }

    #[test]
    fn a_row_is_sent_whole_or_not_at_all(words in prop::collection::vec(0..=4096u16, 0..4000)) {
        let mut messages = RowWords::new(7, &words);
        let is_row = words.iter().all(|&word| word < 4096);
        prop_assert_eq!(messages.left(), if is_row { words.len() } else { 0 });
        let mut sent: Vec<u16> = vec![];
        while let Some(Message::Words { number, first, words }) = messages.next_message() {
            prop_assert_eq!((number, usize::from(first)), (7, sent.len()));
            sent.extend(unpack(words));
        }
        prop_assert_eq!(sent, if is_row { words } else { vec![] });
    }

    #[test]
    fn the_parts_of_a_text_are_the_text(text in "([a-z0-9 ]{0,600}\r\n){0,5}") {
        let parts: Vec<&[u8]> = parts_of_text(&text).collect();
        prop_assert_eq!(parts.concat(), text.as_bytes());
        for part in &parts {
            prop_assert!(part.ends_with(b"\r\n") || part.len() == TEXT_PART || text.len() > TEXT_PART);
        }
    }
}

fn example() -> FrameResult {
    let um = Micrometres::from_f32;
    let measured = at_centre(1770.125);
    let reading = nominal_reading(&measured, &CalibrationErrors::Unknown, Surface::Off);
    FrameResult {
        counter: 1234,
        time_us: 7_033_800,
        is_difference: false,
        result: reading.map(|reading| Reading {
            distance: um(800_123.4),
            uncertainty: um(437.2),
            parts: parts([3.5, 0.0, 0.0, 0.0, 437.186, 0.0, 0.0].map(um)),
            centre_uncertainty: Pixels::from_f32(0.002),
            amplitude: Counts::from_int(1011),
            exposure: Exposure::from_us(187),
            ..reading
        }),
    }
}

/// Every flip of one bit, and of two bits at most 16 bits apart, in the middle one of three packets.
#[test]
fn short_bursts_are_found_and_cost_one_packet() {
    let messages = vec![Message::Result(example()); 3];
    let (bytes, starts) = written(&messages);
    let sent = numbered(&messages);
    let bits = starts[1] * 8..starts[2] * 8;
    let mut bursts = 0;
    for first in bits.clone() {
        for second in first..(first + 17).min(bits.end) {
            let mut damaged = bytes.clone();
            damaged[first / 8] ^= 1 << (first % 8);
            if second > first {
                damaged[second / 8] ^= 1 << (second % 8);
            }
            let (packets, _) = read(&damaged);
            let others = [&sent[0], &sent[2]];
            // A flip in the zeros may leave all three.
            let is_one_lost = packets.iter().eq(others) || packets == sent;
            assert!(is_one_lost, "{first} {second}: {packets:?}");
            bursts += 1;
        }
    }
    println!("{bursts} bursts in {} bits of a packet", bits.len());
}

/// The longest result: all numbers at their longest. And the longest packet of all, without a zero in it.
#[test]
fn the_longest_packets_have_the_stated_lengths() {
    let longest = Micrometres::MIN;
    let result = FrameResult {
        counter: u32::MAX,
        time_us: u64::MAX,
        is_difference: true,
        result: Ok(Reading {
            distance: longest,
            uncertainty: longest,
            parts: parts([longest; 7]),
            centre: Pixels::MIN,
            centre_uncertainty: Pixels::MIN,
            amplitude: Counts::MIN,
            exposure: Some(Exposure::LONGEST),
            width: Pixels::MIN,
            rows_used: u16::MAX,
            rows: u16::MAX,
            slits_used: u8::MAX,
            black_level: Counts::MIN,
            estimator: Estimator::Fraunhofer,
            misfits: u16::MAX,
            correlated: Some(u16::MAX),
            is_nominal: true,
            has_other_settings: true,
        }),
    };
    // The sequence number takes three bytes from 16,384 on.
    let mut packets = Packets::default();
    for _ in 0..20_000 {
        packets.encode(Message::Text(b""));
    }
    let of_result = packets.encode(Message::Result(result)).len();
    let usual = Packets::default().encode(Message::Result(example())).len();
    let of_text = packets.encode(Message::Text(&[b'x'; TEXT_PART])).len();
    let of_comb = frame_of([i32::MIN; 17], [u16::MAX; 5], Some(u16::MAX));
    let of_row = Message::Row(RowHead {
        number: u32::MAX,
        skipped: u32::MAX,
        time_us: u64::MAX,
        exposure: Some(Exposure::LONGEST),
        words: u16::MAX,
        result: Ok(of_comb),
    });
    let of_row = packets.encode(of_row).len();
    let all = Packed::new([4095; COUNTS_A_PACKET].into_iter());
    let of_words = words_message(u32::MAX, u16::MAX, all.bytes());
    let of_words = packets.encode(of_words).len();
    println!("a result: {of_result} bytes, usually {usual}; a text: {of_text}");
    println!("a row: {of_row} bytes; words of a row: {of_words}");
    let stated = (RESULT, 270, 353, MAX_PACKET);
    assert_eq!((of_result, of_text, of_row, of_words), stated);
    let too_long = packets.encode(Message::Text(&[b'x'; MAX_PACKET]));
    assert!(too_long.is_empty());
}

/// The longest packet of a result, as docs/serial-line.md states it.
const RESULT: usize = 118;

/// docs/serial-line.md shows these bytes.
#[test]
fn the_example_of_the_page_is_what_the_core_writes() {
    let mut packets = Packets::default();
    let page = std::fs::read_to_string("../docs/serial-line.md").expect("the page");
    for message in [Message::Text(b"rows 16\r\n"), Message::Result(example())] {
        let bytes = packets.encode(message).iter();
        let digits: Vec<String> = bytes.map(|byte| format!("{byte:02x}")).collect();
        let lines = digits
            .chunks(32)
            .map(|line| format!("    {}", line.join(" ")));
        let block = lines.collect::<Vec<_>>().join("\n");
        println!("{block}\n");
        assert!(page.contains(&block), "docs/serial-line.md lacks\n{block}");
    }
}

/// Bits of numbers that are written in different widths.
const EDGES: [i32; 13] = [
    0,
    1,
    -1,
    64,
    16_384,
    -49_152,
    128,
    2_559_986,
    2_559_987,
    4_385_280,
    99_999_999,
    i32::MAX,
    i32::MIN,
];

/// What the sensor writes, for clients/python/tests/test_printed.py: the numbers of a result or of a row's
/// centre, those with fractions in bits, and then its lines and its packet.
#[test]
fn python_reads_what_is_written() {
    let all = Column::ALL.into_iter().fold(Columns::NONE, Columns::with);
    let mut text = format!("{}\n{}\n", Header(Columns::default()), Header(all));
    let mut packets = Packets::default();
    let mut packet = |message: Message<'_>| {
        let bytes = packets.encode(message).iter();
        bytes.map(|byte| format!("{byte:02x}")).collect::<String>() + "\n"
    };
    let geometry = Geometry {
        words: 100,
        shielded: 0..4,
        light: 4..100,
        ..tcd1304dg()
    };
    let row = geometry.row(&[3788; 100]).expect("a row");
    let place = RowPart::Range {
        first: 96,
        last: 96,
    };
    for i in 0..EDGES.len() {
        let bits: [i32; 17] = std::array::from_fn(|j| EDGES[(i + 5 * j) % EDGES.len()]);
        let counts: [u16; 5] = std::array::from_fn(|j| [0, 1, 3, 16, 64, u16::MAX][(i + j) % 6]);
        let exposure = [None, Some(Exposure::SHORTEST), Some(Exposure::LONGEST)][i % 3];
        let (counter, time_us) = [(0, 0), (1, 1 << 40), (u32::MAX, u64::MAX)][i % 3];
        let [is_odd, is_other] = [i % 2 > 0, i % 4 > 1];
        let mut numbers: Vec<i128> = vec![i as i128, counter.into(), time_us.into()];
        numbers.push(exposure.map_or(0, |it| it.us()).into());
        numbers.extend(bits.map(i128::from));
        numbers.extend(counts.map(i128::from));
        let reading = Reading {
            distance: Micrometres::from_bits(bits[0]),
            uncertainty: Micrometres::from_bits(bits[1]),
            parts: parts(std::array::from_fn(|j| Micrometres::from_bits(bits[2 + j]))),
            centre: Pixels::from_bits(bits[9]),
            centre_uncertainty: Pixels::from_bits(bits[10]),
            amplitude: Counts::from_bits(bits[11]),
            width: Pixels::from_bits(bits[12]),
            black_level: Counts::from_bits(bits[13]),
            exposure,
            rows_used: counts[0],
            rows: counts[1],
            misfits: counts[2],
            correlated: is_odd.then_some(counts[3]),
            slits_used: i as u8 + 1,
            estimator: Estimator::ALL[i % 5],
            is_nominal: is_odd,
            has_other_settings: is_other,
        };
        let mut results = vec![Ok(reading)];
        if (2..5).contains(&i) {
            results.extend(frames::faults([bits[0], bits[1]], [counts[0], counts[1]]).map(Err));
        }
        text += &format!("{numbers:?}\n");
        for result in results {
            for units in [Units::Millimetres, Units::Micrometres] {
                let has_all = is_other == (units == Units::Millimetres);
                let line = ResultLine {
                    number: counter,
                    us: time_us,
                    result: &result,
                    is_difference: is_odd,
                    held: counts[4],
                    settings: &Settings {
                        output: if has_all { all } else { Columns::default() },
                        units,
                        ..Settings::default()
                    },
                };
                text += &format!("{line}\n{}\n", CsvLine(&line));
            }
            text += &packet(Message::Result(FrameResult {
                counter,
                time_us,
                is_difference: is_odd,
                result,
            }));
        }
        let comb = is_odd.then_some(counts[0].max(1));
        let result = Ok(frame_of(bits, counts, comb));
        let light = exposure.map_or(RowExposure::Unknown, RowExposure::On);
        let head = row_lines::RowHead::new(place, &row, light, &result, Region::ALL).to_string();
        text += &(head.replace("\r\n", "\n") + "\n");
        text += &packet(Message::Row(RowHead {
            number: counter,
            skipped: counter,
            time_us,
            exposure,
            words: counts[4],
            result,
        }));
    }
    insta::assert_snapshot!("python", text);
}
