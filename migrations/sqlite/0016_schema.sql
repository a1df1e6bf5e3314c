-- The schema of SQLite. `migrations/postgres` has the same tables and columns.
--
-- Times are milliseconds since 1970 by the database's clock. Digests are 64 hexadecimal digits. Specs, payloads and results
-- are JSON text. Booleans are 0 and 1.

---------------------------------------------------------------------------------------------------------------- the store --

-- Tells this store from others: one row. Objects carry the id too, so that no server deletes another's.
CREATE TABLE store (
    id TEXT NOT NULL
) STRICT;

INSERT INTO store (id) VALUES (lower(hex(randomblob(16))));

-- The server that was started last: one row.
CREATE TABLE server (
    id         INTEGER PRIMARY KEY CHECK (id = 1),
    -- The version of torqued.
    version    TEXT    NOT NULL,
    started_at INTEGER NOT NULL
) STRICT;

-- Written to learn whether the database can be written.
CREATE TABLE probe (
    id         INTEGER PRIMARY KEY CHECK (id = 1),
    written_at INTEGER NOT NULL
) STRICT;

---------------------------------------------------------------------------------------------------------------- the queue --

-- The queue as a whole: one row.
CREATE TABLE queue (
    id        INTEGER PRIMARY KEY CHECK (id = 1),
    -- The time since when no task is claimed; NULL while tasks are.
    paused_at INTEGER
) STRICT;

INSERT INTO queue (id, paused_at) VALUES (1, NULL);

-- The resources that tasks ask of a worker, each combination once. 0 asks for nothing. There are few combinations, so the next
-- task of each is looked up and no task is passed over.
CREATE TABLE resources (
    id        INTEGER PRIMARY KEY AUTOINCREMENT,
    cpus      INTEGER NOT NULL,
    gpus      INTEGER NOT NULL,
    -- In units of 10^6 bytes.
    memory_mb INTEGER NOT NULL,
    -- Sorted names, as JSON.
    tags      TEXT    NOT NULL,
    UNIQUE (cpus, gpus, memory_mb, tags)
) STRICT;

INSERT INTO resources (id, cpus, gpus, memory_mb, tags) VALUES (1, 0, 0, 0, '[]');

CREATE TABLE job (
    id               INTEGER PRIMARY KEY AUTOINCREMENT,
    -- The kind and the name in the spec.
    kind             TEXT    NOT NULL,
    name             TEXT    NOT NULL,
    -- Resolved: every default filled in, every reference a digest.
    spec             TEXT    NOT NULL,
    digest           TEXT    NOT NULL,
    state            TEXT    NOT NULL
        CHECK (state IN ('waiting', 'queued', 'running', 'succeeded', 'failed', 'cancelled')),
    -- Why it failed or was cancelled.
    error            TEXT,
    -- The unit of progress, e.g. 'trajectories'.
    unit             TEXT    NOT NULL,
    -- Higher goes first.
    priority         INTEGER NOT NULL,
    -- How often a task may be claimed before it fails.
    max_attempts     INTEGER NOT NULL,
    -- Seconds that an attempt at a task may take.
    time_limit_s     INTEGER,
    resources        INTEGER NOT NULL DEFAULT 1,
    -- No task is claimed before this time.
    not_before       INTEGER NOT NULL DEFAULT 0,
    -- The time since when it has waited: its submission. If the clock was set back, the latest such time of the open jobs.
    waits_since      INTEGER NOT NULL DEFAULT 0,
    -- Whether it was made for a pipeline.
    is_part          INTEGER NOT NULL CHECK (is_part IN (0, 1)),
    -- Whether somebody submitted this job by itself, not only as a member of a pipeline.
    asked_alone      INTEGER NOT NULL CHECK (asked_alone IN (0, 1)),
    -- Whether its workers take over what earlier jobs with the same digest had committed before they failed or were cancelled.
    takes_over       INTEGER NOT NULL DEFAULT 0 CHECK (takes_over IN (0, 1)),
    cancel_requested INTEGER NOT NULL DEFAULT 0 CHECK (cancel_requested IN (0, 1)),
    created_at       INTEGER NOT NULL,
    started_at       INTEGER,
    finished_at      INTEGER,
    -- Labels: the name that users gave it, and their note. Runs, datasets and checkpoints have them too; one without a name of
    -- its own has its job's.
    given_name       TEXT,
    note             TEXT,
    -- Name and note in lower case, where words are looked for. NULL for a job of before this column until a server fills it in,
    -- and for a run, dataset or checkpoint without name and note.
    searched         TEXT,
    -- The trash: it is deleted for good at `purge_at`. `purged_at` says when its bytes and details went. The row stays as long as
    -- its job's, so that a job without results does not stand in for another. The reason is NULL if a user deleted it.
    deleted_at       INTEGER,
    purge_at         INTEGER,
    purged_at        INTEGER,
    deletion_reason  TEXT
) STRICT;

-- Of two indexes that serve a query equally well, SQLite takes the one that was created later.
CREATE INDEX job_by_digest ON job (digest, id);
CREATE INDEX job_by_state ON job (state, id);
CREATE INDEX job_by_kind ON job (kind, id);
CREATE INDEX experiment ON job (id) WHERE is_part = 0;
CREATE INDEX experiment_by_state ON job (state, id) WHERE is_part = 0;
CREATE INDEX job_open ON job (waits_since) WHERE state NOT IN ('succeeded', 'failed', 'cancelled');
CREATE INDEX job_not_folded ON job (id) WHERE searched IS NULL;
-- The orders of lists. A job that has not ended comes after all that have.
CREATE INDEX job_by_name ON job (COALESCE(given_name, name), id);
CREATE INDEX job_by_finish ON job (COALESCE(finished_at, 9223372036854775807), id);
CREATE INDEX job_by_priority ON job (priority, id);
-- Few jobs were deleted.
CREATE INDEX job_deleted ON job (deleted_at) WHERE deleted_at IS NOT NULL;

CREATE TRIGGER job_final_states_never_change
BEFORE UPDATE OF state ON job
WHEN OLD.state IN ('succeeded', 'failed', 'cancelled') AND NEW.state <> OLD.state
BEGIN
    SELECT RAISE(ABORT, 'the state of a finished job never changes');
END;

CREATE TABLE job_tag (
    job INTEGER NOT NULL REFERENCES job (id) ON DELETE CASCADE,
    tag TEXT    NOT NULL,
    PRIMARY KEY (job, tag)
) STRICT, WITHOUT ROWID;

CREATE INDEX job_by_tag ON job_tag (tag, job);

-- The jobs that must succeed before a job starts.
CREATE TABLE job_need (
    job   INTEGER NOT NULL REFERENCES job (id) ON DELETE CASCADE,
    needs INTEGER NOT NULL REFERENCES job (id),
    PRIMARY KEY (job, needs)
) STRICT, WITHOUT ROWID;

CREATE INDEX job_need_by_needed ON job_need (needs);

-- The digests that a job's spec refers to: of the jobs whose data and checkpoints it reads, and of sent files.
CREATE TABLE job_input (
    job    INTEGER NOT NULL REFERENCES job (id) ON DELETE CASCADE,
    digest TEXT    NOT NULL,
    PRIMARY KEY (job, digest)
) STRICT, WITHOUT ROWID;

CREATE INDEX job_input_by_digest ON job_input (digest, job);

CREATE TABLE pipeline_member (
    pipeline INTEGER NOT NULL REFERENCES job (id) ON DELETE CASCADE,
    name     TEXT    NOT NULL,
    ordinal  INTEGER NOT NULL,
    job      INTEGER NOT NULL REFERENCES job (id),
    -- Whether the job existed before the pipeline was submitted.
    reused   INTEGER NOT NULL CHECK (reused IN (0, 1)),
    PRIMARY KEY (pipeline, name)
) STRICT, WITHOUT ROWID;

CREATE INDEX pipeline_member_by_job ON pipeline_member (job);

CREATE TABLE task (
    id               INTEGER PRIMARY KEY AUTOINCREMENT,
    job              INTEGER NOT NULL REFERENCES job (id) ON DELETE CASCADE,
    -- Tasks of a stage wait for all tasks of earlier stages.
    stage            INTEGER NOT NULL,
    ordinal          INTEGER NOT NULL,
    label            TEXT    NOT NULL,
    payload          TEXT    NOT NULL,
    state            TEXT    NOT NULL
        CHECK (state IN ('waiting', 'queued', 'running', 'succeeded', 'failed', 'cancelled')),
    -- The job's.
    resources        INTEGER NOT NULL DEFAULT 1,
    not_before       INTEGER NOT NULL DEFAULT 0,
    -- The place in line: the smaller goes first, then the smaller id. A point of priority is worth an hour.
    turn             INTEGER NOT NULL DEFAULT 0,
    -- 0, or after a failure the time from when on it may be claimed again.
    run_at           INTEGER NOT NULL,
    attempt          INTEGER NOT NULL DEFAULT 0,
    max_attempts     INTEGER NOT NULL,
    -- The fencing number: one more at every claim.
    epoch            INTEGER NOT NULL DEFAULT 0,
    worker           TEXT,
    lease_until      INTEGER,
    -- How long the lease of a running task lasts after a renewal.
    lease_ms         INTEGER,
    cancel_requested INTEGER NOT NULL DEFAULT 0 CHECK (cancel_requested IN (0, 1)),
    -- Progress in the job's unit.
    done             INTEGER NOT NULL DEFAULT 0,
    total            INTEGER NOT NULL,
    rate             REAL,
    message          TEXT,
    result           TEXT,
    error            TEXT,
    started_at       INTEGER,
    finished_at      INTEGER,
    UNIQUE (job, stage, ordinal)
) STRICT;

CREATE INDEX task_leased ON task (lease_until) WHERE state = 'running';
CREATE INDEX task_to_claim ON task (resources, turn, id, run_at, not_before, state) WHERE state = 'queued';
-- The states of a job's tasks, however many they are.
CREATE INDEX task_by_state ON task (job, state, stage);

CREATE TRIGGER task_final_states_never_change
BEFORE UPDATE OF state ON task
WHEN OLD.state IN ('succeeded', 'failed', 'cancelled') AND NEW.state <> OLD.state
BEGIN
    SELECT RAISE(ABORT, 'the state of a finished task never changes');
END;

-- One row for every claim of a task.
CREATE TABLE attempt (
    id         INTEGER PRIMARY KEY AUTOINCREMENT,
    job        INTEGER NOT NULL REFERENCES job (id) ON DELETE CASCADE,
    task       INTEGER NOT NULL REFERENCES task (id) ON DELETE CASCADE,
    epoch      INTEGER NOT NULL,
    worker     TEXT    NOT NULL,
    -- NULL while it lasts.
    outcome    TEXT    CHECK (outcome IN ('succeeded', 'failed', 'released', 'cancelled')),
    reason     TEXT,
    started_at INTEGER NOT NULL,
    ended_at   INTEGER,
    -- Bytes that it has logged, with those that were left out. NULL if it has no log.
    log_bytes  INTEGER,
    UNIQUE (task, epoch)
) STRICT;

CREATE INDEX attempt_by_job ON attempt (job, id);
CREATE INDEX attempt_running ON attempt (job) WHERE ended_at IS NULL;
CREATE INDEX attempt_logged ON attempt (job, id) WHERE log_bytes IS NOT NULL;
CREATE INDEX attempt_by_worker ON attempt (worker, id);

-- The logs of attempts, in chunks of whole lines. Ids of one job grow in the order in which chunks can be read, so a reader
-- goes on after the last chunk that it has.
CREATE TABLE attempt_log (
    id         INTEGER PRIMARY KEY AUTOINCREMENT,
    -- The attempt's.
    job        INTEGER NOT NULL REFERENCES job (id) ON DELETE CASCADE,
    attempt    INTEGER NOT NULL REFERENCES attempt (id) ON DELETE CASCADE,
    -- Bytes that the attempt had logged before.
    position   INTEGER NOT NULL,
    text       TEXT    NOT NULL CHECK (length(CAST(text AS BLOB)) BETWEEN 1 AND 16384),
    written_at INTEGER NOT NULL,
    UNIQUE (attempt, position)
) STRICT;

CREATE INDEX attempt_log_by_job ON attempt_log (job, id, attempt);

-- Number of ended attempts of jobs that were deleted for good, so that a counter of attempts never falls.
CREATE TABLE purged_attempts (
    kind    TEXT    NOT NULL,
    outcome TEXT    NOT NULL,
    number  INTEGER NOT NULL,
    PRIMARY KEY (kind, outcome)
) STRICT, WITHOUT ROWID;

CREATE TABLE idempotency_key (
    key        TEXT    PRIMARY KEY,
    -- Digest of the request that first came with this key.
    request    TEXT    NOT NULL,
    -- The outcome of that request.
    job        INTEGER NOT NULL REFERENCES job (id) ON DELETE CASCADE,
    reused     INTEGER NOT NULL CHECK (reused IN (0, 1)),
    created_at INTEGER NOT NULL
) STRICT, WITHOUT ROWID;

CREATE INDEX idempotency_key_by_job ON idempotency_key (job);

-------------------------------------------------------------------------------------------------------------- the workers --

-- Processes that execute tasks. A worker that ends in order deletes its row. The row of one that died stays for a day.
CREATE TABLE worker (
    name       TEXT    PRIMARY KEY,
    host       TEXT    NOT NULL,
    pid        INTEGER NOT NULL,
    version    TEXT    NOT NULL,
    device     TEXT    NOT NULL,
    threads    INTEGER NOT NULL,
    -- The resources that it offers.
    cpus       INTEGER NOT NULL DEFAULT 0,
    gpus       INTEGER NOT NULL DEFAULT 0,
    memory_mb  INTEGER NOT NULL DEFAULT 0,
    tags       TEXT    NOT NULL DEFAULT '[]',
    -- The time since when it should end its task and claim no other.
    drained_at INTEGER,
    -- Why it claims no tasks at the moment.
    waits_for  TEXT,
    started_at INTEGER NOT NULL,
    seen_at    INTEGER NOT NULL
) STRICT, WITHOUT ROWID;

-- The engine that starts the workers, Slurm or Kubernetes: one row, and none while servers start their own.
CREATE TABLE engine (
    id       INTEGER PRIMARY KEY CHECK (id = 1),
    name     TEXT    NOT NULL,
    -- Why it starts no workers at the moment.
    obstacle TEXT
) STRICT;

-- Workers that an engine was asked for, as it last described them. Those that ended stay for a day.
CREATE TABLE placement (
    worker     TEXT    PRIMARY KEY,
    engine     TEXT    NOT NULL,
    -- The engine's name for it.
    identifier TEXT,
    state      TEXT    NOT NULL CHECK (state IN ('pending', 'running', 'ended')),
    -- Why it waits, or how it ended.
    reason     TEXT,
    node       TEXT,
    asked_at   INTEGER NOT NULL,
    changed_at INTEGER NOT NULL
) STRICT, WITHOUT ROWID;

-------------------------------------------------------------------------------------------------------------- the results --

-- The record of a training or evaluation.
CREATE TABLE run (
    id              INTEGER PRIMARY KEY AUTOINCREMENT,
    job             INTEGER NOT NULL UNIQUE REFERENCES job (id) ON DELETE CASCADE,
    created_at      INTEGER NOT NULL,
    -- Labels and trash, as those of a job.
    given_name      TEXT,
    note            TEXT,
    searched        TEXT,
    deleted_at      INTEGER,
    purge_at        INTEGER,
    purged_at       INTEGER,
    deletion_reason TEXT
) STRICT;

CREATE INDEX run_deleted ON run (deleted_at) WHERE deleted_at IS NOT NULL;

CREATE TABLE run_tag (
    run INTEGER NOT NULL REFERENCES run (id) ON DELETE CASCADE,
    tag TEXT    NOT NULL,
    PRIMARY KEY (run, tag)
) STRICT, WITHOUT ROWID;

CREATE INDEX run_by_tag ON run_tag (tag, run);

-- The points of a run's metrics. NULL stands for a value that is not a number.
CREATE TABLE metric (
    run   INTEGER NOT NULL REFERENCES run (id) ON DELETE CASCADE,
    key   TEXT    NOT NULL,
    step  INTEGER NOT NULL,
    time  INTEGER NOT NULL,
    value REAL,
    PRIMARY KEY (run, key, step)
) STRICT, WITHOUT ROWID;

-- The point of each metric with the largest step.
CREATE TABLE metric_latest (
    run   INTEGER NOT NULL REFERENCES run (id) ON DELETE CASCADE,
    key   TEXT    NOT NULL,
    step  INTEGER NOT NULL,
    time  INTEGER NOT NULL,
    value REAL,
    PRIMARY KEY (run, key)
) STRICT, WITHOUT ROWID;

-- The lowest and the highest point of every 64 steps of a metric, so that a curve of a million points is drawn from a few
-- thousand rows. A value that is not a number is NULL and counts as the lowest.
CREATE TABLE metric_extremes (
    run        INTEGER NOT NULL REFERENCES run (id) ON DELETE CASCADE,
    key        TEXT    NOT NULL,
    -- The number of the 64 steps: 0 means steps 0 to 63.
    span       INTEGER NOT NULL,
    points     INTEGER NOT NULL,
    low_step   INTEGER NOT NULL,
    low_time   INTEGER NOT NULL,
    low_value  REAL,
    high_step  INTEGER NOT NULL,
    high_time  INTEGER NOT NULL,
    high_value REAL,
    PRIMARY KEY (run, key, span)
) STRICT, WITHOUT ROWID;

-- Files of a run. Here and below, `path` is the object's in the store's place of objects.
CREATE TABLE artifact (
    run        INTEGER NOT NULL REFERENCES run (id) ON DELETE CASCADE,
    name       TEXT    NOT NULL,
    media_type TEXT    NOT NULL,
    path       TEXT    NOT NULL UNIQUE,
    size       INTEGER NOT NULL,
    sha256     TEXT    NOT NULL,
    created_at INTEGER NOT NULL,
    PRIMARY KEY (run, name)
) STRICT, WITHOUT ROWID;

CREATE TABLE dataset (
    id              INTEGER PRIMARY KEY AUTOINCREMENT,
    job             INTEGER NOT NULL UNIQUE REFERENCES job (id) ON DELETE CASCADE,
    -- The job's.
    digest          TEXT    NOT NULL,
    state           TEXT    NOT NULL CHECK (state IN ('building', 'complete')),
    trajectories    INTEGER NOT NULL,
    -- Number of samples of each trajectory.
    samples         INTEGER NOT NULL,
    created_at      INTEGER NOT NULL,
    completed_at    INTEGER,
    -- Labels and trash, as those of a job.
    given_name      TEXT,
    note            TEXT,
    searched        TEXT,
    deleted_at      INTEGER,
    purge_at        INTEGER,
    purged_at       INTEGER,
    deletion_reason TEXT
) STRICT;

CREATE INDEX dataset_by_digest ON dataset (digest, id);
CREATE INDEX dataset_by_trajectories ON dataset (trajectories, id);
CREATE INDEX dataset_deleted ON dataset (deleted_at) WHERE deleted_at IS NOT NULL;

CREATE TABLE dataset_tag (
    dataset INTEGER NOT NULL REFERENCES dataset (id) ON DELETE CASCADE,
    tag     TEXT    NOT NULL,
    PRIMARY KEY (dataset, tag)
) STRICT, WITHOUT ROWID;

CREATE INDEX dataset_by_tag ON dataset_tag (tag, dataset);

CREATE TABLE shard (
    dataset  INTEGER NOT NULL REFERENCES dataset (id) ON DELETE CASCADE,
    ordinal  INTEGER NOT NULL,
    -- Index of the first trajectory, and number of trajectories.
    first    INTEGER NOT NULL,
    count    INTEGER NOT NULL,
    -- Number of draws that were rejected on the way to `count` trajectories.
    rejected INTEGER NOT NULL,
    task     INTEGER NOT NULL REFERENCES task (id),
    epoch    INTEGER NOT NULL,
    PRIMARY KEY (dataset, ordinal)
) STRICT, WITHOUT ROWID;

-- The deletion of a job's tasks looks here.
CREATE INDEX shard_by_task ON shard (task);

CREATE TABLE shard_file (
    dataset INTEGER NOT NULL,
    ordinal INTEGER NOT NULL,
    content TEXT    NOT NULL CHECK (content IN ('trajectories', 'robots')),
    path    TEXT    NOT NULL UNIQUE,
    size    INTEGER NOT NULL,
    sha256  TEXT    NOT NULL,
    PRIMARY KEY (dataset, ordinal, content),
    FOREIGN KEY (dataset, ordinal) REFERENCES shard (dataset, ordinal) ON DELETE CASCADE
) STRICT, WITHOUT ROWID;

CREATE TABLE checkpoint (
    id              INTEGER PRIMARY KEY AUTOINCREMENT,
    job             INTEGER NOT NULL REFERENCES job (id) ON DELETE CASCADE,
    run             INTEGER NOT NULL REFERENCES run (id) ON DELETE CASCADE,
    step            INTEGER NOT NULL,
    is_final        INTEGER NOT NULL CHECK (is_final IN (0, 1)),
    -- Whether its validation is the best of the training so far.
    is_best         INTEGER NOT NULL CHECK (is_best IN (0, 1)),
    -- The validation, as JSON.
    metrics         TEXT    NOT NULL,
    created_at      INTEGER NOT NULL,
    -- Labels and trash, as those of a job.
    given_name      TEXT,
    note            TEXT,
    searched        TEXT,
    deleted_at      INTEGER,
    purge_at        INTEGER,
    purged_at       INTEGER,
    deletion_reason TEXT,
    UNIQUE (job, step)
) STRICT;

CREATE UNIQUE INDEX checkpoint_best ON checkpoint (job) WHERE is_best = 1;
CREATE INDEX checkpoint_by_step ON checkpoint (step, id);
CREATE INDEX checkpoint_deleted ON checkpoint (deleted_at) WHERE deleted_at IS NOT NULL;
CREATE INDEX checkpoint_by_run ON checkpoint (run);

CREATE TABLE checkpoint_tag (
    checkpoint INTEGER NOT NULL REFERENCES checkpoint (id) ON DELETE CASCADE,
    tag        TEXT    NOT NULL,
    PRIMARY KEY (checkpoint, tag)
) STRICT, WITHOUT ROWID;

CREATE INDEX checkpoint_by_tag ON checkpoint_tag (tag, checkpoint);

CREATE TABLE checkpoint_file (
    checkpoint INTEGER NOT NULL REFERENCES checkpoint (id) ON DELETE CASCADE,
    name       TEXT    NOT NULL,
    path       TEXT    NOT NULL UNIQUE,
    size       INTEGER NOT NULL,
    sha256     TEXT    NOT NULL,
    PRIMARY KEY (checkpoint, name)
) STRICT, WITHOUT ROWID;

-- Files that users sent for imports, each once.
CREATE TABLE upload (
    sha256     TEXT    PRIMARY KEY,
    -- The sender's name for it.
    name       TEXT    NOT NULL,
    path       TEXT    NOT NULL UNIQUE,
    size       INTEGER NOT NULL,
    created_at INTEGER NOT NULL
) STRICT, WITHOUT ROWID;

--------------------------------------------------------------------------------------------------------- runs from MLflow --

-- Runs that clients of MLflow log beside torqued's own. Clients set the times of runs and metrics, in milliseconds since 1970.
-- A metric that was not a number has the value 0 and `is_nan`.

CREATE TABLE tracked_experiment (
    id         INTEGER PRIMARY KEY AUTOINCREMENT,
    name       TEXT    NOT NULL UNIQUE,
    is_deleted INTEGER NOT NULL DEFAULT 0 CHECK (is_deleted IN (0, 1)),
    created_at INTEGER NOT NULL,
    updated_at INTEGER NOT NULL,
    -- The trash, as that of a job.
    deleted_at INTEGER,
    purge_at   INTEGER
) STRICT;

-- The experiment of clients that name none, and that of torqued's own runs.
INSERT INTO tracked_experiment (id, name, created_at, updated_at)
SELECT given.column1, given.column2, present, present
FROM (VALUES (0, 'Default'), (1, 'torqued')) AS given,
     (SELECT CAST(unixepoch('subsec') * 1000 AS INTEGER) AS present);

CREATE TABLE tracked_experiment_tag (
    experiment INTEGER NOT NULL REFERENCES tracked_experiment (id) ON DELETE CASCADE,
    key        TEXT    NOT NULL,
    value      TEXT    NOT NULL,
    PRIMARY KEY (experiment, key)
) STRICT, WITHOUT ROWID;

CREATE TABLE tracked_run (
    id         INTEGER PRIMARY KEY AUTOINCREMENT,
    -- The clients' name for it: 32 hexadecimal digits.
    identifier TEXT    NOT NULL UNIQUE,
    experiment INTEGER NOT NULL REFERENCES tracked_experiment (id) ON DELETE CASCADE,
    name       TEXT    NOT NULL,
    user_name  TEXT    NOT NULL,
    status     TEXT    NOT NULL
        CHECK (status IN ('RUNNING', 'SCHEDULED', 'FINISHED', 'FAILED', 'KILLED')),
    start_time INTEGER NOT NULL,
    end_time   INTEGER,
    is_deleted INTEGER NOT NULL DEFAULT 0 CHECK (is_deleted IN (0, 1)),
    created_at INTEGER NOT NULL,
    -- The trash, as that of a job.
    deleted_at INTEGER,
    purge_at   INTEGER
) STRICT;

CREATE INDEX tracked_run_by_experiment ON tracked_run (experiment, id);

CREATE TABLE tracked_param (
    run   INTEGER NOT NULL REFERENCES tracked_run (id) ON DELETE CASCADE,
    key   TEXT    NOT NULL,
    value TEXT    NOT NULL,
    PRIMARY KEY (run, key)
) STRICT, WITHOUT ROWID;

CREATE TABLE tracked_tag (
    run   INTEGER NOT NULL REFERENCES tracked_run (id) ON DELETE CASCADE,
    key   TEXT    NOT NULL,
    value TEXT    NOT NULL,
    PRIMARY KEY (run, key)
) STRICT, WITHOUT ROWID;

-- Every point once, however often a client sends it.
CREATE TABLE tracked_metric (
    run    INTEGER NOT NULL REFERENCES tracked_run (id) ON DELETE CASCADE,
    key    TEXT    NOT NULL,
    step   INTEGER NOT NULL,
    time   INTEGER NOT NULL,
    value  REAL    NOT NULL,
    is_nan INTEGER NOT NULL CHECK (is_nan IN (0, 1)),
    PRIMARY KEY (run, key, step, time, value, is_nan)
) STRICT, WITHOUT ROWID;

CREATE TABLE tracked_metric_latest (
    run    INTEGER NOT NULL REFERENCES tracked_run (id) ON DELETE CASCADE,
    key    TEXT    NOT NULL,
    step   INTEGER NOT NULL,
    time   INTEGER NOT NULL,
    value  REAL    NOT NULL,
    is_nan INTEGER NOT NULL CHECK (is_nan IN (0, 1)),
    PRIMARY KEY (run, key)
) STRICT, WITHOUT ROWID;

CREATE TABLE tracked_artifact (
    run        INTEGER NOT NULL REFERENCES tracked_run (id) ON DELETE CASCADE,
    -- With slashes between folders.
    name       TEXT    NOT NULL,
    path       TEXT    NOT NULL UNIQUE,
    size       INTEGER NOT NULL,
    sha256     TEXT    NOT NULL,
    created_at INTEGER NOT NULL,
    PRIMARY KEY (run, name)
) STRICT, WITHOUT ROWID;

--------------------------------------------------------------------------------------------------------------- the access --

-- The tokens of users. The database keeps the digest of a token, never the token.
CREATE TABLE token (
    id           INTEGER PRIMARY KEY AUTOINCREMENT,
    name         TEXT    NOT NULL,
    digest       TEXT    NOT NULL UNIQUE,
    scope        TEXT    NOT NULL CHECK (scope IN ('read', 'submit', 'admin')),
    created_at   INTEGER NOT NULL,
    expires_at   INTEGER,
    last_used_at INTEGER,
    -- A revoked token keeps its row, so that the names in the audit log keep their meaning.
    revoked_at   INTEGER
) STRICT;

CREATE UNIQUE INDEX token_name ON token (name) WHERE revoked_at IS NULL;

-- Browsers that are logged in. A session permits what the token that opened it permits.
CREATE TABLE session (
    digest     TEXT    PRIMARY KEY,
    token      TEXT    NOT NULL,
    expires_at INTEGER NOT NULL
) STRICT, WITHOUT ROWID;

-- The audit log: requests that changed something, or tried to.
CREATE TABLE audit (
    id      INTEGER PRIMARY KEY AUTOINCREMENT,
    at      INTEGER NOT NULL,
    -- The name of a token, or the reason why the request needed none.
    actor   TEXT    NOT NULL,
    address TEXT    NOT NULL,
    method  TEXT    NOT NULL,
    -- Path and query.
    target  TEXT    NOT NULL,
    status  INTEGER NOT NULL,
    -- The path of the resource that the request made.
    made    TEXT
) STRICT;

--------------------------------------------------------------------------------------------------------------- the events --

-- The changes of jobs, in order, for those who follow them. Old events are deleted. The newest row stays, so that no id is used
-- twice. An event outlives its job.
CREATE TABLE event (
    id   INTEGER PRIMARY KEY,
    at   INTEGER NOT NULL,
    kind TEXT    NOT NULL CHECK (kind IN ('start', 'job', 'task', 'metrics', 'checkpoint', 'deletion')),
    -- NULL for the start.
    job  INTEGER,
    -- The rest, as JSON.
    data TEXT    NOT NULL
) STRICT;

-- Ids begin at the present time, so a client that comes with an id of another database is told so. Such an id is smaller, unless
-- the other database had more than one event in each millisecond of its life.
INSERT INTO event (id, at, kind, data) VALUES (
    CAST(unixepoch('subsec') * 1000 AS INTEGER), CAST(unixepoch('subsec') * 1000 AS INTEGER), 'start', '{}'
);

CREATE TRIGGER job_tells AFTER UPDATE OF state, cancel_requested ON job
WHEN NEW.state <> OLD.state OR NEW.cancel_requested <> OLD.cancel_requested
BEGIN
    INSERT INTO event (at, kind, job, data) VALUES (
        CAST(unixepoch('subsec') * 1000 AS INTEGER), 'job', NEW.id,
        json_object(
            'kind', NEW.kind, 'name', NEW.name, 'state', NEW.state, 'error', NEW.error,
            'cancel_requested', json(iif(NEW.cancel_requested, 'true', 'false'))
        )
    );
END;

-- Tasks have events from their first claim on. Before it the job's are enough.
CREATE TRIGGER task_tells AFTER UPDATE OF state ON task
WHEN NEW.state <> OLD.state AND 'running' IN (NEW.state, OLD.state)
BEGIN
    INSERT INTO event (at, kind, job, data) VALUES (
        CAST(unixepoch('subsec') * 1000 AS INTEGER), 'task', NEW.job,
        json_object(
            'task', NEW.id, 'label', NEW.label, 'state', NEW.state, 'attempt', NEW.attempt,
            'worker', NEW.worker, 'error', NEW.error
        )
    );
END;

CREATE TRIGGER job_deletion_tells AFTER UPDATE OF deleted_at, purged_at ON job
WHEN (NEW.deleted_at IS NULL) <> (OLD.deleted_at IS NULL) OR (NEW.purged_at IS NULL) <> (OLD.purged_at IS NULL)
BEGIN
    INSERT INTO event (at, kind, job, data) VALUES (
        CAST(unixepoch('subsec') * 1000 AS INTEGER), 'deletion', NEW.id,
        json_object(
            'item', 'job', 'item_id', NEW.id,
            'change', iif(NEW.purged_at IS NOT NULL, 'purged', iif(NEW.deleted_at IS NULL, 'restored', 'deleted'))
        )
    );
END;

CREATE TRIGGER run_deletion_tells AFTER UPDATE OF deleted_at, purged_at ON run
WHEN (NEW.deleted_at IS NULL) <> (OLD.deleted_at IS NULL) OR (NEW.purged_at IS NULL) <> (OLD.purged_at IS NULL)
BEGIN
    INSERT INTO event (at, kind, job, data) VALUES (
        CAST(unixepoch('subsec') * 1000 AS INTEGER), 'deletion', NEW.job,
        json_object(
            'item', 'run', 'item_id', NEW.id,
            'change', iif(NEW.purged_at IS NOT NULL, 'purged', iif(NEW.deleted_at IS NULL, 'restored', 'deleted'))
        )
    );
END;

CREATE TRIGGER dataset_deletion_tells AFTER UPDATE OF deleted_at, purged_at ON dataset
WHEN (NEW.deleted_at IS NULL) <> (OLD.deleted_at IS NULL) OR (NEW.purged_at IS NULL) <> (OLD.purged_at IS NULL)
BEGIN
    INSERT INTO event (at, kind, job, data) VALUES (
        CAST(unixepoch('subsec') * 1000 AS INTEGER), 'deletion', NEW.job,
        json_object(
            'item', 'dataset', 'item_id', NEW.id,
            'change', iif(NEW.purged_at IS NOT NULL, 'purged', iif(NEW.deleted_at IS NULL, 'restored', 'deleted'))
        )
    );
END;

CREATE TRIGGER checkpoint_deletion_tells AFTER UPDATE OF deleted_at, purged_at ON checkpoint
WHEN (NEW.deleted_at IS NULL) <> (OLD.deleted_at IS NULL) OR (NEW.purged_at IS NULL) <> (OLD.purged_at IS NULL)
BEGIN
    INSERT INTO event (at, kind, job, data) VALUES (
        CAST(unixepoch('subsec') * 1000 AS INTEGER), 'deletion', NEW.job,
        json_object(
            'item', 'checkpoint', 'item_id', NEW.id,
            'change', iif(NEW.purged_at IS NOT NULL, 'purged', iif(NEW.deleted_at IS NULL, 'restored', 'deleted'))
        )
    );
END;
