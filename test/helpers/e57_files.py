# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""E57 files as libE57 writes them, and the same with other words in their XML."""

import struct
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pye57 import libe57

Fields = Mapping[str, NDArray[Any]]

PAGE, SUM = 1024, 4  # bytes of a page, and of the checksum at its end
POLYNOMIAL = 0x82F63B78  # CRC-32C


def write_e57(path: Path, scans: Sequence[Fields], poses: Sequence[Sequence[float]] = ()) -> Path:
    """Write scans; a pose is a quaternion w, x, y, z, and a place; whole numbers are integers."""
    file = libe57.ImageFile(str(path), 'w')
    file.extensionsAdd('', libe57.E57_V1_0_URI)
    file.extensionsAdd('nor', 'http://www.libe57.org/E57_NOR_surface_normals.txt')
    root, data = file.root(), libe57.VectorNode(file, True)  # noqa: FBT003  scans may differ
    root.set('formatName', libe57.StringNode(file, 'ASTM E57 3D Imaging Data File'))
    root.set('guid', libe57.StringNode(file, '{0}'))
    root.set('versionMajor', libe57.IntegerNode(file, 1))
    root.set('versionMinor', libe57.IntegerNode(file, 0))
    root.set('data3D', data)
    for number, fields in enumerate(scans):
        scan = libe57.StructureNode(file)
        scan.set('guid', libe57.StringNode(file, f'{{{number + 1}}}'))
        data.append(scan)
        for pose in poses[number : number + 1]:
            _set_pose(file, scan, pose)
        _set_points(file, scan, fields)
    file.close()
    return path


def _set_pose(file: Any, scan: Any, pose: Sequence[float]) -> None:
    node = libe57.StructureNode(file)
    scan.set('pose', node)
    for name, axes, values in (('rotation', 'wxyz', pose[:4]), ('translation', 'xyz', pose[4:])):
        part = libe57.StructureNode(file)
        node.set(name, part)
        for axis, value in zip(axes, values, strict=True):
            part.set(axis, libe57.FloatNode(file, value))


def _set_points(file: Any, scan: Any, fields: Fields) -> None:
    prototype = libe57.StructureNode(file)
    buffers = libe57.VectorSourceDestBuffer()
    count = len(next(iter(fields.values())))
    kept = []
    for name, values in fields.items():
        is_float = values.dtype.kind == 'f'
        column = values.astype(np.float64 if is_float else np.longlong)
        kept.append(column)
        prototype.set(
            name,
            libe57.FloatNode(file, 0.0, libe57.E57_DOUBLE, -1e9, 1e9)
            if is_float
            else libe57.IntegerNode(file, int(column[0]), int(column.min()), int(column.max())),
        )
        buffers.append(libe57.SourceDestBuffer(file, name, column, count, True, True))  # noqa: FBT003
    codecs = libe57.VectorNode(file, True)  # noqa: FBT003  they may differ
    points = libe57.CompressedVectorNode(file, prototype, codecs)
    scan.set('points', points)
    writer = points.writer(buffers)
    writer.write(count)
    writer.close()


def reworded(data: bytes, old: bytes, new: bytes) -> bytes:
    """Put other words into the XML at the end of a file; lengths and checksums are right again."""
    plain = b''.join(data[begin : begin + PAGE - SUM] for begin in range(0, len(data), PAGE))
    _, place, size, _ = struct.unpack('<4Q', plain[16:48])
    begin = place // PAGE * (PAGE - SUM) + place % PAGE
    xml = plain[begin : begin + size]
    assert xml.count(old) == 1
    xml = xml.replace(old, new)
    pages = -(-(begin + len(xml)) // (PAGE - SUM))
    head = struct.pack('<4Q', pages * PAGE, place, len(xml), PAGE)
    plain = (plain[:16] + head + plain[48:begin] + xml).ljust(pages * (PAGE - SUM), b'\0')
    parts = (plain[i * (PAGE - SUM) :][: PAGE - SUM] for i in range(pages))
    return b''.join(part + _checksum(part).to_bytes(SUM, 'big') for part in parts)


def _checksum(page: bytes) -> int:
    rest = 0xFFFFFFFF
    for byte in page:
        rest ^= byte
        for _ in range(8):
            rest = rest >> 1 ^ POLYNOMIAL * (rest & 1)
    return rest ^ 0xFFFFFFFF
