use std::process::ExitCode;

use clap::Args;
use wire::{Metric, Run};

use crate::arguments::{OutputArguments, ServerArguments};
use crate::output::write_json;
use crate::progress::measure;

#[derive(Debug, Args)]
pub struct Arguments {
    /// The run; `torqued runs` lists them
    #[arg(value_name = "RUN")]
    run: i64,

    /// Only these metrics, such as train/loss [default: all of the run]
    #[arg(value_name = "KEY")]
    keys: Vec<String>,

    /// Largest number of points per metric; each part of a longer curve keeps its lowest and
    /// highest point
    #[arg(long, value_name = "N", default_value_t = api::limits::POINTS_MAXIMUM, value_parser = clap::value_parser!(u32).range(2..=i64::from(api::limits::POINTS_MAXIMUM)))]
    points: u32,

    /// Print the curves of validation error and loss as SVG instead of numbers
    #[arg(long, conflicts_with_all = ["json", "keys"])]
    figure: bool,

    #[command(flatten)]
    output: OutputArguments,

    #[command(flatten)]
    server: ServerArguments,
}

pub async fn run(arguments: Arguments) -> anyhow::Result<ExitCode> {
    let client = arguments.server.client()?;
    let id = arguments.run;
    if arguments.figure {
        print!("{}", client.raw(&format!("/v1/runs/{id}/figures/loss.svg")).await?);
        return Ok(ExitCode::SUCCESS);
    }
    let keys = if arguments.keys.is_empty() {
        let run: Run = client.get(&format!("/v1/runs/{id}")).await?;
        run.metrics.into_keys().collect()
    } else {
        arguments.keys
    };
    if !arguments.output.json {
        println!("key,step,time,value");
    }
    for key in keys {
        let metric = client.metric(id, &key, arguments.points).await?;
        if arguments.output.json {
            write_json(&metric)?;
        } else {
            print!("{}", csv(&metric));
        }
        let points = metric.points.len() as u64;
        if points < metric.recorded {
            let [points, recorded] = [points, metric.recorded].map(measure::count);
            eprintln!("{key}: {points} of {recorded} points");
        }
    }
    Ok(ExitCode::SUCCESS)
}

/// One line per point. The value is empty if it was not finite.
fn csv(metric: &Metric) -> String {
    let key = if metric.key.contains([',', '"', '\n']) {
        format!("\"{}\"", metric.key.replace('"', "\"\""))
    } else {
        metric.key.clone()
    };
    let mut text = String::new();
    for point in &metric.points {
        let value = point.value.map(|value| value.to_string()).unwrap_or_default();
        text.push_str(&format!("{key},{},{},{value}\n", point.step, point.time));
    }
    text
}

#[cfg(test)]
mod tests {
    use wire::MetricPoint;

    use super::*;

    #[test]
    fn a_value_that_is_no_number_is_empty_and_a_comma_is_quoted() {
        let point = |step, value| MetricPoint { step, time: "2026-01-01T00:00:00Z".into(), value };
        let points = vec![point(1, Some(0.5)), point(2, None)];
        let metric = Metric { key: "a,b".to_owned(), points, recorded: 2 };
        let expected = "\"a,b\",1,2026-01-01T00:00:00Z,0.5\n\"a,b\",2,2026-01-01T00:00:00Z,\n";
        assert_eq!(csv(&metric), expected);
    }
}
