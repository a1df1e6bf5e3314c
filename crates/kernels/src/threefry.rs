//! Random numbers by counter: Threefry-4x32 (Salmon et al. 2011, *Parallel random numbers: as easy
//! as 1, 2, 3*). It needs only additions, rotations and exclusive ors, which all vectors have.

use super::vectorized::vectorized;

/// Blocks that are computed together.
const LANES: usize = 16;

/// Numbers that are computed together: four of each block.
const NUMBERS: usize = 4 * LANES;

/// The smallest number of rounds that passes BigCrush.
const ROUNDS: u32 = 12;

/// The rotations of both pairs, which repeat every eight rounds.
const ROTATIONS: [[u32; 2]; 8] =
    [[10, 26], [11, 21], [13, 27], [23, 5], [6, 20], [17, 11], [25, 10], [18, 20]];

const PARITY: u32 = 0x1bd1_1bda;

pub(super) type Key = [u32; 4];

/// One word of every block.
type Words = [u32; LANES];

vectorized! {
    /// Multiplies each value of rows of `width` by `scale`, or by 0 where its random number is
    /// below `threshold`. The first row has the number `first`.
    fn drop_out(
        values: &mut [f32],
        width: usize,
        key: &Key,
        place: u32,
        first: u32,
        threshold: u32,
        scale: f32,
    ) {
        for (row, values) in (first..).zip(values.chunks_exact_mut(width)) {
            let mut blocks: Words = [0; LANES];
            for (lane, block) in (0..).zip(&mut blocks) {
                *block = lane;
            }
            for values in values.chunks_mut(NUMBERS) {
                let counters = [blocks, [row; LANES], [place; LANES], [0; LANES]];
                let numbers = threefry::<ROUNDS>(key, counters);
                for (value, &number) in values.iter_mut().zip(numbers.as_flattened()) {
                    *value = if number < threshold { 0.0 } else { *value * scale };
                }
                for block in &mut blocks {
                    *block += 16;
                }
            }
        }
    }
}

#[inline(always)]
fn threefry<const ROUNDS: u32>(key: &Key, counters: [Words; 4]) -> [Words; 4] {
    let keys = [key[0], key[1], key[2], key[3], PARITY ^ key[0] ^ key[1] ^ key[2] ^ key[3]];
    let [mut a, mut b, mut c, mut d] = counters;
    for round in 0..=ROUNDS {
        if round % 4 == 0 {
            let turn = round / 4;
            let key = |word: u32| keys[((turn + word) % 5) as usize];
            add(&mut a, key(0));
            add(&mut b, key(1));
            add(&mut c, key(2));
            add(&mut d, key(3).wrapping_add(turn));
        }
        if round == ROUNDS {
            break;
        }
        let [first, second] = ROTATIONS[(round % 8) as usize];
        if round % 2 == 0 {
            mix(&mut a, &mut b, first);
            mix(&mut c, &mut d, second);
        } else {
            mix(&mut a, &mut d, first);
            mix(&mut c, &mut b, second);
        }
    }
    [a, b, c, d]
}

#[inline(always)]
fn add(words: &mut Words, number: u32) {
    for word in words {
        *word = word.wrapping_add(number);
    }
}

#[inline(always)]
fn mix(sums: &mut Words, others: &mut Words, rotation: u32) {
    for (sum, other) in sums.iter_mut().zip(others) {
        *sum = sum.wrapping_add(*other);
        *other = other.rotate_left(rotation) ^ *sum;
    }
}

#[cfg(test)]
mod tests {
    use super::super::instruction_set;
    use super::{LANES, drop_out, threefry};

    /// Checks the values of Random123's `kat_vectors`.
    #[test]
    fn blocks_are_the_published_ones() {
        let pi = [
            [0x243f_6a88, 0x85a3_08d3, 0x1319_8a2e, 0x0370_7344],
            [0xa409_3822, 0x299f_31d0, 0x082e_fa98, 0xec4e_6c89],
        ];
        for (counter, key, expected) in [
            ([0; 4], [0; 4], [0x9c6c_a96a, 0xe17e_ae66, 0xfc10_ecd4, 0x5256_a7d8]),
            ([u32::MAX; 4], [u32::MAX; 4], [0x2a88_1696, 0x5701_2287, 0xf6c7_446e, 0xa16a_6732]),
            (pi[0], pi[1], [0x59cd_1dbb, 0xb887_9579, 0x86b5_d00c, 0xac8b_6d84]),
        ] {
            let found = threefry::<20>(&key, counter.map(|word| [word; LANES]));
            assert_eq!(found.map(|words| words[5]), expected);
        }
    }

    fn dropped(width: usize, first: u32, rows: usize, key: [u32; 4], place: u32) -> Vec<f32> {
        let mut values = vec![1.0; rows * width];
        drop_out(&mut values, width, &key, place, first, 1 << 30, 4.0 / 3.0);
        values
    }

    #[test]
    fn a_number_depends_on_its_place_alone() {
        instruction_set::tests::with_each(|set| {
            let all = dropped(150, 0, 5, [1, 2, 3, 4], 7);
            assert_eq!(dropped(150, 2, 2, [1, 2, 3, 4], 7), all[300..600], "{set:?}");
            // A shorter row is the beginning of a longer one.
            for (short, long) in dropped(70, 0, 5, [1, 2, 3, 4], 7).chunks(70).zip(all.chunks(150))
            {
                assert_eq!(short, &long[..70], "{set:?}");
            }
            assert_ne!(dropped(150, 0, 5, [1, 2, 3, 5], 7), all);
            assert_ne!(dropped(150, 0, 5, [1, 2, 3, 4], 8), all);
            assert_ne!(all[..150], all[150..300]);
        });
    }

    #[test]
    fn a_quarter_is_left_out_and_the_rest_makes_up_for_it() {
        let values = dropped(1000, 0, 1000, [9, 8, 7, 6], 0);
        let zeros = values.iter().filter(|&&value| value == 0.0).count() as f64;
        // Five standard deviations for a million numbers.
        assert!((zeros / 1e6 - 0.25).abs() < 5.0 * (0.25 * 0.75 / 1e6_f64).sqrt(), "{zeros}");
        assert!(values.iter().all(|&value| value == 0.0 || value == 4.0 / 3.0));
        // Neighbours in a row, in a column and among the words of a block are independent.
        for distance in [1, 16, 64, 1000] {
            let pairs = values.iter().zip(&values[distance..]);
            let both = pairs.filter(|(a, b)| **a == 0.0 && **b == 0.0).count() as f64;
            assert!((both / 1e6 - 0.0625).abs() < 2e-3, "{distance}: {both}");
        }
    }
}
