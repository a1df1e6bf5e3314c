//! Fields that all searches share.

use crate::mlflow::entities::View;
use crate::mlflow::filter::Filter;
use crate::mlflow::order::Order;
use crate::mlflow::{Attribute, Fields, MlflowError, limits};

/// The largest number of bytes of a filter, far more than its clauses need.
const FILTER: usize = 100_000;

pub fn filter(fields: Fields<'_>, attributes: &[Attribute]) -> Result<Filter, MlflowError> {
    Filter::parse(fields.text("filter", FILTER)?.unwrap_or_default(), attributes)
}

pub fn orders(fields: Fields<'_>, attributes: &[Attribute]) -> Result<Vec<Order>, MlflowError> {
    let orders = fields.texts("order_by", limits::CLAUSES)?;
    orders.into_iter().map(|order| Order::parse(order, attributes)).collect()
}

pub fn view(fields: Fields<'_>, name: &str) -> Result<View, MlflowError> {
    match fields.text(name, limits::KEY)?.unwrap_or("ACTIVE_ONLY") {
        "ACTIVE_ONLY" => Ok(View::Active),
        "DELETED_ONLY" => Ok(View::Deleted),
        "ALL" => Ok(View::All),
        other => Err(MlflowError::invalid(name, other, "ACTIVE_ONLY, DELETED_ONLY or ALL")),
    }
}

/// Number of items on a page.
pub fn limit(fields: Fields<'_>, default: u32, most: u32) -> Result<u32, MlflowError> {
    let Some(asked) = fields.integer("max_results")? else { return Ok(default) };
    match u32::try_from(asked) {
        Ok(limit) if (1..=most).contains(&limit) => Ok(limit),
        _ => Err(MlflowError::invalid("max_results", &asked.to_string(), &format!("1 to {most}"))),
    }
}

/// Number of items before the page. It is the content of tokens.
pub fn skipped(fields: Fields<'_>) -> Result<u64, MlflowError> {
    let token = fields.text("page_token", limits::KEY)?.filter(|token| !token.is_empty());
    let Some(token) = token else { return Ok(0) };
    let allowed = "the next_page_token of an earlier answer";
    let skipped = token.parse::<u32>().map(u64::from);
    skipped.map_err(|_| MlflowError::invalid("page_token", token, allowed))
}

/// The number of items before the page, for items in memory.
pub fn skipped_items(fields: Fields<'_>) -> Result<usize, MlflowError> {
    Ok(usize::try_from(skipped(fields)?).unwrap_or(usize::MAX))
}
