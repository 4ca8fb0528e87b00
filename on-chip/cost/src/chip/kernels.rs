//! The assembly of `dual_mac` against its portable twin.

use dual_mac::{Pair, Pairs, SixPairs, portable};
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
            let row = &row[start..start + samples];
            let weights_given = (samples / 2).saturating_sub(if round < 4 { round } else { 0 });
            let (single, double) = (&single[..weights_given], &weights[..weights_given]);
            judge(dual_mac::dot(row, single) == portable::dot(row, single));
            judge(dual_mac::dot2(row, double) == portable::dot2(row, double));
            let mut rows = [SixPairs::default(); LONGEST / 5];
            rows.fill_with(|| SixPairs([(); 6].map(|()| random.next_u32())));
            let rows = &rows[..samples / 5];
            judge(dual_mac::gram(rows) == portable::gram(rows));
            let least = 2 * i32::from(number(&mut random));
            judge(dual_mac::reaches(row, least) == portable::reaches(row, least));
            let fours = row.as_chunks().0;
            judge(dual_mac::sum_of_steps(fours) == portable::sum_of_steps(fours));
            let (blocks, weights) = (row.as_chunks().0, pair(&mut random));
            let limit = number(&mut random);
            judge(
                dual_mac::blocks_at_most(blocks, limit) == portable::blocks_at_most(blocks, limit),
            );
            let (mut chip, mut twin) = ([0; LONGEST / 3], [0; LONGEST / 3]);
            dual_mac::sum_pairs(row, &mut chip);
            portable::sum_pairs(row, &mut twin);
            judge(chip == twin);
            let (mut chip, mut twin) = ([0; LONGEST], [0; LONGEST]);
            let (chip, twin) = (&mut chip[..samples], &mut twin[..samples]);
            chip.copy_from_slice(row);
            twin.copy_from_slice(row);
            judge(dual_mac::halve(chip) == portable::halve(twin));
            judge(chip == twin);
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
