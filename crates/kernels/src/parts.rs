//! Work on rows, shared out among threads.

use std::mem::MaybeUninit;

use rayon::prelude::*;

/// `length` values, written in parts of `part` values on all threads. `write` gets a part's index
/// and the part, which holds zeros.
pub(super) fn each_part(
    length: usize,
    part: usize,
    write: impl Fn(usize, &mut [f32]) + Send + Sync,
) -> Vec<f32> {
    let (values, _) = in_parts(length, part, || (), |(), index, place| write(index, place));
    values
}

/// `length` values, written in parts of `part` values on all threads, and the results of `write`.
/// `write` gets the value of `scratch`, which consecutive parts share, a part's index and the part.
///
/// A part holds zeros. Its own task writes them just before, so that they lie in the core's cache.
/// If one thread cleared all parts first, the others would have to wait.
pub(super) fn in_parts<S, R: Send>(
    length: usize,
    part: usize,
    scratch: impl Fn() -> S + Send + Sync,
    write: impl Fn(&mut S, usize, &mut [f32]) -> R + Send + Sync,
) -> (Vec<f32>, Vec<R>) {
    let mut values = Vec::with_capacity(length);
    let parts = values.spare_capacity_mut()[..length].par_chunks_mut(part);
    let results = parts
        .enumerate()
        .map_init(scratch, |scratch, (index, part)| {
            part.fill(MaybeUninit::new(0.0));
            // SAFETY: the whole part was just written.
            let part = unsafe { part.assume_init_mut() };
            write(scratch, index, part)
        })
        .collect();
    // SAFETY: the parts cover all values, and each was written.
    unsafe { values.set_len(length) };
    (values, results)
}

/// `length` values, written like those of [`in_parts`]. A part holds nothing. `write` gives the
/// whole part after it wrote every value.
pub(super) fn in_unwritten_parts<S>(
    length: usize,
    part: usize,
    scratch: impl Fn() -> S + Send + Sync,
    write: impl for<'a> Fn(&mut S, usize, &'a mut [MaybeUninit<f32>]) -> &'a mut [f32] + Send + Sync,
) -> Vec<f32> {
    let mut values = Vec::with_capacity(length);
    let parts = values.spare_capacity_mut()[..length].par_chunks_mut(part);
    parts.enumerate().for_each_init(scratch, |scratch, (index, part)| {
        let (place, count) = (part.as_ptr(), part.len());
        let written = write(scratch, index, part);
        assert_eq!((written.as_ptr(), written.len()), (place.cast(), count), "not the whole part");
    });
    // SAFETY: the parts cover all values, and each was written.
    unsafe { values.set_len(length) };
    values
}

/// Two arrays of `length` values, written in parts of `part` values on all threads. `write` gets the
/// index of a part's first value and the parts of both arrays, which hold nothing.
///
/// # Safety
/// `write` must write all values of both parts.
pub(super) unsafe fn each_unwritten_part_of_two(
    length: usize,
    part: usize,
    write: impl Fn(usize, &mut [MaybeUninit<f32>], &mut [MaybeUninit<f32>]) + Send + Sync,
) -> [Vec<f32>; 2] {
    let mut arrays = [Vec::with_capacity(length), Vec::with_capacity(length)];
    let [first, second] = arrays.each_mut().map(|array| &mut array.spare_capacity_mut()[..length]);
    let parts = first.par_chunks_mut(part).zip(second.par_chunks_mut(part));
    parts.enumerate().for_each(|(index, (first, second))| write(index * part, first, second));
    for array in &mut arrays {
        // SAFETY: the parts cover all values, and each was written.
        unsafe { array.set_len(length) };
    }
    arrays
}

#[cfg(test)]
mod tests {
    use std::mem::MaybeUninit;

    use super::in_unwritten_parts;

    #[test]
    fn every_part_is_written_in_its_place() {
        let written = in_unwritten_parts(
            5,
            2,
            || (),
            |(), index, part| {
                part.fill(MaybeUninit::new(index as f32));
                // SAFETY: the whole part was just written.
                unsafe { part.assume_init_mut() }
            },
        );
        assert_eq!(written, [0.0, 0.0, 1.0, 1.0, 2.0]);
    }

    #[test]
    #[should_panic(expected = "not the whole part")]
    fn a_part_that_was_not_written_to_its_end_is_refused() {
        in_unwritten_parts(
            4,
            2,
            || (),
            |(), _, part| {
                let (first, _) = part.split_at_mut(1);
                first[0].write(1.0);
                // SAFETY: the only value was just written.
                unsafe { first.assume_init_mut() }
            },
        );
    }
}
