//! The data behind the errors of a list: a cue where errors are not comparable, and the way to a list
//! where they are.

use reports::lists::{has_error, is_by_error};
use spec::DataSource;
use wire::List;

use crate::app::App;
use crate::app::listing::has_errors;
use crate::error::ApiError;
use crate::page::filter_query::FilterQuery;
use crate::page::lists::Paged;
use crate::page::parts::Link;

/// Datasets that a cue has links to.
const LINKS: usize = 5;

/// The sentence and the links of a list's page about the data of its errors.
#[derive(Default)]
pub struct Comparable {
    /// Whether the list is sorted by errors on different data.
    pub is_mixed: bool,
    /// The lists with the errors on one of these datasets alone.
    pub each: Vec<Link>,
    /// The dataset that the list is filtered by.
    pub data: Option<DataFilter>,
}

/// A dataset by which a list is filtered.
pub struct DataFilter {
    pub id: String,
    pub name: String,
    /// The same list without this filter.
    pub without: String,
}

impl Comparable {
    /// `items` are those of the page that `asked` asks for.
    pub async fn of<T: Paged>(
        app: &App,
        list: &List,
        asked: &FilterQuery,
        items: &[T],
    ) -> Result<Self, ApiError> {
        if !has_errors(list) {
            return Ok(Self::default());
        }
        let data = match asked.value("dataset") {
            id if id.is_empty() => None,
            id => Some(DataFilter::of(app, asked, id).await?),
        };
        if data.is_some() || !is_by_error(&asked.order()) {
            return Ok(Self { data, ..Self::default() });
        }
        let jobs: Vec<i64> =
            items.iter().filter(|item| has_error(*item)).filter_map(Paged::job).collect();
        let mut different: Vec<Vec<DataSource>> = Vec::new();
        for data in app.data_of_jobs(&jobs).await? {
            if !different.contains(&data) {
                different.push(data);
            }
        }
        if different.len() < 2 {
            return Ok(Self::default());
        }
        let mut each = Vec::new();
        for source in different.iter().flatten() {
            let DataSource::Digest(digest) = source else { continue };
            let Some(id) = app.dataset_of_digest(*digest).await? else { continue };
            let href = asked.with("dataset", Some(&id.to_string()));
            if each.iter().all(|link: &Link| link.href != href) {
                each.push(Link::new(href, app.dataset(id).await?.name));
            }
            if each.len() == LINKS {
                break;
            }
        }
        Ok(Self { is_mixed: true, each, data: None })
    }
}

impl DataFilter {
    /// A dataset that is gone has its id alone.
    async fn of(app: &App, asked: &FilterQuery, id: String) -> Result<Self, ApiError> {
        let found = match id.parse() {
            Ok(id) => app.datasets_by_id(&[id]).await?.remove(&id),
            Err(_) => None,
        };
        let name = found.map(|dataset| dataset.name).unwrap_or_default();
        Ok(Self { name, without: asked.with("dataset", None), id })
    }
}
