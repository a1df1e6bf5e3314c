-- Runs that clients of MLflow log beside torqued's own. Times of runs and metrics are those that clients say, in
-- milliseconds since 1970. A metric that was not a number has the value 0 and says so.

CREATE TABLE tracked_experiment (
    id         INTEGER PRIMARY KEY AUTOINCREMENT,
    name       TEXT    NOT NULL UNIQUE,
    is_deleted INTEGER NOT NULL DEFAULT 0 CHECK (is_deleted IN (0, 1)),
    created_at INTEGER NOT NULL,
    updated_at INTEGER NOT NULL
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
    -- As clients name it: 32 hexadecimal digits.
    identifier TEXT    NOT NULL UNIQUE,
    experiment INTEGER NOT NULL REFERENCES tracked_experiment (id) ON DELETE CASCADE,
    name       TEXT    NOT NULL,
    user_name  TEXT    NOT NULL,
    status     TEXT    NOT NULL
        CHECK (status IN ('RUNNING', 'SCHEDULED', 'FINISHED', 'FAILED', 'KILLED')),
    start_time INTEGER NOT NULL,
    end_time   INTEGER,
    is_deleted INTEGER NOT NULL DEFAULT 0 CHECK (is_deleted IN (0, 1)),
    created_at INTEGER NOT NULL
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
