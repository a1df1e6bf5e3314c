-- Who may ask, and for what. The database keeps the digest of a token, never the token.
CREATE TABLE token (
    id           INTEGER PRIMARY KEY AUTOINCREMENT,
    name         TEXT    NOT NULL,
    digest       TEXT    NOT NULL UNIQUE,
    scope        TEXT    NOT NULL CHECK (scope IN ('read', 'submit', 'admin')),
    created_at   INTEGER NOT NULL,
    expires_at   INTEGER,
    last_used_at INTEGER,
    -- A token that was revoked stays, so that the audit log's names keep their meaning.
    revoked_at   INTEGER
) STRICT;

CREATE UNIQUE INDEX token_name ON token (name) WHERE revoked_at IS NULL;

-- Browsers that logged in. A session is as good as the token that it was opened with.
CREATE TABLE session (
    digest     TEXT    PRIMARY KEY,
    token      TEXT    NOT NULL,
    expires_at INTEGER NOT NULL
) STRICT, WITHOUT ROWID;

-- Requests that changed something, or tried to.
CREATE TABLE audit (
    id      INTEGER PRIMARY KEY AUTOINCREMENT,
    at      INTEGER NOT NULL,
    -- Name of a token, or what else let the request in.
    actor   TEXT    NOT NULL,
    address TEXT    NOT NULL,
    method  TEXT    NOT NULL,
    -- Path and query.
    target  TEXT    NOT NULL,
    status  INTEGER NOT NULL,
    -- Path of what the request made.
    made    TEXT
) STRICT;
