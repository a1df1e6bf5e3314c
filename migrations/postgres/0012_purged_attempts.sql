-- Attempts that ended, of jobs that were deleted for good: a count of attempts never falls.
CREATE TABLE purged_attempts (
    kind    TEXT COLLATE "C" NOT NULL,
    outcome TEXT COLLATE "C" NOT NULL,
    number  BIGINT NOT NULL,
    PRIMARY KEY (kind, outcome)
);
