use std::mem::MaybeUninit;

use rayon::prelude::*;

/// `length` numbers, of which `write` makes parts of `part` numbers each, on all threads. It is given
/// a part's index and its place, which holds zeros.
pub(super) fn each_part(
    length: usize,
    part: usize,
    write: impl Fn(usize, &mut [f32]) + Send + Sync,
) -> Vec<f32> {
    let (values, _) = in_parts(length, part, || (), |(), index, place| write(index, place));
    values
}

/// `length` numbers, of which `write` makes parts of `part` numbers each, on all threads, and what it
/// gives for each of them. It is given what `scratch` makes, shared by parts that follow each other, a
/// part's index and its place.
///
/// The place holds zeros, written by the same task a moment before, in its core's cache. One thread
/// that clears all of it first lets the others wait.
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
            // SAFETY: all of it was just written.
            let part = unsafe { part.assume_init_mut() };
            write(scratch, index, part)
        })
        .collect();
    // SAFETY: the parts are all of it, and each was written.
    unsafe { values.set_len(length) };
    (values, results)
}
