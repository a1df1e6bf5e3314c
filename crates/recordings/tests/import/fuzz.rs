//! Damaged files. An error is fine; an escaped panic, an abort or full memory is not.
//!
//! `MUTATIONS=1000000 cargo nextest run --cargo-profile release -p worker -E 'test(damaged_file)'`
//! runs this many mutations instead of the usual number.

use std::sync::atomic::{AtomicUsize, Ordering};

use random::{ChaCha8Rng, Rng, SeedableRng};
use serde_json::json;
use spec::ImportSpec;

use super::{Recordings, import, mcap, npz, parquet, parquet_of, small_pages, spec};

const USUAL_MUTATIONS: u64 = 100_000;

/// Limit of the memory for converting a damaged file of a few kilobytes, in bytes.
const ENOUGH: u64 = 1 << 30;

#[test]
fn no_damaged_file_takes_the_worker_along() {
    let mutations = std::env::var("MUTATIONS").ok().map(|count| count.parse().unwrap());
    let mutations = mutations.unwrap_or(USUAL_MUTATIONS);
    let files = originals();
    for (file, spec) in &files {
        import(file.clone(), spec).unwrap();
    }
    // The decoder's panics are caught, and their messages would be thousands of lines.
    std::panic::set_hook(Box::new(|_| {}));
    let imported = AtomicUsize::new(0);
    let threads = 2;
    std::thread::scope(|scope| {
        for thread in 0..threads {
            let (files, imported) = (&files, &imported);
            scope.spawn(move || {
                for seed in (0..mutations).filter(|seed| seed % threads == thread) {
                    let mut random = ChaCha8Rng::seed_from_u64(seed);
                    let (file, spec) = &files[below(&mut random, files.len())];
                    let damaged = damage(file, &mut random);
                    imported
                        .fetch_add(usize::from(import(damaged, spec).is_ok()), Ordering::Relaxed);
                }
            });
        }
    });
    let _ = std::panic::take_hook();
    let imported = imported.into_inner() as u64;
    assert!(imported < mutations / 2, "{imported} of {mutations} damages went unnoticed");
    let peak = peak_memory();
    assert!(peak < ENOUGH, "{peak} bytes of memory");
}

fn originals() -> Vec<(Vec<u8>, ImportSpec)> {
    let recordings = Recordings::of(&[60, 45]);
    let split = json!({"split": {"kind": "windows", "stride": 20}});
    let resampled = json!({
        "split": {"kind": "windows", "stride": 30}, "resampling": "linear", "rate_hz": 50.0,
    });
    let mut files: Vec<(Vec<u8>, ImportSpec)> = parquet::variants()
        .into_iter()
        .map(|properties| (recordings.parquet(properties), spec("parquet", &split)))
        .collect();
    files.push((recordings.parquet(small_pages()), spec("parquet", &resampled)));
    files.push((recordings.csv().into_bytes(), spec("csv", &split)));
    files.push((recordings.csv().into_bytes(), spec("csv", &resampled)));
    let with = |columns: serde_json::Value| json!({"split": {"kind": "windows", "stride": 20}, "columns": columns});
    let lists = parquet::with_lists(&recordings);
    let list_spec = spec("parquet", &with(parquet::of_lists()));
    files.push((parquet_of(lists.clone(), small_pages()), list_spec.clone()));
    files.push((parquet_of(lists, parquet::variants().swap_remove(5)), list_spec));
    let one_list = parquet_of(parquet::with_one_list(&recordings), small_pages());
    files.push((one_list, spec("parquet", &with(parquet::of_one_list()))));
    for is_deflated in [false, true] {
        files.push((npz::archive(&recordings, is_deflated), spec("npz", &with(npz::columns()))));
    }
    let whole = Recordings::of(&[60]);
    for compression in ["", "zstd", "lz4"] {
        files.push((mcap::file(&whole, compression), spec("mcap", &with(mcap::columns()))));
    }
    files
}

/// Applies one to four damages: bits, bytes, numbers, cuts, doublings. Most of them hit the file's
/// structure.
fn damage(file: &[u8], random: &mut ChaCha8Rng) -> Vec<u8> {
    let mut file = file.to_vec();
    for _ in 0..=below(random, 4) {
        if file.len() < 8 {
            return file;
        }
        let place = place(&file, random);
        match below(random, 7) {
            0 => file[place] ^= 1 << below(random, 8),
            1 => file[place] = u8::try_from(random.next_u32() & 0xff).unwrap(),
            2 => file[place] = [0, 1, 0x7f, 0x80, 0xff, b'"', b'\n', b','][below(random, 8)],
            3 => {
                // Claims of every size: lengths and counts are varints or little-endian numbers.
                let end = (place + 1 + below(random, 9)).min(file.len());
                file[place..end].fill(0xff);
            }
            4 => {
                let end = (place + 1 + below(random, 64)).min(file.len());
                file.drain(place..end);
            }
            5 => {
                let end = (place + 1 + below(random, 64)).min(file.len());
                let copy = file[place..end].to_vec();
                file.splice(place..place, copy);
            }
            _ => file.truncate(place),
        }
    }
    file
}

/// A place to damage. Half of them are in the last quarter, where Parquet has its footer.
fn place(file: &[u8], random: &mut ChaCha8Rng) -> usize {
    let footer = file.len() / 4;
    match below(random, 2) {
        0 => below(random, file.len()),
        _ => file.len() - 1 - below(random, footer),
    }
}

fn below(random: &mut ChaCha8Rng, end: usize) -> usize {
    usize::try_from(random.next_u64() % end as u64).unwrap()
}

/// `VmHWM` of this process: the most memory that it ever used.
fn peak_memory() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find(|line| line.starts_with("VmHWM:")).unwrap();
    let kibibytes: u64 = line.split_whitespace().nth(1).unwrap().parse().unwrap();
    kibibytes * 1024
}
