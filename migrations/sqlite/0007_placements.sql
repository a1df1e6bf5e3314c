-- The engine that workers are asked of: one row, and none while servers start their own.
CREATE TABLE engine (
    id       INTEGER PRIMARY KEY CHECK (id = 1),
    name     TEXT    NOT NULL,
    -- Why no workers come from it at the moment.
    obstacle TEXT
) STRICT;

-- Workers that were asked of an engine, as it showed them last. Those that ended stay for a day.
CREATE TABLE placement (
    worker     TEXT    PRIMARY KEY,
    engine     TEXT    NOT NULL,
    -- What the engine calls it.
    identifier TEXT,
    state      TEXT    NOT NULL CHECK (state IN ('pending', 'running', 'ended')),
    -- Why it waits, or how it ended.
    reason     TEXT,
    node       TEXT,
    asked_at   INTEGER NOT NULL,
    changed_at INTEGER NOT NULL
) STRICT, WITHOUT ROWID;

CREATE INDEX attempt_by_worker ON attempt (worker, id);
