//! What a sensor's answers say, where they are more than the command that they answer.

use calibration::points::{Shape, SlitImage, SlitImages};
use slitrange::base::exposure::Exposure;
use slitrange::centre::spot_shape::COMPONENTS;
use slitrange::frame::comb::MAX_SLITS;

/// The centre of a frame, as `centre` answers it: `x 1770.98771 u 0.00195 a 1993 n 16/16 b 300 e t w 7.62131
/// o 0.00012 -0.00310 0.01203 0.00010 -0.00020`, and ` t 187`, ` m 3` and ` c 3` as in a reading.
///
/// A comb has ` k 16` after the shape, and a second line with the image of each slit: `slits 912.12345/1830 -
/// ...`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Centre {
    /// In pixels.
    pub x_px: f64,
    /// The standard uncertainty that the sensor claims, in pixels.
    pub claimed_px: f64,
    /// The spot's height in counts.
    pub height_counts: f64,
    /// The mean exposure of the rows used, in microseconds.
    pub exposure_us: u16,
    /// Rows in the frame.
    pub rows: u16,
    /// The estimator's letter.
    pub estimator: char,
    /// The spot's shape. None if the sensor could not measure it.
    pub shape: Option<Shape>,
    /// Rows that did not look like their spot.
    pub misfits: u32,
    /// As how few independent rows the frame's may count, where the sensor says so.
    pub correlated: Option<u16>,
    /// The images of a comb's slits.
    pub slits: Option<SlitImages>,
}

/// Why a frame gave no centre, in the sensor's own words.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NoCentre {
    /// `too dim: 35.2 counts, needs 60.1`
    pub fault: String,
    /// What to do about it.
    pub advice: String,
}

/// What the lines that came since `centre` was asked say, once they say it.
pub fn centre(lines: &[String]) -> Option<Result<Centre, NoCentre>> {
    let (last, before) = lines.split_last()?;
    let advice = last.strip_prefix('(').and_then(|it| it.strip_suffix(')'));
    if let Some(advice) = advice {
        return Some(Err(NoCentre {
            fault: before.last()?.strip_prefix("f ")?.to_owned(),
            advice: advice.to_owned(),
        }));
    }
    if let Some(images) = last.strip_prefix("slits ") {
        let (centre, _) = reading(before.last()?).filter(|(_, has_comb)| *has_comb)?;
        let slits = Some(slit_images(images)?);
        return Some(Ok(Centre { slits, ..centre }));
    }
    // The line with the slits follows that of a comb.
    let (centre, has_comb) = reading(last)?;
    (!has_comb).then_some(Ok(centre))
}

/// The images of a comb: `912.12345/1830`, or `-` for none.
fn slit_images(words: &str) -> Option<SlitImages> {
    let mut images = SlitImages::default();
    let words: Vec<&str> = words.split(' ').collect();
    for (image, word) in images.iter_mut().zip(&words) {
        if *word == "-" {
            continue;
        }
        let (x, height) = word.split_once('/')?;
        let height: u16 = height.parse().ok()?;
        *image = Some(SlitImage::new(five_decimals(x)?, height.into()));
    }
    (words.len() == MAX_SLITS).then_some(images)
}

/// The first line, and whether it is that of a comb.
fn reading(line: &str) -> Option<(Centre, bool)> {
    let words: Vec<&str> = line.split(' ').collect();
    let (measured, flags) = words.split_at_checked(20)?;
    let (of_frame, shape) = measured.split_at_checked(14)?;
    let [x, u, height, rows, black, letter, width] =
        keyed(of_frame, ["x", "u", "a", "n", "b", "e", "w"])?;
    let (&"o", components) = shape.split_first()? else {
        return None;
    };
    let mut components_px = [0.0; COMPONENTS];
    for (component, word) in components_px.iter_mut().zip(components) {
        *component = five_decimals(word)?;
    }
    let width_px = five_decimals(width)?;
    let (exposure, flags) = match *flags {
        ["t", us, ref flags @ ..] => (Exposure::from_us(us.parse().ok()?)?, flags),
        _ => (Exposure::LONGEST, flags),
    };
    let (has_comb, flags) = match *flags {
        ["k", used, ref flags @ ..] => {
            let _: u8 = used.parse().ok()?;
            (true, flags)
        }
        _ => (false, flags),
    };
    let (misfits, correlated) = match *flags {
        [] => ("0", None),
        ["m", misfits] => (misfits, None),
        ["c", correlated] => ("0", Some(correlated)),
        ["m", misfits, "c", correlated] => (misfits, Some(correlated)),
        _ => return None,
    };
    let (used, of) = rows.split_once('/')?;
    let used: u16 = used.parse().ok()?;
    let rows = of.parse().ok()?;
    let height: i32 = height.parse().ok()?;
    // It is of no interest here, but where noise made something else of it, it may have of the rest.
    let _: i32 = black.parse().ok()?;
    let mut letters = letter.chars();
    let centre = Centre {
        x_px: five_decimals(x)?,
        claimed_px: five_decimals(u)?,
        height_counts: height.into(),
        exposure_us: exposure.us(),
        rows: Some(rows).filter(|&rows| used <= rows)?,
        estimator: letters.next().filter(|_| letters.next().is_none())?,
        // All are zero if the sensor could not measure the shape.
        shape: (width_px > 0.0).then_some(Shape {
            width_px,
            components_px,
        }),
        misfits: misfits.parse().ok()?,
        correlated: correlated.map(str::parse).transpose().ok()?,
        slits: None,
    };
    Some((centre, has_comb))
}

/// The values of words that are a key and a value in turn: these keys, in this order.
pub(super) fn keyed<'a, const N: usize>(
    words: &[&'a str],
    keys: [&str; N],
) -> Option<[&'a str; N]> {
    let mut values = [""; N];
    for ((value, key), pair) in values.iter_mut().zip(keys).zip(words.chunks(2)) {
        let &[name, word] = pair else { return None };
        *value = (name == key).then_some(word)?;
    }
    (words.len() == 2 * N).then_some(values)
}

/// A number with as many decimals as the sensor sends: otherwise the line lost a byte, or has one too many.
fn five_decimals(word: &str) -> Option<f64> {
    let (whole, decimals) = word.split_once('.')?;
    let digits = whole.strip_prefix('-').unwrap_or(whole);
    let all = |text: &str| !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
    (all(digits) && all(decimals) && decimals.len() == 5).then(|| word.parse().ok())?
}

/// What follows these words in the first line that begins with them.
fn after<'a>(lines: &'a [String], words: &str) -> Option<&'a str> {
    lines.iter().find_map(|line| line.strip_prefix(words))
}

/// What `calibration` answers of the calibration in use, as far as a program needs it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct InUse {
    /// The record in use, where there is one.
    pub record: Option<RecordInUse>,
    /// What the flash holds: `same`, `other`, `none` or `unusable`.
    pub stored: String,
}

/// The record in use.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RecordInUse {
    /// Its length in bytes.
    pub bytes: usize,
    /// The CRC-32 at its end.
    pub crc: u32,
    /// The sensor's serial number.
    pub serial_number: u32,
    /// Whether the record may hold a measured front end. A line that was lost does not say that the record
    /// holds none.
    pub may_have_front_end: bool,
}

/// What the lines that came since `calibration` was asked say, once they say it.
pub fn in_use(lines: &[String]) -> Option<InUse> {
    let of = |key: &str| after(lines, &format!("calibration {key} "));
    let stored = of("stored")?.to_owned();
    if lines.iter().any(|line| line == "calibration none") {
        let record = None;
        return Some(InUse { record, stored });
    }
    let (bytes, crc) = of("record")?.split_once(' ')?;
    Some(InUse {
        record: Some(RecordInUse {
            bytes: bytes.parse().ok()?,
            crc: u32::from_str_radix(crc, 16).ok()?,
            serial_number: of("serial")?.parse().ok()?,
            may_have_front_end: of("front-end") != Some("assumed"),
        }),
        stored,
    })
}

/// The answer to a command that takes rows for a map of the pixels: `flat dark 300.1 counts`.
pub fn taken(lines: &[String], command: &str) -> Option<String> {
    let line = lines.last()?;
    let words = line.strip_prefix(command)?.strip_prefix(' ')?;
    let (counts, rest) = words.split_once(' ')?;
    let is_whole = counts.parse::<f64>().is_ok() && rest.starts_with("counts");
    is_whole.then(|| line.clone())
}

/// The lines of the answer to `flat`.
pub fn flat(lines: &[String]) -> Option<Vec<String>> {
    lines.last()?.strip_prefix("flat stored ")?;
    let of_flat = lines.iter().filter(|line| line.starts_with("flat "));
    Some(of_flat.cloned().collect())
}

/// The rows lost and the lines dropped, once the answer to `status` says both.
pub fn losses(lines: &[String]) -> Option<(u32, u32)> {
    let number = |words| after(lines, words)?.parse().ok();
    let (rows, dropped) = ("status rows lost ", "status lines dropped ");
    Some((number(rows)?, number(dropped)?))
}

/// The sensor head's name, once a line of the answer to `info` says it.
pub fn head(lines: &[String]) -> Option<String> {
    after(lines, "info sensor head ").map(str::to_owned)
}

#[cfg(test)]
mod tests {
    use super::*;
    use simulator::with;
    use slitrange::base::units::Units;
    use slitrange_device::protocol::calibration::{CalibrationAnswer, FlashStatus};
    use slitrange_device::record::encoded::EncodedRecord;

    fn lines(text: &str) -> Vec<String> {
        text.lines().map(str::to_owned).collect()
    }

    #[test]
    fn a_centre_is_read_whole_or_not_at_all() {
        let line = "x 1770.98771 u 0.00195 a 1993 n 15/16 b 300 e t w 7.62131 o 0.00012 -0.00310 0.01203 \
                    0.00010 -0.00020 m 3 c 2";
        let read = Centre {
            x_px: 1770.98771,
            claimed_px: 0.00195,
            height_counts: 1993.0,
            exposure_us: 5600,
            rows: 16,
            estimator: 't',
            shape: Some(Shape {
                width_px: 7.62131,
                components_px: [0.00012, -0.00310, 0.01203, 0.00010, -0.00020],
            }),
            misfits: 3,
            correlated: Some(2),
            slits: None,
        };
        assert_eq!(centre(&lines(line)), Some(Ok(read)));
        let plain = line.strip_suffix(" m 3 c 2").expect("flags");
        let mut unflagged = read;
        (unflagged.misfits, unflagged.correlated) = (0, None);
        assert_eq!(centre(&lines(plain)), Some(Ok(unflagged)));
        // A byte lost anywhere leaves no centre, but for the digits of whole numbers.
        for at in 0..plain.len() {
            let lost = [&plain[..at], &plain[at + 1..]].concat();
            let Some((read, _)) = reading(&lost).filter(|(read, _)| *read != unflagged) else {
                continue;
            };
            let is_of_height = read.height_counts < 1000.0;
            let is_of_shape = read.x_px == unflagged.x_px && read.shape != unflagged.shape;
            let is_of_centre = read.x_px < 1000.0 && read.claimed_px == 0.00195;
            assert!(
                read.rows != 16 || is_of_height || is_of_centre || is_of_shape,
                "{lost}"
            );
        }
        // A shorter exposure is a word and a number more.
        let exposed = |us: &str| centre(&lines(&format!("{plain} t {us} m 3 c 2")));
        let mut short = read;
        short.exposure_us = 187;
        assert_eq!(exposed("187"), Some(Ok(short)));
        assert_eq!((exposed("9"), exposed("5601")), (None, None));
        // A line without a shape is no answer, and a shape of zeros is none.
        let (before, _) = plain.split_once(" w ").expect("a shape");
        let mut without = unflagged;
        without.shape = None;
        assert_eq!(centre(&lines(before)), None);
        let zeros = format!("{before} w 0.00000 o{}", " 0.00000".repeat(5));
        assert_eq!(centre(&lines(&zeros)), Some(Ok(without)));
    }

    #[test]
    fn a_comb_has_a_second_line() {
        let first = "x 1770.98771 u 0.00195 a 1993 n 16/16 b 300 e a w 0.00000 o 0.00000 0.00000 0.00000 \
                     0.00000 0.00000 k 3 m 2";
        let slits = format!("slits - 912.12345/1830{} 2912.00001/7", " -".repeat(13));
        let both = format!("{first}\n{slits}");
        let image = |x_px, height_counts| Some(SlitImage::new(x_px, height_counts));
        let read = centre(&lines(&both)).expect("an answer").expect("a centre");
        let images = read.slits.expect("images");
        assert_eq!((images[0], images[1]), (None, image(912.12345, 1830.0)));
        assert_eq!(images[15], image(2912.00001, 7.0));
        assert_eq!((read.x_px, read.misfits), (1770.98771, 2));
        // Half of an answer is none, and no line goes with the line of another answer.
        assert_eq!(centre(&lines(first)), None);
        assert_eq!(centre(&lines(&slits)), None);
        let one = first.replace(" k 3", "");
        assert_eq!(centre(&lines(&format!("{one}\n{slits}"))), None);
        // A byte lost in the second line leaves no answer, but for the digits of whole numbers.
        let at_px = |images: &SlitImages| images.map(|it| it.map(|it| it.x_px));
        for at in first.len() + 7..both.len() {
            let lost = [&both[..at], &both[at + 1..]].concat();
            if let Some(Ok(found)) = centre(&lines(&lost)) {
                let found = at_px(&found.slits.expect("images"));
                let images = at_px(&images);
                let changed = found.iter().zip(&images).filter(|(a, b)| a != b).count();
                let is_whole = found.iter().flatten().all(|px| px.fract() > 0.0);
                assert!(changed <= 1 && is_whole, "{lost}");
            }
        }
    }

    #[test]
    fn a_fault_comes_with_advice() {
        let said = "f too dim: 35.2 counts, needs 60.1\n(more laser power)";
        let fault = "too dim: 35.2 counts, needs 60.1".to_owned();
        let advice = "more laser power".to_owned();
        assert_eq!(centre(&lines(said)), Some(Err(NoCentre { fault, advice })));
        assert_eq!(centre(&lines("f too dim: 35.2 counts, needs 60.1")), None);
        assert_eq!(centre(&lines("d 799.9966 mm u 0.0016 x 1770.9878")), None);
    }

    #[test]
    fn the_calibration_in_use_is_known_at_its_last_line() {
        let written = EncodedRecord::nominal().expect("a record");
        let shown = CalibrationAnswer {
            record: Some(written.record()),
            is_on: true,
            stored: FlashStatus::Record(!written.sum()),
            units: Units::default(),
        };
        let said = lines(&shown.to_string());
        let in_use = InUse {
            record: Some(RecordInUse {
                bytes: written.bytes().len(),
                crc: written.sum(),
                serial_number: 0,
                may_have_front_end: false,
            }),
            stored: "other".to_owned(),
        };
        for count in 0..said.len() {
            assert_eq!(super::in_use(&said[..count]), None);
        }
        assert_eq!(super::in_use(&said), Some(in_use));
        let none = with(shown, |it| {
            (it.record, it.stored) = (None, FlashStatus::Damaged)
        });
        let (record, stored) = (None, "unusable".to_owned());
        let none = super::in_use(&lines(&none.to_string()));
        assert_eq!(none, Some(InUse { record, stored }));
    }
}
