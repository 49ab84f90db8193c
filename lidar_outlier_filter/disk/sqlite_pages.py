# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Whether an SQLite database is whole: SQLite itself reads one that was cut off without a word."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

_MAGIC = b'SQLite format 3\0'
_HEADER = 100  # bytes
_SHORTEST_LIMIT = 2**20  # bytes of a value; SQLite's own words must fit


def check_pages(path: Path, refuse: Callable[[str], Exception]) -> None:
    """Refuse a database that has not all its pages, or whose pages do not fit together."""
    with path.open('rb') as stream:
        head = stream.read(_HEADER)
    if len(head) < _HEADER or not head.startswith(_MAGIC):
        return  # SQLite says so
    page = int.from_bytes(head[16:18], 'big')
    page = 65536 if page == 1 else page
    size, pages = path.stat().st_size, int.from_bytes(head[28:32], 'big')
    # Old versions of SQLite do not count the pages: the two numbers differ then.
    counted = head[24:28] == head[92:96] and pages > 0
    expected = page * pages if counted else size - size % max(1, page)
    if size != expected:
        raise refuse(f'{size} bytes instead of {expected}, as it says')
    with closing(connect(path)) as database:
        database.text_factory = bytes
        try:
            # A check that is stored in the file is an expression of who wrote it.
            database.execute('PRAGMA ignore_check_constraints = ON')
            (found,) = database.execute('PRAGMA quick_check(1)').fetchone()
        except UnicodeDecodeError as err:  # names of tables that are no text, in SQLite's sentence
            raise refuse('names that are no text') from err
        except sqlite3.DatabaseError as err:
            raise refuse(str(err)) from err
        if found != b'ok':
            raise refuse(' '.join(found.decode('latin-1').split()))


def connect(path: Path) -> sqlite3.Connection:
    """Open a database that nobody writes, so that SQLite puts no file beside it.

    No value is longer than the file, unless an expression in the file makes it: that is refused.
    """
    database = sqlite3.connect(f'{path.resolve().as_uri()}?mode=ro&immutable=1', uri=True)
    database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, max(path.stat().st_size, _SHORTEST_LIMIT))
    database.execute('PRAGMA trusted_schema = OFF')
    return database
