//! The part of a failed step's output that is repeated at the end of the test run. Long logs are
//! often cut to their last lines.

/// Lines from the end of the output that are repeated.
const LAST_LINES: usize = 60;

/// Begins of the lines with which test runners name a failed test, without leading spaces.
const NAMES_A_FAILURE: [&str; 9] = [
    "FAIL [",    // nextest
    "TIMEOUT [", // nextest
    "SIGABRT [", // nextest
    "SIGSEGV [", // nextest
    "not ok ",   // Node
    "FAIL: ",    // unittest
    "ERROR: ",   // unittest
    "error: ",   // cargo
    "error[",    // rustc
];

/// The lines of `text` that name failed tests, each once, then its last lines.
pub fn of_output(text: &str) -> Vec<&str> {
    let lines: Vec<&str> = text.lines().collect();
    let (earlier, last) = lines.split_at(lines.len().saturating_sub(LAST_LINES));
    let mut shown: Vec<&str> = Vec::new();
    for &line in earlier {
        if is_failure(line) && !shown.contains(&line) {
            shown.push(line);
        }
    }
    shown.extend(last);
    shown
}

/// The tests that nextest names as flaky, because they failed and then passed.
/// `FLAKY 2/2 [   0.051s] ( 7/20) worker leases::expire`
pub fn flaky(text: &str) -> impl Iterator<Item = &str> {
    let (_, summary) = text.rsplit_once("Summary [").unwrap_or_default();
    let lines = summary.lines().map(str::trim_start);
    lines
        .filter(|line| line.starts_with("FLAKY "))
        .filter_map(|line| Some(line.rsplit_once(") ")?.1))
}

fn is_failure(line: &str) -> bool {
    NAMES_A_FAILURE.iter().any(|begin| line.trim_start().starts_with(begin))
}

#[cfg(test)]
mod tests {
    use super::{LAST_LINES, flaky, of_output};

    #[test]
    fn failed_tests_are_named_before_the_last_lines() {
        let failures = "        FAIL [   0.3s] worker leases::expire\nnot ok 7 - a button\n";
        let repeated = "        FAIL [   0.3s] worker leases::expire\n";
        let passed = "        PASS [   0.1s] worker leases::renew\n".repeat(LAST_LINES);
        let text = format!("{failures}{repeated}{passed}");
        let shown = of_output(&text);
        assert_eq!(shown.len(), 2 + LAST_LINES);
        assert_eq!(shown[..2], failures.lines().collect::<Vec<_>>());
        assert!(shown[2..].iter().all(|line| line.contains("PASS")));
    }

    #[test]
    fn flaky_tests_are_those_that_the_summary_names() {
        let text = "  TRY 1 FAIL [   0.1s] (─────) worker leases::expire\n     Summary [   1.2s] 2 tests run: 2 \
                    passed (1 flaky), 0 skipped\n   FLAKY 2/2 [   0.1s] (1/2) worker leases::expire\n";
        assert_eq!(flaky(text).collect::<Vec<_>>(), ["worker leases::expire"]);
        assert_eq!(flaky("error: it does not compile").count(), 0);
    }

    #[test]
    fn short_output_is_repeated_as_it_is() {
        assert_eq!(of_output("a\nerror: b\n"), ["a", "error: b"]);
    }
}
