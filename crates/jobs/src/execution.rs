//! The limits of a server on the execution of jobs.

use spec::{JobSpec, Moment, SpecError, Violation};
use store::Timestamp;

use crate::kind::Limits;

/// How many days ahead the start time of a job may lie.
const DAYS_AHEAD: i64 = 366;

const DAY_MS: i64 = 24 * 60 * 60 * 1000;

/// # Errors
/// Names each field of a job's execution that exceeds a limit of the server. `now` is by the
/// database's clock.
pub(crate) fn check(spec: &JobSpec, limits: &Limits, now: Timestamp) -> Result<(), SpecError> {
    let execution = spec.execution();
    let mut found = SpecError::default();
    let mut violation = |field: &str, value: String, allowed: String| {
        found.add_with(|| Violation::new(format!("execution.{field}"), value, allowed));
    };
    let longest = limits.time_limits_s.get(&spec.kind()).copied();
    if let (Some(asked), Some(longest)) = (execution.time_limit_s, longest)
        && asked > longest
    {
        let kind = spec.kind();
        let allowed = format!(
            "at most {longest}, the limit that this server was started with (--time-limit {kind}={longest})"
        );
        violation("time_limit_s", asked.to_string(), allowed);
    }
    let latest = Moment::from_milliseconds(now.milliseconds() + DAYS_AHEAD * DAY_MS);
    if let Some(moment) = execution.not_before.filter(|moment| *moment > latest) {
        let allowed = format!("at most {DAYS_AHEAD} days ahead, until {latest}");
        violation("not_before", moment.to_string(), allowed);
    }
    found.into_result()
}

#[cfg(test)]
mod tests {
    use serde_json::{Value, json};
    use spec::JobKind;

    use super::*;
    use crate::inputs::tests::parse;

    fn violations(execution: &Value) -> Vec<(String, String)> {
        let spec = parse(&json!({"preset": "D1-chirp", "execution": execution}));
        let time_limits_s = [(JobKind::Simulate, 600), (JobKind::Train, 60)].into();
        let limits = Limits { max_trajectories: 1_000_000, time_limits_s };
        // 2026-11-24T00:00:00Z
        let now = Timestamp::from_milliseconds(1_795_478_400_000);
        let error = check(&spec, &limits, now).err();
        let violations = error.map(|error| error.violations).unwrap_or_default();
        violations.into_iter().map(|violation| (violation.field, violation.allowed)).collect()
    }

    #[test]
    fn a_longer_time_than_the_operator_allows_the_kind_is_refused() {
        assert_eq!(violations(&json!({"time_limit_s": 600})), []);
        let refused = violations(&json!({"time_limit_s": 601}));
        assert_eq!(refused[0].0, "execution.time_limit_s");
        assert!(refused[0].1.contains("at most 600") && refused[0].1.contains("simulate=600"));
    }

    #[test]
    fn a_job_may_be_told_to_begin_a_year_ahead_and_no_more() {
        assert_eq!(violations(&json!({"not_before": "2020-01-01T00:00:00Z"})), []);
        assert_eq!(violations(&json!({"not_before": "2027-11-25T00:00:00Z"})), []);
        let refused =
            violations(&json!({"not_before": "2027-11-25T00:00:01Z", "time_limit_s": 900}));
        assert_eq!(refused.len(), 2);
        assert_eq!(refused[1].0, "execution.not_before");
        assert!(refused[1].1.contains("until 2027-11-25T00:00:00Z"), "{refused:?}");
    }
}
