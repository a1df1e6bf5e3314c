//! A picture of the jobs from which results come and of those that use them: a box for each job,
//! with links.

use std::collections::{BTreeMap, BTreeSet};

use wire::{Job, JobState};

use crate::app::App;
use crate::error::ApiError;
use crate::page::kinds::headlines;
use crate::page::rows::results;
use crate::page::text;

/// The width of a box, as far as columns beside each other leave room.
const WIDTHS: [usize; 2] = [196, 320];
/// The width of the page.
const PAGE: usize = 1070;
const HEIGHT: usize = 46;
/// Gaps between columns and between the boxes of a column.
const GAPS: [usize; 2] = [52, 14];

/// Hundredths of a character per pixel that fit into the two lines of a box.
const CHARACTERS: [usize; 2] = [13, 14];

/// A picture with the jobs in columns, each one right of those whose results it uses.
pub struct Lineage {
    pub width: usize,
    pub height: usize,
    /// The width of a box.
    pub of_box: usize,
    pub nodes: Vec<Node>,
    /// Curves of SVG.
    pub edges: Vec<String>,
    /// The jobs by the digests with which specs refer to them.
    pub sources: Vec<Source>,
    /// Whether jobs are left out.
    pub is_cut: bool,
}

/// A job whose results another one uses.
#[derive(Clone, Debug, PartialEq)]
pub struct Source {
    pub digest: String,
    pub name: String,
    /// The page of its result, or its own.
    pub href: String,
}

/// A job.
pub struct Node {
    pub x: usize,
    pub y: usize,
    /// The page of its result, or its own.
    pub href: String,
    pub name: String,
    /// Its kind, its state if it has not succeeded, and its main result.
    pub said: String,
    /// The same without a limit.
    pub title: String,
    pub state: JobState,
    /// Whether the page is about it.
    pub is_here: bool,
}

impl Lineage {
    /// The picture around a job, or around the members of a pipeline. `None` if it has nothing
    /// before and nothing after it.
    pub async fn of(app: &App, job: &Job) -> Result<Option<Self>, ApiError> {
        let roots: Vec<i64> = match job.members.as_slice() {
            [] => vec![job.id],
            members => members.iter().map(|member| member.job).collect(),
        };
        let lineage = app.lineage(&roots).await?;
        if lineage.jobs.len() < 2 {
            return Ok(None);
        }
        let shown: Vec<&Job> = lineage.jobs.values().collect();
        let headlines = headlines(app, &shown).await?;
        let ids: Vec<i64> = lineage.jobs.keys().copied().collect();
        // A box has the name of the page that it leads to.
        let names = app.result_names(ids.iter().copied()).await?;
        let places = places(&ids, &lineage.uses);
        let columns = places.values().map(|place| place[0] + 1).max().unwrap_or(1);
        let wide = (PAGE / columns).saturating_sub(GAPS[0]).clamp(WIDTHS[0], WIDTHS[1]);
        let name = |job: &Job| names.get(&job.id).unwrap_or(&job.name).clone();
        let href = |job: &Job| {
            let results = results(job);
            results.first().map_or(format!("/jobs/{}", job.id), |link| link.href.clone())
        };
        let sources = shown.iter().map(|job| Source {
            digest: job.digest.to_string(),
            name: name(job),
            href: href(job),
        });
        let sources = sources.collect();
        let node = |(job, [column, row]): (&Job, [usize; 2])| {
            let state = match job.state {
                JobState::Succeeded => String::new(),
                state => format!(", {state}"),
            };
            let headline = headlines.get(&job.id).map(|text| format!(", {text}"));
            let said = format!("{}{state}{}", job.kind, headline.unwrap_or_default());
            let name = name(job);
            Node {
                x: column * (wide + GAPS[0]),
                y: row * (HEIGHT + GAPS[1]),
                href: href(job),
                name: text::shortened(&name, wide * CHARACTERS[0] / 100),
                title: format!("{name}: {said}, job {}, digest {}", job.id, job.digest.short()),
                said: text::shortened(&said, wide * CHARACTERS[1] / 100),
                state: job.state,
                is_here: roots == [job.id],
            }
        };
        let nodes: Vec<Node> = shown.into_iter().zip(places.values().copied()).map(node).collect();
        let edges =
            lineage.uses.iter().map(|(job, source)| edge(wide, places[source], places[job]));
        let [columns, rows] = [0, 1].map(|axis| places.values().map(|place| place[axis]).max());
        // With a pixel around it, for the outlines.
        let extent = |last: Option<usize>, size, gap| last.unwrap_or(0) * (size + gap) + size + 2;
        Ok(Some(Self {
            of_box: wide,
            width: extent(columns, wide, GAPS[0]),
            height: extent(rows, HEIGHT, GAPS[1]),
            edges: edges.collect(),
            sources,
            nodes,
            is_cut: lineage.is_cut,
        }))
    }
}

/// The curve from the right of one box to the left of another.
fn edge(
    wide: usize,
    [from_column, from_row]: [usize; 2],
    [to_column, to_row]: [usize; 2],
) -> String {
    let middle = |row: usize| row * (HEIGHT + GAPS[1]) + HEIGHT / 2;
    let (x0, y0) = (from_column * (wide + GAPS[0]) + wide, middle(from_row));
    let (x1, y1) = (to_column * (wide + GAPS[0]), middle(to_row));
    let bend = GAPS[0] / 2;
    format!("M{x0} {y0}C{} {y0} {} {y1} {x1} {y1}", x0 + bend, x1 - bend)
}

/// Column and row of each job. Its column is right of those of all that it needs, and left of its
/// users as far as it can be. The jobs of a column have the order of what they need.
fn places(jobs: &[i64], needs: &[(i64, i64)]) -> BTreeMap<i64, [usize; 2]> {
    let of = |job: i64| needs.iter().filter(move |pair| pair.0 == job).map(|pair| pair.1);
    // A job is newer than what it needs, so that one walk in the order of ids would do; jobs of an
    // imported database need not be.
    let mut columns: BTreeMap<i64, usize> = jobs.iter().map(|job| (*job, 0)).collect();
    for _ in jobs {
        for &job in jobs {
            let column = of(job).map(|need| columns[&need] + 1).max().unwrap_or(0);
            columns.insert(job, column.min(jobs.len()));
        }
    }
    // A source that only later columns use stands beside them.
    for &job in jobs.iter().rev() {
        let users = needs.iter().filter(|pair| pair.1 == job).map(|pair| columns[&pair.0]);
        if let Some(first) = users.min() {
            let column = columns[&job];
            columns.insert(job, column.max(first.saturating_sub(1)));
        }
    }
    let mut places = BTreeMap::new();
    let used: BTreeSet<usize> = columns.values().copied().collect();
    for (column, wanted) in used.into_iter().enumerate() {
        let mut here: Vec<i64> =
            jobs.iter().copied().filter(|job| columns[job] == wanted).collect();
        let row = |job: &i64| {
            let rows: Vec<usize> = of(*job)
                .filter_map(|need| places.get(&need))
                .map(|place: &[usize; 2]| place[1])
                .collect();
            // The mean, in thousandths of a row.
            rows.iter().sum::<usize>() * 1000 / rows.len().max(1)
        };
        here.sort_by_cached_key(|job| (row(job), *job));
        for (row, job) in here.into_iter().enumerate() {
            places.insert(job, [column, row]);
        }
    }
    places
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::{edge, places};

    #[test]
    fn every_job_stands_right_of_what_it_needs_and_alone_at_its_place() {
        // Two datasets, two trainings, an evaluation of both on a third dataset.
        let (jobs, needs) = ([1, 2, 3, 4, 5, 6], [(3, 1), (4, 1), (4, 2), (6, 3), (6, 4), (6, 5)]);
        let places = places(&jobs, &needs);
        for (job, need) in needs {
            assert!(places[&need][0] < places[&job][0], "{job} {need}");
        }
        let distinct: BTreeSet<[usize; 2]> = places.values().copied().collect();
        assert_eq!(distinct.len(), jobs.len());
        // The third dataset stands beside the trainings, not beside the others.
        assert_eq!(places[&5][0], 1);
        assert_eq!(places[&6], [2, 0]);
    }

    #[test]
    fn jobs_in_a_circle_end() {
        assert_eq!(places(&[1, 2], &[(1, 2), (2, 1)]).len(), 2);
    }

    #[test]
    fn a_curve_begins_at_a_box_and_ends_at_the_next_one() {
        assert_eq!(edge(196, [0, 0], [1, 1]), "M196 23C222 23 222 83 248 83");
    }
}
