-- Ids begin at the moment of the table: a client that comes with an id of another database is told so, since those ids are
-- smaller unless a database has more than one event in each millisecond of its life.
CREATE SEQUENCE event_id;
SELECT setval('event_id', CAST(EXTRACT(EPOCH FROM clock_timestamp()) * 1000 AS BIGINT));

-- A transaction has its number before its events have ids: once all transactions up to a number have ended, no event appears
-- any more with an id that was given before that number.
CREATE FUNCTION next_event_id() RETURNS BIGINT LANGUAGE plpgsql AS $$
BEGIN
    PERFORM pg_current_xact_id();
    RETURN nextval('event_id');
END
$$;

-- What happened to jobs, in order, for those who follow them. Old ones are forgotten, and the newest row stays. A row outlives
-- its job.
CREATE TABLE event (
    id   BIGINT  PRIMARY KEY DEFAULT next_event_id(),
    at   BIGINT  NOT NULL,
    kind TEXT    NOT NULL CHECK (kind IN ('start', 'job', 'task', 'metrics', 'checkpoint')),
    -- NULL for the start.
    job  BIGINT,
    -- The rest, as JSON.
    data TEXT    NOT NULL
);

INSERT INTO event (at, kind, data)
VALUES (CAST(EXTRACT(EPOCH FROM clock_timestamp()) * 1000 AS BIGINT), 'start', '{}');

CREATE FUNCTION job_tells() RETURNS trigger LANGUAGE plpgsql AS $$
BEGIN
    INSERT INTO event (at, kind, job, data) VALUES (
        CAST(EXTRACT(EPOCH FROM clock_timestamp()) * 1000 AS BIGINT), 'job', NEW.id,
        json_build_object(
            'kind', NEW.kind, 'name', NEW.name, 'state', NEW.state, 'error', NEW.error,
            'cancel_requested', NEW.cancel_requested
        )
    );
    RETURN NULL;
END
$$;

CREATE TRIGGER job_tells AFTER UPDATE OF state, cancel_requested ON job FOR EACH ROW
WHEN (NEW.state <> OLD.state OR NEW.cancel_requested <> OLD.cancel_requested)
EXECUTE FUNCTION job_tells();

CREATE FUNCTION task_tells() RETURNS trigger LANGUAGE plpgsql AS $$
BEGIN
    INSERT INTO event (at, kind, job, data) VALUES (
        CAST(EXTRACT(EPOCH FROM clock_timestamp()) * 1000 AS BIGINT), 'task', NEW.job,
        json_build_object(
            'task', NEW.id, 'label', NEW.label, 'state', NEW.state, 'attempt', NEW.attempt,
            'worker', NEW.worker, 'error', NEW.error
        )
    );
    RETURN NULL;
END
$$;

-- A job tells of tasks that nobody has begun.
CREATE TRIGGER task_tells AFTER UPDATE OF state ON task FOR EACH ROW
WHEN (NEW.state <> OLD.state AND 'running' IN (NEW.state, OLD.state))
EXECUTE FUNCTION task_tells();
