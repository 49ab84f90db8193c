# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A table of an SQLite database; the verdict becomes a table of its own beside it."""

import errno
import sqlite3
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, suppress
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidar_outlier_filter.disk.sqlite_pages import connect, damage_of, open_logs
from lidar_outlier_filter.errors import CloudError
from lidar_outlier_filter.files.cloud_file import CHUNK_ROWS, Change, CloudFile, parse_number

VERDICT = '_verdict'  # behind the name of the table
ROW_ID = 'rowid'
_STORED = {0, 3}  # hidden flags of PRAGMA table_xinfo: stored columns, computed and stored ones
_SHOWN = 40  # letters of a quoted value
_TYPES = {'f': 'REAL', 'u': 'INTEGER', 'i': 'INTEGER'}


class SqliteFile(CloudFile):
    """A table of an SQLite database; see :class:`CloudFile`."""

    whole = 'the verdict on a table is a table of its own'

    def __init__(self, path: Path, table: str | None = None) -> None:
        self.path = path
        for log in open_logs(path):
            must_be = 'closed by its writer'
            raise CloudError(f'the database {path}', must_be, f'changes in {log.name}')
        if wrong := damage_of(path):
            raise CloudError(f'the database {path}', 'whole', f'"{wrong}"')
        with closing(connect(path)) as database:
            self.table = _choose(database, path, table)
            about = database.execute(f'PRAGMA table_xinfo({_quoted(self.table)})').fetchall()
            # Columns that an expression in the file computes on reading are not read.
            stored = [column for column in about if column[-1] in _STORED]
            if ROW_ID in {column[1].lower() for column in about}:
                must_be = f'without {ROW_ID}, which SQLite numbers the rows by'
                raise CloudError(f'the columns of table {self.table!r}', must_be, ROW_ID)
            count = f'SELECT count(*) FROM {_quoted(self.table)}'  # noqa: S608  quoted
            self._count: int = database.execute(count).fetchone()[0]
            requested = ', '.join(_quoted(column[1]) for column in stored)
            first = self._select(database, requested, 'LIMIT 1').fetchone()
        self.columns: Mapping[str, np.dtype[Any]] = {
            name: np.dtype(
                np.int64 if 'INT' in kind.upper() or isinstance(value, int) else np.float64
            )
            for (_, name, kind, *_), value in zip(stored, first or (), strict=False)
            if value is None or _number(value) is not None
        }

    def read(self, names: Sequence[str]) -> Iterator[tuple[NDArray[Any], ...]]:
        """Read columns chunk by chunk, in the order of the row ids; NULL is missing."""
        requested = ', '.join(_quoted(name) for name in names)
        with closing(connect(self.path)) as database:
            # Row by row, as every text may be as long as the file.
            rows = (
                tuple(map(self._number, names, row)) for row in self._select(database, requested)
            )
            while chunk := list(islice(rows, CHUNK_ROWS)):
                yield tuple(_column(values) for values in zip(*chunk, strict=True))

    def _number(self, name: str, value: Any) -> float | None:
        """Turn a value into a number, whatever its column was declared to be; None: it is NULL."""
        number = _number(value)
        if number is None and value is not None:
            what = f'column {name!r} of table {self.table!r}'
            raise CloudError(what, 'of numbers', repr(value[:_SHOWN]))
        return number

    def _select(
        self, database: sqlite3.Connection, requested: str, limit: str = ''
    ) -> sqlite3.Cursor:
        """Select columns in the order of the row ids."""
        return database.execute(
            f'SELECT {requested} FROM {_quoted(self.table)} ORDER BY {ROW_ID} {limit}'  # noqa: S608  quoted
        )

    def copy(self, path: Path, change: Change) -> Iterator[int]:
        """Copy the database and add the table with the verdict: a row for each, by its row id."""
        name, done = _quoted(self.table + VERDICT), 0
        columns = ''.join(
            f', {_quoted(key)} {_TYPES[values.dtype.kind]}' for key, values in change.added.items()
        )
        insert = f'INSERT INTO {name} VALUES (?{", ?" * len(change.added)})'  # noqa: S608  quoted
        try:
            with closing(connect(self.path)) as source, closing(sqlite3.connect(path)) as target:
                source.backup(target)
                with target:
                    target.execute(f'CREATE TABLE {name} (row_id INTEGER PRIMARY KEY{columns})')
                    ids = self._select(source, ROW_ID)
                    while rows := ids.fetchmany(CHUNK_ROWS):
                        part = slice(done, done + len(rows))
                        added = [values[part].tolist() for values in change.added.values()]
                        numbers = (row[0] for row in rows)
                        target.executemany(insert, zip(numbers, *added, strict=True))
                        done = part.stop
                        yield done
        except sqlite3.OperationalError as err:  # the database that is read is whole
            raise OSError(errno.EIO, str(err)) from err


def _choose(database: sqlite3.Connection, path: Path, requested: str | None) -> str:
    # Virtual tables, whose rows a module makes, have no page.
    of_rows = "SELECT name FROM sqlite_schema WHERE type = 'table' AND rootpage > 0"
    found = database.execute(of_rows)
    names = [name for (name,) in found if not name.startswith('sqlite_')]
    if requested is None and len(names) == 1:
        requested = names[0]
    if requested is None or requested not in names:
        got = 'none' if requested is None else repr(requested)
        raise CloudError(f'the table of {path}', f'one of {", ".join(names) or "none"}', got)
    if requested + VERDICT in names:
        must_be = f'without {requested + VERDICT}, which is to be made'
        raise CloudError(f'the tables of {path}', must_be, ', '.join(names))
    return requested


def _column(values: Sequence[float | None]) -> NDArray[Any]:
    """Turn numbers, None for NULL, into a column."""
    missing = np.array([value is None for value in values])
    numbers = np.array([0 if value is None else value for value in values])
    if numbers.dtype.kind == 'f':
        numbers[missing] = np.nan
    elif missing.any():
        return np.ma.MaskedArray(numbers, missing)
    return numbers


def _number(value: Any) -> float | None:
    """Return a number, even if it was stored as text; None for anything else."""
    if isinstance(value, int | float):
        return value
    if not isinstance(value, str):
        return None
    with suppress(ValueError):
        number = parse_number(value)
        with suppress(ValueError):
            if -(2**63) <= (whole := int(value)) < 2**63:
                return whole
        return number
    return None


def _quoted(name: str) -> str:
    return '"' + name.replace('"', '""') + '"'
