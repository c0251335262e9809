"""A table that grows on the disk: a folder of Parquet files, as readers of data sets accept it, each with the rows after those before it.

A run that is killed leaves readable files. When it is resumed, the rows from its snapshot on are removed, and come again.
"""

from pathlib import Path

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from orchard.folders import write_whole

MOST_ROWS = 50_000  # of a file; the newest is written again until it has as many
# Columns of numbers that seldom come again: their bytes compress better in planes.
PLANES = ("x", "y", "yaw", "measured_x", "measured_y", "odometry_x", "odometry_y", "odometry_yaw")


def write_table(path: Path, table: pa.Table) -> None:
    """Write a table in place of an old one, wholly or not at all. Raises OSError."""
    sink = pa.BufferOutputStream()
    others = [name for name in table.column_names if name not in PLANES]
    planes = {name: "BYTE_STREAM_SPLIT" for name in table.column_names if name in PLANES}
    pq.write_table(table, sink, compression="zstd", use_dictionary=others, column_encoding=planes)
    write_whole(path, sink.getvalue().to_pybytes())


class GrowingTable:
    """One table of a run. Its rows come in the order of their column `tick`."""

    def __init__(self, folder: Path, schema: pa.Schema, until: int) -> None:
        """Rows from tick `until` on are of an earlier attempt, and are removed. Raises OSError."""
        self.schema, self._folder = schema, folder
        folder.mkdir(parents=True, exist_ok=True)
        for torn in folder.glob("*.new"):  # of a program that was killed while it wrote
            torn.unlink()
        self._remove_from(until)
        self._number = max((int(part.stem) for part in files_of(folder)), default=0) + 1
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
        """Leave a file without rows if there is none, so that the table has its columns. Raises OSError."""
        if not files_of(self._folder):
            write_table(self._part(self._number), self._newest)

    def _part(self, number: int) -> Path:
        return self._folder / f"{number:06d}.parquet"

    def _remove_from(self, until: int) -> None:
        for part in reversed(files_of(self._folder)):
            rows = pq.read_table(part)
            early = rows.filter(pc.field("tick") < until)
            if len(early) == len(rows) > 0:
                return
            if len(early):
                write_table(part, early.replace_schema_metadata(self.schema.metadata))
            else:
                part.unlink()


def files_of(table: Path) -> list[Path]:
    """Return the files of a table, in the order of their rows: itself, or those in its folder."""
    return [table] if table.is_file() else sorted(table.glob("*.parquet"))
