-- Names that stand for a checkpoint, such as champion. Each stands for one, and may move to another.
CREATE TABLE checkpoint_alias (
    alias      TEXT COLLATE "C" PRIMARY KEY,
    checkpoint BIGINT NOT NULL REFERENCES checkpoint (id) ON DELETE CASCADE
);

CREATE INDEX checkpoint_alias_by_checkpoint ON checkpoint_alias (checkpoint);
