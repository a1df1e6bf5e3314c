//! The lists of datasets, runs, checkpoints, evaluations and robots, each with a filter, orders and pages.
//! Their columns are declared in `wire`.

use std::collections::BTreeSet;

use askama::Template;
use axum::extract::State;
use axum::http::header::{CONTENT_DISPOSITION, CONTENT_TYPE};
use axum::response::{IntoResponse, Response};
use store::Page;
use wire::{
    Checkpoint, Dataset, DatasetState, Evaluation, JobState, List, ListCell, ListPage as _, Run,
};

use crate::app::App;
use crate::app::listing::ListRequest;
use crate::app::mlflow::spec_fields;
use crate::app::resources::Resource;
use crate::error::ApiError;
use crate::extract::QueryPairs;
use crate::limits::{EXPORTED_ITEMS, LISTED_COLUMNS};
use crate::page::answer::{PageError, html};
use crate::page::comparable::Comparable;
use crate::page::dataset::filling;
use crate::page::filter_query::{FilterQuery, Order};
use crate::page::instant::Instant;
use crate::page::kinds::own_page;
use crate::page::note::Note;
use crate::page::text;

#[derive(Template)]
#[template(path = "list.html")]
struct ListTemplate {
    list: &'static List,
    text: String,
    tags: String,
    filtered: bool,
    sort: String,
    orders: Vec<Order>,
    /// Where items come from, for a list without any.
    empty: Option<Note>,
    /// The columns that the reader chose, in one text.
    chosen: String,
    columns: Vec<Heading>,
    /// The values that the field of columns may get: the chosen columns, and one more that an item of the page has.
    suggested: Vec<String>,
    /// Chosen columns that no item of the page has.
    unknown: Vec<String>,
    rows: Vec<ListRow>,
    next: Option<String>,
    /// The address of the whole list as CSV.
    csv: String,
    comparable: Comparable,
}

/// The head of a column.
struct Heading {
    name: String,
    is_number: bool,
    /// The address of all runs in the order of a chosen metric; empty for other columns.
    sorted: String,
}

pub struct ListRow {
    href: String,
    name: String,
    id: i64,
    tags: Vec<String>,
    /// The cells, and whether each is a number.
    cells: Vec<(Shown, bool)>,
}

/// A cell, in the form of the page.
enum Shown {
    Moment(Instant),
    Span(Instant, Instant),
    Text(String),
    State(JobState, String),
}

impl Shown {
    fn is_empty(&self) -> bool {
        matches!(self, Self::Text(text) if text.is_empty())
    }
}

/// A list with a page of its own.
pub trait Paged: Resource {
    /// The path of the page about this item.
    fn href(&self) -> String;

    /// The job that its error comes from.
    fn job(&self) -> Option<i64> {
        None
    }

    /// The columns that a reader may choose, as far as this item has them: metrics, and fields of the spec.
    fn choices(&self) -> Vec<String> {
        Vec::new()
    }

    /// Whether it has a metric of this name.
    fn has_metric(&self, _name: &str) -> bool {
        false
    }

    /// The address of all items in the order of a metric. `None` without such a page.
    fn sorted_by(_metric: &str, _columns: &[&str]) -> Option<String> {
        None
    }

    /// Changes rows by data that the items do not have.
    fn complete_rows(
        _: &App,
        _: &[Self],
        _: &mut [ListRow],
    ) -> impl Future<Output = Result<(), ApiError>> + Send {
        async { Ok(()) }
    }
}

/// The page of the list of `T`.
pub async fn show<T: Paged + Sync>(
    State(app): State<App>,
    pairs: QueryPairs,
) -> Result<Response, PageError> {
    let list: &'static List = const { &T::LIST };
    let asked = FilterQuery::new(format!("/{}", list.name), pairs);
    let chosen = asked.value("columns");
    let chosen: Vec<&str> = match list.has_columns {
        true => chosen.split([' ', ',']).filter(|it| !it.is_empty()).take(LISTED_COLUMNS).collect(),
        false => Vec::new(),
    };
    if asked.value("format") == CSV {
        return as_csv::<T>(&app, asked.pairs(), &chosen).await;
    }
    let found = app.list::<T>(&ListRequest::read(list, asked.pairs())?).await?;
    let (items, next) = found.into_parts();
    let mut rows: Vec<ListRow> = items.iter().map(|item| ListRow::of(item, &chosen)).collect();
    T::complete_rows(&app, &items, &mut rows).await?;
    let known: BTreeSet<String> = match list.has_columns {
        true => items.iter().flat_map(Paged::choices).collect(),
        false => BTreeSet::new(),
    };
    let page = ListTemplate {
        list,
        text: asked.value("text"),
        tags: asked.value("tag"),
        filtered: asked.is_filtered(),
        sort: asked.order(),
        orders: asked.orders(list),
        columns: headings::<T>(&chosen, &items),
        suggested: suggested(&chosen, &known),
        unknown: match items.is_empty() {
            true => Vec::new(),
            false => chosen
                .iter()
                .filter(|column| !known.contains(**column))
                .map(|column| (*column).to_owned())
                .collect(),
        },
        empty: Note::new(list.empty),
        chosen: chosen.join(" "),
        rows,
        next: next.map(|cursor| asked.with("cursor", Some(&cursor))),
        csv: asked.with("format", Some(CSV)),
        comparable: Comparable::of(&app, list, &asked, &items).await?,
    };
    Ok(html(&page)?)
}

fn headings<T: Paged>(chosen: &[&str], items: &[T]) -> Vec<Heading> {
    let is_metric = |column: &str| items.iter().any(|item| item.has_metric(column));
    let of_chosen = |column: &&str| Heading {
        name: (*column).to_owned(),
        is_number: true,
        sorted: match is_metric(column) {
            true => T::sorted_by(column, chosen).unwrap_or_default(),
            false => String::new(),
        },
    };
    let own = T::COLUMNS.iter().map(|column| Heading {
        name: text::title(column.heading),
        is_number: column.is_number,
        sorted: String::new(),
    });
    chosen.iter().map(of_chosen).chain(own).collect()
}

/// The texts that complete the field of chosen columns.
pub fn suggested(chosen: &[&str], known: &BTreeSet<String>) -> Vec<String> {
    let others = known.iter().filter(|column| !chosen.contains(&column.as_str()));
    let with = |column: &String| [chosen, &[column.as_str()]].concat().join(" ");
    others.map(with).collect()
}

/// The value of the parameter `format` that asks for CSV.
pub const CSV: &str = "csv";

/// The list as a file: the first [`EXPORTED_ITEMS`] items, from the first page on.
async fn as_csv<T: Paged + Sync>(
    app: &App,
    asked: &[(String, String)],
    chosen: &[&str],
) -> Result<Response, PageError> {
    let of_page = |name: &String| ["limit", "cursor"].contains(&name.as_str());
    let asked = asked.iter().filter(|(name, _)| !of_page(name)).cloned();
    let asked: Vec<(String, String)> =
        asked.chain([("limit".to_owned(), Page::MAX_LIMIT.to_string())]).collect();
    let (mut items, mut cursor) = (Vec::new(), None);
    loop {
        let mut pairs = asked.clone();
        pairs.extend(cursor.map(|cursor| ("cursor".to_owned(), cursor)));
        let found = app.list::<T>(&ListRequest::read(&T::LIST, &pairs)?).await?;
        let (of_page, next) = found.into_parts();
        items.extend(of_page);
        cursor = next;
        if cursor.is_none() || items.len() >= EXPORTED_ITEMS {
            break;
        }
    }
    items.truncate(EXPORTED_ITEMS);
    let csv = reports::lists::to_csv(&items, chosen).map_err(|_| ApiError::Internal)?;
    let name = format!("attachment; filename=\"{}.csv\"", T::LIST.name);
    let headers = [(CONTENT_TYPE, "text/csv; charset=utf-8"), (CONTENT_DISPOSITION, &name)];
    Ok((headers, csv).into_response())
}

impl ListRow {
    fn of<T: Paged>(item: &T, chosen: &[&str]) -> Self {
        let shown = |cell: ListCell| match cell {
            ListCell::Missing => Shown::Text(String::new()),
            ListCell::Text(words) => Shown::Text(words),
            ListCell::State(state, word) => Shown::State(state, word.to_owned()),
            ListCell::Count(number) => Shown::Text(text::count(number)),
            ListCell::Bytes(bytes) => Shown::Text(text::size(bytes)),
            ListCell::Number(number) => Shown::Text(text::value(number)),
            ListCell::Degrees(angle) => Shown::Text(format!("{}°", text::degrees(angle))),
            ListCell::Headline(headline) => Shown::Text(reports::headline(&headline)),
            ListCell::Percent(percent) => Shown::Text(format!("{percent:.0} %")),
            ListCell::Part(done, all) => {
                Shown::Text(format!("{} of {}", text::count(done), text::count(all)))
            }
            ListCell::Moment(time) | ListCell::Span(time, None) => {
                Shown::Moment(Instant::new(&time))
            }
            ListCell::Span(from, Some(to)) => Shown::Span(Instant::new(&from), Instant::new(&to)),
        };
        let columns = T::COLUMNS.iter();
        Self {
            href: item.href(),
            name: item.name().to_owned(),
            id: item.id(),
            tags: item.tags().into_iter().map(str::to_owned).collect(),
            cells: chosen
                .iter()
                .map(|column| (shown(item.chosen(column)), true))
                .chain(columns.map(|column| (shown((column.cell)(item)), column.is_number)))
                .collect(),
        }
    }
}

impl Paged for Dataset {
    fn href(&self) -> String {
        format!("/datasets/{}", self.id)
    }

    /// Says how the job ended that would have completed a dataset.
    async fn complete_rows(
        app: &App,
        datasets: &[Self],
        rows: &mut [ListRow],
    ) -> Result<(), ApiError> {
        let is_abandoned = |dataset: &&Self| dataset.state == DatasetState::Abandoned;
        let jobs: Vec<i64> =
            datasets.iter().filter(is_abandoned).map(|dataset| dataset.job).collect();
        let jobs = app.jobs_by_id(&jobs).await?;
        for (dataset, row) in datasets.iter().zip(rows) {
            let Some(job) = jobs.get(&dataset.job) else { continue };
            for (cell, _) in &mut row.cells {
                if let Shown::State(state, words) = cell {
                    (*state, *words) = (job.state, format!("{} {}", filling(job.kind), job.state));
                }
            }
        }
        Ok(())
    }
}

impl Paged for Run {
    fn href(&self) -> String {
        let page = own_page(self.kind, self.job, self.id).map(|link| link.href);
        page.unwrap_or_else(|| format!("/jobs/{}", self.job))
    }

    fn choices(&self) -> Vec<String> {
        let fields = spec_fields(&self.spec).into_iter().map(|field| field.key);
        self.metrics.keys().cloned().chain(fields).collect()
    }

    fn has_metric(&self, name: &str) -> bool {
        self.metrics.contains_key(name)
    }

    /// The list of all runs is sorted by any metric.
    fn sorted_by(metric: &str, columns: &[&str]) -> Option<String> {
        let mut query = form_urlencoded::Serializer::new(String::new());
        query.append_pair("columns", &columns.join(" "));
        query.append_pair("order", &format!("metrics.`{metric}` ASC"));
        Some(format!("/logged?{}", query.finish()))
    }

    fn job(&self) -> Option<i64> {
        Some(self.job)
    }
}

impl Paged for Checkpoint {
    fn href(&self) -> String {
        format!("/checkpoints/{}", self.id)
    }

    fn choices(&self) -> Vec<String> {
        self.metrics.keys().cloned().collect()
    }

    fn job(&self) -> Option<i64> {
        Some(self.job)
    }

    /// A checkpoint without a name has that of its run.
    async fn complete_rows(
        app: &App,
        checkpoints: &[Self],
        rows: &mut [ListRow],
    ) -> Result<(), ApiError> {
        let names = app.result_names(checkpoints.iter().map(|checkpoint| checkpoint.job)).await?;
        for (checkpoint, row) in checkpoints.iter().zip(rows) {
            if let Some(name) = names.get(&checkpoint.job).filter(|_| row.name.is_empty()) {
                row.name.clone_from(name);
            }
        }
        Ok(())
    }
}

impl Paged for Evaluation {
    fn href(&self) -> String {
        format!("/evaluations/{}", self.id)
    }

    fn job(&self) -> Option<i64> {
        Some(self.id)
    }

    /// An evaluation has the name of its run.
    async fn complete_rows(
        app: &App,
        evaluations: &[Self],
        rows: &mut [ListRow],
    ) -> Result<(), ApiError> {
        let names = app.result_names(evaluations.iter().map(|evaluation| evaluation.id)).await?;
        for (evaluation, row) in evaluations.iter().zip(rows) {
            if let Some(name) = names.get(&evaluation.id) {
                row.name.clone_from(name);
            }
        }
        Ok(())
    }
}
