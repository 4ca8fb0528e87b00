//! Rows that no spot is in, as counts: what a broken wire, a covered or a flooded sensor delivers.

use slitrange::row::LARGEST_COUNT;

/// Pixels of such a row.
const PIXELS: usize = 512;

/// All pixels alike.
pub fn constant<const COUNT: u16>(_: u64) -> Vec<u16> {
    vec![COUNT; PIXELS]
}

/// So many pixels side by side at full scale, at a place by the row's number, on a row without noise.
pub fn lit<const LIT: usize>(number: u64) -> Vec<u16> {
    reading::<LIT>(LARGEST_COUNT, number)
}

/// So many pixels of 2000 counts.
pub fn half_lit<const LIT: usize>(number: u64) -> Vec<u16> {
    reading::<LIT>(2100, number)
}

fn reading<const LIT: usize>(count: u16, number: u64) -> Vec<u16> {
    let mut light = vec![100; PIXELS];
    let from = 60 + 47 * number as usize % (PIXELS - 120 - LIT);
    light[from..from + LIT].fill(count);
    light
}

/// Runs of so many pixels, dark and at full scale in turn.
pub fn alternating<const RUN: usize>(number: u64) -> Vec<u16> {
    (0..PIXELS)
        .map(|i| match (i + number as usize) / RUN % 2 {
            0 => 0,
            _ => LARGEST_COUNT,
        })
        .collect()
}

/// From dark to full scale, evenly; the other way round in every other row.
pub fn ramp(number: u64) -> Vec<u16> {
    let mut light: Vec<u16> = (0..PIXELS as u16).map(|i| 8 * i).collect();
    if number % 2 == 1 {
        light.reverse();
    }
    light
}

/// One half dark, the other at full scale.
pub fn halves(number: u64) -> Vec<u16> {
    let edge = 200 + 13 * number as usize;
    let mut light = vec![0; PIXELS];
    light[edge..].fill(LARGEST_COUNT);
    light
}

/// Any words: a multiplicative generator (D. H. Lehmer; S. K. Park and K. W. Miller, 1988), so that
/// neighbouring pixels show no pattern.
pub fn any_words(number: u64) -> Vec<u16> {
    let mut state = 48_271 * (number + 1) % 0x7fff_ffff;
    (0..PIXELS)
        .map(|_| {
            state = state * 48_271 % 0x7fff_ffff;
            (state >> 10) as u16 & LARGEST_COUNT
        })
        .collect()
}
