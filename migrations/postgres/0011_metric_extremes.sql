-- The lowest and the highest point of every 64 steps of a metric, so that a curve of a million points is drawn from a few
-- thousand rows. A value that is not a number is NULL; it is the lowest.

CREATE TABLE metric_extremes (
    run        BIGINT  NOT NULL REFERENCES run (id) ON DELETE CASCADE,
    key        TEXT COLLATE "C" NOT NULL,
    -- The number of the steps: 0 is 0 to 63.
    span       BIGINT  NOT NULL,
    points     BIGINT  NOT NULL,
    low_step   BIGINT  NOT NULL,
    low_time   BIGINT  NOT NULL,
    low_value  DOUBLE PRECISION,
    high_step  BIGINT  NOT NULL,
    high_time  BIGINT  NOT NULL,
    high_value DOUBLE PRECISION,
    PRIMARY KEY (run, key, span)
);

INSERT INTO metric_extremes
    (run, key, span, points, low_step, low_time, low_value, high_step, high_time, high_value)
SELECT run, key, span, COUNT(*),
       MAX(CASE WHEN from_lowest = 1 THEN step END),
       MAX(CASE WHEN from_lowest = 1 THEN time END),
       MAX(CASE WHEN from_lowest = 1 THEN value END),
       MAX(CASE WHEN from_highest = 1 THEN step END),
       MAX(CASE WHEN from_highest = 1 THEN time END),
       MAX(CASE WHEN from_highest = 1 THEN value END)
FROM (SELECT run, key, step / 64 AS span, step, time, value,
             ROW_NUMBER() OVER (PARTITION BY run, key, step / 64 ORDER BY value NULLS FIRST, step)
                 AS from_lowest,
             ROW_NUMBER() OVER (PARTITION BY run, key, step / 64 ORDER BY value DESC NULLS LAST, step)
                 AS from_highest
      FROM metric) AS ranked
GROUP BY run, key, span;
