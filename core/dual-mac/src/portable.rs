//! The weights, the size of a block, and the portable twins of the assembly, in safe Rust.

use core::cell::Cell;

/// The weights of two neighbouring samples. Aligned, so that one instruction loads both.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(C, align(4))]
pub struct Pair(pub i16, pub i16);

/// The weights of two neighbouring samples in two inner products.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(C)]
pub struct Pairs(pub Pair, pub Pair);

/// Samples in a block of [`sum_blocks`] and [`blocks_at_most`].
pub const BLOCK: usize = 8;
/// The largest sample. Samples are read as signed 16-bit numbers, so larger ones would be negative.
pub const LARGEST_SAMPLE: u16 = i16::MAX as u16;

/// Sum of sample * weight over the samples, or over the weights if those are fewer. A last sample without a
/// partner is left out.
pub fn dot(samples: &[u16], weights: &[Pair]) -> i32 {
    let mut sum = 0i32;
    for (&[even, odd], &weight) in samples.as_chunks::<2>().0.iter().zip(weights) {
        sum = sum.wrapping_add(two_products(even, odd, weight));
    }
    sum
}

/// Two such sums over the same samples. Four samples at a time keep a PC's vector unit busy; sums that wrap
/// may be taken in any order.
pub fn dot2(samples: &[u16], weights: &[Pairs]) -> (i32, i32) {
    let pairs = (samples.len() / 2).min(weights.len());
    let samples = samples.get(..2 * pairs).unwrap_or_default();
    let weights = weights.get(..pairs).unwrap_or_default();
    let (fours, two) = samples.as_chunks::<4>();
    let (weight_pairs, last) = weights.as_chunks::<2>();
    let mut sums = [0i32; 4];
    for (&[a, b, c, d], [even, odd]) in fours.iter().zip(weight_pairs) {
        sums[0] = sums[0].wrapping_add(two_products(a, b, even.0));
        sums[1] = sums[1].wrapping_add(two_products(a, b, even.1));
        sums[2] = sums[2].wrapping_add(two_products(c, d, odd.0));
        sums[3] = sums[3].wrapping_add(two_products(c, d, odd.1));
    }
    if let (&[a, b], [weight]) = (two, last) {
        sums[0] = sums[0].wrapping_add(two_products(a, b, weight.0));
        sums[1] = sums[1].wrapping_add(two_products(a, b, weight.1));
    }
    (sums[0].wrapping_add(sums[2]), sums[1].wrapping_add(sums[3]))
}

/// Sums blocks of samples. Samples of even and of odd places have their own weight; the constant is added to
/// each sum. Writes as many sums as there are blocks or room for them, and returns all bits that are set in
/// any of these samples. If four samples of even
/// or of odd places are together above [`LARGEST_SAMPLE`], their block's sum means nothing.
pub fn sum_blocks(blocks: &[[u16; BLOCK]], weights: Pair, constant: u16, sums: &mut [u16]) -> u16 {
    let mut bits = 0;
    for (block, sum) in blocks.iter().zip(sums) {
        let pairs = block.as_chunks::<2>().0.iter();
        let pairs = pairs.map(|&[even, odd]| u32::from(even) | u32::from(odd) << 16);
        bits |= pairs.clone().fold(0, |bits, pair| bits | pair);
        let both = pairs.fold(0, u32::wrapping_add);
        let all = two_products((both & 0xffff) as u16, (both >> 16) as u16, weights);
        *sum = (all.cast_unsigned().wrapping_add(constant.into()) & 0xffff) as u16;
    }
    ((bits | bits >> 16) & 0xffff) as u16
}

/// The sum of the steps from the first to the second of each four samples, without sign. A step of 2^15 or
/// more counts as negative.
pub fn sum_of_steps(fours: &[[u16; 4]]) -> u32 {
    let step = |&[first, second, ..]: &[u16; 4]| {
        let step = i32::from(second as i16) - i32::from(first as i16);
        // As SMLAD takes it.
        i32::from((step.unsigned_abs() & 0xffff) as i16).cast_unsigned()
    };
    fours.iter().map(step).fold(0, u32::wrapping_add)
}

/// How many blocks come before the first one that has a sample above a limit.
pub fn blocks_at_most(blocks: &[[u16; BLOCK]], limit: u16) -> usize {
    let has_none_above = |block: &&[u16; BLOCK]| block.iter().all(|&sample| sample <= limit);
    blocks.iter().take_while(has_none_above).count()
}

/// The sums of pairs of samples, as many as there are or as there is room for. A sum wraps.
pub fn sum_pairs(samples: &[u16], sums: &mut [u16]) {
    for (&[one, other], sum) in samples.as_chunks::<2>().0.iter().zip(sums) {
        *sum = one.wrapping_add(other);
    }
}

/// Replaces the first half of the samples by the means of their pairs, rounded down. Returns how many these
/// are. A last sample without a partner is left out.
pub fn halve(samples: &mut [u16]) -> usize {
    halve_from(samples, 0)
}

/// As [`halve`], where so many means are there.
pub(crate) fn halve_from(samples: &mut [u16], done: usize) -> usize {
    let samples = Cell::from_mut(samples).as_slice_of_cells();
    let pairs = samples.as_chunks::<2>().0;
    for (mean, [one, other]) in samples.iter().zip(pairs).skip(done) {
        mean.set(one.get().midpoint(other.get()));
    }
    pairs.len()
}

/// Whether the kernel [1 2 1] responds with `least` or more anywhere on the samples.
pub fn reaches(samples: &[u16], least: i32) -> bool {
    let below = least.wrapping_sub(1);
    let signs = samples.windows(3).fold(0, |signs, three| {
        let &[left, middle, right] = three else {
            return signs;
        };
        let response =
            i32::from(left as i16) + 2 * i32::from(middle as i16) + i32::from(right as i16);
        // Negative where the response is `least` or more.
        signs | below.wrapping_sub(response)
    });
    signs < 0
}

fn two_products(even: u16, odd: u16, weight: Pair) -> i32 {
    // Products of 16 bits fit 31; the sum of two wraps at most for (-2^15)^2 twice, as SMLAD's does.
    (i32::from(even as i16) * i32::from(weight.0))
        .wrapping_add(i32::from(odd as i16) * i32::from(weight.1))
}

/// The square root, rounded to nearest as IEEE 754 asks.
#[cfg(target_os = "none")]
pub fn square_root(value: f32) -> f32 {
    libm::sqrtf(value)
}

/// The square root, rounded to nearest as IEEE 754 asks: an instruction of every PC.
#[cfg(not(target_os = "none"))]
#[inline]
pub fn square_root(value: f32) -> f32 {
    value.sqrt()
}
