# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What can be read of a damaged database of ROS 2: every row whose pages are there.

SQLite reads nothing behind a lost page of its tree. Here each page is read by itself, as SQLite's
file format describes it: a leaf of a table has its rows in cells, the rest of a long row is in a
list of overflow pages. Rows are known by their columns, so that no tree is needed.
"""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Any, BinaryIO, NamedTuple

from rosbags.interfaces import (
    Connection,
    ConnectionExtRosbag2,
    MessageDefinition,
    MessageDefinitionFormat,
)
from rosbags.rosbag2.metadata import parse_qos

from lidar_outlier_filter.disk.sqlite_pages import check_pages
from lidar_outlier_filter.errors import RecordingError

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from lidar_outlier_filter.recordings.salvage.losses import Losses

_HEADER = 100  # bytes of the file, before the first page's own
_LEAF = 13  # kind of a page: leaf of a table
_TEXT, _BLOB = 13, 12  # types of columns: these and every second number above
FORMATS = {'ros2msg': MessageDefinitionFormat.MSG, 'ros2idl': MessageDefinitionFormat.IDL}
_MOST_COLUMNS = 6  # of the tables of a bag


class _Cell(NamedTuple):
    """A row: its number, its bytes here, how many there are, and its first overflow page or 0."""

    row: int
    local: bytes
    size: int
    overflow: int


class _Message(NamedTuple):
    """A row of the messages: its topic and time, its cell's offset, and where its data begin."""

    topic: int
    time: int
    page: int
    offset: int
    begin: int


class DamagedDatabase:
    """A database of messages that may be damaged anywhere.

    ``connections`` are those of its topics that are known; ``expected`` is 0, for it does not say
    how many messages it has.
    """

    def __init__(self, path: Path, largest: int, losses: Losses) -> None:
        """Read all pages, and count what is lost; rows of more than ``largest`` bytes are."""
        self.path, self._largest, self._losses = path, largest, losses
        self.expected = 0
        self._topics: dict[int, tuple[Any, ...]] = {}
        self._definitions: dict[str, MessageDefinition] = {}
        self._rows: dict[int, _Message] = {}
        self._used = bytearray()  # by how many rows each overflow page is used: none, one, or more
        with path.open('rb') as stream:
            self._measure(stream.read(_HEADER))
            self._used = bytearray(self._pages + 1)
            for page in range(1, self._pages + 1):
                for offset, cell in self._cells(stream, page):
                    self._learn(stream, page, offset, cell)
            self._drop_broken(stream)
        self.connections = list(self._connections())
        self._count_losses()

    def messages(self) -> Iterator[tuple[int, int, bytes]]:
        """Read the topic, bag time and bytes of each message, in the order of the rows."""
        known = {connection.id for connection in self.connections}
        with self.path.open('rb') as stream:
            for _, message in sorted(self._rows.items()):
                if message.topic in known:
                    cell = self._cell(self._read(stream, message.page), message.offset)
                    data = cell.local + b''.join(
                        data for _, data in self._overflow(stream, cell, with_data=True)
                    )
                    yield message.topic, message.time, data[message.begin :]

    def _measure(self, header: bytes) -> None:
        """Take the sizes of pages from the header; where it is lost, the usual ones."""
        page = int.from_bytes(header[16:18], 'big')
        page = 65536 if page == 1 else page
        is_usual = page < 512 or page & (page - 1) != 0  # noqa: PLR2004  the least that SQLite allows
        self._page = 4096 if is_usual else page
        self._usable = self._page - (0 if is_usual else header[20])
        self._pages = self.path.stat().st_size // self._page

    def _read(self, stream: BinaryIO, page: int) -> bytes:
        stream.seek((page - 1) * self._page)
        return stream.read(self._page)

    def _cells(self, stream: BinaryIO, page: int) -> Iterator[tuple[int, _Cell]]:
        """Read the cells of a page, with their offsets; of a page that is no leaf, none."""
        data = self._read(stream, page)
        begin = _HEADER if page == 1 else 0
        if data[begin] != _LEAF:
            return
        count = int.from_bytes(data[begin + 3 : begin + 5], 'big')
        for i in range(count):
            at = begin + 8 + 2 * i
            offset = int.from_bytes(data[at : at + 2], 'big')
            if at + 2 <= self._usable and begin + 8 <= offset < self._usable:
                try:
                    yield offset, self._cell(data, offset)
                except IndexError:
                    self._lose(f'row {i} of page {page} ends behind the page', 1)

    def _cell(self, data: bytes, offset: int) -> _Cell:
        """Read the cell at an offset of a page."""
        size, offset = _varint(data, offset)
        row, offset = _varint(data, offset)
        local = size
        if size > self._usable - 35:
            least = (self._usable - 12) * 32 // 255 - 23
            local = least + (size - least) % (self._usable - 4)
            local = local if local <= self._usable - 35 else least
        end = offset + local + (4 if local < size else 0)
        if end > self._usable:
            raise IndexError
        overflow = int.from_bytes(data[offset + local : end], 'big')
        return _Cell(row, data[offset : offset + local], size, overflow)

    def _overflow(
        self, stream: BinaryIO, cell: _Cell, *, with_data: bool
    ) -> Iterator[tuple[int, bytes]]:
        """Follow the overflow pages of a row: their numbers and data; break off where one lacks."""
        left, page = cell.size - len(cell.local), cell.overflow
        while left > 0 and 1 <= page <= self._pages:
            stream.seek((page - 1) * self._page)
            following = int.from_bytes(stream.read(4), 'big')
            take = min(left, self._usable - 4)
            yield page, stream.read(take) if with_data else b''
            left, page = left - take, following
        if left > 0 or page:
            raise RecordingError('the pages of a row', 'whole', 'another page')

    def _learn(self, stream: BinaryIO, page: int, offset: int, cell: _Cell) -> None:
        """Note a message, a topic or the definition of a type; other rows are of other tables."""
        if cell.size > self._largest:
            self._lose(f'a row of {cell.size} bytes in page {page}', 1)
            return
        try:
            columns, begin = _columns(cell.local)
        except (IndexError, UnicodeDecodeError):  # longer than a page: a topic or a definition
            try:
                data = cell.local + b''.join(self._claimed(stream, cell, with_data=True))
                columns, begin = _columns(data)
            except (IndexError, UnicodeDecodeError, RecordingError):
                self._lose(f'row {cell.row} of page {page} is damaged', 0)
                return
        match columns:
            case (None | int(), int(topic), int(time), memoryview()):
                self._rows.setdefault(cell.row, _Message(topic, time, page, offset, begin))
            case (None | int(), str(name), str(form), str(text), str()) if form in FORMATS:
                self._definitions[name] = MessageDefinition(FORMATS[form], text)
            case (None | int(), str(), str(), str(), *_):
                self._topics.setdefault(cell.row, tuple(columns[1:]))

    def _drop_broken(self, stream: BinaryIO) -> None:
        """Drop the messages whose overflow pages are not there, or belong to several rows."""
        broken = set()
        for row in self._rows:
            try:
                for _ in self._claimed(stream, self._cell_of(stream, row), with_data=False):
                    pass
            except RecordingError:
                broken.add(row)
        for row in list(self._rows):
            # Those that came first do not know yet that another row has their pages, too.
            if row in broken or not self._alone(stream, row):
                del self._rows[row]
                self._lose(f'row {row} has lost pages', 1)

    def _claimed(self, stream: BinaryIO, cell: _Cell, *, with_data: bool) -> Iterator[bytes]:
        """Read the overflow pages of a row up to one that another row has.

        So all rows together visit each page twice at most, however their lists run into each other.
        """
        for page, data in self._overflow(stream, cell, with_data=with_data):
            if self._used[page]:
                self._used[page] = 2
                raise RecordingError('the pages of a row', 'its own', 'those of another row')
            self._used[page] = 1
            yield data

    def _alone(self, stream: BinaryIO, row: int) -> bool:
        """Return whether no other row has a page of a row whose pages are all there."""
        pages = self._overflow(stream, self._cell_of(stream, row), with_data=False)
        return all(self._used[page] == 1 for page, _ in pages)

    def _cell_of(self, stream: BinaryIO, row: int) -> _Cell:
        message = self._rows[row]
        return self._cell(self._read(stream, message.page), message.offset)

    def _lose(self, reason: str, messages: int) -> None:
        self._losses.add(f'{self.path.name}: {reason}', messages=messages)

    def _connections(self) -> Iterator[Connection]:
        """Make the connections of all topics that are known; the messages of others are lost."""
        counts = Counter(message.topic for message in self._rows.values())
        for number, columns in self._topics.items():
            name, msgtype, form, *more = columns
            definition = self._definitions.get(
                msgtype, MessageDefinition(MessageDefinitionFormat.NONE, '')
            )
            try:
                extension = ConnectionExtRosbag2(form, parse_qos(more[0] if more else ''))
            except Exception:  # noqa: BLE001  on damaged text, the parser raises anything
                extension = ConnectionExtRosbag2(form, [])
                self._lose(f'the quality of service of {name} is damaged', 0)
            digest = more[1] if len(more) > 1 else ''
            owner: Any = self
            yield Connection(
                number, name, msgtype, definition, digest, counts[number], extension, owner
            )
        for number in counts.keys() - self._topics.keys():
            self._lose(f'nothing says what topic {number} is', counts[number])

    def _count_losses(self) -> None:
        """Say what SQLite says of the file; if it is damaged, missing rows are counted, too."""
        try:
            check_pages(self.path, lambda wrong: RecordingError('the pages', 'whole', wrong))
        except RecordingError as err:
            with self.path.open('rb') as stream:
                pages = int.from_bytes(stream.read(_HEADER)[28:32], 'big')
            lost = max(0, pages * self._page - self.path.stat().st_size)
            # A recorder numbers its rows without a gap.
            missing = max(self._rows, default=0) - len(self._rows)
            counted = self._losses.messages
            self._losses.add(f'{self.path.name}: {err}', size=lost)
            self._losses.messages = max(counted, missing)


def _varint(data: bytes, offset: int) -> tuple[int, int]:
    """Read a number of one to nine bytes; return it and the offset behind it."""
    number = 0
    for i in range(8):
        byte = data[offset + i]
        number = number << 7 | byte & 127
        if byte < 128:  # noqa: PLR2004  the last one
            return number, offset + i + 1
    return number << 8 | data[offset + 8], offset + 9


def _columns(data: bytes) -> tuple[list[Any], int]:
    """Read the columns of a row up to the first blob, which is left where it is.

    Return them, and where the last one begins.
    """
    head, offset = _varint(data, 0)
    kinds: list[int] = []
    while offset < head and len(kinds) <= _MOST_COLUMNS:
        kind, offset = _varint(data, offset)
        kinds.append(kind)
    columns: list[Any] = []
    offset = head
    for kind in kinds:
        size = _size(kind)
        if kind >= _BLOB and kind % 2 == 0:
            columns.append(memoryview(b''))
            break
        part = data[offset : offset + size]
        if len(part) < size:
            raise IndexError
        if kind >= _TEXT:
            columns.append(part.decode())
        elif kind == 7:  # noqa: PLR2004  a float, which no table of a bag has
            columns.append(0.0)
        else:
            columns.append(None if kind == 0 else _whole(kind, part))
        offset += size
    return columns, offset


def _size(kind: int) -> int:
    """Return how many bytes a column of a kind has."""
    if kind >= _BLOB:
        return (kind - _BLOB) // 2
    return (0, 1, 2, 3, 4, 6, 8, 8, 0, 0, 0, 0)[kind]


def _whole(kind: int, part: bytes) -> int:
    """Read a whole number; two kinds are a number without a byte."""
    return kind - 8 if kind in {8, 9} else int.from_bytes(part, 'big', signed=True)
