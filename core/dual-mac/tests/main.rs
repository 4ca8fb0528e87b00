//! Compares the portable twins with sums in 64 bits. `cost-on-chip` compares them with the assembly, on the
//! chip.

use dual_mac::portable::{
    blocks_at_most, dot, dot2, gram, halve, reaches, square_root, sum_blocks, sum_of_steps,
    sum_pairs, upper_product, upper_product_of_halves,
};
use dual_mac::{LARGEST_SAMPLE, Pair, Pairs, SixPairs};
use proptest::prelude::*;

/// The most samples: more than in the longest window of the phase tables, which has 116.
const LONGEST: usize = 120;

/// The sum in 64 bits, over the pairs that both samples and weights have. SMLAD takes samples as signed.
fn sum(samples: &[u16], weights: impl Iterator<Item = Pair>) -> i64 {
    samples
        .as_chunks::<2>()
        .0
        .iter()
        .zip(weights)
        .map(|(samples, Pair(even, odd))| {
            i64::from(samples[0] as i16) * i64::from(even)
                + i64::from(samples[1] as i16) * i64::from(odd)
        })
        .sum()
}

fn pair() -> impl Strategy<Value = Pair> {
    let weight = || prop_oneof![any::<i16>(), -300..300i16, Just(i16::MIN), Just(i16::MAX)];
    (weight(), weight()).prop_map(|(even, odd)| Pair(even, odd))
}

fn weights() -> impl Strategy<Value = Vec<Pairs>> {
    let pairs = (pair(), pair()).prop_map(|(first, second)| Pairs(first, second));
    prop::collection::vec(pairs, 0..=LONGEST / 2)
}

fn samples(largest: u16) -> impl Strategy<Value = Vec<u16>> {
    prop::collection::vec(prop_oneof![0..=largest, Just(largest)], 0..=LONGEST)
}

/// Halves weights until their sum with the largest samples fits, as that of the tables' weights does.
fn without_overflow(mut weights: Vec<Pairs>) -> Vec<Pairs> {
    let magnitude = |pair: &Pair| i64::from(pair.0).abs() + i64::from(pair.1).abs();
    let fits = |weights: &[Pairs]| {
        let first: i64 = weights.iter().map(|pairs| magnitude(&pairs.0)).sum();
        let second: i64 = weights.iter().map(|pairs| magnitude(&pairs.1)).sum();
        first.max(second) * i64::from(LARGEST_SAMPLE) < 1 << 31
    };
    while !fits(&weights) {
        for Pairs(first, second) in &mut weights {
            for pair in [first, second] {
                *pair = Pair(pair.0 / 2, pair.1 / 2);
            }
        }
    }
    weights
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(5000))]

    #[test]
    fn blocks_are_sums_of_eight(samples in samples(4095), constant in any::<u16>(), rises in any::<bool>()) {
        let sign = if rises { 1 } else { -1 };
        let blocks = samples.as_chunks::<8>().0;
        let mut sums = vec![7; blocks.len() + 1];
        let bits = sum_blocks(blocks, Pair(sign, sign), constant, &mut sums);
        for (block, sum) in blocks.iter().zip(&sums) {
            let all: i32 = block.iter().map(|&sample| i32::from(sample)).sum();
            prop_assert_eq!(*sum, (i32::from(constant) + i32::from(sign) * all) as u16);
        }
        prop_assert_eq!(sums.last(), Some(&7));
        prop_assert_eq!(bits, blocks.iter().flatten().fold(0, |bits, sample| bits | sample));
    }

    #[test]
    fn the_next_block_has_a_sample_above_the_limit(samples in samples(u16::MAX), limit in any::<u16>()) {
        let (blocks, _) = samples.as_chunks();
        let (before, behind) = blocks.split_at(blocks_at_most(blocks, limit));
        prop_assert!(before.as_flattened().iter().all(|&sample| sample <= limit));
        prop_assert!(behind.first().is_none_or(|block| block.iter().any(|&sample| sample > limit)));
    }

    #[test]
    fn pairs_have_a_sum_and_a_mean(samples in samples(u16::MAX), room in 0..LONGEST) {
        let (pairs, last) = samples.as_chunks::<2>();
        let sum = |&[one, other]: &[u16; 2]| u32::from(one) + u32::from(other);
        let mut sums = vec![7; room];
        sum_pairs(&samples, &mut sums);
        for (at, all) in sums.into_iter().enumerate() {
            prop_assert_eq!(all, pairs.get(at).map_or(7, |pair| sum(pair) as u16));
        }
        let mut means = samples.clone();
        prop_assert_eq!(halve(&mut means), pairs.len());
        prop_assert!(pairs.iter().zip(&means).all(|(pair, &mean)| u32::from(mean) == sum(pair) / 2));
        prop_assert!(last.is_empty() || means.last() == last.last());
    }

    #[test]
    fn the_kernel_reaches_its_highest_response(samples in samples(LARGEST_SAMPLE)) {
        let response = |it: &[u16]| i32::from(it[0]) + 2 * i32::from(it[1]) + i32::from(it[2]);
        match samples.windows(3).map(response).max() {
            Some(highest) => {
                prop_assert!(reaches(&samples, highest) && reaches(&samples, highest - 1));
                prop_assert!(!reaches(&samples, highest + 1));
            }
            None => prop_assert!(!reaches(&samples, 0)),
        }
    }

    #[test]
    fn steps_are_those_of_the_first_two_of_four(samples in samples(LARGEST_SAMPLE)) {
        let fours = samples.as_chunks::<4>().0;
        let sum: u32 = fours.iter().map(|four| u32::from(four[0].abs_diff(four[1]))).sum();
        prop_assert_eq!(sum_of_steps(fours), sum);
    }

    /// If nothing overflows, both results are the true sums.
    #[test]
    fn inner_products_are_sums(
        samples in samples(LARGEST_SAMPLE),
        weights in weights().prop_map(without_overflow),
    ) {
        let firsts: Vec<Pair> = weights.iter().map(|pairs| pairs.0).collect();
        let first = sum(&samples, weights.iter().map(|pairs| pairs.0));
        let second = sum(&samples, weights.iter().map(|pairs| pairs.1));
        let (one, two) = dot2(&samples, &weights);
        prop_assert_eq!((i64::from(one), i64::from(two)), (first, second));
        prop_assert_eq!(i64::from(dot(&samples, &firsts)), first);
    }

    #[test]
    fn products_of_columns_are_those_of_a_matrix(rows in prop::collection::vec(any::<[u32; 6]>(), 0..20)) {
        let halves = |pair: u32| [pair as i16, (pair >> 16) as i16].map(i64::from);
        let column = |at: usize| rows.iter().flat_map(move |row| halves(row[at]));
        let product = |i, j| column(i).zip(column(j)).map(|(a, b)| a * b).sum::<i64>() as i32;
        let triangle: Vec<i32> = (0..6).flat_map(|i| (0..=i).map(move |j| product(i, j))).collect();
        let rows: Vec<SixPairs> = rows.iter().map(|row| SixPairs(*row)).collect();
        prop_assert_eq!(gram(&rows).to_vec(), triangle);
    }

    #[test]
    fn halves_have_the_same_product(a in any::<i32>(), b in any::<i32>()) {
        for (a, b) in [(a, b), (i32::MIN, b), (i32::MAX, b), (a | 0xffff, b | 0xffff), (i32::MIN, i32::MIN)] {
            prop_assert_eq!(upper_product_of_halves(a, b), upper_product(a, b));
        }
    }

    /// For any samples and weights the result is the low 32 bits of the sum, without a panic.
    #[test]
    fn inner_products_wrap(samples in samples(u16::MAX), weights in weights()) {
        let seconds: Vec<Pair> = weights.iter().map(|pairs| pairs.1).collect();
        let first = sum(&samples, weights.iter().map(|pairs| pairs.0)) as i32;
        let second = sum(&samples, weights.iter().map(|pairs| pairs.1)) as i32;
        prop_assert_eq!(dot2(&samples, &weights), (first, second));
        prop_assert_eq!(dot(&samples, &seconds), second);
    }

    /// Compares with `std`, which rounds as IEEE 754 asks.
    #[test]
    fn square_roots_are_rounded_to_nearest(bits in any::<u32>()) {
        let value = f32::from_bits(bits);
        let (root, expected) = (square_root(value), value.sqrt());
        prop_assert!(root.to_bits() == expected.to_bits() || root.is_nan() && expected.is_nan());
    }
}

/// Tries each length with fewer weights, as many, and more. All samples are one, so a sample too many or too
/// few shows.
#[test]
fn every_length_takes_the_samples_that_have_a_weight() {
    let ones = [Pairs(Pair(1, 1), Pair(-2, -2)); LONGEST / 2 + 1];
    let first_ones = ones.map(|pairs| pairs.0);
    let samples = [1u16; LONGEST + 1];
    // Miri takes its time.
    for length in (0..=LONGEST + 1).step_by(if cfg!(miri) { 11 } else { 1 }) {
        for pairs in 0..=LONGEST / 2 + 1 {
            let expected = 2 * (length / 2).min(pairs) as i32;
            let samples = &samples[..length];
            assert_eq!(dot(samples, &first_ones[..pairs]), expected);
            let both = dot2(samples, &ones[..pairs]);
            assert_eq!(both, (expected, -2 * expected), "{length} {pairs}");
        }
    }
}

/// Where the samples lie on whole words, two are loaded at once.
#[test]
fn every_length_of_blocks_has_its_sums_at_any_address() {
    let samples: Vec<u16> = (0..50).map(|i| (0x155 * i) & 0xfff).collect();
    for start in 0..4 {
        let (blocks, _) = samples[start..].as_chunks::<8>();
        for length in 0..=blocks.len() {
            let mut sums = vec![0; length];
            let bits = sum_blocks(&blocks[..length], Pair(-1, -1), 7, &mut sums);
            let all = |block: &[u16; 8]| block.iter().copied().fold(0, u16::wrapping_add);
            let expected = (blocks.iter().take(length)).map(|block| 7u16.wrapping_sub(all(block)));
            assert_eq!(sums, expected.collect::<Vec<_>>());
            let set = blocks[..length]
                .as_flattened()
                .iter()
                .fold(0, |bits, it| bits | it);
            assert_eq!(bits, set);
        }
    }
}

/// The only sum of two products that does not fit, and the largest one that does.
#[test]
fn the_extremes() {
    const LOW: u16 = i16::MIN as u16;
    let weights = [Pair(i16::MIN, i16::MIN)];
    assert_eq!(dot(&[LOW, LOW], &weights), i32::MIN);
    assert_eq!(dot(&[LOW, 0], &weights), 1 << 30);
    let twice = [Pairs(weights[0], weights[0])];
    assert_eq!(dot2(&[LOW, LOW], &twice), (i32::MIN, i32::MIN));
    assert_eq!(dot2(&[LOW, 0], &twice), (1 << 30, 1 << 30));
}
