-- Whether its validation is the best of the training so far, and what it was.
ALTER TABLE checkpoint ADD COLUMN is_best INTEGER NOT NULL DEFAULT 0 CHECK (is_best IN (0, 1));
ALTER TABLE checkpoint ADD COLUMN metrics TEXT NOT NULL DEFAULT '{}';

CREATE UNIQUE INDEX checkpoint_best ON checkpoint (job) WHERE is_best = 1;
