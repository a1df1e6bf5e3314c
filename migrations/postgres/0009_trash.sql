-- What was deleted is in the trash until `purge_at`. `purged_at` says when its bytes and details went; the row stays as long as
-- its job's does, so that a job that lost its results does not stand in for another. A reason is NULL when somebody asked.
ALTER TABLE job ADD COLUMN deleted_at BIGINT;
ALTER TABLE job ADD COLUMN purge_at BIGINT;
ALTER TABLE job ADD COLUMN purged_at BIGINT;
ALTER TABLE job ADD COLUMN deletion_reason TEXT;
ALTER TABLE run ADD COLUMN deleted_at BIGINT;
ALTER TABLE run ADD COLUMN purge_at BIGINT;
ALTER TABLE run ADD COLUMN purged_at BIGINT;
ALTER TABLE run ADD COLUMN deletion_reason TEXT;
ALTER TABLE dataset ADD COLUMN deleted_at BIGINT;
ALTER TABLE dataset ADD COLUMN purge_at BIGINT;
ALTER TABLE dataset ADD COLUMN purged_at BIGINT;
ALTER TABLE dataset ADD COLUMN deletion_reason TEXT;
ALTER TABLE checkpoint ADD COLUMN deleted_at BIGINT;
ALTER TABLE checkpoint ADD COLUMN purge_at BIGINT;
ALTER TABLE checkpoint ADD COLUMN purged_at BIGINT;
ALTER TABLE checkpoint ADD COLUMN deletion_reason TEXT;

-- Most of what there is was never deleted.
CREATE INDEX job_deleted ON job (deleted_at) WHERE deleted_at IS NOT NULL;
CREATE INDEX run_deleted ON run (deleted_at) WHERE deleted_at IS NOT NULL;
CREATE INDEX dataset_deleted ON dataset (deleted_at) WHERE deleted_at IS NOT NULL;
CREATE INDEX checkpoint_deleted ON checkpoint (deleted_at) WHERE deleted_at IS NOT NULL;

-- Cascades of a job that is purged look here.
CREATE INDEX checkpoint_by_run ON checkpoint (run);
CREATE INDEX shard_by_task ON shard (task);
CREATE INDEX idempotency_key_by_job ON idempotency_key (job);

-- The digests that a job's spec refers to: of the jobs whose data and checkpoints it reads, and of files that were sent.
CREATE TABLE job_input (
    job    BIGINT NOT NULL REFERENCES job (id) ON DELETE CASCADE,
    digest TEXT   NOT NULL,
    PRIMARY KEY (job, digest)
);

CREATE INDEX job_input_by_digest ON job_input (digest, job);

-- Of jobs that are there already: every digest that stands in the spec.
INSERT INTO job_input (job, digest)
SELECT DISTINCT job.id, named.digest[1]
FROM job, regexp_matches(job.spec, '"([0-9a-f]{64})"', 'g') AS named (digest)
WHERE NOT EXISTS (SELECT 1 FROM pipeline_member WHERE pipeline = job.id);

-- The trash of MLflow's clients has a date, too: 30 days for what lies in it already.
ALTER TABLE tracked_run ADD COLUMN deleted_at BIGINT;
ALTER TABLE tracked_run ADD COLUMN purge_at BIGINT;
ALTER TABLE tracked_experiment ADD COLUMN deleted_at BIGINT;
ALTER TABLE tracked_experiment ADD COLUMN purge_at BIGINT;
UPDATE tracked_run SET deleted_at = CAST(EXTRACT(EPOCH FROM clock_timestamp()) * 1000 AS BIGINT) WHERE is_deleted;
UPDATE tracked_run SET purge_at = deleted_at + 2592000000 WHERE is_deleted;
UPDATE tracked_experiment SET deleted_at = CAST(EXTRACT(EPOCH FROM clock_timestamp()) * 1000 AS BIGINT) WHERE is_deleted;
UPDATE tracked_experiment SET purge_at = deleted_at + 2592000000 WHERE is_deleted;
