use std::ffi::OsString;
use std::process::{Command, ExitCode, Stdio};

use anyhow::bail;
use clap::Args;

use crate::arguments::ServerArguments;
use crate::resource::Resource;

#[derive(Debug, Args)]
pub struct Arguments {
    /// Open the page of a thing of this kind [default: the list of jobs]
    #[arg(value_name = "KIND", requires = "id")]
    resource: Option<Resource>,

    /// Its id
    #[arg(value_name = "ID")]
    id: Option<i64>,

    /// Print the address without opening it
    #[arg(long)]
    print: bool,

    #[command(flatten)]
    server: ServerArguments,
}

pub async fn run(arguments: Arguments) -> anyhow::Result<ExitCode> {
    let client = arguments.server.client()?;
    if client.is_on_socket() {
        bail!(
            "browsers cannot open a socket; forward it to a port (docs/operate.md), and give that \
             address with --server"
        );
    }
    let path = match (arguments.resource, arguments.id) {
        (Some(resource), Some(id)) => resource.page_path(id),
        _ => "/".to_owned(),
    };
    let url = client.url(&path);
    println!("{url}");
    if !arguments.print {
        open(&url);
    }
    Ok(ExitCode::SUCCESS)
}

/// Opens the address in a browser, if there is one. The address is printed before, so nothing is
/// lost without one.
fn open(url: &str) {
    let Some(program) = browser(|name| std::env::var_os(name).filter(|value| !value.is_empty()))
    else {
        return;
    };
    let mut command = Command::new(program);
    command.arg(url).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    if let Err(error) = command.spawn() {
        tracing::debug!("cannot start a browser: {error}");
    }
}

/// The program that opens addresses: the one in `BROWSER`, or the desktop's own.
fn browser(variable: impl Fn(&str) -> Option<OsString>) -> Option<OsString> {
    if let Some(browser) = variable("BROWSER") {
        return Some(browser);
    }
    if cfg!(target_os = "macos") {
        return Some("open".into());
    }
    let has_desktop =
        ["DISPLAY", "WAYLAND_DISPLAY"].into_iter().any(|name| variable(name).is_some());
    has_desktop.then(|| "xdg-open".into())
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;

    #[test]
    fn a_browser_is_looked_for_where_there_is_a_desktop_or_one_is_named() {
        let with = |set: &'static str| {
            browser(move |name| (name == set).then(|| OsString::from("something")))
        };
        assert_eq!(with("BROWSER"), Some("something".into()));
        assert_eq!(with("WAYLAND_DISPLAY"), Some("xdg-open".into()));
        assert_eq!(with("SSH_TTY"), None);
    }
}
