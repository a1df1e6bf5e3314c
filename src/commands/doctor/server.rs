use wire::Health;

use super::Findings;
use crate::client::{Client, ClientError};

pub async fn look(client: &Client, report: &mut Findings) -> anyhow::Result<()> {
    let url = client.url("");
    let health: Health = match client.get("/healthz").await {
        Ok(health) => health,
        Err(ClientError::Unreachable { .. }) => {
            let remedy = "torqued serve starts one; --server names another";
            return report.note("server", format!("none answers at {url}"), remedy);
        }
        Err(error) => {
            return report.wrong("server", error.to_string(), "its log has the details");
        }
    };
    let own = env!("CARGO_PKG_VERSION");
    if health.version == own {
        report.good("server", format!("torqued {own} at {url}, {} workers", health.workers))?;
    } else {
        let found = format!("torqued {} at {url}, and this is {own}", health.version);
        report.note("server", found, "install the same version for both")?;
    }
    for reason in &health.reasons {
        report.wrong("server", reason, "tasks wait until this is fixed")?;
    }
    match client.queue().await {
        Ok(queue) if queue.paused => report.note("queue", "paused", "torqued resume resumes it"),
        Ok(queue) => {
            let found = format!("{} tasks wait, {} run", queue.queued, queue.running);
            report.good("queue", found)
        }
        Err(error) => report.wrong("queue", error.to_string(), "is TORQUED_TOKEN right?"),
    }
}
