PRAGMA foreign_keys=OFF;
BEGIN TRANSACTION;
CREATE TABLE job (
    id               INTEGER PRIMARY KEY AUTOINCREMENT,
    kind             TEXT    NOT NULL,
    name             TEXT    NOT NULL,
    spec             TEXT    NOT NULL,
    digest           TEXT    NOT NULL,
    state            TEXT    NOT NULL
        CHECK (state IN ('waiting', 'queued', 'running', 'succeeded', 'failed', 'cancelled')),
    error            TEXT,
    unit             TEXT    NOT NULL,
    priority         INTEGER NOT NULL,
    max_attempts     INTEGER NOT NULL,
    is_part          INTEGER NOT NULL CHECK (is_part IN (0, 1)),
    asked_alone      INTEGER NOT NULL CHECK (asked_alone IN (0, 1)),
    cancel_requested INTEGER NOT NULL DEFAULT 0 CHECK (cancel_requested IN (0, 1)),
    created_at       INTEGER NOT NULL,
    started_at       INTEGER,
    finished_at      INTEGER
, takes_over INTEGER NOT NULL DEFAULT 0 CHECK (takes_over IN (0, 1)), resources INTEGER NOT NULL DEFAULT 1, not_before INTEGER NOT NULL DEFAULT 0, time_limit_s INTEGER, waits_since INTEGER NOT NULL DEFAULT 0, given_name TEXT, note TEXT, searched TEXT, deleted_at INTEGER, purge_at INTEGER, purged_at INTEGER, deletion_reason TEXT) STRICT;
INSERT INTO job VALUES(1,'simulate','old','{"seed": 1}','cba06b5736faf67e54b07b561eae94395e774c517a7d910a54369e1263ccfbd4','queued',NULL,'trajectories',0,3,0,1,0,1795700000000,NULL,NULL,0,1,0,NULL,1795700000000,NULL,NULL,'old',NULL,NULL,NULL,NULL);
CREATE TABLE job_need (
    job   INTEGER NOT NULL REFERENCES job (id) ON DELETE CASCADE,
    needs INTEGER NOT NULL REFERENCES job (id),
    PRIMARY KEY (job, needs)
) STRICT, WITHOUT ROWID;
CREATE TABLE pipeline_member (
    pipeline INTEGER NOT NULL REFERENCES job (id) ON DELETE CASCADE,
    name     TEXT    NOT NULL,
    ordinal  INTEGER NOT NULL,
    job      INTEGER NOT NULL REFERENCES job (id),
    reused   INTEGER NOT NULL CHECK (reused IN (0, 1)),
    PRIMARY KEY (pipeline, name)
) STRICT, WITHOUT ROWID;
CREATE TABLE task (
    id               INTEGER PRIMARY KEY AUTOINCREMENT,
    job              INTEGER NOT NULL REFERENCES job (id) ON DELETE CASCADE,
    stage            INTEGER NOT NULL,
    ordinal          INTEGER NOT NULL,
    label            TEXT    NOT NULL,
    payload          TEXT    NOT NULL,
    state            TEXT    NOT NULL
        CHECK (state IN ('waiting', 'queued', 'running', 'succeeded', 'failed', 'cancelled')),
    run_at           INTEGER NOT NULL,
    attempt          INTEGER NOT NULL DEFAULT 0,
    max_attempts     INTEGER NOT NULL,
    epoch            INTEGER NOT NULL DEFAULT 0,
    worker           TEXT,
    lease_until      INTEGER,
    cancel_requested INTEGER NOT NULL DEFAULT 0 CHECK (cancel_requested IN (0, 1)),
    done             INTEGER NOT NULL DEFAULT 0,
    total            INTEGER NOT NULL,
    rate             REAL,
    message          TEXT,
    result           TEXT,
    error            TEXT,
    started_at       INTEGER,
    finished_at      INTEGER, lease_ms INTEGER, resources INTEGER NOT NULL DEFAULT 1, not_before INTEGER NOT NULL DEFAULT 0, turn INTEGER NOT NULL DEFAULT 0,
    UNIQUE (job, stage, ordinal)
) STRICT;
INSERT INTO task VALUES(1,1,0,0,'shard 0','{}','queued',0,0,3,0,NULL,NULL,0,0,7,NULL,NULL,NULL,NULL,NULL,NULL,NULL,1,0,1795700000000);
CREATE TABLE idempotency_key (
    key        TEXT    PRIMARY KEY,
    request    TEXT    NOT NULL,
    job        INTEGER NOT NULL REFERENCES job (id) ON DELETE CASCADE,
    reused     INTEGER NOT NULL CHECK (reused IN (0, 1)),
    created_at INTEGER NOT NULL
) STRICT, WITHOUT ROWID;
CREATE TABLE run (
    id         INTEGER PRIMARY KEY AUTOINCREMENT,
    job        INTEGER NOT NULL UNIQUE REFERENCES job (id) ON DELETE CASCADE,
    created_at INTEGER NOT NULL
, given_name TEXT, note TEXT, searched TEXT, deleted_at INTEGER, purge_at INTEGER, purged_at INTEGER, deletion_reason TEXT) STRICT;
CREATE TABLE metric (
    run   INTEGER NOT NULL REFERENCES run (id) ON DELETE CASCADE,
    key   TEXT    NOT NULL,
    step  INTEGER NOT NULL,
    time  INTEGER NOT NULL,
    value REAL,
    PRIMARY KEY (run, key, step)
) STRICT, WITHOUT ROWID;
CREATE TABLE metric_latest (
    run   INTEGER NOT NULL REFERENCES run (id) ON DELETE CASCADE,
    key   TEXT    NOT NULL,
    step  INTEGER NOT NULL,
    time  INTEGER NOT NULL,
    value REAL,
    PRIMARY KEY (run, key)
) STRICT, WITHOUT ROWID;
CREATE TABLE artifact (
    run        INTEGER NOT NULL REFERENCES run (id) ON DELETE CASCADE,
    name       TEXT    NOT NULL,
    media_type TEXT    NOT NULL,
    path       TEXT    NOT NULL UNIQUE,
    size       INTEGER NOT NULL,
    sha256     TEXT    NOT NULL,
    created_at INTEGER NOT NULL,
    PRIMARY KEY (run, name)
) STRICT, WITHOUT ROWID;
CREATE TABLE dataset (
    id           INTEGER PRIMARY KEY AUTOINCREMENT,
    job          INTEGER NOT NULL UNIQUE REFERENCES job (id) ON DELETE CASCADE,
    digest       TEXT    NOT NULL,
    state        TEXT    NOT NULL CHECK (state IN ('building', 'complete')),
    trajectories INTEGER NOT NULL,
    samples      INTEGER NOT NULL,
    created_at   INTEGER NOT NULL,
    completed_at INTEGER
, given_name TEXT, note TEXT, searched TEXT, deleted_at INTEGER, purge_at INTEGER, purged_at INTEGER, deletion_reason TEXT) STRICT;
CREATE TABLE shard (
    dataset  INTEGER NOT NULL REFERENCES dataset (id) ON DELETE CASCADE,
    ordinal  INTEGER NOT NULL,
    first    INTEGER NOT NULL,
    count    INTEGER NOT NULL,
    rejected INTEGER NOT NULL,
    task     INTEGER NOT NULL REFERENCES task (id),
    epoch    INTEGER NOT NULL,
    PRIMARY KEY (dataset, ordinal)
) STRICT, WITHOUT ROWID;
CREATE TABLE shard_file (
    dataset INTEGER NOT NULL,
    ordinal INTEGER NOT NULL,
    content TEXT    NOT NULL CHECK (content IN ('trajectories', 'robots')),
    path    TEXT    NOT NULL UNIQUE,
    size    INTEGER NOT NULL,
    sha256  TEXT    NOT NULL,
    PRIMARY KEY (dataset, ordinal, content),
    FOREIGN KEY (dataset, ordinal) REFERENCES shard (dataset, ordinal) ON DELETE CASCADE
) STRICT, WITHOUT ROWID;
CREATE TABLE checkpoint (
    id         INTEGER PRIMARY KEY AUTOINCREMENT,
    job        INTEGER NOT NULL REFERENCES job (id) ON DELETE CASCADE,
    run        INTEGER NOT NULL REFERENCES run (id) ON DELETE CASCADE,
    step       INTEGER NOT NULL,
    is_final   INTEGER NOT NULL CHECK (is_final IN (0, 1)),
    is_best    INTEGER NOT NULL CHECK (is_best IN (0, 1)),
    metrics    TEXT    NOT NULL,
    created_at INTEGER NOT NULL, given_name TEXT, note TEXT, searched TEXT, deleted_at INTEGER, purge_at INTEGER, purged_at INTEGER, deletion_reason TEXT,
    UNIQUE (job, step)
) STRICT;
CREATE TABLE checkpoint_file (
    checkpoint INTEGER NOT NULL REFERENCES checkpoint (id) ON DELETE CASCADE,
    name       TEXT    NOT NULL,
    path       TEXT    NOT NULL UNIQUE,
    size       INTEGER NOT NULL,
    sha256     TEXT    NOT NULL,
    PRIMARY KEY (checkpoint, name)
) STRICT, WITHOUT ROWID;
CREATE TABLE upload (
    sha256     TEXT    PRIMARY KEY,
    name       TEXT    NOT NULL,
    path       TEXT    NOT NULL UNIQUE,
    size       INTEGER NOT NULL,
    created_at INTEGER NOT NULL
) STRICT, WITHOUT ROWID;
CREATE TABLE worker (
    name       TEXT    PRIMARY KEY,
    host       TEXT    NOT NULL,
    pid        INTEGER NOT NULL,
    version    TEXT    NOT NULL,
    device     TEXT    NOT NULL,
    threads    INTEGER NOT NULL,
    waits_for  TEXT,
    started_at INTEGER NOT NULL,
    seen_at    INTEGER NOT NULL
, cpus INTEGER NOT NULL DEFAULT 0, gpus INTEGER NOT NULL DEFAULT 0, memory_mb INTEGER NOT NULL DEFAULT 0, tags TEXT NOT NULL DEFAULT '[]', drained_at INTEGER) STRICT, WITHOUT ROWID;
CREATE TABLE probe (
    id         INTEGER PRIMARY KEY CHECK (id = 1),
    written_at INTEGER NOT NULL
) STRICT;
CREATE TABLE attempt (
    id         INTEGER PRIMARY KEY AUTOINCREMENT,
    job        INTEGER NOT NULL REFERENCES job (id) ON DELETE CASCADE,
    task       INTEGER NOT NULL REFERENCES task (id) ON DELETE CASCADE,
    epoch      INTEGER NOT NULL,
    worker     TEXT    NOT NULL,
    outcome    TEXT    CHECK (outcome IN ('succeeded', 'failed', 'released', 'cancelled')),
    reason     TEXT,
    started_at INTEGER NOT NULL,
    ended_at   INTEGER, log_bytes INTEGER,
    UNIQUE (task, epoch)
) STRICT;
CREATE TABLE queue (
    id        INTEGER PRIMARY KEY CHECK (id = 1),
    paused_at INTEGER
) STRICT;
INSERT INTO queue VALUES(1,NULL);
CREATE TABLE server (
    id         INTEGER PRIMARY KEY CHECK (id = 1),
    version    TEXT    NOT NULL,
    started_at INTEGER NOT NULL
) STRICT;
CREATE TABLE store (
    id TEXT NOT NULL
) STRICT;
INSERT INTO store VALUES('84d8c1ad539f4bd3b5d3400a9d5f839f');
CREATE TABLE attempt_log (
    id         INTEGER PRIMARY KEY AUTOINCREMENT,
    job        INTEGER NOT NULL REFERENCES job (id) ON DELETE CASCADE,
    attempt    INTEGER NOT NULL REFERENCES attempt (id) ON DELETE CASCADE,
    position   INTEGER NOT NULL,
    text       TEXT    NOT NULL CHECK (length(CAST(text AS BLOB)) BETWEEN 1 AND 16384),
    written_at INTEGER NOT NULL,
    UNIQUE (attempt, position)
) STRICT;
CREATE TABLE resources (
    id        INTEGER PRIMARY KEY AUTOINCREMENT,
    cpus      INTEGER NOT NULL,
    gpus      INTEGER NOT NULL,
    memory_mb INTEGER NOT NULL,
    tags      TEXT    NOT NULL,
    UNIQUE (cpus, gpus, memory_mb, tags)
) STRICT;
INSERT INTO resources VALUES(1,0,0,0,'[]');
CREATE TABLE engine (
    id       INTEGER PRIMARY KEY CHECK (id = 1),
    name     TEXT    NOT NULL,
    obstacle TEXT
) STRICT;
CREATE TABLE placement (
    worker     TEXT    PRIMARY KEY,
    engine     TEXT    NOT NULL,
    identifier TEXT,
    state      TEXT    NOT NULL CHECK (state IN ('pending', 'running', 'ended')),
    reason     TEXT,
    node       TEXT,
    asked_at   INTEGER NOT NULL,
    changed_at INTEGER NOT NULL
) STRICT, WITHOUT ROWID;
CREATE TABLE token (
    id           INTEGER PRIMARY KEY AUTOINCREMENT,
    name         TEXT    NOT NULL,
    digest       TEXT    NOT NULL UNIQUE,
    scope        TEXT    NOT NULL CHECK (scope IN ('read', 'submit', 'admin')),
    created_at   INTEGER NOT NULL,
    expires_at   INTEGER,
    last_used_at INTEGER,
    revoked_at   INTEGER
) STRICT;
CREATE TABLE session (
    digest     TEXT    PRIMARY KEY,
    token      TEXT    NOT NULL,
    expires_at INTEGER NOT NULL
) STRICT, WITHOUT ROWID;
CREATE TABLE audit (
    id      INTEGER PRIMARY KEY AUTOINCREMENT,
    at      INTEGER NOT NULL,
    actor   TEXT    NOT NULL,
    address TEXT    NOT NULL,
    method  TEXT    NOT NULL,
    target  TEXT    NOT NULL,
    status  INTEGER NOT NULL,
    made    TEXT
) STRICT;
CREATE TABLE tracked_experiment (
    id         INTEGER PRIMARY KEY AUTOINCREMENT,
    name       TEXT    NOT NULL UNIQUE,
    is_deleted INTEGER NOT NULL DEFAULT 0 CHECK (is_deleted IN (0, 1)),
    created_at INTEGER NOT NULL,
    updated_at INTEGER NOT NULL
, deleted_at INTEGER, purge_at INTEGER) STRICT;
INSERT INTO tracked_experiment VALUES(0,'Default',0,1795738207000,1795738207000,NULL,NULL);
INSERT INTO tracked_experiment VALUES(1,'torqued',0,1795738207000,1795738207000,NULL,NULL);
CREATE TABLE tracked_experiment_tag (
    experiment INTEGER NOT NULL REFERENCES tracked_experiment (id) ON DELETE CASCADE,
    key        TEXT    NOT NULL,
    value      TEXT    NOT NULL,
    PRIMARY KEY (experiment, key)
) STRICT, WITHOUT ROWID;
CREATE TABLE tracked_run (
    id         INTEGER PRIMARY KEY AUTOINCREMENT,
    identifier TEXT    NOT NULL UNIQUE,
    experiment INTEGER NOT NULL REFERENCES tracked_experiment (id) ON DELETE CASCADE,
    name       TEXT    NOT NULL,
    user_name  TEXT    NOT NULL,
    status     TEXT    NOT NULL
        CHECK (status IN ('RUNNING', 'SCHEDULED', 'FINISHED', 'FAILED', 'KILLED')),
    start_time INTEGER NOT NULL,
    end_time   INTEGER,
    is_deleted INTEGER NOT NULL DEFAULT 0 CHECK (is_deleted IN (0, 1)),
    created_at INTEGER NOT NULL
, deleted_at INTEGER, purge_at INTEGER) STRICT;
CREATE TABLE tracked_param (
    run   INTEGER NOT NULL REFERENCES tracked_run (id) ON DELETE CASCADE,
    key   TEXT    NOT NULL,
    value TEXT    NOT NULL,
    PRIMARY KEY (run, key)
) STRICT, WITHOUT ROWID;
CREATE TABLE tracked_tag (
    run   INTEGER NOT NULL REFERENCES tracked_run (id) ON DELETE CASCADE,
    key   TEXT    NOT NULL,
    value TEXT    NOT NULL,
    PRIMARY KEY (run, key)
) STRICT, WITHOUT ROWID;
CREATE TABLE tracked_metric (
    run    INTEGER NOT NULL REFERENCES tracked_run (id) ON DELETE CASCADE,
    key    TEXT    NOT NULL,
    step   INTEGER NOT NULL,
    time   INTEGER NOT NULL,
    value  REAL    NOT NULL,
    is_nan INTEGER NOT NULL CHECK (is_nan IN (0, 1)),
    PRIMARY KEY (run, key, step, time, value, is_nan)
) STRICT, WITHOUT ROWID;
CREATE TABLE tracked_metric_latest (
    run    INTEGER NOT NULL REFERENCES tracked_run (id) ON DELETE CASCADE,
    key    TEXT    NOT NULL,
    step   INTEGER NOT NULL,
    time   INTEGER NOT NULL,
    value  REAL    NOT NULL,
    is_nan INTEGER NOT NULL CHECK (is_nan IN (0, 1)),
    PRIMARY KEY (run, key)
) STRICT, WITHOUT ROWID;
CREATE TABLE tracked_artifact (
    run        INTEGER NOT NULL REFERENCES tracked_run (id) ON DELETE CASCADE,
    name       TEXT    NOT NULL,
    path       TEXT    NOT NULL UNIQUE,
    size       INTEGER NOT NULL,
    sha256     TEXT    NOT NULL,
    created_at INTEGER NOT NULL,
    PRIMARY KEY (run, name)
) STRICT, WITHOUT ROWID;
CREATE TABLE job_tag (
    job INTEGER NOT NULL REFERENCES job (id) ON DELETE CASCADE,
    tag TEXT    NOT NULL,
    PRIMARY KEY (job, tag)
) STRICT, WITHOUT ROWID;
CREATE TABLE run_tag (
    run INTEGER NOT NULL REFERENCES run (id) ON DELETE CASCADE,
    tag TEXT    NOT NULL,
    PRIMARY KEY (run, tag)
) STRICT, WITHOUT ROWID;
CREATE TABLE dataset_tag (
    dataset INTEGER NOT NULL REFERENCES dataset (id) ON DELETE CASCADE,
    tag     TEXT    NOT NULL,
    PRIMARY KEY (dataset, tag)
) STRICT, WITHOUT ROWID;
CREATE TABLE checkpoint_tag (
    checkpoint INTEGER NOT NULL REFERENCES checkpoint (id) ON DELETE CASCADE,
    tag        TEXT    NOT NULL,
    PRIMARY KEY (checkpoint, tag)
) STRICT, WITHOUT ROWID;
CREATE TABLE job_input (
    job    INTEGER NOT NULL REFERENCES job (id) ON DELETE CASCADE,
    digest TEXT    NOT NULL,
    PRIMARY KEY (job, digest)
) STRICT, WITHOUT ROWID;
CREATE TABLE metric_extremes (
    run        INTEGER NOT NULL REFERENCES run (id) ON DELETE CASCADE,
    key        TEXT    NOT NULL,
    span       INTEGER NOT NULL,
    points     INTEGER NOT NULL,
    low_step   INTEGER NOT NULL,
    low_time   INTEGER NOT NULL,
    low_value  REAL,
    high_step  INTEGER NOT NULL,
    high_time  INTEGER NOT NULL,
    high_value REAL,
    PRIMARY KEY (run, key, span)
) STRICT, WITHOUT ROWID;
CREATE TABLE purged_attempts (
    kind    TEXT    NOT NULL,
    outcome TEXT    NOT NULL,
    number  INTEGER NOT NULL,
    PRIMARY KEY (kind, outcome)
) STRICT, WITHOUT ROWID;
CREATE TABLE IF NOT EXISTS "event" (
    id   INTEGER PRIMARY KEY,
    at   INTEGER NOT NULL,
    kind TEXT    NOT NULL CHECK (kind IN ('start', 'job', 'task', 'metrics', 'checkpoint', 'deletion')),
    job  INTEGER,
    data TEXT    NOT NULL
) STRICT;
INSERT INTO event VALUES(1795738207000,1795738207000,'start',NULL,'{}');
CREATE TABLE _sqlx_migrations (
    version BIGINT PRIMARY KEY,
    description TEXT NOT NULL,
    installed_on TIMESTAMP NOT NULL DEFAULT CURRENT_TIMESTAMP,
    success BOOLEAN NOT NULL,
    checksum BLOB NOT NULL,
    execution_time BIGINT NOT NULL
);
INSERT INTO _sqlx_migrations VALUES(1,'initial','2026-11-25 02:51:52',1,X'bc05f6bda284159d61967d4c6d40e118e6dcdf3fd0099b31c663f1e340006f9b15288b3488dcfddd888ca0ea0052cbb4',1000000);
INSERT INTO _sqlx_migrations VALUES(2,'forgiving_queue','2026-11-25 02:51:52',1,X'1d9b6c9a683e5ecdc6f8941ab8dd7e9b05858b560ccfdc0a5b6585f3b21beee82b9353e9664797d39f06a2ecd8ca20ab',1000000);
INSERT INTO _sqlx_migrations VALUES(3,'identity','2026-11-25 02:51:52',1,X'f736af6e65b1df04a5e80f488dad531128fcf5068ae391db2accd67572e9e012ba14be072ca0f49b8b67bb93a16120bd',1000000);
INSERT INTO _sqlx_migrations VALUES(4,'logs','2026-11-25 02:51:52',1,X'1fe23bb7b821cf25c74ad2d8075bf28206819c4fdcebe61cdf69d0aed92c571e3e0e1bd8f55135ee025371772baab947',1000000);
INSERT INTO _sqlx_migrations VALUES(5,'resources','2026-11-25 02:51:52',1,X'c10cf5050c9db68e34be223caa62896528370d359a8bb52b117a0e765808410a4aba41eac263148e9a74e52faa68bc39',1000000);
INSERT INTO _sqlx_migrations VALUES(6,'task_states','2026-11-25 02:51:52',1,X'b0d416bee384444e757e3b2e33a26e4ac93f29b67c814abe42c8cdbc2cf76ac9e4f200a627c07bdc283eff2f95220bec',1000000);
INSERT INTO _sqlx_migrations VALUES(7,'placements','2026-11-25 02:51:52',1,X'06a7ab144510e4fcd29a0a226c477de09d8f83d50f23243750c7b5cb50935e370784c2ad32dd4508ddad7378e42037c4',1000000);
INSERT INTO _sqlx_migrations VALUES(8,'access','2026-11-25 02:51:52',1,X'b2880c4fed7405eaabd0fa072f565bac48ab1386b4d22732af9404bd0fe5725dca2c2a683141170f2a1df082b4f5dfb0',1000000);
INSERT INTO _sqlx_migrations VALUES(9,'tracked_runs','2026-11-25 02:51:52',1,X'faaaf3dc8fcbbee3e97d047c57e70e5d89d000c48c33243798a950cc803e822c816f6832f16197319e993a802fd8eaa2',1000000);
INSERT INTO _sqlx_migrations VALUES(10,'events','2026-11-25 02:51:52',1,X'7c05fd0307057588bcb97ecbb888fec6dfc6e35ac0a7602c21cf4a2b8d23c914128825a1e70b3057b5cef91689c9d21c',1000000);
INSERT INTO _sqlx_migrations VALUES(11,'labels','2026-11-25 02:51:52',1,X'74811e833b3fcf27eb0e90f89686f3272646e4c328b106ba4a3f366d5b53af57c633ca5ffd9fce8bd19dc2bc9e928443',1000000);
INSERT INTO _sqlx_migrations VALUES(12,'trash','2026-11-25 02:51:52',1,X'cb37170b03962b1bdd05869b9c8b37180c16ae711746d566b60ba3f1829aa1f45dd6cf4767dd0b479dc53ec65124ed1a',1000000);
INSERT INTO _sqlx_migrations VALUES(14,'metric_extremes','2026-11-25 02:51:52',1,X'20d43b8f0a7a13b6c204aa0bebb1da528f244c97e3e5c8e459d749704553e31cbf08496bfe555c032039b02ad55a78c3',1000000);
INSERT INTO _sqlx_migrations VALUES(15,'purged_attempts','2026-11-25 02:51:52',1,X'd84770c292431daeb2c9f6e64a9c931ec987ee3f23c71fab48cb2f18199a6fde89d855db4352a3c539873d378549eaa1',1000000);
INSERT INTO _sqlx_migrations VALUES(16,'deletion_events','2026-11-25 02:51:52',1,X'a5b4f8949b440df79e1136df225e8bb720f009b16c06fc15bbaa9754cd813dfb40b68633c6732e95294c18504e5efb01',1000000);
DELETE FROM sqlite_sequence;
INSERT INTO sqlite_sequence VALUES('resources',1);
INSERT INTO sqlite_sequence VALUES('tracked_experiment',1);
INSERT INTO sqlite_sequence VALUES('job',1);
INSERT INTO sqlite_sequence VALUES('task',1);
CREATE INDEX job_by_digest ON job (digest, id);
CREATE INDEX job_by_state ON job (state, id);
CREATE INDEX job_by_kind ON job (kind, id);
CREATE INDEX experiment ON job (id) WHERE is_part = 0;
CREATE INDEX experiment_by_state ON job (state, id) WHERE is_part = 0;
CREATE TRIGGER job_final_states_never_change
BEFORE UPDATE OF state ON job
WHEN OLD.state IN ('succeeded', 'failed', 'cancelled') AND NEW.state <> OLD.state
BEGIN
    SELECT RAISE(ABORT, 'the state of a finished job never changes');
END;
CREATE INDEX job_need_by_needed ON job_need (needs);
CREATE INDEX pipeline_member_by_job ON pipeline_member (job);
CREATE INDEX task_leased ON task (lease_until) WHERE state = 'running';
CREATE TRIGGER task_final_states_never_change
BEFORE UPDATE OF state ON task
WHEN OLD.state IN ('succeeded', 'failed', 'cancelled') AND NEW.state <> OLD.state
BEGIN
    SELECT RAISE(ABORT, 'the state of a finished task never changes');
END;
CREATE INDEX dataset_by_digest ON dataset (digest, id);
CREATE UNIQUE INDEX checkpoint_best ON checkpoint (job) WHERE is_best = 1;
CREATE INDEX attempt_by_job ON attempt (job, id);
CREATE INDEX attempt_running ON attempt (job) WHERE ended_at IS NULL;
CREATE INDEX attempt_logged ON attempt (job, id) WHERE log_bytes IS NOT NULL;
CREATE INDEX attempt_log_by_job ON attempt_log (job, id, attempt);
CREATE INDEX job_open ON job (waits_since) WHERE state NOT IN ('succeeded', 'failed', 'cancelled');
CREATE INDEX task_to_claim ON task (resources, turn, id, run_at, not_before, state) WHERE state = 'queued';
CREATE INDEX task_by_state ON task (job, state, stage);
CREATE INDEX attempt_by_worker ON attempt (worker, id);
CREATE UNIQUE INDEX token_name ON token (name) WHERE revoked_at IS NULL;
CREATE INDEX tracked_run_by_experiment ON tracked_run (experiment, id);
CREATE INDEX job_not_folded ON job (id) WHERE searched IS NULL;
CREATE INDEX job_by_tag ON job_tag (tag, job);
CREATE INDEX run_by_tag ON run_tag (tag, run);
CREATE INDEX dataset_by_tag ON dataset_tag (tag, dataset);
CREATE INDEX checkpoint_by_tag ON checkpoint_tag (tag, checkpoint);
CREATE INDEX job_by_name ON job (COALESCE(given_name, name), id);
CREATE INDEX job_by_finish ON job (COALESCE(finished_at, 9223372036854775807), id);
CREATE INDEX job_by_priority ON job (priority, id);
CREATE INDEX dataset_by_trajectories ON dataset (trajectories, id);
CREATE INDEX checkpoint_by_step ON checkpoint (step, id);
CREATE INDEX job_deleted ON job (deleted_at) WHERE deleted_at IS NOT NULL;
CREATE INDEX run_deleted ON run (deleted_at) WHERE deleted_at IS NOT NULL;
CREATE INDEX dataset_deleted ON dataset (deleted_at) WHERE deleted_at IS NOT NULL;
CREATE INDEX checkpoint_deleted ON checkpoint (deleted_at) WHERE deleted_at IS NOT NULL;
CREATE INDEX checkpoint_by_run ON checkpoint (run);
CREATE INDEX shard_by_task ON shard (task);
CREATE INDEX idempotency_key_by_job ON idempotency_key (job);
CREATE INDEX job_input_by_digest ON job_input (digest, job);
CREATE TRIGGER job_tells AFTER UPDATE OF state, cancel_requested ON job
WHEN NEW.state <> OLD.state OR NEW.cancel_requested <> OLD.cancel_requested
BEGIN
    INSERT INTO event (at, kind, job, data) VALUES (
        CAST(unixepoch('subsec') * 1000 AS INTEGER), 'job', NEW.id,
        json_object(
            'kind', NEW.kind, 'name', NEW.name, 'state', NEW.state, 'error', NEW.error,
            'cancel_requested', json(iif(NEW.cancel_requested, 'true', 'false'))
        )
    );
END;
CREATE TRIGGER task_tells AFTER UPDATE OF state ON task
WHEN NEW.state <> OLD.state AND 'running' IN (NEW.state, OLD.state)
BEGIN
    INSERT INTO event (at, kind, job, data) VALUES (
        CAST(unixepoch('subsec') * 1000 AS INTEGER), 'task', NEW.job,
        json_object(
            'task', NEW.id, 'label', NEW.label, 'state', NEW.state, 'attempt', NEW.attempt,
            'worker', NEW.worker, 'error', NEW.error
        )
    );
END;
CREATE TRIGGER job_deletion_tells AFTER UPDATE OF deleted_at, purged_at ON job
WHEN (NEW.deleted_at IS NULL) <> (OLD.deleted_at IS NULL) OR (NEW.purged_at IS NULL) <> (OLD.purged_at IS NULL)
BEGIN
    INSERT INTO event (at, kind, job, data) VALUES (
        CAST(unixepoch('subsec') * 1000 AS INTEGER), 'deletion', NEW.id,
        json_object(
            'item', 'job', 'item_id', NEW.id,
            'change', iif(NEW.purged_at IS NOT NULL, 'purged', iif(NEW.deleted_at IS NULL, 'restored', 'deleted'))
        )
    );
END;
CREATE TRIGGER run_deletion_tells AFTER UPDATE OF deleted_at, purged_at ON run
WHEN (NEW.deleted_at IS NULL) <> (OLD.deleted_at IS NULL) OR (NEW.purged_at IS NULL) <> (OLD.purged_at IS NULL)
BEGIN
    INSERT INTO event (at, kind, job, data) VALUES (
        CAST(unixepoch('subsec') * 1000 AS INTEGER), 'deletion', NEW.job,
        json_object(
            'item', 'run', 'item_id', NEW.id,
            'change', iif(NEW.purged_at IS NOT NULL, 'purged', iif(NEW.deleted_at IS NULL, 'restored', 'deleted'))
        )
    );
END;
CREATE TRIGGER dataset_deletion_tells AFTER UPDATE OF deleted_at, purged_at ON dataset
WHEN (NEW.deleted_at IS NULL) <> (OLD.deleted_at IS NULL) OR (NEW.purged_at IS NULL) <> (OLD.purged_at IS NULL)
BEGIN
    INSERT INTO event (at, kind, job, data) VALUES (
        CAST(unixepoch('subsec') * 1000 AS INTEGER), 'deletion', NEW.job,
        json_object(
            'item', 'dataset', 'item_id', NEW.id,
            'change', iif(NEW.purged_at IS NOT NULL, 'purged', iif(NEW.deleted_at IS NULL, 'restored', 'deleted'))
        )
    );
END;
CREATE TRIGGER checkpoint_deletion_tells AFTER UPDATE OF deleted_at, purged_at ON checkpoint
WHEN (NEW.deleted_at IS NULL) <> (OLD.deleted_at IS NULL) OR (NEW.purged_at IS NULL) <> (OLD.purged_at IS NULL)
BEGIN
    INSERT INTO event (at, kind, job, data) VALUES (
        CAST(unixepoch('subsec') * 1000 AS INTEGER), 'deletion', NEW.job,
        json_object(
            'item', 'checkpoint', 'item_id', NEW.id,
            'change', iif(NEW.purged_at IS NOT NULL, 'purged', iif(NEW.deleted_at IS NULL, 'restored', 'deleted'))
        )
    );
END;
COMMIT;
