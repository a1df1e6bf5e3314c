//! Reads the numbers of passed and failed tests from the output of each test runner.

use std::ops::AddAssign;

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    pub passed: u64,
    pub failed: u64,
}

impl Counts {
    pub const fn one(passed: bool) -> Self {
        if passed { Self { passed: 1, failed: 0 } } else { Self { passed: 0, failed: 1 } }
    }

    /// Counts a program that failed without a failed test, because it did not compile or crashed,
    /// as one failure.
    pub const fn agreeing_with(mut self, success: bool) -> Self {
        if !success && self.failed == 0 {
            self.failed = 1;
        }
        self
    }
}

impl AddAssign for Counts {
    fn add_assign(&mut self, other: Self) {
        self.passed += other.passed;
        self.failed += other.failed;
    }
}

/// `Summary [   1.2s] 54 tests run: 51 passed (1 slow, 1 leaky), 2 failed, 1 timed out, 3 skipped`
pub fn nextest(text: &str) -> Option<Counts> {
    let line = text.lines().rev().find(|line| line.trim_start().starts_with("Summary ["))?;
    let (_, results) = line.split_once(" run: ")?;
    let mut counts = Counts::default();
    for result in without_parentheses(results).split(", ") {
        let mut words = result.split_whitespace();
        let number: u64 = words.next()?.parse().ok()?;
        match words.next()? {
            "passed" => counts.passed += number,
            "skipped" => {}
            _ => counts.failed += number,
        }
    }
    Some(counts)
}

/// `text` without what parentheses enclose. nextest lists there how some of the passed tests ran:
/// slowly, or leaving a process behind.
fn without_parentheses(text: &str) -> String {
    let mut is_inside = false;
    let outside = |letter: &char| {
        is_inside = (is_inside || *letter == '(') && *letter != ')';
        !is_inside && *letter != ')'
    };
    text.chars().filter(outside).collect()
}

/// `test result: ok. 3 passed; 0 failed; 0 ignored; ...`, once per crate.
pub fn cargo_test(text: &str) -> Option<Counts> {
    let mut counts = Counts::default();
    for line in text.lines().filter_map(|line| line.trim_start().strip_prefix("test result: ")) {
        counts.passed += number_before(line, " passed")?;
        counts.failed += number_before(line, " failed")?;
    }
    Some(counts)
}

/// `Ran 7 tests in 1.2s`, then `OK` or `FAILED (failures=1, errors=2)`.
pub fn unittest(text: &str) -> Option<Counts> {
    let ran = text.lines().rev().find_map(|line| line.strip_prefix("Ran "))?;
    let ran: u64 = ran.split_whitespace().next()?.parse().ok()?;
    let last = text.lines().rev().find(|line| line.starts_with("OK") || line.starts_with("FAILED"));
    let after = |key: &str| -> u64 {
        let rest = last.and_then(|line| line.split_once(key)).map_or("", |(_, rest)| rest);
        rest.chars().take_while(char::is_ascii_digit).collect::<String>().parse().unwrap_or(0)
    };
    let failed = after("failures=") + after("errors=");
    Some(Counts { passed: ran.saturating_sub(failed + after("skipped=")), failed })
}

/// `# pass 3` and `# fail 0`.
pub fn node(text: &str) -> Option<Counts> {
    let number = |key: &str| -> Option<u64> {
        text.lines().rev().find_map(|line| line.strip_prefix(key))?.trim().parse().ok()
    };
    Some(Counts { passed: number("# pass ")?, failed: number("# fail ")? })
}

fn number_before(line: &str, word: &str) -> Option<u64> {
    line.split_once(word)?.0.rsplit(' ').next()?.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    const fn counts(passed: u64, failed: u64) -> Option<Counts> {
        Some(Counts { passed, failed })
    }

    #[test]
    fn nextest_counts_every_way_to_fail() {
        let text = "  PASS [0.1s] a\n------\n     Summary [   1.2s] 54 tests run: 51 passed \
                    (1 slow), 2 failed, 1 timed out, 3 skipped\n";
        assert_eq!(nextest(text), counts(51, 3));
        assert_eq!(nextest("error: could not compile"), None);
    }

    #[test]
    fn nextest_counts_slow_and_leaky_tests_as_passed() {
        let text = "     Summary [   1.2s] 54 tests run: 54 passed (2 slow, 1 leaky), 0 skipped\n";
        assert_eq!(nextest(text), counts(54, 0));
        let text = "     Summary [   1.2s] 3 tests run: 2 passed (1 slow, 1 flaky), 1 failed\n";
        assert_eq!(nextest(text), counts(2, 1));
    }

    #[test]
    fn cargo_test_sums_over_crates() {
        let text = "test result: ok. 3 passed; 0 failed; 0 ignored\n\n\
                    test result: FAILED. 2 passed; 1 failed; 0 ignored\n";
        assert_eq!(cargo_test(text), counts(5, 1));
    }

    #[test]
    fn unittest_counts_failures_and_errors_apart_from_skips() {
        assert_eq!(unittest("Ran 7 tests in 1.2s\n\nOK\n"), counts(7, 0));
        let text = "Ran 9 tests in 1.2s\n\nFAILED (failures=1, errors=2, skipped=1)\n";
        assert_eq!(unittest(text), counts(5, 3));
    }

    #[test]
    fn node_counts_come_from_its_last_lines() {
        assert_eq!(node("# tests 4\n# pass 3\n# fail 1\n"), counts(3, 1));
    }

    #[test]
    fn a_crash_without_a_failed_test_is_a_failure() {
        assert_eq!(Counts::default().agreeing_with(false), Counts { passed: 0, failed: 1 });
    }
}
