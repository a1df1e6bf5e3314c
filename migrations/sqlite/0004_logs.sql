-- Bytes that an attempt has logged, those that were left out included; NULL without a log, and of old attempts, whose
-- logs are not kept.
ALTER TABLE attempt ADD COLUMN log_bytes INTEGER;

CREATE INDEX attempt_running ON attempt (job) WHERE ended_at IS NULL;
CREATE INDEX attempt_logged ON attempt (job, id) WHERE log_bytes IS NOT NULL;

-- What attempts logged, in chunks of whole lines. Ids of one job grow in the order in which chunks can be read, so that
-- a reader goes on after the last one that it has.
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
