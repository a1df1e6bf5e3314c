-- Robots that users added, and those that jobs identified. Specs name one by its id or its digest, and jobs keep a copy of the
-- description, so a robot can be deleted at any time.
CREATE TABLE robot (
    id          INTEGER PRIMARY KEY AUTOINCREMENT,
    name        TEXT    NOT NULL,
    -- The name in lower case, where words are looked for.
    searched    TEXT    NOT NULL,
    -- Of the description's canonical JSON.
    digest      TEXT    NOT NULL UNIQUE,
    description TEXT    NOT NULL,
    -- The URDF that it was read from, and how it was read, as JSON; NULL if it came as a description.
    source      TEXT,
    options     TEXT,
    -- The doubts of reading, as a JSON list of texts.
    doubts      TEXT    NOT NULL,
    -- The job that identified it.
    job         INTEGER REFERENCES job (id) ON DELETE SET NULL,
    -- The name of a token, or the reason why none was needed; NULL if a job added it.
    added_by    TEXT,
    created_at  INTEGER NOT NULL
) STRICT;

CREATE INDEX robot_by_job ON robot (job) WHERE job IS NOT NULL;
