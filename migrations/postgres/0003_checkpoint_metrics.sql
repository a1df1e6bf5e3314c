-- JSON text, kept as it was written: JSONB writes numbers such as 1e16 in other digits.
ALTER TABLE checkpoint ALTER COLUMN metrics TYPE TEXT USING CAST(metrics AS TEXT);
