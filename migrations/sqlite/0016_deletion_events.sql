-- Deletions tell, too. A constraint of SQLite changes with its table.
DROP TRIGGER job_tells;
DROP TRIGGER task_tells;

CREATE TABLE changed_event (
    id   INTEGER PRIMARY KEY,
    at   INTEGER NOT NULL,
    kind TEXT    NOT NULL CHECK (kind IN ('start', 'job', 'task', 'metrics', 'checkpoint', 'deletion')),
    -- NULL for the start.
    job  INTEGER,
    -- The rest, as JSON.
    data TEXT    NOT NULL
) STRICT;

INSERT INTO changed_event (id, at, kind, job, data) SELECT id, at, kind, job, data FROM event;
DROP TABLE event;
ALTER TABLE changed_event RENAME TO event;

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
