//! Faults of the converter, and of the words on their way to memory.

use crate::hard_cases::Truth;
use crate::second_judge::plan::Plan;
use crate::second_judge::{ROWS_OF_FRAME, Rng, log_even};
use rand::Rng as _;
use rand::seq::index;

/// A converter without codes about the multiples of a power of two. Voltages there give its nearest code.
pub fn missing_codes(plan: &mut Plan, random: &mut Rng) {
    let spacing = 1u16 << random.random_range(5..=9);
    let missing = (log_even(random, 2.0, 24.0) as u16).min(spacing / 4);
    plan.counts.add(move |counts, _, _| {
        let half = missing / 2;
        for count in counts {
            // From the start of a gap: codes 0 to `missing` - 1 are missing.
            let within = (*count + half) % spacing;
            if within < half {
                *count = count.saturating_sub(within + 1);
            } else if within < missing {
                *count += missing - within;
            }
            *count = (*count).min(4095);
        }
    });
}

/// A word that the DMA loses: the same one in all rows, because an interrupt of the same clock delays it. The
/// words after it move up by one, and the last one comes twice.
///
/// The truth is where the spot's top is. If the word is lost before the top, the top moves down by a pixel.
/// If it is lost within half a width of the centre, nothing tells which half of the spot moved. Then all
/// places between the old centre and a pixel further down are right.
pub fn lost_word(plan: &mut Plan, random: &mut Rng) {
    let widths: f64 = random.random_range(-3.0..3.0);
    let centre = plan.spot.centre;
    // The truth holds for all rows.
    plan.speed = 0.0;
    plan.truth = match widths {
        widths if widths < -0.5 => Truth::Centre(centre - 1.0),
        widths if widths > 0.5 => Truth::Centre(centre),
        _ => Truth::Between(centre - 1.0, centre),
    };
    let place = (centre + widths * plan.spot.width).round() as usize;
    let word = plan.sensor.geometry().light.start + place;
    plan.words
        .add(move |words, _, _| words.copy_within(word + 1.., word));
}

/// Rows whose words come late by a few. In a single row nothing tells that, so its truth is the shifted
/// centre; in a frame the other rows tell.
pub fn slip(plan: &mut Plan, random: &mut Rng) {
    let late = random.random_range(1..=60);
    let count = random.random_range(1..=6);
    let mut rows = index::sample(random, ROWS_OF_FRAME, count).into_vec();
    if plan.rows == 1 {
        rows = vec![0];
        plan.truth = Truth::Centre(plan.spot.centre + late as f64);
    }
    plan.words.add(move |words, moment, _| {
        if rows.contains(&moment.row) {
            let end = words.len() - late;
            words.copy_within(..end, late);
        }
    });
}

/// A clock pulse that the converter or the receiver misses: all bits after it move. The receiver takes 16
/// bits for each word, of which the first four are zero.
pub fn lost_clock(plan: &mut Plan, random: &mut Rng) {
    let bits = random.random_range(1..=3);
    let is_lost = random.random_bool(0.5);
    let from = random.random_range(0..plan.sensor.geometry().light.end);
    plan.words.add(move |words, _, _| {
        let all = words.to_vec();
        for i in from..words.len() {
            let next = all.get(i + 1).copied().unwrap_or_default();
            let last = all[i.saturating_sub(1)];
            words[i] = if is_lost {
                all[i] << bits | next >> (16 - bits)
            } else {
                all[i] >> bits | last << (16 - bits)
            };
        }
    });
}
