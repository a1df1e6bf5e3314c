//! Names of operations, such as `get_job_tasks`, for clients that are generated from the OpenAPI
//! document.

/// The unique name of the operation for `method` at `path`.
pub fn of_operation(method: &str, path: &str) -> String {
    let mut words: Vec<String> = vec![method.to_owned()];
    let mut was_variable = false;
    let segments = path.split('/').filter(|segment| !segment.is_empty() && *segment != "v1");
    for segment in segments {
        let variable = segment.strip_prefix('{').and_then(|name| name.strip_suffix('}'));
        match variable {
            // The segment before a variable is singular.
            Some(_) if !was_variable => {
                if let Some(last) = words.last_mut() {
                    *last = singular(last);
                }
            }
            Some(name) => words.extend(["by".to_owned(), name.to_owned()]),
            None => words.push(segment.replace('.', "_")),
        }
        was_variable = variable.is_some();
    }
    words.join("_")
}

fn singular(plural: &str) -> String {
    match plural.strip_suffix("ies") {
        Some(stem) => format!("{stem}y"),
        None => plural.strip_suffix('s').unwrap_or(plural).to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::of_operation;

    #[test]
    fn an_operation_is_named_after_its_method_and_path() {
        for (method, path, name) in [
            ("get", "/v1/jobs", "get_jobs"),
            ("get", "/v1/jobs/{id}/tasks", "get_job_tasks"),
            ("post", "/v1/jobs/{id}/cancel", "post_job_cancel"),
            ("get", "/v1/datasets/{id}/trajectories/{index}", "get_dataset_trajectory"),
            ("get", "/v1/datasets/{id}/spectrum.svg", "get_dataset_spectrum_svg"),
            ("get", "/v1/runs/{id}/metrics/{key}", "get_run_metric"),
            ("get", "/v1/runs/{id}/metrics/{group}/{name}", "get_run_metric_by_name"),
        ] {
            assert_eq!(of_operation(method, path), name);
        }
    }
}
