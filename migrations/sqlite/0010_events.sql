-- What happened to jobs, in order, for those who follow them. Old ones are forgotten, and the newest row stays, so that no id
-- is given twice. A row outlives its job.
CREATE TABLE event (
    id   INTEGER PRIMARY KEY,
    at   INTEGER NOT NULL,
    kind TEXT    NOT NULL CHECK (kind IN ('start', 'job', 'task', 'metrics', 'checkpoint')),
    -- NULL for the start.
    job  INTEGER,
    -- The rest, as JSON.
    data TEXT    NOT NULL
) STRICT;

-- Ids begin at the moment of the table: a client that comes with an id of another database is told so, since those ids are
-- smaller unless a database has more than one event in each millisecond of its life.
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

-- A job tells of tasks that nobody has begun.
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
