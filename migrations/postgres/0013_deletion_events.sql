-- Deletions tell, too.
ALTER TABLE event DROP CONSTRAINT event_kind_check;
ALTER TABLE event ADD CONSTRAINT event_kind_check
    CHECK (kind IN ('start', 'job', 'task', 'metrics', 'checkpoint', 'deletion'));

-- The argument is the column with the job.
CREATE FUNCTION deletion_tells() RETURNS trigger LANGUAGE plpgsql AS $$
BEGIN
    INSERT INTO event (at, kind, job, data) VALUES (
        CAST(EXTRACT(EPOCH FROM clock_timestamp()) * 1000 AS BIGINT), 'deletion',
        CAST(to_jsonb(NEW) ->> TG_ARGV[0] AS BIGINT),
        json_build_object(
            'item', TG_TABLE_NAME, 'item_id', NEW.id,
            'change', CASE WHEN NEW.purged_at IS NOT NULL THEN 'purged'
                           WHEN NEW.deleted_at IS NULL THEN 'restored'
                           ELSE 'deleted' END
        )
    );
    RETURN NULL;
END
$$;

CREATE TRIGGER deletion_tells AFTER UPDATE OF deleted_at, purged_at ON job FOR EACH ROW
WHEN ((NEW.deleted_at IS NULL) <> (OLD.deleted_at IS NULL) OR (NEW.purged_at IS NULL) <> (OLD.purged_at IS NULL))
EXECUTE FUNCTION deletion_tells('id');

CREATE TRIGGER deletion_tells AFTER UPDATE OF deleted_at, purged_at ON run FOR EACH ROW
WHEN ((NEW.deleted_at IS NULL) <> (OLD.deleted_at IS NULL) OR (NEW.purged_at IS NULL) <> (OLD.purged_at IS NULL))
EXECUTE FUNCTION deletion_tells('job');

CREATE TRIGGER deletion_tells AFTER UPDATE OF deleted_at, purged_at ON dataset FOR EACH ROW
WHEN ((NEW.deleted_at IS NULL) <> (OLD.deleted_at IS NULL) OR (NEW.purged_at IS NULL) <> (OLD.purged_at IS NULL))
EXECUTE FUNCTION deletion_tells('job');

CREATE TRIGGER deletion_tells AFTER UPDATE OF deleted_at, purged_at ON checkpoint FOR EACH ROW
WHEN ((NEW.deleted_at IS NULL) <> (OLD.deleted_at IS NULL) OR (NEW.purged_at IS NULL) <> (OLD.purged_at IS NULL))
EXECUTE FUNCTION deletion_tells('job');
