-- Tells this store from others: one row. Objects carry it, too, so that no server sweeps another's.
CREATE TABLE store (
    id TEXT NOT NULL
) STRICT;

INSERT INTO store (id) VALUES (lower(hex(randomblob(16))));
