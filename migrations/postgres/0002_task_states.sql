-- Where a job stands, however many tasks it has.
CREATE INDEX task_by_state ON task (job, state, stage);

-- An attempt goes with its task, and that with the job. A reference to the job as well has all who claim tasks of one job
-- lock its row.
ALTER TABLE attempt DROP CONSTRAINT attempt_job_fkey;
