-- How long the lease of a running task lasts after a renewal.
ALTER TABLE task ADD COLUMN lease_ms INTEGER;

-- A task may be claimed at once (0) or, after a failure, from a moment on. Jobs go in the order of their submission.
UPDATE task SET run_at = 0 WHERE state = 'queued';
DROP INDEX task_to_claim;
CREATE INDEX task_to_claim ON task (priority DESC, id) WHERE state = 'queued';

-- Whether what earlier jobs of the same digest had committed before they failed or were cancelled is taken over.
ALTER TABLE job ADD COLUMN takes_over INTEGER NOT NULL DEFAULT 0 CHECK (takes_over IN (0, 1));

-- Processes that execute tasks. A row goes when its worker ends in order; one that died stays for a day.
CREATE TABLE worker (
    name       TEXT    PRIMARY KEY,
    host       TEXT    NOT NULL,
    pid        INTEGER NOT NULL,
    version    TEXT    NOT NULL,
    device     TEXT    NOT NULL,
    threads    INTEGER NOT NULL,
    -- Why it claims no tasks at the moment.
    waits_for  TEXT,
    started_at INTEGER NOT NULL,
    seen_at    INTEGER NOT NULL
) STRICT, WITHOUT ROWID;

-- Written to learn whether the database can be written.
CREATE TABLE probe (
    id         INTEGER PRIMARY KEY CHECK (id = 1),
    written_at INTEGER NOT NULL
) STRICT;

-- Every time that a worker had a task.
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
    UNIQUE (task, epoch)
) STRICT;

CREATE INDEX attempt_by_job ON attempt (job, id);

-- The queue as a whole: one row.
CREATE TABLE queue (
    id        INTEGER PRIMARY KEY CHECK (id = 1),
    -- Since when no task is claimed; NULL while tasks are.
    paused_at INTEGER
) STRICT;

INSERT INTO queue (id, paused_at) VALUES (1, NULL);

-- The server that was started last: one row.
CREATE TABLE server (
    id         INTEGER PRIMARY KEY CHECK (id = 1),
    -- The version of torqued.
    version    TEXT    NOT NULL,
    started_at INTEGER NOT NULL
) STRICT;
