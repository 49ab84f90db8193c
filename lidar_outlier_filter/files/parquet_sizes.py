# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What the row groups of a Parquet file unpack to, before they are unpacked.

A value that is repeated, or a run of zeros, takes a few bytes of the file however often it comes.
A copy holds a row group in memory as a whole, to keep it; so one that becomes too large is refused.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from pyarrow import compute, parquet, types

from lidar_outlier_filter.errors import CloudError
from lidar_outlier_filter.files.size_check import check_fits

if TYPE_CHECKING:
    from pathlib import Path

LARGEST = 2**30  # bytes of a row group
OF_A_ROW = 2**10  # bytes: a group of so many rows may be larger
ROWS_OF_A_BYTE = 1000  # that a file may have: of grids that are flat and even there are 200
_ROWS = 65_536  # rows measured at once
_TEXT = 'BYTE_ARRAY'
_WIDTHS = {'BOOLEAN': 1, 'INT32': 4, 'INT64': 8, 'INT96': 12, 'FLOAT': 4, 'DOUBLE': 8, _TEXT: 4}


def check_groups(path: Path, file: parquet.ParquetFile) -> None:
    """Refuse more rows, or larger row groups, than a file of its size can mean."""
    size, metadata = path.stat().st_size, file.metadata
    check_fits(path, 'the number of points', metadata.num_rows, 1, ROWS_OF_A_BYTE * size)
    for number in range(metadata.num_row_groups):
        group = metadata.row_group(number)
        total = 0
        for index in range(group.num_columns):
            column = group.column(index)
            # Of values of a fixed length the schema says it.
            width = _WIDTHS.get(column.physical_type) or file.schema.column(index).length
            total += max(column.total_uncompressed_size, column.num_values * width)
        _check(path, number, group.num_rows, total)


def check_texts(path: Path, file: parquet.ParquetFile, number: int) -> None:
    """Refuse a row group whose texts, and other values of any length, become too large.

    Parameters
    ----------
    path : of the file
    file : opened with :func:`texts` as dictionaries, so that one that is repeated is held once
    number : of the row group

    """
    rows = file.metadata.row_group(number).num_rows
    total = 0
    for name in texts(file):
        for batch in file.iter_batches(_ROWS, row_groups=[number], columns=[name]):
            total += sum(_unpacked(column) for column in batch.columns)
            _check(path, number, rows, total)


def texts(file: parquet.ParquetFile) -> list[str]:
    """List the columns of values of any length, those within others too."""
    columns = [file.schema.column(index) for index in range(len(file.schema.names))]
    return [column.path for column in columns if column.physical_type == _TEXT]


def _check(path: Path, number: int, rows: int, total: int) -> None:
    most = max(LARGEST, OF_A_ROW * rows)
    if total > most:
        what = f'the bytes that row group {number} of {path} unpacks to'
        raise CloudError(what, f'at most {most}', f'{total} or more')


def _unpacked(column: Any) -> int:
    """Count the bytes of values that are held once each, if each were written out."""
    if types.is_dictionary(column.type):
        lengths = compute.binary_length(column.dictionary).to_numpy(zero_copy_only=False)
        indices = column.indices.drop_null().to_numpy()
        counts = np.bincount(indices, minlength=len(lengths))
        return int(counts @ np.nan_to_num(lengths).astype(np.int64))
    if types.is_struct(column.type):
        return sum(_unpacked(child) for child in column.flatten())
    if types.is_nested(column.type):
        return _unpacked(column.flatten())
    return int(column.nbytes)
