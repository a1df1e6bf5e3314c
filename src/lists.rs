//! Lists of the server's resources, and tables of items. The columns, filters and orders are declared
//! in `wire`.

use std::marker::PhantomData;
use std::process::ExitCode;

use clap::builder::PossibleValuesParser;
use clap::{Arg, ArgMatches, Args, Command, FromArgMatches};
use reports::lists::{NOT_COMPARABLE, data_of_errors, is_by_error};
use reports::{Align, Table};
use reqwest::Url;
use wire::{List, ListCell, ListColumn, ListPage as _, Listed, Robot, Sort, Tabled};

use crate::arguments::{OutputArguments, ServerArguments};
use crate::progress::measure;

/// The flags of the list of `T`.
#[derive(Debug)]
pub struct Arguments<T> {
    /// The values of the filters and the order that the list of `T` declares, by the name of the
    /// parameter.
    declared: Vec<(&'static str, String)>,
    list: ListArguments,
    items: PhantomData<T>,
}

/// Flags that all lists have.
#[derive(Debug, Args)]
struct ListArguments {
    /// Only those with this tag, on themselves or on their job; with several flags, with all of the
    /// tags
    #[arg(long = "tag", value_name = "TAG")]
    tags: Vec<String>,

    /// Only those with this text in their name, or in their note, ignoring case
    #[arg(long, value_name = "TEXT")]
    text: Option<String>,

    /// Only those created at this time or later, such as 2026-12-01T08:00:00Z
    #[arg(long, value_name = "MOMENT")]
    since: Option<String>,

    /// Only those created before this time
    #[arg(long, value_name = "MOMENT")]
    until: Option<String>,

    /// Show this column, too: a metric such as train/loss, or a field of the spec such as optimizer.learning_rate
    #[arg(long = "column", value_name = "COLUMN")]
    columns: Vec<String>,

    /// Largest number of items to list
    #[arg(long, value_name = "N", default_value_t = 20, value_parser = clap::value_parser!(u32).range(1..=500))]
    limit: u32,

    /// List all of them, page by page
    #[arg(long, conflicts_with = "limit")]
    all: bool,

    /// Only those with a smaller id, which are older
    #[arg(long, value_name = "ID")]
    before: Option<i64>,

    /// Continue here: the `next` of the page before, with the same --sort
    #[arg(long, value_name = "NEXT")]
    cursor: Option<String>,

    /// Print CSV: numbers without units, and times as RFC 3339
    #[arg(long, conflicts_with = "json")]
    csv: bool,

    #[command(flatten)]
    output: OutputArguments,

    #[command(flatten)]
    server: ServerArguments,
}

/// Number of items per page when all are listed: the most that the server sends at once.
const LONGEST_PAGE: u32 = 500;

impl<T: Listed> Args for Arguments<T> {
    fn augment_args(command: Command) -> Command {
        let command = ListArguments::augment_args(command.args(declared::<T>()));
        // The server refuses tags in other lists.
        let hide = |tags: Arg| tags.hide(!T::LIST.has_labels);
        let command = command.mut_arg("tags", hide);
        command.mut_arg("columns", |columns| columns.hide(!T::LIST.has_columns))
    }

    fn augment_args_for_update(command: Command) -> Command {
        Self::augment_args(command)
    }
}

impl<T: Listed> FromArgMatches for Arguments<T> {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, clap::Error> {
        let value = |name| Some((name, matches.try_get_one::<String>(name).ok()??.clone()));
        Ok(Self {
            declared: ["kind", "state", "dataset", "sort"].into_iter().filter_map(value).collect(),
            list: ListArguments::from_arg_matches(matches)?,
            items: PhantomData,
        })
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), clap::Error> {
        *self = Self::from_arg_matches(matches)?;
        Ok(())
    }
}

/// The flags that the list of `T` declares.
fn declared<T: Listed>() -> Vec<Arg> {
    let list = const { &T::LIST };
    let flag =
        |name: &'static str, value: &'static str| Arg::new(name).long(name).value_name(value);
    let mut flags = Vec::new();
    if !list.kinds.is_empty() {
        let kind = flag("kind", "KIND").value_parser(PossibleValuesParser::new(list.kinds));
        flags.push(kind.help("Only those of jobs of this kind"));
    }
    if !list.states.is_empty() {
        let state = flag("state", "STATE").value_parser(PossibleValuesParser::new(list.states));
        flags.push(state.help("Only those in this state"));
    }
    if list.sorts.contains(&Sort::Rmse) {
        let data = flag("dataset", "ID").value_parser(dataset);
        flags.push(
            data.help("Only those on the dataset with this id, whose errors can be compared"),
        );
    }
    let words: Vec<&str> = list.sorts.iter().map(|sort| sort.as_str()).collect();
    let about = format!("Sort order: {}; a dash before it reverses it", words.join(", "));
    let sort = flag("sort", "ORDER").value_parser(order::<T>).help(about);
    flags.push(sort.allow_hyphen_values(true));
    flags
}

fn dataset(value: &str) -> Result<String, String> {
    let id: Result<i64, _> = value.parse();
    id.map(|id| id.to_string()).map_err(|_| "allowed: the id of a dataset".to_owned())
}

fn order<T: Listed>(value: &str) -> Result<String, String> {
    let orders = T::LIST.orders();
    if orders.iter().any(|order| order == value) {
        return Ok(value.to_owned());
    }
    Err(format!("allowed: {}", orders.join(", ")))
}

/// Lists the items of `T` as a table, or as the server wrote them.
pub async fn run<T: Listed>(arguments: Arguments<T>) -> anyhow::Result<ExitCode> {
    let list = &arguments.list;
    let client = list.server.client()?;
    let (mut cursor, mut items) = (list.cursor.clone(), Vec::new());
    loop {
        let page = client.raw(&arguments.address(cursor.as_deref())?).await?;
        if list.output.json {
            println!("{page}");
        }
        let page: T::Page = serde_json::from_str(&page)?;
        let (of_page, next) = page.into_parts();
        items.extend(of_page);
        cursor = next;
        if !list.all || cursor.is_none() {
            break;
        }
    }
    if list.csv {
        let columns: Vec<&str> = list.columns.iter().map(String::as_str).collect();
        print!("{}", reports::lists::to_csv(&items, &columns)?);
    } else if !list.output.json {
        print!("{}", listed(&items, &list.columns));
        if let Some(cue) = arguments.cue(&items) {
            eprintln!("{cue}");
        }
        arguments.print_rest(cursor.as_deref(), items.last().map(T::id));
    }
    Ok(ExitCode::SUCCESS)
}

impl<T: Listed> Arguments<T> {
    /// The path and the query of a page.
    fn address(&self, cursor: Option<&str>) -> anyhow::Result<String> {
        let ListArguments { tags, text, since, until, limit, all, before, .. } = &self.list;
        let limit = if *all { LONGEST_PAGE } else { *limit };
        let path = format!("/v1/{}", T::LIST.name);
        let mut address = Url::parse("http://localhost")?;
        let mut query = address.query_pairs_mut();
        query.append_pair("limit", &limit.to_string());
        query.extend_pairs(&self.declared);
        query.extend_pairs(tags.iter().map(|tag| ("tag", tag)));
        for (name, value) in [("text", text), ("since", since), ("until", until)] {
            query.extend_pairs(value.iter().map(|value| (name, value)));
        }
        query.extend_pairs(before.iter().map(|id| ("before", id.to_string())));
        query.extend_pairs(cursor.map(|cursor| ("cursor", cursor)));
        drop(query);
        Ok(format!("{path}?{}", address.query().unwrap_or_default()))
    }

    /// The sentence that a list has if it is sorted by errors on different data.
    fn cue(&self, items: &[T]) -> Option<String> {
        let value = |name| self.declared.iter().find(|(known, _)| *known == name);
        let (_, sort) = value("sort")?;
        let is_mixed = || data_of_errors(items).len() > 1;
        (is_by_error(sort) && value("dataset").is_none() && is_mixed())
            .then(|| format!("{NOT_COMPARABLE} --dataset ID lists those on one dataset alone."))
    }

    /// Prints how to continue the list after the item with the id `last`, if there is more.
    fn print_rest(&self, next: Option<&str>, last: Option<i64>) {
        let Some(cursor) = next else { return };
        let is_sorted = self.declared.iter().any(|(name, _)| *name == "sort");
        match last.filter(|_| !is_sorted && self.list.cursor.is_none()) {
            Some(last) => println!("older ones: torqued {} --before {last}", command(&T::LIST)),
            None => println!("more: the same with --cursor {cursor}"),
        }
    }
}

/// The command that prints a list.
fn command(list: &List) -> &'static str {
    if list.name == Robot::LIST.name { "robot list" } else { list.name }
}

/// The items of a list as a table.
fn listed<T: Listed>(items: &[T], chosen: &[String]) -> String {
    let columns = T::COLUMNS.iter().map(head);
    let tags = T::LIST.has_labels.then_some(("tags", Align::Left));
    let owned = |(heading, align): (&str, Align)| (heading.to_owned(), align);
    let own = [("id", Align::Right), ("name", Align::Left)].into_iter().chain(columns);
    let chosen_heads = chosen.iter().map(|column| (column.clone(), Align::Right));
    let mut table = Table::new(own.map(owned).chain(chosen_heads).chain(tags.map(owned)));
    for item in items {
        let mut row = vec![item.id().to_string(), item.name().to_owned()];
        row.extend(T::COLUMNS.iter().map(|column| shown((column.cell)(item))));
        row.extend(chosen.iter().map(|column| shown(item.chosen(column))));
        row.extend(tags.map(|_| item.tags().join(" ")));
        table.push(row);
    }
    table.render()
}

/// Items as a table.
pub fn table<T: Tabled>(items: &[T]) -> String {
    let mut table = Table::new(T::COLUMNS.iter().map(head));
    for item in items {
        table.push(T::COLUMNS.iter().map(|column| shown((column.cell)(item))).collect());
    }
    table.render()
}

fn head<T>(column: &ListColumn<T>) -> (&'static str, Align) {
    (column.heading, if column.is_number { Align::Right } else { Align::Left })
}

/// A cell, in the form of the command line.
fn shown(cell: ListCell) -> String {
    match cell {
        ListCell::Missing => String::new(),
        ListCell::Text(words) => words,
        ListCell::State(_, word) => word.to_owned(),
        ListCell::Count(number) => measure::count(number),
        ListCell::Bytes(bytes) => measure::size(bytes),
        ListCell::Number(number) => reports::numbers::value(number),
        ListCell::Degrees(angle) => format!("{}°", reports::numbers::degrees(angle)),
        ListCell::Headline(headline) => reports::headline(&headline),
        ListCell::Percent(percent) => format!("{percent:.0} %"),
        ListCell::Part(done, all) => format!("{} of {}", measure::count(done), measure::count(all)),
        ListCell::Moment(time) => measure::ago(&time),
        ListCell::Span(from, to) => {
            measure::since(&from, to.as_deref()).map(measure::duration).unwrap_or_default()
        }
    }
}

#[cfg(test)]
mod tests {
    use clap::Parser;
    use wire::{Evaluation, Job, Run};

    use super::*;

    #[derive(Parser)]
    struct Command<T: Listed + Send + Sync> {
        #[command(flatten)]
        arguments: Arguments<T>,
    }

    fn address(flags: &[&str]) -> String {
        let list = Command::<Run>::try_parse_from([&["list"], flags].concat()).unwrap();
        list.arguments.address(Some("c+c")).unwrap()
    }

    #[test]
    fn every_flag_is_a_parameter() {
        let flags = [
            "--kind",
            "train",
            "--tag",
            "a",
            "--tag",
            "lr=1",
            "--text",
            "50 % & ä",
            "--sort",
            "-name",
        ];
        let expected = "/v1/runs?limit=20&kind=train&sort=-name&tag=a&tag=lr%3D1&text=50+%25+%26+%C3%A4&cursor=c%2Bc";
        assert_eq!(address(&flags), expected);
        let flags = ["--all", "--since", "2026-12-01T08:00:00+01:00", "--before", "7"];
        let expected =
            "/v1/runs?limit=500&since=2026-12-01T08%3A00%3A00%2B01%3A00&before=7&cursor=c%2Bc";
        assert_eq!(address(&flags), expected);
    }

    #[test]
    fn errors_on_different_data_are_told_apart() {
        let run = |data: &str| -> Run {
            serde_json::from_value(serde_json::json!({
                "id": 1, "job": 2, "kind": "train", "name": "train", "digest": "0".repeat(64),
                "state": "succeeded", "error": null, "spec": {}, "artifacts": [], "data": data,
                "metrics": {"validation/rmse_deg": {"step": 10, "value": 0.25}},
                "created_at": "2026-11-28T12:00:00Z",
            }))
            .unwrap()
        };
        let cue = |flags: &[&str], runs: &[Run]| {
            let list = Command::<Run>::try_parse_from([&["list"], flags].concat()).unwrap();
            list.arguments.cue(runs)
        };
        let mixed = [run("lab"), run("stream")];
        assert!(cue(&["--sort", "rmse"], &mixed).unwrap().contains("--dataset ID"));
        assert_eq!(cue(&["--sort", "-rmse"], &mixed[..1]), None);
        assert_eq!(cue(&[], &mixed), None);
        assert_eq!(cue(&["--sort", "rmse", "--dataset", "3"], &mixed), None);
        assert!(Command::<Run>::try_parse_from(["list", "--dataset", "lab"]).is_err());
        assert!(Command::<Job>::try_parse_from(["list", "--dataset", "3"]).is_err());
    }

    /// Catches a hand-written list of kinds, which lacked `control`.
    #[test]
    fn jobs_of_every_kind_can_be_listed() {
        for kind in spec::JobKind::WORDS {
            assert!(Command::<Job>::try_parse_from(["jobs", "--kind", kind]).is_ok());
        }
    }

    #[test]
    fn an_order_that_a_list_does_not_have_is_refused_with_those_that_it_has() {
        assert!(Command::<Evaluation>::try_parse_from(["list", "--sort", "rmse"]).is_ok());
        let error = Command::<Job>::try_parse_from(["list", "--sort", "rmse"]).err().unwrap();
        let error = error.to_string();
        assert!(
            error.contains("'rmse' for '--sort <ORDER>': allowed: created, -created,"),
            "{error}"
        );
    }
}
