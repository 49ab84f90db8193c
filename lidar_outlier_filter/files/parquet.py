# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Parquet files, through pyarrow: row group by row group, schema and metadata kept.

A value that is repeated, or a run of zeros, takes a few bytes of the file however often it comes.
A copy holds a row group in memory as a whole, to keep it; so one that becomes too large is refused.
"""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from pyarrow import parquet

from lidar_outlier_filter.errors import CloudError
from lidar_outlier_filter.files.cloud_file import (
    CHUNK_ROWS,
    Change,
    CloudFile,
    check_count,
    check_fits,
    check_names,
    readable,
)

MAX_GROUP_BYTES = 2**30  # bytes of a row group
MAX_ROW_BYTES = 2**10  # bytes: a group of so many rows may be larger
MAX_ROWS_PER_BYTE = 1000  # that a file may have: of grids that are flat and even there are 200
_ROWS = 512  # rows measured at once
_TEXT = 'BYTE_ARRAY'
_WIDTHS = {'BOOLEAN': 1, 'INT32': 4, 'INT64': 8, 'INT96': 12, 'FLOAT': 4, 'DOUBLE': 8, _TEXT: 4}


class ParquetFile(CloudFile):
    """A Parquet file; see :class:`CloudFile`."""

    def __init__(self, path: Path) -> None:
        self.path = path
        with path.open('rb') as stream, parquet.ParquetFile(stream) as file:
            self._schema = file.schema_arrow
            self._count = check_groups(path, file)
        check_names(path, self._schema.names)
        self.columns: Mapping[str, np.dtype[Any]] = {
            # With a time zone or without, a time is a number of nanoseconds.
            field.name: np.dtype(
                np.int64 if pa.types.is_timestamp(field.type) else field.type.to_pandas_dtype()
            )
            for field in self._schema
            if pa.types.is_integer(field.type)
            or pa.types.is_floating(field.type)
            or pa.types.is_timestamp(field.type)
        }

    def read(self, names: Sequence[str]) -> Iterator[tuple[NDArray[Any], ...]]:
        """Read columns chunk by chunk; null is missing."""
        with self.path.open('rb') as stream, parquet.ParquetFile(stream) as file:
            for batch in file.iter_batches(CHUNK_ROWS, columns=list(dict.fromkeys(names))):
                yield tuple(_numbers(batch.column(name)) for name in names)

    def copy(self, path: Path, change: Change) -> Iterator[int]:
        """Write a copy with the same row groups and compression."""
        schema = self._schema
        for name, values in change.added.items():
            schema = schema.append(pa.field(name, pa.from_numpy_dtype(values.dtype)))
        done = 0
        with (
            self.path.open('rb') as stream,
            parquet.ParquetFile(stream) as file,
            path.open('wb') as target,
            parquet.ParquetWriter(target, schema, **_properties(self.path, file)) as writer,
        ):
            for group in range(file.num_row_groups):
                with readable(self.path):
                    check_texts(self.path, file, group)
                    table = file.read_row_group(group)
                part = slice(done, done + len(table))
                for name, values in change.added.items():
                    table = table.append_column(name, pa.array(values[part]))
                if change.keep is not None:
                    table = table.filter(pa.array(change.keep[part]))
                writer.write_table(table.cast(schema), row_group_size=max(1, len(table)))
                done = part.stop
                yield done


def _numbers(column: Any) -> NDArray[Any]:
    if pa.types.is_timestamp(column.type):
        column = column.cast(pa.timestamp('ns', column.type.tz)).cast(pa.int64())
    if column.null_count and pa.types.is_integer(column.type):
        missing = column.is_null().to_numpy(zero_copy_only=False)
        return np.ma.MaskedArray(column.fill_null(0).to_numpy(zero_copy_only=False), missing)
    return np.asarray(column.to_numpy(zero_copy_only=False))


def _properties(path: Path, file: Any) -> dict[str, Any]:
    """Return the options of a writer for the compression and version of the file."""
    if file.num_row_groups == 0:
        return {}
    flat = [column.path for column in _columns(file) if not column.max_repetition_level]
    with readable(path):  # as in check_groups, which has read the repeated columns
        next(file.iter_batches(1, row_groups=[0], columns=flat), None)
    group = file.metadata.row_group(0)
    columns = (group.column(i) for i in range(group.num_columns))
    compression = {
        one.path_in_schema: one.compression.replace('UNCOMPRESSED', 'NONE') for one in columns
    }
    return {'compression': compression, 'version': file.metadata.format_version}


def check_groups(path: Path, file: parquet.ParquetFile) -> int:
    """Count the rows; refuse more, or larger row groups, than a file of its size can mean."""
    metadata = file.metadata
    groups = [metadata.row_group(number) for number in range(metadata.num_row_groups)]
    if (fewest := min((group.num_rows for group in groups), default=0)) < 0:
        raise CloudError(f'the points in a part of {path}', 'at least 0', fewest)
    check_count(path, metadata.num_rows, sum(group.num_rows for group in groups))
    most = MAX_ROWS_PER_BYTE * path.stat().st_size
    check_fits(path, 'the number of points', metadata.num_rows, 1, most)
    # pyarrow aborts at the metadata of a damaged column, and raises where it reads it, which takes
    # little memory here. Only a repeated column has more values than there are rows.
    columns = _columns(file)
    if repeated := [column.path for column in columns if column.max_repetition_level]:
        file.scan_contents(repeated)
    for number, group in enumerate(groups):
        total = group.total_byte_size
        for index, one in enumerate(columns):
            count = group.column(index).num_values if one.max_repetition_level else group.num_rows
            # The schema has the width of values of a fixed length.
            total += count * (_WIDTHS.get(one.physical_type) or one.length)
        _check_size(path, number, group.num_rows, total)
    return int(metadata.num_rows)


def _columns(file: parquet.ParquetFile) -> list[Any]:
    return [file.schema.column(index) for index in range(len(file.schema.names))]


def check_texts(path: Path, file: parquet.ParquetFile, number: int) -> None:
    """Refuse a row group whose texts, and other values of any length, become too large."""
    rows, total = file.metadata.row_group(number).num_rows, 0
    texts = [column.path for column in _columns(file) if column.physical_type == _TEXT]
    # Few at once: one that is repeated may be as long as the file.
    for batch in file.iter_batches(_ROWS, row_groups=[number], columns=texts) if texts else ():
        # The values of a dictionary are held once.
        held = (c.indices if pa.types.is_dictionary(c.type) else c for c in batch.columns)
        total += sum(column.nbytes for column in held)
        _check_size(path, number, rows, total)


def _check_size(path: Path, number: int, rows: int, total: int) -> None:
    most = max(MAX_GROUP_BYTES, MAX_ROW_BYTES * rows)
    if total > most:
        what = f'the bytes that row group {number} of {path} unpacks to'
        raise CloudError(what, f'at most {most}', f'{total} or more')
