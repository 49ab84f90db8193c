# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""PLY files: ascii and binary of both byte orders.

The element ``vertex``, which must be the first, is read; everything behind it is copied unchanged.
No library is used: plyfile's licence is the GPL, and meshio, trimesh and Open3D keep only the
properties that they know.
"""

import shutil
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from lidar_outlier_filter.errors import CloudError
from lidar_outlier_filter.files.cloud_file import Change, check_fits, check_names, parse_count
from lidar_outlier_filter.files.rows import (
    BinaryRows,
    RowFile,
    TextRows,
    read_header,
    single_numbers,
)

_NAMES = {
    'i1': ('char', 'int8'),
    'u1': ('uchar', 'uint8'),
    'i2': ('short', 'int16'),
    'u2': ('ushort', 'uint16'),
    'i4': ('int', 'int32'),
    'u4': ('uint', 'uint32'),
    'f4': ('float', 'float32'),
    'f8': ('double', 'float64'),
}
_KINDS = {name: kind for kind, names in _NAMES.items() for name in names}
_ORDERS = {'ascii': '<', 'binary_little_endian': '<', 'binary_big_endian': '>'}


@dataclass
class _Element:
    """An element: how many, and the type words of each property; two for the lists."""

    name: str
    count: int
    properties: dict[str, list[str]] = field(default_factory=dict)

    @property
    def has_lists(self) -> bool:
        return any(len(words) > 1 for words in self.properties.values())

    @property
    def names_vertices(self) -> bool:
        return self.count > 0 and any(name.startswith('vert') for name in self.properties)

    @property
    def least(self) -> int:
        """Bytes of one at least, in binary: lists may be empty."""
        return sum(np.dtype(_KINDS[words[-1]]).itemsize for words in self.properties.values())

    def layout(self, order: str) -> np.dtype[np.void]:
        return np.dtype(
            [(name, order + _KINDS[words[0]]) for name, words in self.properties.items()]
        )


class PlyFile(RowFile):
    """A PLY file; see :class:`CloudFile`."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._size = path.stat().st_size
        with path.open('rb') as stream:
            self._header = read_header(
                stream,
                lambda line: line.strip() == b'ply',
                lambda line: line.strip() == b'end_header',
            )
            self._begin = stream.tell()
        self._format, self._elements = _parse(path, self._header)
        if not self._elements or self._elements[0].name != 'vertex':
            got = ', '.join(element.name for element in self._elements) or 'none'
            raise CloudError(f'the first element of {path}', 'vertex', got)
        self._vertex, *behind = self._elements
        self._count = self._vertex.count
        if not self._vertex.properties:
            raise CloudError(f'the element vertex of {path}', 'with properties', 'none')
        if self._vertex.has_lists:
            raise CloudError(f'the element vertex of {path}', 'without lists', 'a list')
        self._dtype = self._vertex.layout(_ORDERS[self._format])
        self.columns: Mapping[str, np.dtype[Any]] = single_numbers(self._dtype)
        names = [element.name for element in self._elements if element.names_vertices]
        self.whole = f'its elements {", ".join(names)} name vertices by number' if names else ''
        self._rows, self._end = self._find(behind)

    def _find(self, behind: Sequence[_Element]) -> tuple[BinaryRows | TextRows, int]:
        """Return the rows of the vertices, and where they end in the file."""
        if self._format == 'ascii':
            columns = {name: (i, kind) for i, (name, kind) in enumerate(self.columns.items())}
            width, is_last = len(self._vertex.properties), not behind
            lines = TextRows(self.path, self._begin, self._count, width, columns, is_last=is_last)
            return lines, lines.measure()[1]
        end = self._begin + self._dtype.itemsize * self._count
        least = sum(element.count * element.least for element in behind)
        # Lists behind the vertices may have any length.
        before = end if any(element.has_lists for element in behind) else self._size - least
        check_fits(self.path, 'the bytes of all elements', end + least, 1, self._size)
        return BinaryRows.map(self.path, self._begin, self._dtype, self._count, before), end

    def copy(self, path: Path, change: Change) -> Iterator[int]:
        """Write a copy, with every other element as it is."""
        yield from super().copy(path, change)
        with path.open('ab') as stream, self.path.open('rb') as source:
            source.seek(self._end)
            shutil.copyfileobj(source, stream)

    def _changed_header(self, change: Change) -> Iterator[bytes]:
        added = (
            f'property {_NAMES[values.dtype.str[1:]][0]} {name}'.encode()
            for name, values in change.added.items()
        )
        is_vertex = False
        for line in self._header:
            end = line[len(line.rstrip()) :]
            words = [*line.split(), b'']
            if is_vertex and words[0] not in {b'property', b'comment', b'obj_info'}:
                yield from (one + end for one in added)
                is_vertex = False
            if words[:2] == [b'element', b'vertex']:
                is_vertex = True
                line = b'element vertex %d' % change.count(self._count) + end  # noqa: PLW2901
            yield line


def header_of(count: int, kinds: Mapping[str, np.dtype[Any]]) -> bytes:
    """Make the header of a new binary file with so many points, and columns of these types."""
    named = ''.join(f'property {_NAMES[kind.str[1:]][0]} {name}\n' for name, kind in kinds.items())
    head = f'ply\nformat binary_little_endian 1.0\nelement vertex {count}\n{named}end_header\n'
    return head.encode()


def _parse(path: Path, header: Sequence[bytes]) -> tuple[str, list[_Element]]:
    """Read format and elements out of the lines of a header."""
    form, elements, size = '', list[_Element](), path.stat().st_size
    for line in header:
        match line.decode('latin-1').split():
            case ['format', word, _]:
                form = word
            case ['element', name, count]:
                elements.append(_Element(name, parse_count(path, f'the number of {name}', count)))
                check_fits(path, f'the number of {name}', elements[-1].count, 1, size)
            case ['property', 'list', length, kind, name] if elements:
                _add(path, elements[-1], name, [kind, length])
            case ['property', kind, name] if elements:
                _add(path, elements[-1], name, [kind])
            case ['property' | 'element' | 'format', *_]:
                must_be = 'of the words that the format has'
                raise CloudError(f'the header of {path}', must_be, repr(line.decode('latin-1')))
    if form not in _ORDERS:
        raise CloudError(f'the format of {path}', f'one of {", ".join(_ORDERS)}', repr(form))
    return form, elements


def _add(path: Path, element: _Element, name: str, words: list[str]) -> None:
    """Add a property to an element; of two words the second is the type of a list's length."""
    for word in words:
        if word not in _KINDS:
            raise CloudError(f'a type in {path}', f'one of {", ".join(_KINDS)}', repr(word))
    if len(words) > 1 and _KINDS[words[1]].startswith('f'):
        raise CloudError(f'the length of a list in {path}', 'a whole number', repr(words[1]))
    if name in element.properties:
        check_names(path, [name, name])
    element.properties[name] = words
