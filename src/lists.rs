//! Lists: their shared flags, their pages, and their last line.

use clap::Args;
use reqwest::Url;
use serde::Deserialize;

use crate::arguments::{OutputArguments, ServerArguments};
use crate::client::Client;

/// Flags for the part of a list, and for its order.
#[derive(Debug, Args)]
pub struct ListArguments {
    /// Only those with this tag, on themselves or on their job; with several flags, with all of the
    /// tags
    #[arg(long = "tag", value_name = "TAG")]
    tags: Vec<String>,

    /// Only those with this text in name or note, ignoring case
    #[arg(long, value_name = "TEXT")]
    text: Option<String>,

    /// Only those created at this time or later, such as 2026-12-01T08:00:00Z
    #[arg(long, value_name = "MOMENT")]
    since: Option<String>,

    /// Only those created before this time
    #[arg(long, value_name = "MOMENT")]
    until: Option<String>,

    /// Sort order, such as name or -finished; a dash reverses it
    #[arg(long, value_name = "ORDER", allow_hyphen_values = true)]
    sort: Option<String>,

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

    #[command(flatten)]
    pub output: OutputArguments,

    #[command(flatten)]
    pub server: ServerArguments,
}

/// Number of items per page when all are listed: the most that the server sends at once.
const LONGEST_PAGE: u32 = 500;

/// How a list continues.
pub struct Rest {
    cursor: Option<String>,
}

/// The field of every page that leads to the next one.
#[derive(Deserialize)]
struct Next {
    next: Option<String>,
}

impl ListArguments {
    /// Passes on each page of the list at `path`, as the server wrote it. `filters` are further
    /// filters of this list.
    pub async fn each_page(
        &self,
        client: &Client,
        path: &str,
        filters: &[(&str, &Option<String>)],
        mut show: impl FnMut(&str) -> anyhow::Result<()>,
    ) -> anyhow::Result<Rest> {
        let mut cursor = self.cursor.clone();
        loop {
            let page = client.raw(&self.address(path, filters, cursor.as_deref())?).await?;
            cursor = serde_json::from_str::<Next>(&page)?.next;
            show(&page)?;
            if !self.all || cursor.is_none() {
                return Ok(Rest { cursor });
            }
        }
    }

    fn address(
        &self,
        path: &str,
        filters: &[(&str, &Option<String>)],
        cursor: Option<&str>,
    ) -> anyhow::Result<String> {
        let limit = if self.all { LONGEST_PAGE } else { self.limit };
        let mut address = Url::parse("http://localhost")?;
        address.set_path(path);
        let mut query = address.query_pairs_mut();
        query.append_pair("limit", &limit.to_string());
        for (name, value) in filters {
            query.extend_pairs(value.iter().map(|value| (name, value)));
        }
        query.extend_pairs(self.tags.iter().map(|tag| ("tag", tag)));
        let own = [
            ("text", &self.text),
            ("since", &self.since),
            ("until", &self.until),
            ("sort", &self.sort),
        ];
        for (name, value) in own {
            query.extend_pairs(value.iter().map(|value| (name, value)));
        }
        query.extend_pairs(self.before.iter().map(|id| ("before", id.to_string())));
        query.extend_pairs(cursor.map(|cursor| ("cursor", cursor)));
        drop(query);
        Ok(format!("{path}?{}", address.query().unwrap_or_default()))
    }

    /// Prints how to continue the list after the item with the id `last`, if there is more.
    pub fn print_rest(&self, command: &str, rest: &Rest, last: Option<i64>) {
        let Some(cursor) = &rest.cursor else { return };
        match last.filter(|_| self.sort.is_none() && self.cursor.is_none()) {
            Some(last) => println!("older ones: torqued {command} --before {last}"),
            None => println!("more: the same with --cursor {cursor}"),
        }
    }
}

/// Tags of a thing and of its job, for one cell of a table.
pub fn both(tags: &[String], job_tags: &[String]) -> String {
    let others = job_tags.iter().filter(|tag| !tags.contains(tag));
    tags.iter().chain(others).map(String::as_str).collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    #[derive(Parser)]
    struct List {
        #[command(flatten)]
        arguments: ListArguments,
    }

    fn address(flags: &[&str]) -> String {
        let list = List::try_parse_from([&["list"], flags].concat()).unwrap();
        let kind = Some("train".to_owned());
        let filters = [("kind", &kind), ("state", &None)];
        list.arguments.address("/v1/runs", &filters, Some("c+c")).unwrap()
    }

    #[test]
    fn every_flag_is_a_parameter() {
        let flags = ["--tag", "a", "--tag", "lr=1", "--text", "50 % & ä", "--sort", "-name"];
        let expected = "/v1/runs?limit=20&kind=train&tag=a&tag=lr%3D1&text=50+%25+%26+%C3%A4&sort=-name&cursor=c%2Bc";
        assert_eq!(address(&flags), expected);
        let flags = ["--all", "--since", "2026-12-01T08:00:00+01:00", "--before", "7"];
        let expected = "/v1/runs?limit=500&kind=train&since=2026-12-01T08%3A00%3A00%2B01%3A00&before=7&cursor=c%2Bc";
        assert_eq!(address(&flags), expected);
    }
}
