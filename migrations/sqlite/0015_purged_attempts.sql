-- Attempts that ended, of jobs that were deleted for good: a count of attempts never falls.
CREATE TABLE purged_attempts (
    kind    TEXT    NOT NULL,
    outcome TEXT    NOT NULL,
    number  INTEGER NOT NULL,
    PRIMARY KEY (kind, outcome)
) STRICT, WITHOUT ROWID;
