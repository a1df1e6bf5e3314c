"""Measures how fast pyarrow and polars write and read the trajectories of a file. Prints JSON.

    POLARS_MAX_THREADS=1 python tests/peers/parquet_rates.py trajectories-00000.parquet

pyarrow writes the trajectories with the settings of torqued's files and reads them back. Both use one thread. Every
time is the best of three, and writing ends when the file is on the disk.
"""

import argparse
import gc
import json
import os
import tempfile
import time
from pathlib import Path

import polars
import pyarrow
import pyarrow.parquet

REPETITIONS = 3
# The settings of store/src/parquet/layout.rs.
ROWS_PER_ROW_GROUP = 200_000
PAGE_SIZE = 64 * 1024


def seconds(action):
    """The best of several runs. The result of an action is dropped outside of its time."""
    best = float("inf")
    for _ in range(REPETITIONS):
        start = time.perf_counter()
        result = action()
        best = min(best, time.perf_counter() - start)
        del result
        gc.collect()
    return best


def write(table, file):
    encodings = {
        field.name: "BYTE_STREAM_SPLIT"
        if pyarrow.types.is_floating(field.type)
        else "DELTA_BINARY_PACKED"
        for field in table.schema
    }
    pyarrow.parquet.write_table(
        table,
        file,
        row_group_size=ROWS_PER_ROW_GROUP,
        data_page_size=PAGE_SIZE,
        compression="zstd",
        compression_level=1,
        use_dictionary=False,
        column_encoding=encodings,
        write_statistics=["trajectory", "step"],
    )
    with open(file, "rb") as written:
        os.fsync(written.fileno())


def read(file):
    return pyarrow.parquet.read_table(file, use_threads=False)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("file", metavar="FILE", type=Path)
    ours = parser.parse_args().file
    pyarrow.set_cpu_count(1)
    table = read(ours).combine_chunks()
    with tempfile.TemporaryDirectory(dir=ours.parent) as folder:
        theirs = Path(folder) / "pyarrow.parquet"
        result = {
            "pyarrow": pyarrow.__version__,
            "polars": polars.__version__,
            "pyarrow_write_s": seconds(lambda: write(table, theirs)),
            "pyarrow_read_s": seconds(lambda: read(theirs)),
            "file_bytes": theirs.stat().st_size,
            "pyarrow_read_ours_s": seconds(lambda: read(ours)),
            "polars_read_ours_s": seconds(lambda: polars.read_parquet(ours)),
        }
        assert read(theirs).equals(table), "pyarrow read back something else"
    assert polars.thread_pool_size() == 1, "polars has more threads: set POLARS_MAX_THREADS=1"
    print(json.dumps(result))


if __name__ == "__main__":
    main()
