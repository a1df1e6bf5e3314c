-- Times are milliseconds since 1970 by the database's clock; digests are 64 hexadecimal digits;
-- specs, payloads and results are JSON text.

CREATE TABLE job (
    id               INTEGER PRIMARY KEY AUTOINCREMENT,
    -- What the specification calls it.
    kind             TEXT    NOT NULL,
    name             TEXT    NOT NULL,
    spec             TEXT    NOT NULL,
    digest           TEXT    NOT NULL,
    state            TEXT    NOT NULL
        CHECK (state IN ('waiting', 'queued', 'running', 'succeeded', 'failed', 'cancelled')),
    error            TEXT,
    -- What progress counts, e.g. 'trajectories'.
    unit             TEXT    NOT NULL,
    priority         INTEGER NOT NULL,
    max_attempts     INTEGER NOT NULL,
    -- Whether it was made for a pipeline.
    is_part          INTEGER NOT NULL CHECK (is_part IN (0, 1)),
    -- Whether somebody asked for this job by itself, not only as a member of a pipeline.
    asked_alone      INTEGER NOT NULL CHECK (asked_alone IN (0, 1)),
    cancel_requested INTEGER NOT NULL DEFAULT 0 CHECK (cancel_requested IN (0, 1)),
    created_at       INTEGER NOT NULL,
    started_at       INTEGER,
    finished_at      INTEGER
) STRICT;

CREATE INDEX job_by_digest ON job (digest, id);
CREATE INDEX job_by_state ON job (state, id);
CREATE INDEX job_by_kind ON job (kind, id);
CREATE INDEX experiment ON job (id) WHERE is_part = 0;
CREATE INDEX experiment_by_state ON job (state, id) WHERE is_part = 0;

CREATE TRIGGER job_final_states_never_change
BEFORE UPDATE OF state ON job
WHEN OLD.state IN ('succeeded', 'failed', 'cancelled') AND NEW.state <> OLD.state
BEGIN
    SELECT RAISE(ABORT, 'the state of a finished job never changes');
END;

CREATE TABLE job_need (
    job   INTEGER NOT NULL REFERENCES job (id) ON DELETE CASCADE,
    needs INTEGER NOT NULL REFERENCES job (id),
    PRIMARY KEY (job, needs)
) STRICT, WITHOUT ROWID;

CREATE INDEX job_need_by_needed ON job_need (needs);

CREATE TABLE pipeline_member (
    pipeline INTEGER NOT NULL REFERENCES job (id) ON DELETE CASCADE,
    name     TEXT    NOT NULL,
    ordinal  INTEGER NOT NULL,
    job      INTEGER NOT NULL REFERENCES job (id),
    -- Whether the job was there before the pipeline was submitted.
    reused   INTEGER NOT NULL CHECK (reused IN (0, 1)),
    PRIMARY KEY (pipeline, name)
) STRICT, WITHOUT ROWID;

CREATE INDEX pipeline_member_by_job ON pipeline_member (job);

CREATE TABLE task (
    id               INTEGER PRIMARY KEY AUTOINCREMENT,
    job              INTEGER NOT NULL REFERENCES job (id) ON DELETE CASCADE,
    stage            INTEGER NOT NULL,
    ordinal          INTEGER NOT NULL,
    label            TEXT    NOT NULL,
    payload          TEXT    NOT NULL,
    state            TEXT    NOT NULL
        CHECK (state IN ('waiting', 'queued', 'running', 'succeeded', 'failed', 'cancelled')),
    priority         INTEGER NOT NULL,
    run_at           INTEGER NOT NULL,
    attempt          INTEGER NOT NULL DEFAULT 0,
    max_attempts     INTEGER NOT NULL,
    epoch            INTEGER NOT NULL DEFAULT 0,
    worker           TEXT,
    lease_until      INTEGER,
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

CREATE INDEX task_to_claim ON task (priority DESC, run_at, id) WHERE state = 'queued';
CREATE INDEX task_leased ON task (lease_until) WHERE state = 'running';

CREATE TRIGGER task_final_states_never_change
BEFORE UPDATE OF state ON task
WHEN OLD.state IN ('succeeded', 'failed', 'cancelled') AND NEW.state <> OLD.state
BEGIN
    SELECT RAISE(ABORT, 'the state of a finished task never changes');
END;

CREATE TABLE idempotency_key (
    key        TEXT    PRIMARY KEY,
    -- Digest of the request that first came with this key.
    request    TEXT    NOT NULL,
    job        INTEGER NOT NULL REFERENCES job (id) ON DELETE CASCADE,
    reused     INTEGER NOT NULL CHECK (reused IN (0, 1)),
    created_at INTEGER NOT NULL
) STRICT, WITHOUT ROWID;

CREATE TABLE run (
    id         INTEGER PRIMARY KEY AUTOINCREMENT,
    job        INTEGER NOT NULL UNIQUE REFERENCES job (id) ON DELETE CASCADE,
    created_at INTEGER NOT NULL
) STRICT;

-- A value that is NULL was not a number.
CREATE TABLE metric (
    run   INTEGER NOT NULL REFERENCES run (id) ON DELETE CASCADE,
    key   TEXT    NOT NULL,
    step  INTEGER NOT NULL,
    time  INTEGER NOT NULL,
    value REAL,
    PRIMARY KEY (run, key, step)
) STRICT, WITHOUT ROWID;

CREATE TABLE metric_latest (
    run   INTEGER NOT NULL REFERENCES run (id) ON DELETE CASCADE,
    key   TEXT    NOT NULL,
    step  INTEGER NOT NULL,
    time  INTEGER NOT NULL,
    value REAL,
    PRIMARY KEY (run, key)
) STRICT, WITHOUT ROWID;

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
    id           INTEGER PRIMARY KEY AUTOINCREMENT,
    job          INTEGER NOT NULL UNIQUE REFERENCES job (id) ON DELETE CASCADE,
    digest       TEXT    NOT NULL,
    state        TEXT    NOT NULL CHECK (state IN ('building', 'complete')),
    trajectories INTEGER NOT NULL,
    -- Samples of each trajectory.
    samples      INTEGER NOT NULL,
    created_at   INTEGER NOT NULL,
    completed_at INTEGER
) STRICT;

CREATE INDEX dataset_by_digest ON dataset (digest, id);

CREATE TABLE shard (
    dataset  INTEGER NOT NULL REFERENCES dataset (id) ON DELETE CASCADE,
    ordinal  INTEGER NOT NULL,
    -- Index of the first trajectory, and how many follow.
    first    INTEGER NOT NULL,
    count    INTEGER NOT NULL,
    -- Draws that were refused on the way to `count` trajectories.
    rejected INTEGER NOT NULL,
    task     INTEGER NOT NULL REFERENCES task (id),
    epoch    INTEGER NOT NULL,
    PRIMARY KEY (dataset, ordinal)
) STRICT, WITHOUT ROWID;

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
    id         INTEGER PRIMARY KEY AUTOINCREMENT,
    job        INTEGER NOT NULL REFERENCES job (id) ON DELETE CASCADE,
    run        INTEGER NOT NULL REFERENCES run (id) ON DELETE CASCADE,
    step       INTEGER NOT NULL,
    is_final   INTEGER NOT NULL CHECK (is_final IN (0, 1)),
    -- Whether its validation is the best of the training so far, and what it was.
    is_best    INTEGER NOT NULL CHECK (is_best IN (0, 1)),
    metrics    TEXT    NOT NULL,
    created_at INTEGER NOT NULL,
    UNIQUE (job, step)
) STRICT;

CREATE UNIQUE INDEX checkpoint_best ON checkpoint (job) WHERE is_best = 1;

CREATE TABLE checkpoint_file (
    checkpoint INTEGER NOT NULL REFERENCES checkpoint (id) ON DELETE CASCADE,
    name       TEXT    NOT NULL,
    path       TEXT    NOT NULL UNIQUE,
    size       INTEGER NOT NULL,
    sha256     TEXT    NOT NULL,
    PRIMARY KEY (checkpoint, name)
) STRICT, WITHOUT ROWID;

-- Files that somebody sent to be imported, each once.
CREATE TABLE upload (
    sha256     TEXT    PRIMARY KEY,
    -- As the sender called it.
    name       TEXT    NOT NULL,
    path       TEXT    NOT NULL UNIQUE,
    size       INTEGER NOT NULL,
    created_at INTEGER NOT NULL
) STRICT, WITHOUT ROWID;
