-- Which kinds of job there are is for the specification to say. Dropping a CHECK changes no stored
-- row, so the table need not be copied (sqlite.org/lang_altertable.html, section 7).
PRAGMA writable_schema = ON;
UPDATE sqlite_schema
SET sql = replace(sql, ' CHECK (kind IN (''simulate'', ''train'', ''evaluate'', ''pipeline''))', '')
WHERE type = 'table' AND name = 'job';
PRAGMA writable_schema = RESET;

-- Files that somebody sent to be imported, each once.
CREATE TABLE upload (
    sha256     TEXT    PRIMARY KEY,
    -- As the sender called it.
    name       TEXT    NOT NULL,
    path       TEXT    NOT NULL UNIQUE,
    size       INTEGER NOT NULL,
    created_at INTEGER NOT NULL
) STRICT, WITHOUT ROWID;
