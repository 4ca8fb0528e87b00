//! The weights, the sizes of blocks and parts, and the portable twins of the assembly, in safe Rust.

/// The weights of two neighbouring samples. Aligned, so that one instruction loads both.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(C, align(4))]
pub struct Pair(pub i16, pub i16);

/// The weights of two neighbouring samples in two inner products.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(C)]
pub struct Pairs(pub Pair, pub Pair);

/// Samples in a block of [`sum_blocks`].
pub const BLOCK: usize = 8;
/// Pairs of samples in a part of [`sweep`].
pub const PART: usize = 16;
/// The largest sample. Samples are read as signed 16-bit numbers, so larger ones would be negative.
pub const LARGEST_SAMPLE: u16 = i16::MAX as u16;
/// [`contrasts`] compares a sample with the two samples that are so far to its left and to its right.
pub const BESIDE: usize = 4;
/// The contrast of a sample depends on so many samples to its left, and on as many to its right.
pub const REACH: usize = BESIDE + 1;
/// Places in a part of [`contrasts`].
pub const PLACES_OF_PART: usize = 24;
/// Samples of the places in a part, and those to their sides.
pub const SAMPLES_OF_PART: usize = PLACES_OF_PART + 2 * REACH;

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

/// Sums the pairs of samples, and takes the highest response of the kernel [1 2 1] in each part of [`PART`]
/// pairs. A part holds the kernels whose last sample is in it. The first pair is in no part: it starts the
/// first kernel. A sample is a word with an exclusive or of `inverted`. Takes as many pairs as there is room
/// for. If four of the largest sample do not fit 16 bits, the results mean nothing.
pub fn sweep(words: &[u16], inverted: u16, sums: &mut [u16], parts: &mut [u32]) {
    let sample = |word| u32::from(word ^ inverted);
    sweep_of(words, sample, sums, |sum| (sum & 0xffff) as u16, parts);
}

/// As [`sweep`], of words that are samples, and with responses of 17 bits: if two of the largest sample do
/// not fit 16 bits, the results mean nothing.
pub fn sweep_wide(samples: &[u16], sums: &mut [u16], parts: &mut [u32]) {
    sweep_of(samples, u32::from, sums, |sum| (sum & 0xffff) as u16, parts);
}

/// As [`sweep`], of any integers, with responses of 32 bits. `stored` makes what is written of a pair's sum.
#[inline(always)]
pub fn sweep_of<T: Copy, S>(
    values: &[T],
    value: impl Fn(T) -> u32,
    sums: &mut [S],
    stored: impl Fn(u32) -> S,
    parts: &mut [u32],
) {
    let pairs = values.as_chunks::<2>().0;
    let (Some((&[a, b], pairs)), Some((sum, sums))) = (pairs.split_first(), sums.split_first_mut())
    else {
        return;
    };
    let pairs = pairs.get(..sums.len()).unwrap_or(pairs);
    let (mut last, mut last_two) = (value(b), value(a).wrapping_add(value(b)));
    *sum = stored(last_two);
    let mut take = |highest: u32, &[a, b]: &[T; 2], sum: &mut S| {
        let (a, b) = (value(a), value(b));
        let (to_a, to_b) = (last.wrapping_add(a), a.wrapping_add(b));
        // The kernel with its last value at a gives last_two + to_a, and at b to_a + to_b.
        let response = last_two.max(to_b).wrapping_add(to_a);
        *sum = stored(to_b);
        (last, last_two) = (b, to_b);
        highest.max(response)
    };
    for ((pairs, sums), part) in pairs.chunks(PART).zip(sums.chunks_mut(PART)).zip(parts) {
        // Two at a time, so that the compiler need not move what the kernel keeps.
        let (twos, one) = pairs.as_chunks::<2>();
        let (sum_twos, sum_one) =
            (sums.get_mut(..pairs.len()).unwrap_or_default()).as_chunks_mut::<2>();
        let mut highest = 0;
        for ([pair, next], [sum, next_sum]) in twos.iter().zip(sum_twos) {
            highest = take(highest, pair, sum);
            highest = take(highest, next, next_sum);
        }
        if let ([pair], [sum]) = (one, sum_one) {
            highest = take(highest, pair, sum);
        }
        *part = highest;
    }
}

/// Subtracts a slope from samples. A sample is a word with an exclusive or of `inverted`. The slope has the
/// height `start` at the first one and rises by `step` to each next one, both in Q16. Writes the differences
/// as signed 16-bit numbers, as far as there is room, and returns the lowest.
pub fn subtract_slope(
    words: &[u16],
    inverted: u16,
    start: i32,
    step: i32,
    differences: &mut [u16],
) -> i16 {
    let (mut height, mut lowest) = (start, i16::MAX);
    for (&word, difference) in words.iter().zip(differences) {
        *difference = (word ^ inverted).wrapping_sub((height.cast_unsigned() >> 16) as u16);
        lowest = lowest.min(*difference as i16);
        height = height.wrapping_add(step);
    }
    lowest
}

/// Subtracts a number from signed 16-bit numbers, and limits the results to 12 bits without sign.
pub fn subtract_to_12_bits(numbers: &mut [u16], subtracted: i16) {
    for number in numbers {
        let difference = (*number as i16).wrapping_sub(subtracted);
        *number = difference.clamp(0, 4095).cast_unsigned();
    }
}

/// Writes the highest contrast of each part, as far as there is room. The contrast of a sample is how much a
/// quarter of the kernel [1 2 1] responds there with more than [`BESIDE`] samples to the left and to the
/// right, or zero. The first part starts with sample [`REACH`]; the last one is as long as the others, if
/// there are so many samples, and ends [`REACH`] samples before the end.
///
/// The response is rounded down to a whole number: the true one is higher by at most 3/4.
pub fn contrasts(samples: &[u16], highest: &mut [u16]) {
    let starts = (0..samples.len().saturating_sub(2 * REACH)).step_by(PLACES_OF_PART);
    for (start, highest) in starts.zip(highest) {
        let start = start.min(samples.len().saturating_sub(SAMPLES_OF_PART));
        let part = samples.get(start..).unwrap_or_default();
        let part = part.get(..SAMPLES_OF_PART).unwrap_or(part);
        let contrasts = part.windows(2 * REACH + 1).map(contrast);
        *highest = contrasts.max().unwrap_or_default();
    }
}

/// The contrast of the middle one of these samples.
fn contrast(samples: &[u16]) -> u16 {
    let mut quarters = samples.windows(3).step_by(BESIDE).map(|three| match three {
        &[left, middle, right] => left.midpoint(right).midpoint(middle),
        _ => 0,
    });
    let (Some(left), Some(here), Some(right)) = (quarters.next(), quarters.next(), quarters.next())
    else {
        return 0;
    };
    here.saturating_sub(left.max(right))
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
