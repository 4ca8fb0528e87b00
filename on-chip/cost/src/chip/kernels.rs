//! The assembly of `dual_mac` against its portable twin.

use core::ops::Range;

use dual_mac::{Pair, Pairs, portable};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{RngCore as _, SeedableRng as _};

/// The longest inner product in samples, one more than a window's so that a last one without a partner is
/// among them.
const LONGEST: usize = 100;

/// Times that each length is tried.
const ROUNDS: usize = 20;

/// Square roots that are tried.
const ROOTS: usize = 5000;

/// Compares on seeded random numbers: inner products and sums of all lengths, from even and from odd pixels
/// on, with weights as many and fewer; a quarter of all numbers is extreme. Square roots of any 32 bits.
pub fn compare() {
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let (mut compared, mut different) = (0u32, 0u32);
    let mut judge = |same: bool| {
        compared += 1;
        different += u32::from(!same);
    };
    for samples in 0..=LONGEST {
        for round in 0..ROUNDS {
            let mut row = [0u16; LONGEST + 1];
            row.fill_with(|| number(&mut random));
            let mut weights = [Pairs::default(); LONGEST / 2];
            weights.fill_with(|| Pairs(pair(&mut random), pair(&mut random)));
            let single = weights.map(|Pairs(first, _)| first);
            let start = round % 2;
            let (range, is_inverted) = (start..start + samples, round % 4 < 2);
            judge(sweeps_agree(&row, range.clone(), is_inverted));
            let slope = [random.next_u32() as i32, random.next_u32() as i32 >> 8];
            judge(slopes_agree(&row, range, number(&mut random), slope));
            let row = &row[start..start + samples];
            let weights_given = (samples / 2).saturating_sub(if round < 4 { round } else { 0 });
            let (single, double) = (&single[..weights_given], &weights[..weights_given]);
            judge(dual_mac::dot(row, single) == portable::dot(row, single));
            judge(dual_mac::dot2(row, double) == portable::dot2(row, double));
            let least = 2 * i32::from(number(&mut random));
            judge(dual_mac::reaches(row, least) == portable::reaches(row, least));
            let (mut chip, mut twin) = ([7; 8], [7; 8]);
            dual_mac::contrasts(row, &mut chip[..room(round)]);
            portable::contrasts(row, &mut twin[..room(round)]);
            judge(chip == twin);
            let fours = row.as_chunks().0;
            judge(dual_mac::sum_of_steps(fours) == portable::sum_of_steps(fours));
            let (blocks, weights) = (row.as_chunks().0, pair(&mut random));
            let constant = number(&mut random);
            let (mut chip, mut twin) = ([0; LONGEST / 8], [0; LONGEST / 8]);
            let bits = dual_mac::sum_blocks(blocks, weights, constant, &mut chip);
            judge(bits == portable::sum_blocks(blocks, weights, constant, &mut twin));
            judge(chip == twin);
        }
    }
    for _ in 0..ROOTS {
        let value = f32::from_bits(random.next_u32());
        let (chip, twin) = (dual_mac::square_root(value), portable::square_root(value));
        judge(chip.to_bits() == twin.to_bits() || (chip.is_nan() && twin.is_nan()));
    }
    defmt::println!(
        "kernels dual-mac compared {} different {}",
        compared,
        different
    );
    super::board::let_the_log_out();
}

/// Whether both sweeps of these samples agree, where the samples are as large as they may be.
fn sweeps_agree(row: &[u16; LONGEST + 1], samples: Range<usize>, is_inverted: bool) -> bool {
    const NARROW: u16 = u16::MAX / 4;
    const WIDE: u16 = u16::MAX / 2;
    let nothing = ([0; LONGEST / 2], [0; LONGEST / 32]);
    let (mut chip, mut twin) = (nothing, nothing);
    let words = &row.map(|number| number & NARROW)[samples.clone()];
    let inverted = if is_inverted { NARROW } else { 0 };
    dual_mac::sweep(words, inverted, &mut chip.0, &mut chip.1);
    portable::sweep(words, inverted, &mut twin.0, &mut twin.1);
    let do_narrow_agree = chip == twin;
    let samples = &row.map(|number| number & WIDE)[samples];
    dual_mac::sweep_wide(samples, &mut chip.0, &mut chip.1);
    portable::sweep_wide(samples, &mut twin.0, &mut twin.1);
    do_narrow_agree && chip == twin
}

/// Whether the subtractions of a slope and of a number agree.
fn slopes_agree(
    row: &[u16; LONGEST + 1],
    samples: Range<usize>,
    inverted: u16,
    [start, step]: [i32; 2],
) -> bool {
    let room = samples.clone();
    let (mut chip, mut twin) = ([0; LONGEST + 1], [0; LONGEST + 1]);
    let (words, to) = (&row[samples], &mut chip[room.clone()]);
    let on_chip = dual_mac::subtract_slope(words, inverted, start, step, to);
    let by_twin = portable::subtract_slope(words, inverted, start, step, &mut twin[room.clone()]);
    let do_slopes_agree = on_chip == by_twin && chip == twin;
    dual_mac::subtract_to_12_bits(&mut chip[room.clone()], on_chip);
    portable::subtract_to_12_bits(&mut twin[room], on_chip);
    do_slopes_agree && chip == twin
}

/// Room for fewer parts than the longest samples have, or for more.
const fn room(round: usize) -> usize {
    if round % 4 == 3 { 2 } else { 8 }
}

fn pair(random: &mut ChaCha8Rng) -> Pair {
    Pair(number(random) as i16, number(random) as i16)
}

/// Any 16 bits, or an extreme of them.
fn number(random: &mut ChaCha8Rng) -> u16 {
    const EXTREMES: [u16; 8] = [0, 1, 0x7FFF, 0x8000, 0x8001, 0xFFFF, 4095, 32_760];
    let bits = random.next_u32();
    if bits >> 30 == 0 {
        EXTREMES[(bits >> 16) as usize % EXTREMES.len()]
    } else {
        bits as u16
    }
}
