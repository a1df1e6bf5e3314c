//! The limits of the process that decodes a file.

use std::io::{self, Write};

use crate::isolation::{Mechanism, isolate};

/// Limit of the memory that decoding a file may take.
pub const MEMORY_BYTES: u64 = 1 << 30;

/// Limit of the processor time for decoding the next rows, in seconds. A usual file takes
/// milliseconds.
pub const BATCH_SECONDS: u64 = 60;

/// Limits this process permanently. An allocation beyond [`MEMORY_BYTES`] fails. The process ends
/// when its parent ends. `SIGXCPU` also ends it, unless it writes to the returned output within
/// [`BATCH_SECONDS`] of processor time. It can open no file and no connection, and start no process
/// or thread. If the kernel has no filter for system calls, it says so on standard error, and goes
/// on.
///
/// # Errors
/// When the operating system refuses a limit.
pub fn confine<W: Write>(output: W) -> io::Result<TimedOutput<W>> {
    #[cfg(target_os = "linux")]
    end_with_parent()?;
    // A failed allocation aborts, and must not leave a core dump of a gigabyte.
    lower(libc::RLIMIT_CORE, 0)?;
    lower(libc::RLIMIT_DATA, data_bytes() + MEMORY_BYTES)?;
    grant_time()?;
    let failed = isolate();
    // The filter alone is enough.
    if failed.iter().any(|(mechanism, _)| *mechanism == Mechanism::Seccomp) {
        for (mechanism, reason) in failed {
            eprintln!("the decoder could read other files; {mechanism} failed: {reason}");
        }
    }
    Ok(TimedOutput(output))
}

#[cfg(target_os = "linux")]
fn end_with_parent() -> io::Result<()> {
    let signal = libc::c_ulong::from(libc::SIGKILL.unsigned_abs());
    // SAFETY: the call takes two numbers and touches no memory.
    check(unsafe { libc::prctl(libc::PR_SET_PDEATHSIG, signal) })
}

/// The output of a confined process. Each write grants time for the next one.
pub struct TimedOutput<W>(W);

impl<W: Write> Write for TimedOutput<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.0.flush()?;
        grant_time()
    }
}

/// Memory that this process uses already, as `RLIMIT_DATA` counts it.
fn data_bytes() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmData:"));
    let kibibytes = line.and_then(|line| line.trim().strip_suffix("kB")?.trim().parse().ok());
    kibibytes.map_or(0, |kibibytes: u64| 1024 * kibibytes)
}

/// Allows this process another [`BATCH_SECONDS`] of processor time.
fn grant_time() -> io::Result<()> {
    let Limit { hard, .. } = limit(libc::RLIMIT_CPU)?;
    let soft = (seconds_used()? + 1 + BATCH_SECONDS).min(hard);
    set_limit(libc::RLIMIT_CPU, Limit { soft, hard })
}

fn lower(resource: Resource, bytes: u64) -> io::Result<()> {
    let bytes = limit(resource)?.hard.min(bytes);
    set_limit(resource, Limit { soft: bytes, hard: bytes })
}

#[cfg(target_env = "gnu")]
type Resource = libc::__rlimit_resource_t;
#[cfg(not(target_env = "gnu"))]
type Resource = libc::c_int;

/// The enforced limit and its maximum. The largest number means no limit.
struct Limit {
    soft: u64,
    hard: u64,
}

fn limit(resource: Resource) -> io::Result<Limit> {
    let mut limit = libc::rlimit { rlim_cur: 0, rlim_max: 0 };
    // SAFETY: the pointer is to a value that lives through the call, and is not kept.
    check(unsafe { libc::getrlimit(resource, &raw mut limit) })?;
    Ok(Limit { soft: limit.rlim_cur, hard: limit.rlim_max })
}

fn set_limit(resource: Resource, Limit { soft, hard }: Limit) -> io::Result<()> {
    let limit = libc::rlimit { rlim_cur: soft, rlim_max: hard };
    // SAFETY: the pointer is to a value that lives through the call, and is not kept.
    check(unsafe { libc::setrlimit(resource, &raw const limit) })
}

/// Processor time of all threads of this process.
fn seconds_used() -> io::Result<u64> {
    let mut time = libc::timespec { tv_sec: 0, tv_nsec: 0 };
    // SAFETY: the pointer is to a value that lives through the call, and is not kept.
    check(unsafe { libc::clock_gettime(libc::CLOCK_PROCESS_CPUTIME_ID, &raw mut time) })?;
    Ok(time.tv_sec.unsigned_abs())
}

fn check(result: libc::c_int) -> io::Result<()> {
    if result == 0 { Ok(()) } else { Err(io::Error::last_os_error()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The memory limit is not set here, because this process runs other tests as well.
    #[test]
    fn every_frame_grants_the_same_time_again() {
        let granted = || limit(libc::RLIMIT_CPU).unwrap();
        grant_time().unwrap();
        let used = seconds_used().unwrap();
        assert!((used + BATCH_SECONDS..=used + BATCH_SECONDS + 2).contains(&granted().soft));
        set_limit(libc::RLIMIT_CPU, Limit { soft: used + 5, ..granted() }).unwrap();
        let mut output = TimedOutput(Vec::new());
        output.write_all(b"frame").unwrap();
        assert_eq!(granted().soft, used + 5);
        output.flush().unwrap();
        assert!(granted().soft >= used + BATCH_SECONDS);
    }

    #[test]
    fn what_this_process_has_is_known() {
        assert!((1 << 16..1 << 40).contains(&data_bytes()), "{}", data_bytes());
    }
}
