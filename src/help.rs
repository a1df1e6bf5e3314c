//! The list of commands that `torqued --help` prints, in groups.

use std::fmt::Write as _;

use clap::Command;

/// A heading, and the commands below it.
type Group = (&'static str, &'static [&'static str]);

const GROUPS: [Group; 8] = [
    ("Start", &["quickstart", "serve", "worker", "study", "open", "doctor", "devices"]),
    (
        "Jobs",
        &[
            "submit", "presets", "watch", "cancel", "retry", "jobs", "tasks", "attempts", "logs",
            "events",
        ],
    ),
    ("Data", &["simulate", "import", "datasets", "summary", "trajectory", "verify"]),
    ("Arms", &["robot", "excite", "identify"]),
    ("Results", &["runs", "checkpoints", "evaluations", "show", "compare", "metrics", "label"]),
    ("Use", &["predict", "stream", "download", "export"]),
    (
        "Operate",
        &[
            "health", "workers", "queue", "pause", "resume", "drain", "undrain", "delete",
            "undelete", "trash", "gc", "token", "audit", "backup", "restore", "migrate", "reindex",
        ],
    ),
    ("Shell", &["completions", "man", "help"]),
];

/// Underlined and bold, as clap's headings; taken out again where nobody sees colours.
const HEADING: &str = "\u{1b}[1m\u{1b}[4m";
const NAME: &str = "\u{1b}[1m";
const PLAIN: &str = "\u{1b}[0m";

/// The command with its subcommands in groups.
pub fn grouped(mut command: Command) -> Command {
    command.build();
    let mut commands = String::new();
    for (heading, names) in GROUPS {
        let _ = writeln!(commands, "{HEADING}{heading}:{PLAIN}");
        for name in names {
            let about = command.find_subcommand(name).and_then(Command::get_about);
            let about = about.map(ToString::to_string).unwrap_or_default();
            let _ = writeln!(commands, "  {NAME}{name:<12}{PLAIN} {about}");
        }
        commands.push('\n');
    }
    let template = format!(
        "{{about-with-newline}}\n{{usage-heading}} {{usage}}\n\n{commands}\
         {HEADING}Options:{PLAIN}\n{{options}}{{after-help}}"
    );
    command.help_template(template)
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use clap::CommandFactory;

    use super::*;
    use crate::cli::Cli;

    #[test]
    fn every_command_is_in_one_group() {
        let mut command = Cli::command();
        command.build();
        let shown = command.get_subcommands().filter(|it| !it.is_hide_set());
        let shown: BTreeSet<&str> = shown.map(Command::get_name).collect();
        let grouped: Vec<&str> = GROUPS.iter().flat_map(|(_, names)| *names).copied().collect();
        assert_eq!(grouped.iter().copied().collect::<BTreeSet<&str>>(), shown);
        assert_eq!(grouped.len(), shown.len());
    }

    #[test]
    fn the_list_fits_a_terminal_of_80_columns() {
        let help = grouped(Cli::command()).render_help().to_string();
        let list = help.split("Options:").next().unwrap();
        for line in list.lines().skip(2) {
            assert!(line.chars().count() <= 80, "{line}");
        }
        assert!(list.contains("Jobs:\n  submit       Submit a job\n"), "{list}");
    }
}
