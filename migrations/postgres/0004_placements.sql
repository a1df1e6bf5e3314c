-- The engine that workers are asked of: one row, and none while servers start their own.
CREATE TABLE engine (
    id       BIGINT  PRIMARY KEY CHECK (id = 1),
    name     TEXT    NOT NULL,
    -- Why no workers come from it at the moment.
    obstacle TEXT
);

-- Workers that were asked of an engine, as it showed them last. Those that ended stay for a day.
CREATE TABLE placement (
    worker     TEXT COLLATE "C" PRIMARY KEY,
    engine     TEXT    NOT NULL,
    -- What the engine calls it.
    identifier TEXT,
    state      TEXT    NOT NULL CHECK (state IN ('pending', 'running', 'ended')),
    -- Why it waits, or how it ended.
    reason     TEXT,
    node       TEXT,
    asked_at   BIGINT  NOT NULL,
    changed_at BIGINT  NOT NULL
);

CREATE INDEX attempt_by_worker ON attempt (worker, id);
