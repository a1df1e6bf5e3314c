"""Writes long_names.parquet: a recording with a name of 4 MiB in each of 1000 rows.

With a dictionary and zstd the file has kilobytes, and decoding it takes gigabytes. Run it with pyarrow 21 or later.
It has no other dependencies.

    python tests/data/long_names.py tests/data/long_names.parquet
"""

import sys

import pyarrow as pa
import pyarrow.parquet as pq

ROWS, NAME_BYTES = 1000, 4 << 20


def main(path):
    names = pa.DictionaryArray.from_arrays(pa.array([0] * ROWS, pa.int32()), ["x" * NAME_BYTES])
    columns = {"arm": names, "t": pa.array([k / 60 for k in range(ROWS)])}
    for name in [f"{prefix}{joint}" for prefix in ("tau_", "pos_") for joint in range(1, 8)]:
        columns[name] = pa.array([0.0] * ROWS, pa.float32())
    pq.write_table(pa.table(columns), path, compression="zstd", dictionary_pagesize_limit=1 << 26)


if __name__ == "__main__":
    main(sys.argv[1])
