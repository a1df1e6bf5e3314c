//! Requests for workers to an engine, and its answers.

use spec::Resources;

/// A worker to request.
#[derive(Clone, Debug, PartialEq)]
pub struct Ask {
    /// Unique among the workers of all stores. Requesting twice under one name makes one worker.
    pub name: String,
    /// The resources that it offers to tasks.
    pub resources: Resources,
    /// Whether it keeps running when it finds no task.
    pub stays: bool,
}

/// A worker in the engine's view.
#[derive(Clone, Debug, PartialEq)]
pub struct PlacedWorker {
    /// The name under which it reports to the store.
    pub name: String,
    /// The engine's name for it.
    pub identifier: String,
    /// The resources that it offers to tasks.
    pub resources: Resources,
    /// Whether it keeps running when it finds no task.
    pub stays: bool,
    /// The node on which it runs or ran.
    pub node: Option<String>,
    /// Whether it waits, runs or has ended.
    pub phase: Phase,
}

/// The phase of a worker.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Phase {
    /// It waits for its place, for this reason.
    Pending(Option<String>),
    /// It runs, whether or not it has a task.
    Running,
    /// It was told to end, for this reason.
    Ending(Option<String>),
    /// It is gone, and its task may go to another worker.
    Ended(End),
}

/// How a worker ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct End {
    /// Whether its task is to blame.
    pub cause: Cause,
    /// The text completes "worker NAME ...".
    pub how: String,
}

/// The consequence of a worker's end for its task.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cause {
    /// The worker ended normally.
    Finished,
    /// An outside cause ended it, and its task is not to blame.
    Interrupted,
    /// It died, and its task may be to blame.
    Died,
}
