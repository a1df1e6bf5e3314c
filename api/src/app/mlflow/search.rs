//! Searches of runs. Torqued's own runs and those of clients pass the same filter and are sorted
//! together.
//!
//! A search reads one row of every run of the experiments, and the metrics, params and tags that
//! the filter and the order name. It reads all data only for the runs of the page.

use std::cmp::Ordering;
use std::collections::{BTreeSet, HashMap};
use std::time::Instant;

use store::{ExperimentId, Listed, Listing, Page, RunId, RunSummary, TrackedRunId};

use super::runs::{own_metric, tracked_metric};
use super::{RunName, own_runs, page, runs};
use crate::app::App;
use crate::app::paging::json_bytes;
use crate::error::ApiError;
use crate::limits::{PAGE_BYTES, REQUEST_TIMEOUT};
use crate::mlflow::entities::{Pair, Run, RunData, RunInfo, Stage, View};
use crate::mlflow::filter::Filter;
use crate::mlflow::order::Order;
use crate::mlflow::{Attribute, Datum, Field, MlflowError};

pub struct RunSearch {
    pub experiments: Vec<ExperimentId>,
    pub filter: Filter,
    pub orders: Vec<Order>,
    pub view: View,
    pub limit: u32,
    pub skipped: usize,
    /// Reads only as many of torqued's own runs, the newest ones, as fill the page: for a list without a filter, newest first.
    pub newest: bool,
}

/// Runs whose data are read at the same time.
const RUNS_AT_ONCE: usize = 1000;

/// The kind of a run, with its key in the store.
enum Source {
    Own(RunId),
    Tracked(TrackedRunId),
}

/// A run that a search may find, with the values that the search needs.
struct Candidate {
    source: Source,
    info: RunInfo,
    numbers: HashMap<Field, f64>,
    texts: HashMap<Field, String>,
}

/// The keys that a search needs.
#[derive(Default)]
struct Keys {
    metrics: Vec<String>,
    params: Vec<String>,
    tags: Vec<String>,
}

impl App {
    pub(crate) async fn mlflow_run(&self, run: &RunName) -> Result<Run, MlflowError> {
        let candidate = match run {
            RunName::Own(id) => Candidate::own(&RunSummary::from(&self.store.run(*id).await?)),
            RunName::Tracked(identifier) => {
                Candidate::tracked(&self.store.tracked_run(identifier).await?)
            }
        };
        let run = self.whole_runs(vec![candidate]).await?.pop();
        run.ok_or_else(|| ApiError::Internal.into())
    }

    /// A page of runs, and the token of the next page.
    pub(crate) async fn search_runs(
        &self,
        search: &RunSearch,
    ) -> Result<(Vec<Run>, Option<String>), MlflowError> {
        let keys = Keys::of(search);
        let mut candidates = self.tracked_candidates(search, &keys).await?;
        if search.experiments.contains(&ExperimentId::TORQUED) {
            candidates.extend(self.own_candidates(search, &keys).await?);
        }
        let (view, filter, orders) = (search.view, search.filter.clone(), search.orders.clone());
        let find = move || found(candidates, view, &filter, &orders);
        // Many patterns and many runs take long however short the request is.
        let candidates = self.checks.run(usize::MAX, find).await?;
        let (shown, next) = page(candidates, search.skipped, search.limit);
        self.page_of_runs(shown, next, search.skipped).await
    }

    /// Runs with all their data, and the token of the next page. The page ends early once it has
    /// [`PAGE_BYTES`].
    async fn page_of_runs(
        &self,
        mut candidates: Vec<Candidate>,
        next: Option<String>,
        skipped: usize,
    ) -> Result<(Vec<Run>, Option<String>), MlflowError> {
        let (mut runs, mut bytes) = (Vec::new(), 0);
        while !candidates.is_empty() {
            let rest = candidates.split_off(candidates.len().min(RUNS_AT_ONCE));
            for run in self.whole_runs(candidates).await? {
                bytes += json_bytes(&run);
                if bytes > PAGE_BYTES && !runs.is_empty() {
                    let next = (skipped + runs.len()).to_string();
                    return Ok((runs, Some(next)));
                }
                runs.push(run);
            }
            candidates = rest;
        }
        Ok((runs, next))
    }

    async fn tracked_candidates(
        &self,
        search: &RunSearch,
        keys: &Keys,
    ) -> Result<Vec<Candidate>, MlflowError> {
        let mut rows = self.store.tracked_runs(&search.experiments).await?;
        rows.retain(|run| search.view.shows(run.is_deleted));
        let mut candidates: Vec<Candidate> = rows.iter().map(Candidate::tracked).collect();
        let ids: Vec<TrackedRunId> = rows.iter().map(|run| run.id).collect();
        let places: HashMap<TrackedRunId, usize> =
            ids.iter().enumerate().map(|(place, id)| (*id, place)).collect();
        if !keys.metrics.is_empty() {
            for (id, metric) in self.store.latest_tracked(&ids, Some(&keys.metrics)).await? {
                let numbers = &mut candidates[places[&id]].numbers;
                numbers.insert(Field::Metric(metric.key), metric.value);
            }
        }
        if !keys.params.is_empty() {
            for (id, key, value) in self.store.tracked_params(&ids, Some(&keys.params)).await? {
                candidates[places[&id]].texts.insert(Field::Param(key), value);
            }
        }
        if !keys.tags.is_empty() {
            for (id, key, value) in self.store.tracked_tags(&ids, Some(&keys.tags)).await? {
                candidates[places[&id]].texts.insert(Field::Tag(key), value);
            }
        }
        Ok(candidates)
    }

    async fn own_candidates(
        &self,
        search: &RunSearch,
        keys: &Keys,
    ) -> Result<Vec<Candidate>, MlflowError> {
        let mut candidates = Vec::new();
        if search.newest || !keys.params.is_empty() || !keys.tags.is_empty() {
            let most = match search.newest {
                // One more than the page has, so that there is a next one.
                true => search.skipped.saturating_add(search.limit as usize).saturating_add(1),
                false => usize::MAX,
            };
            for run in self.own_runs(most).await? {
                let mut texts = HashMap::new();
                if !keys.params.is_empty() {
                    texts.extend(asked(own_runs::params(&run.spec), &keys.params, Field::Param));
                }
                if !keys.tags.is_empty() {
                    texts.extend(asked(own_runs::tags(&run), &keys.tags, Field::Tag));
                }
                candidates.push(Candidate { texts, ..Candidate::own(&RunSummary::from(&run)) });
            }
        } else {
            // Nothing of their specs is asked for, which are long.
            candidates.extend(self.store.run_summaries().await?.iter().map(Candidate::own));
        }
        let ids: Vec<RunId> = candidates.iter().filter_map(Candidate::own_id).collect();
        let places: HashMap<RunId, usize> =
            ids.iter().enumerate().map(|(place, id)| (*id, place)).collect();
        for key in &keys.metrics {
            for (id, point) in self.store.latest_values(&ids, key).await? {
                let numbers = &mut candidates[places[&id]].numbers;
                numbers.insert(Field::Metric(key.clone()), point.value);
            }
        }
        Ok(candidates)
    }

    /// Torqued's own runs, newest first, at least `most` of them if there are as many. They are read page by page.
    async fn own_runs(&self, most: usize) -> Result<Vec<store::Run>, MlflowError> {
        let mut listing = Listing { limit: Page::MAX_LIMIT, ..Listing::default() };
        let mut runs = Vec::new();
        loop {
            let Listed { mut items, end } = self.store.list_runs(&listing).await?;
            runs.append(&mut items);
            if end.is_none() || runs.len() >= most {
                return Ok(runs);
            }
            listing.after = end;
        }
    }

    /// Runs with all their metrics, params and tags.
    async fn whole_runs(&self, candidates: Vec<Candidate>) -> Result<Vec<Run>, MlflowError> {
        let (mut own, mut tracked) = (Vec::new(), Vec::new());
        for candidate in &candidates {
            match &candidate.source {
                Source::Own(id) => own.push(*id),
                Source::Tracked(id) => tracked.push(*id),
            }
        }
        let mut of_own: HashMap<RunId, RunData> = HashMap::new();
        if !own.is_empty() {
            for run in self.store.runs_with_ids(&own).await? {
                let (params, tags) = (own_runs::params(&run.spec), own_runs::tags(&run));
                of_own.insert(run.id, RunData { params, tags, ..RunData::default() });
            }
            for (id, key, point) in self.store.latest_metrics(&own).await? {
                of_own.entry(id).or_default().metrics.push(own_metric(key, &point));
            }
        }
        let mut of_tracked: HashMap<TrackedRunId, RunData> = HashMap::new();
        if !tracked.is_empty() {
            for (id, metric) in self.store.latest_tracked(&tracked, None).await? {
                of_tracked.entry(id).or_default().metrics.push(tracked_metric(metric));
            }
            for (id, key, value) in self.store.tracked_params(&tracked, None).await? {
                of_tracked.entry(id).or_default().params.push(Pair { key, value });
            }
            for (id, key, value) in self.store.tracked_tags(&tracked, None).await? {
                of_tracked.entry(id).or_default().tags.push(Pair { key, value });
            }
        }
        let run = |candidate: Candidate| {
            let data = match candidate.source {
                Source::Own(id) => of_own.remove(&id).unwrap_or_default(),
                Source::Tracked(id) => of_tracked.remove(&id).unwrap_or_default(),
            };
            Run { info: candidate.info, data }
        };
        Ok(candidates.into_iter().map(run).collect())
    }
}

/// The candidates that a search finds, in its order.
///
/// # Errors
/// [`ApiError::Timeout`] when a filter takes longer than the request may.
fn found(
    candidates: Vec<Candidate>,
    view: View,
    filter: &Filter,
    orders: &[Order],
) -> Result<Vec<Candidate>, ApiError> {
    let began = Instant::now();
    let mut found = Vec::new();
    for candidate in candidates {
        if began.elapsed() > REQUEST_TIMEOUT {
            return Err(ApiError::Timeout);
        }
        if view.shows(candidate.info.lifecycle_stage == Stage::Deleted)
            && filter.is_met(|field| candidate.datum(field))
        {
            found.push(candidate);
        }
    }
    let last = [Order::descending(Attribute::StartTime), Order::ascending(Attribute::RunId)];
    found.sort_by(|a, b| {
        let orders = orders.iter().chain(&last);
        let compare = |order: &Order| order.compare(a.datum(&order.field), b.datum(&order.field));
        orders.map(compare).find(|order| order.is_ne()).unwrap_or(Ordering::Equal)
    });
    Ok(found)
}

fn asked<'a>(
    pairs: Vec<Pair>,
    keys: &'a [String],
    field: fn(String) -> Field,
) -> impl Iterator<Item = (Field, String)> + 'a {
    let is_asked = |pair: &Pair| keys.contains(&pair.key);
    pairs.into_iter().filter(is_asked).map(move |pair| (field(pair.key), pair.value))
}

impl Keys {
    fn of(search: &RunSearch) -> Self {
        let ordered = search.orders.iter().map(|order| &order.field);
        let (mut metrics, mut params, mut tags) =
            (BTreeSet::new(), BTreeSet::new(), BTreeSet::new());
        for field in search.filter.fields().chain(ordered) {
            match field {
                Field::Metric(key) => metrics.insert(key.clone()),
                Field::Param(key) => params.insert(key.clone()),
                Field::Tag(key) => tags.insert(key.clone()),
                Field::Attribute(_) => false,
            };
        }
        let list = |keys: BTreeSet<String>| keys.into_iter().collect();
        Self { metrics: list(metrics), params: list(params), tags: list(tags) }
    }
}

impl Candidate {
    fn own(run: &RunSummary) -> Self {
        let (source, info) = (Source::Own(run.id), own_runs::info(run));
        Self { source, info, numbers: HashMap::new(), texts: HashMap::new() }
    }

    fn own_id(&self) -> Option<RunId> {
        match self.source {
            Source::Own(id) => Some(id),
            Source::Tracked(_) => None,
        }
    }

    fn tracked(run: &store::TrackedRun) -> Self {
        let source = Source::Tracked(run.id);
        Self { source, info: runs::info(run), numbers: HashMap::new(), texts: HashMap::new() }
    }

    fn datum(&self, field: &Field) -> Option<Datum<'_>> {
        let info = &self.info;
        let Field::Attribute(attribute) = field else {
            let text = || self.texts.get(field).map(|text| Datum::Text(text));
            return self.numbers.get(field).copied().map(Datum::Number).or_else(text);
        };
        match attribute {
            Attribute::RunId => Some(Datum::Text(&info.run_id)),
            Attribute::RunName => Some(Datum::Text(&info.run_name)),
            Attribute::UserId => Some(Datum::Text(&info.user_id)),
            Attribute::Status => Some(Datum::Text(info.status)),
            Attribute::ArtifactUri => Some(Datum::Text(&info.artifact_uri)),
            Attribute::StartTime => Some(Datum::moment(info.start_time)),
            Attribute::EndTime => info.end_time.map(Datum::moment),
            Attribute::Name
            | Attribute::ExperimentId
            | Attribute::CreationTime
            | Attribute::LastUpdateTime => None,
        }
    }
}
