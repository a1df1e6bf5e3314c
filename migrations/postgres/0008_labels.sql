-- What people call things, and what they say of them. A thing without a name of its own has its job's.
ALTER TABLE job ADD COLUMN given_name TEXT;
ALTER TABLE job ADD COLUMN note TEXT;
-- Name and note in lower case: where words are looked for. NULL of a job that was there before these columns, until a server folds it;
-- of the others without name and note.
ALTER TABLE job ADD COLUMN searched TEXT;

ALTER TABLE run ADD COLUMN given_name TEXT;
ALTER TABLE run ADD COLUMN note TEXT;
ALTER TABLE run ADD COLUMN searched TEXT;

ALTER TABLE dataset ADD COLUMN given_name TEXT;
ALTER TABLE dataset ADD COLUMN note TEXT;
ALTER TABLE dataset ADD COLUMN searched TEXT;

ALTER TABLE checkpoint ADD COLUMN given_name TEXT;
ALTER TABLE checkpoint ADD COLUMN note TEXT;
ALTER TABLE checkpoint ADD COLUMN searched TEXT;

CREATE INDEX job_not_folded ON job (id) WHERE searched IS NULL;

CREATE TABLE job_tag (
    job BIGINT NOT NULL REFERENCES job (id) ON DELETE CASCADE,
    tag TEXT COLLATE "C" NOT NULL,
    PRIMARY KEY (job, tag)
);

CREATE INDEX job_by_tag ON job_tag (tag, job);

CREATE TABLE run_tag (
    run BIGINT NOT NULL REFERENCES run (id) ON DELETE CASCADE,
    tag TEXT COLLATE "C" NOT NULL,
    PRIMARY KEY (run, tag)
);

CREATE INDEX run_by_tag ON run_tag (tag, run);

CREATE TABLE dataset_tag (
    dataset BIGINT NOT NULL REFERENCES dataset (id) ON DELETE CASCADE,
    tag     TEXT COLLATE "C" NOT NULL,
    PRIMARY KEY (dataset, tag)
);

CREATE INDEX dataset_by_tag ON dataset_tag (tag, dataset);

CREATE TABLE checkpoint_tag (
    checkpoint BIGINT NOT NULL REFERENCES checkpoint (id) ON DELETE CASCADE,
    tag        TEXT COLLATE "C" NOT NULL,
    PRIMARY KEY (checkpoint, tag)
);

CREATE INDEX checkpoint_by_tag ON checkpoint_tag (tag, checkpoint);

-- The orders of lists, besides that of ids. What has not ended comes after all that has.
CREATE INDEX job_by_name ON job ((COALESCE(given_name, name) COLLATE "C"), id);
CREATE INDEX job_by_finish ON job (COALESCE(finished_at, 9223372036854775807), id);
CREATE INDEX job_by_priority ON job (priority, id);
CREATE INDEX dataset_by_trajectories ON dataset (trajectories, id);
CREATE INDEX checkpoint_by_step ON checkpoint (step, id);
