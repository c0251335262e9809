"""A table that grows on the disk: a folder of parts, each a whole Parquet file, which become one file at the end of the run.

A run that is killed leaves readable parts. When it is resumed, the rows from its snapshot on are removed, and come again.
"""

import shutil
from pathlib import Path

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from orchard.sim.disk import write_whole

MOST_ROWS = 50_000  # of a part; the newest part is written again until it has as many
# Columns of numbers that seldom come again: their bytes compress better in planes.
PLANES = ("x", "y", "yaw", "measured_x", "measured_y", "odometry_x", "odometry_y", "odometry_yaw")


def options(schema: pa.Schema) -> dict[str, object]:
    """Return how a table is written."""
    planes = [name for name in schema.names if name in PLANES]
    others = [name for name in schema.names if name not in planes]
    return {"compression": "zstd", "use_dictionary": others, "column_encoding": dict.fromkeys(planes, "BYTE_STREAM_SPLIT")}


def write_table(path: Path, table: pa.Table) -> None:
    """Write a table in place of an old one, wholly or not at all. Raises OSError."""
    sink = pa.BufferOutputStream()
    pq.write_table(table, sink, **options(table.schema))
    write_whole(path, sink.getvalue().to_pybytes())


class GrowingTable:
    """One table of a run. Its rows come in the order of their column `tick`."""

    def __init__(self, file: Path, schema: pa.Schema, until: int) -> None:
        """`file`: of the finished table. Rows from tick `until` on are of an earlier attempt, and are removed. Raises OSError."""
        self.file, self.schema, self._parts = file, schema, parts_of(file)
        if file.exists():
            shutil.rmtree(self._parts, ignore_errors=True)  # of a program that was killed when it had made one file of them
        self._parts.mkdir(parents=True, exist_ok=True)
        if file.exists():
            file.replace(self._part(0))
        self._remove_from(until)
        self._number = max((int(part.stem) for part in self._files), default=0) + 1
        self._newest = schema.empty_table()  # the rows of the newest part

    def add(self, rows: pa.Table) -> None:
        """Add rows, and write them to the disk. Raises OSError."""
        if not len(rows):
            return
        self._newest = pa.concat_tables([self._newest, rows])
        write_table(self._part(self._number), self._newest)
        if len(self._newest) >= MOST_ROWS:
            self._newest, self._number = self.schema.empty_table(), self._number + 1

    def finish(self) -> None:
        """Make one file of all parts. Raises OSError."""
        beside = self.file.with_suffix(".new")
        with pq.ParquetWriter(beside, self.schema, **options(self.schema)) as writer:
            writer.write_table(self.schema.empty_table())
            for part in self._files:
                writer.write_table(pq.read_table(part))
        beside.replace(self.file)
        shutil.rmtree(self._parts)

    @property
    def _files(self) -> list[Path]:
        return sorted(self._parts.glob("*.parquet"))

    def _part(self, number: int) -> Path:
        return self._parts / f"{number:06d}.parquet"

    def _remove_from(self, until: int) -> None:
        for part in reversed(self._files):
            rows = pq.read_table(part)
            early = rows.filter(pc.field("tick") < until)
            if len(early) == len(rows) > 0:
                return
            if len(early):
                write_table(part, early.replace_schema_metadata(self.schema.metadata))
            else:
                part.unlink()


def parts_of(file: Path) -> Path:
    """Return the folder of a table's parts while it grows."""
    return file.with_suffix(".parts")


def files_of(file: Path) -> list[Path]:
    """Return the existing files of a table, finished or not, in the order of their rows."""
    return [file] if file.exists() else sorted(parts_of(file).glob("*.parquet"))
