//! The configuration file of a server. It is TOML with the flags of `serve` as keys. The command
//! itself defines which keys there are, and which values each allows. Other commands with the flag
//! `--config` read the same file, and take the flags that they have from it.
//!
//! Flags and variables override the file. There is no list of keys, and none of commands.

use std::ffi::OsString;
use std::path::Path;

use anyhow::{Context, anyhow, bail, ensure};
use clap::builder::ArgAction;
use clap::error::{ContextKind, ContextValue};
use clap::parser::ValueSource;
use clap::{Arg, ArgMatches, Command, CommandFactory, FromArgMatches};
use toml::{Table, Value};

use crate::cli::Cli;
use crate::help::grouped;

/// The command whose flags are the keys.
const COMMAND: &str = "serve";

/// The flag that names it.
const FLAG: &str = "config";

/// Flags that are not allowed in the file: the one that names it, those that only print, and the
/// confirmation of a place, which is for a single start.
const NO_KEYS: [&str; 4] = [FLAG, "help", "version", "claim-place"];

/// Reads the command line, and then the file that it or `TORQUED_CONFIG` names. A flag takes
/// precedence over a variable, a variable over the file, and the file over the built-in default. An
/// invalid command line ends the process, as `--help` does.
///
/// # Errors
/// Name the file, the key and what is allowed.
pub fn parse() -> anyhow::Result<Cli> {
    let arguments: Vec<OsString> = std::env::args_os().collect();
    let matches = grouped(Cli::command()).get_matches_from(&arguments);
    let cli = match file(&matches) {
        None => Cli::from_arg_matches(&matches),
        Some(Named { path, reader, given }) => {
            let text = std::fs::read_to_string(path)
                .with_context(|| format!("cannot read {}", path.display()))?;
            let more =
                arguments_of(&text, &reader, given).with_context(|| path.display().to_string())?;
            let all = arguments.into_iter().chain(more);
            Cli::from_arg_matches(&Cli::command().get_matches_from(all))
        }
    };
    Ok(cli.unwrap_or_else(|error| error.exit()))
}

/// A configuration file that the command line names.
struct Named<'a> {
    path: &'a Path,
    /// The command that reads it, such as `token create`.
    reader: Vec<&'a str>,
    /// The command's arguments.
    given: &'a ArgMatches,
}

fn file(matches: &ArgMatches) -> Option<Named<'_>> {
    let (mut reader, mut given) = (Vec::new(), matches);
    while let Some((name, inner)) = given.subcommand() {
        reader.push(name);
        given = inner;
    }
    // Most commands do not have the flag.
    let path = given.try_get_one::<std::path::PathBuf>(FLAG).ok().flatten()?;
    Some(Named { path, reader, given })
}

/// The flags for the keys in `text`, without those that a flag or a variable has set, and without
/// those that `reader` does not have. All keys and values are checked.
fn arguments_of(text: &str, reader: &[&str], given: &ArgMatches) -> anyhow::Result<Vec<OsString>> {
    let table: Table = text.parse().map_err(|error: toml::de::Error| syntax(text, &error))?;
    let mut command = Cli::command();
    command.build();
    let find = |names: &[&str]| {
        let found = names.iter().try_fold(&command, |command, name| command.find_subcommand(name));
        found.context("there is no such command")
    };
    let (command, reader) = (find(&[COMMAND])?, find(reader)?);
    let mut arguments = Vec::new();
    for (key, value) in &table {
        let argument = known(command, key)?;
        let flags = flags(argument, key, value)?;
        check(argument, key, value, &flags)?;
        let has_flag = reader.get_arguments().any(|own| own.get_id() == argument.get_id());
        let is_given = || {
            matches!(
                given.value_source(argument.get_id().as_str()),
                Some(ValueSource::CommandLine | ValueSource::EnvVariable)
            )
        };
        if has_flag && !is_given() {
            arguments.extend(flags);
        }
    }
    Ok(arguments)
}

fn syntax(text: &str, error: &toml::de::Error) -> anyhow::Error {
    let before = error.span().map_or("", |span| text.get(..span.start).unwrap_or_default());
    let line = before.matches('\n').count() + 1;
    anyhow!("line {line} is not valid TOML: {}", error.message())
}

/// The key of a flag, e.g. `max_connections` for `--max-connections`.
fn key_of(argument: &Arg) -> Option<String> {
    let long = argument.get_long().filter(|long| !NO_KEYS.contains(long))?;
    Some(long.replace('-', "_"))
}

fn known<'a>(command: &'a Command, key: &str) -> anyhow::Result<&'a Arg> {
    let mut arguments = command.get_arguments();
    if let Some(argument) =
        arguments.find(|argument| key_of(argument).is_some_and(|known| known == key))
    {
        return Ok(argument);
    }
    let keys: Vec<String> = command.get_arguments().filter_map(key_of).collect();
    match spec::nearest(key, keys.iter().map(String::as_str)) {
        Some(nearest) => bail!("{key} is not a key; did you mean {nearest}?"),
        None => bail!("{key} is not a key; allowed: {}", keys.join(", ")),
    }
}

/// The flags of a key. A list gives one flag per value, and a table gives one per `NAME=VALUE`.
fn flags(argument: &Arg, key: &str, value: &Value) -> anyhow::Result<Vec<OsString>> {
    let long = argument.get_long().unwrap_or_default();
    let flag = |text: &str| OsString::from(format!("--{long}={text}"));
    let takes_several = matches!(argument.get_action(), ArgAction::Append);
    Ok(match value {
        Value::Boolean(on) if matches!(argument.get_action(), ArgAction::SetTrue) => {
            if *on {
                vec![format!("--{long}").into()]
            } else {
                Vec::new()
            }
        }
        Value::Array(values) if takes_several => {
            let texts = values.iter().map(|value| text(key, value));
            texts.map(|text| Ok(flag(&text?))).collect::<anyhow::Result<_>>()?
        }
        Value::Table(values) if takes_several => {
            let pair = |(name, value)| Ok(flag(&format!("{name}={}", text(key, value)?)));
            values.iter().map(pair).collect::<anyhow::Result<_>>()?
        }
        value => vec![flag(&text(key, value)?)],
    })
}

/// A single value in the form of the command line.
fn text(key: &str, value: &Value) -> anyhow::Result<String> {
    Ok(match value {
        Value::String(text) => text.clone(),
        Value::Integer(number) => number.to_string(),
        Value::Float(number) => number.to_string(),
        other => bail!("{key} is {other}, allowed: a single text or number"),
    })
}

/// Lets the command check the flags of one key alone, so that an error is about that key.
fn check(argument: &Arg, key: &str, value: &Value, flags: &[OsString]) -> anyhow::Result<()> {
    let command = ["torqued", COMMAND].map(OsString::from);
    let checked = Cli::command().try_get_matches_from(command.iter().chain(flags));
    let Err(error) = checked else { return Ok(()) };
    let allowed = match (error.get(ContextKind::ValidValue), std::error::Error::source(&error)) {
        (Some(ContextValue::Strings(values)), _) if !values.is_empty() => {
            format!("allowed: {}", values.join(", "))
        }
        (_, Some(reason)) => reason.to_string(),
        _ => "not allowed".to_owned(),
    };
    // The error does not repeat passwords and tokens.
    ensure!(!argument.is_hide_env_values_set(), "{key}: {allowed}");
    bail!("{key} is {value}: {allowed}")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read_by(reader: &[&str], arguments: &[&str], text: &str) -> anyhow::Result<Vec<OsString>> {
        let command = ["torqued"];
        let words = command.iter().chain(reader).chain(arguments).chain(&["--config=file"]);
        let matches = Cli::command().get_matches_from(words);
        let named = file(&matches).unwrap();
        assert_eq!(named.reader, reader);
        arguments_of(text, reader, named.given)
    }

    fn read(text: &str) -> anyhow::Result<Vec<OsString>> {
        read_by(&[COMMAND], &["--lease-seconds", "7"], text)
    }

    #[test]
    fn other_commands_take_the_flags_that_they_have_from_the_file_of_the_server() {
        let text = "data = \"/srv/torqued\"\nobjects = \"s3://lab/torqued\"\nworkers = 4\nlog = \"warn\"\n\
                    token = \"secret\"\nkeep_logs_days = 7\n";
        let (data, token, logs) = ("--data=/srv/torqued", "--token=secret", "--keep-logs-days=7");
        let always = ["--log=warn", "--objects=s3://lab/torqued"];
        for (reader, arguments, more) in [
            (&["backup"][..], &["to", "--data=here"][..], &[][..]),
            (&["restore"], &["from"], &[data]),
            (&["migrate"], &["--to-data=there"], &[data]),
            (&["reindex"], &[], &[data]),
            (&["doctor"], &[], &[data, token]),
            (&["gc"], &[], &[data, logs]),
            (&["token", "create"], &["ada"], &[data, token]),
            (&["token", "clear"], &[], &[data]),
        ] {
            let mut found = read_by(reader, arguments, text).unwrap();
            found.sort();
            let mut expected: Vec<OsString> =
                always.iter().chain(more).map(OsString::from).collect();
            expected.sort();
            assert_eq!(found, expected, "{reader:?}");
        }
        let error = read_by(&["backup"], &["to"], "wrokers = 4").unwrap_err().to_string();
        assert!(error.contains("did you mean workers?"), "{error}");
    }

    #[test]
    fn every_flag_of_serve_is_a_key_and_a_flag_that_was_given_stands() {
        let text = "max_connections = 64\nlease_seconds = 9\nlog = \"warn\"\nslurm_option = [\"-p lab\", \"-q x\"]\n\
                    [time_limit]\ntrain = 3600\n";
        let flags = [
            "--max-connections=64",
            "--log=warn",
            "--slurm-option=-p lab",
            "--slurm-option=-q x",
            "--time-limit=train=3600",
        ];
        let mut found = read(text).unwrap();
        found.sort();
        let mut expected = flags.map(OsString::from);
        expected.sort();
        assert_eq!(found, expected);
    }

    #[test]
    fn an_error_names_the_key_its_value_and_what_is_allowed() {
        for (text, words) in [
            ("max_conections = 64", "max_conections is not a key; did you mean max_connections?"),
            ("wrokers = 1", "wrokers is not a key; did you mean workers?"),
            ("colour = 1", "colour is not a key; allowed: "),
            ("config = \"x\"", "config is not a key"),
            ("max_connections = 2", "max_connections is 2: allowed: 16 to 100000"),
            ("workers = 65", "workers is 65: 65 is not in 0..=64"),
            ("executor = \"slrum\"", "executor is \"slrum\": allowed: local, slurm, kubernetes"),
            ("workers = [1]", "workers is [1], allowed: a single text or number"),
            ("workers = true", "workers is true, allowed: a single text or number"),
            ("workers = 1\nlog = ", "line 2 is not valid TOML"),
        ] {
            let error = read(text).unwrap_err().to_string();
            assert!(error.starts_with(words), "{text}: {error}");
        }
        let error = read("database = \"mysql://u:secret@h/d\"").unwrap_err().to_string();
        assert!(!error.contains("secret"), "{error}");
    }
}
