-- What tasks ask of the worker that takes them, each combination once; 0 asks for nothing. There are few, so that the next
-- task of each is looked for and none is passed over.
CREATE TABLE resources (
    id        INTEGER PRIMARY KEY AUTOINCREMENT,
    cpus      INTEGER NOT NULL,
    gpus      INTEGER NOT NULL,
    -- In units of 10^6 bytes.
    memory_mb INTEGER NOT NULL,
    -- Names in order, as JSON.
    tags      TEXT    NOT NULL,
    UNIQUE (cpus, gpus, memory_mb, tags)
) STRICT;

INSERT INTO resources (id, cpus, gpus, memory_mb, tags) VALUES (1, 0, 0, 0, '[]');

ALTER TABLE job ADD COLUMN resources INTEGER NOT NULL DEFAULT 1;
-- No task is claimed before this moment.
ALTER TABLE job ADD COLUMN not_before INTEGER NOT NULL DEFAULT 0;
-- Seconds that an attempt at a task may take.
ALTER TABLE job ADD COLUMN time_limit_s INTEGER;
-- From when on it has waited: its submission, unless a clock was set back since that of another that is there.
ALTER TABLE job ADD COLUMN waits_since INTEGER NOT NULL DEFAULT 0;
UPDATE job SET waits_since = created_at, time_limit_s = json_extract(spec, '$.execution.time_limit_s');
CREATE INDEX job_open ON job (waits_since) WHERE state NOT IN ('succeeded', 'failed', 'cancelled');

-- Those of the job, and the place in line: the smaller goes first, of equal ones the smaller id. A point of priority is
-- worth an hour.
ALTER TABLE task ADD COLUMN resources INTEGER NOT NULL DEFAULT 1;
ALTER TABLE task ADD COLUMN not_before INTEGER NOT NULL DEFAULT 0;
ALTER TABLE task ADD COLUMN turn INTEGER NOT NULL DEFAULT 0;
UPDATE task SET turn = (SELECT job.created_at FROM job WHERE job.id = task.job) - priority * 3600000
WHERE state IN ('waiting', 'queued', 'running');
DROP INDEX task_to_claim;
ALTER TABLE task DROP COLUMN priority;
CREATE INDEX task_to_claim ON task (resources, turn, id, run_at, not_before, state) WHERE state = 'queued';

-- What it offers.
ALTER TABLE worker ADD COLUMN cpus INTEGER NOT NULL DEFAULT 0;
ALTER TABLE worker ADD COLUMN gpus INTEGER NOT NULL DEFAULT 0;
ALTER TABLE worker ADD COLUMN memory_mb INTEGER NOT NULL DEFAULT 0;
ALTER TABLE worker ADD COLUMN tags TEXT NOT NULL DEFAULT '[]';
-- Since when it is to end its task and claim no other.
ALTER TABLE worker ADD COLUMN drained_at INTEGER;
