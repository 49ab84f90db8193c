# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Open an SQLite database read-only; find out whether it is complete."""

import sqlite3
from contextlib import closing
from pathlib import Path

_MAGIC = b'SQLite format 3\0'
_MIN_LIMIT = 2**20  # bytes of a value; SQLite's own words must fit


def open_logs(path: Path) -> list[Path]:
    """List the logs beside a database that its writer did not close.

    In a log for writing ahead are rows that the database lacks; by a journal, SQLite takes back
    rows that were not committed. Where a journal is kept for the next writer its head is zero.
    """
    found = []
    for ending in ('-wal', '-journal'):
        log = path.with_name(path.name + ending)
        if log.is_file():
            with log.open('rb') as stream:
                if stream.read(1).strip(b'\0'):
                    found.append(log)
    return found


def damage_of(path: Path) -> str:
    """Describe the damage of a database; empty: it is complete, or SQLite refuses to open it.

    SQLite reads a file whose last page was cut off as if zeros followed.
    """
    with path.open('rb') as stream:
        head = stream.read(len(_MAGIC) + 2)
    page = int.from_bytes(head[-2:], 'big')
    page = 65536 if page == 1 else page
    if not head.startswith(_MAGIC):
        return ''
    if path.stat().st_size % max(page, 1):
        return f'an end within a page of {page} bytes'
    try:
        with closing(connect(path)) as database:
            database.text_factory = bytes
            # A check in the file is an expression by its author.
            database.execute('PRAGMA ignore_check_constraints = ON')
            (found,) = database.execute('PRAGMA quick_check(1)').fetchone()
    except UnicodeDecodeError:  # names of tables in a sentence of SQLite
        return 'names that are not text'
    except sqlite3.DatabaseError as err:
        return str(err)
    return '' if found == b'ok' else ' '.join(found.decode('latin-1').split())


def connect(path: Path) -> sqlite3.Connection:
    """Open a database read-only, so that SQLite creates no file beside it.

    No value is longer than the file, unless an expression in the file makes it: that is refused.
    """
    database = sqlite3.connect(f'{path.resolve().as_uri()}?mode=ro&immutable=1', uri=True)
    database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, max(path.stat().st_size, _MIN_LIMIT))
    database.execute('PRAGMA trusted_schema = OFF')
    return database
