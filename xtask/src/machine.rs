//! A line that describes the machine of a measurement.

use std::fs;
use std::process::Command;
use std::thread::available_parallelism;

use simd::InstructionSet;

/// Processor, the vector instructions in use, cores, memory, kernel, compiler, commit, and the load
/// of the machine before the measurement.
pub fn description() -> String {
    let read = |path| fs::read_to_string(path).unwrap_or_default();
    let processors = read("/proc/cpuinfo");
    let processor = field(&processors, "model name").unwrap_or("unknown processor");
    let cores = available_parallelism().map_or(1, usize::from);
    let memory = field(&read("/proc/meminfo"), "MemTotal").and_then(gibibytes);
    let memory = memory.map_or_else(|| "unknown".to_owned(), |gib| format!("{gib:.1} GiB"));
    let kernel = read("/proc/sys/kernel/osrelease");
    let load = read("/proc/loadavg");
    format!(
        "{processor} ({}), {cores} cores, {memory} memory, Linux {}; {}; commit {}; load {} before",
        InstructionSet::best(),
        kernel.trim(),
        first_line_of("rustc", &["--version"]),
        first_line_of("git", &["describe", "--always", "--dirty"]),
        load.split_whitespace().next().unwrap_or("unknown"),
    )
}

/// The first line that a program prints.
pub fn first_line_of(program: &str, arguments: &[&str]) -> String {
    let output =
        Command::new(program).args(arguments).current_dir(crate::places::repository()).output();
    let text = output.map(|output| String::from_utf8_lossy(&output.stdout).into_owned());
    let text = text.unwrap_or_default();
    text.lines().next().map_or_else(|| format!("{program} unknown"), str::to_owned)
}

/// The value of the first line `name : value` in a file of the kernel.
pub fn field<'a>(text: &'a str, name: &str) -> Option<&'a str> {
    text.lines().find_map(|line| {
        let (key, value) = line.split_once(':')?;
        (key.trim() == name).then(|| value.trim())
    })
}

/// Gibibytes from `N kB`. In these files kB means kibibytes.
pub fn gibibytes(value: &str) -> Option<f64> {
    let kibibytes: f64 = value.strip_suffix("kB")?.trim().parse().ok()?;
    Some(kibibytes / (1024.0 * 1024.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fields_of_the_kernels_files_are_found_by_their_whole_name() {
        let text = "processor\t: 0\nmodel\t\t: 2\nmodel name\t: AMD EPYC\nmodel name\t: other\n";
        assert_eq!(field(text, "model name"), Some("AMD EPYC"));
        assert_eq!(field(text, "name"), None);
    }

    #[test]
    fn memory_is_read_in_kibibytes() {
        assert_eq!(gibibytes("2097152 kB"), Some(2.0));
        assert_eq!(gibibytes("2097152"), None);
        assert_eq!(gibibytes("much kB"), None);
    }

    #[test]
    fn a_program_that_is_not_there_says_nothing() {
        assert_eq!(
            first_line_of("no-such-program-anywhere", &[]),
            "no-such-program-anywhere unknown"
        );
    }
}
