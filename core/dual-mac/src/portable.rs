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

/// Two signed 16-bit samples of each of six columns, the first one in the lower half.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(transparent)]
pub struct SixPairs(pub [u32; 6]);

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
/// any of these samples. If four samples of even or of odd places are together above [`LARGEST_SAMPLE`],
/// their block's sum means nothing.
pub fn sum_blocks(blocks: &[[u16; BLOCK]], weights: Pair, constant: u16, sums: &mut [u16]) -> u16 {
    // Only the lower 16 bits of a sum count. They do not depend on the samples' signs.
    let [even, odd] = [weights.0, weights.1].map(|weight| i32::from(weight).cast_unsigned());
    let mut bits = 0;
    let mut take = |words: [u32; BLOCK / 2], sum: &mut u16| {
        bits |= words.into_iter().fold(0, |bits, word| bits | word);
        let both = words.into_iter().fold(0, u32::wrapping_add);
        let all = (both.wrapping_mul(even)).wrapping_add((both >> 16).wrapping_mul(odd));
        *sum = (all.wrapping_add(constant.into()) & 0xffff) as u16;
    };
    if let Some(blocks) = in_words(blocks) {
        for (&words, sum) in blocks.iter().zip(sums) {
            take(words, sum);
        }
    } else {
        for (block, sum) in blocks.iter().zip(sums) {
            let (twos, _) = block.as_chunks();
            let word = |i| {
                twos.get(i)
                    .map_or(0, |&[first, second]: &[u16; 2]| word(first, second))
            };
            take(core::array::from_fn(word), sum);
        }
    }
    ((bits | bits >> 16) & 0xffff) as u16
}

/// Two samples, the first one in the lower half.
const fn word(first: u16, second: u16) -> u32 {
    first as u32 | (second as u32) << 16
}

/// Blocks of words as [`word`] makes them, where memory has them so: half the loads.
fn in_words(blocks: &[[u16; BLOCK]]) -> Option<&[[u32; BLOCK / 2]]> {
    // SAFETY: all bits of two samples are a number, and `align_to` takes only aligned ones.
    let (before, words, _) = unsafe { blocks.as_flattened().align_to::<u32>() };
    (cfg!(target_endian = "little") && before.is_empty()).then_some(words.as_chunks().0)
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
    let (&[left, middle], rest) = samples.split_first_chunk().unwrap_or((&[0; 2], &[]));
    let below = least.wrapping_sub(1);
    let (mut signs, mut middle) = (0, i32::from(middle as i16));
    let mut left = i32::from(left as i16) + middle;
    for &right in rest {
        let right = i32::from(right as i16);
        let both = middle + right;
        // Negative where the response is `least` or more.
        signs |= below.wrapping_sub(left + both);
        (left, middle) = (both, right);
    }
    signs < 0
}

fn two_products(even: u16, odd: u16, weight: Pair) -> i32 {
    // Products of 16 bits fit 31; the sum of two wraps at most for (-2^15)^2 twice, as SMLAD's does.
    (i32::from(even as i16) * i32::from(weight.0))
        .wrapping_add(i32::from(odd as i16) * i32::from(weight.1))
}

/// The products of six columns with each other and with themselves: in each row the lower triangle of a
/// symmetric matrix, (0, 0), (1, 0), (1, 1), (2, 0) and so on to (5, 5).
pub fn gram(rows: &[SixPairs]) -> [i32; 21] {
    let mut sums = [0i32; 21];
    for row in rows {
        let pairs = row
            .0
            .map(|pair| Pair((pair & 0xffff) as i16, (pair >> 16) as i16));
        let mut sums = sums.iter_mut();
        for (i, one) in pairs.iter().enumerate() {
            let columns = pairs.iter().take(i.wrapping_add(1));
            for (&other, sum) in columns.zip(&mut sums) {
                let products = two_products(one.0.cast_unsigned(), one.1.cast_unsigned(), other);
                *sum = sum.wrapping_add(products);
            }
        }
    }
    sums
}

/// The upper half of the product of two numbers, rounded down: an instruction where a chip has products of 64
/// bits.
#[inline(always)]
pub fn upper_product(a: i32, b: i32) -> i32 {
    (i64::from(a).wrapping_mul(i64::from(b)) >> 32) as i32
}

/// As [`upper_product`], for a chip whose products have 32 bits.
#[inline(always)]
pub fn upper_product_of_halves(a: i32, b: i32) -> i32 {
    let (a_low, b_low) = (a & 0xffff, b & 0xffff);
    let (a_high, b_high) = (a >> 16, b >> 16);
    // A product of two lower halves has all 32 bits.
    let low = a_low.cast_unsigned().wrapping_mul(b_low.cast_unsigned()) >> 16;
    // 2^15 * (2^16 - 1) + 2^16 - 1 is below 2^31, so neither sum wraps.
    let one = a_high.wrapping_mul(b_low).wrapping_add(low.cast_signed());
    let other = a_low.wrapping_mul(b_high).wrapping_add(one & 0xffff);
    a_high
        .wrapping_mul(b_high)
        .wrapping_add(one >> 16)
        .wrapping_add(other >> 16)
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
