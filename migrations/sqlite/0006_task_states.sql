-- Where a job stands, however many tasks it has.
CREATE INDEX task_by_state ON task (job, state, stage);
