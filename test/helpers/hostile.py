# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Strategies for clouds and files, legal and broken, and what must hold for each of them."""

import sqlite3
import struct
from contextlib import closing
from pathlib import Path
from time import perf_counter
from typing import Any

import lzf
import numpy as np
import pyarrow as pa
from hypothesis import strategies as st
from pyarrow import parquet

from helpers.cloud_files import write_las
from helpers.clouds import STORE, point_bytes
from helpers.e57_files import write_e57
from lidar_outlier_filter.errors import CloudError
from lidar_outlier_filter.files import cloud_file
from lidar_outlier_filter.files.cloud_file import Change, copy_suffix, open_cloud
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.pipeline.library import CloudFilter

TYPES = STORE.types
SIZES = {1: 1, 2: 1, 3: 2, 4: 2, 5: 4, 6: 4, 7: 4, 8: 8}
NAMES = ('x', 'y', 'z', 'time', 't', 'timestamp', 'ring', 'intensity', 'score', 'label', '', 'é')
WILD = (0, 1, 2, 3, 255, 2**15, 2**16, 2**31 - 1, 2**31, 2**32 - 1)
SLOW = 10.0  # seconds: nothing so small may take so long
SETTINGS = {'chain': ('sor',), 'block': 0.02, 'halo': 0.0, 'threads': 1}

# Clouds -------------------------------------------------------------------------------------------


@st.composite
def legal_clouds(draw: st.DrawFn) -> Any:
    """Draw a cloud that its own fields describe: any order, type, count, gap, padding, endianness.

    The bytes are anything: NaN, infinities and wild times among them.
    """
    names = ['x', 'y', 'z', *draw(st.lists(st.sampled_from(NAMES[3:]), max_size=4, unique=True))]
    fields, offset = [], draw(st.integers(0, 5))
    for name in draw(st.permutations(names)):
        kind = (
            draw(st.sampled_from((7, 8))) if name in 'xyz' else draw(st.sampled_from(list(SIZES)))
        )
        count = 1 if name in 'xyz' else draw(st.sampled_from((1, 1, 1, 3)))
        fields.append([name, offset, kind, count])
        offset += SIZES[kind] * count + draw(st.integers(0, 3))
    height, width = draw(st.sampled_from(((1, 0), (0, 3), (1, 1), (1, 20), (4, 5), (1, 60))))
    row = width * offset + draw(st.sampled_from((0, 0, 7)))
    data = draw(st.integers(0, 2**32 - 1))
    return message(fields, (height, width, offset, row), data, is_big=draw(st.booleans()))


def message(
    fields: list[list[Any]], shape: tuple[int, int, int, int], seed: int, *, is_big: bool = False
) -> Any:
    """Make a message of fields and of height, width, size of a point and size of a row."""
    height, width, step, row = shape
    rng = np.random.default_rng(seed)
    data = rng.integers(0, 256, height * row, np.uint8)
    if seed % 3:  # small numbers, as of a sensor
        for name, offset, kind, _ in fields:
            if kind in {7, 8} and name in {'x', 'y', 'z'}:
                for i in range(height * width):
                    at = i // width * row + i % width * step + offset
                    text = ('>' if is_big else '<') + ('f' if kind == 7 else 'd')
                    raw = struct.pack(text, rng.normal())
                    data[at : at + len(raw)] = np.frombuffer(raw, np.uint8)
    point_field, header = TYPES['sensor_msgs/msg/PointField'], TYPES['std_msgs/msg/Header']
    stamp = TYPES['builtin_interfaces/msg/Time'](seed % 1000, seed % 10**9)
    return TYPES['sensor_msgs/msg/PointCloud2'](
        header=header(stamp=stamp, frame_id='lidar'),
        height=height,
        width=width,
        fields=[point_field(name, at, kind, count) for name, at, kind, count in fields],
        is_bigendian=is_big,
        point_step=step,
        row_step=row,
        data=data,
        is_dense=bool(seed % 2),
    )


@st.composite
def broken_clouds(draw: st.DrawFn) -> Any:
    """Draw a cloud of which something is not true: a size, an offset, a type, a name, a stamp."""
    cloud = draw(legal_clouds())
    for _ in range(draw(st.integers(1, 3))):
        what = draw(
            st.sampled_from(('size', 'field', 'name', 'data', 'stamp', 'fields', 'overlap'))
        )
        if what == 'size':
            name = draw(st.sampled_from(('height', 'width', 'point_step', 'row_step')))
            setattr(cloud, name, draw(st.sampled_from(WILD)))
        elif what == 'field' and cloud.fields:
            one = draw(st.sampled_from(cloud.fields))
            setattr(one, draw(st.sampled_from(('offset', 'count'))), draw(st.sampled_from(WILD)))
        elif what == 'name' and cloud.fields:
            one = draw(st.sampled_from(cloud.fields))
            one.name = draw(st.sampled_from((*NAMES, 'z\n', '\x1b[2J')))
            one.datatype = draw(st.integers(0, 255))
        elif what == 'data':
            cloud.data = cloud.data[: draw(st.integers(0, max(1, len(cloud.data))))]
        elif what == 'stamp':
            cloud.header.stamp.sec = draw(st.integers(-(2**31), 2**31 - 1))
            cloud.header.stamp.nanosec = draw(st.sampled_from(WILD))
        elif what == 'fields':
            cloud.fields = draw(st.lists(st.sampled_from(cloud.fields or [None]), max_size=3))
            cloud.fields = [one for one in cloud.fields if one is not None]
        elif cloud.fields:
            draw(st.sampled_from(cloud.fields)).offset = 0
    return cloud


def judge(cloud: Any) -> bool:
    """Filter a cloud; every point comes out once, or the cloud is refused in one sentence.

    Return whether it was processed.
    """
    begin = perf_counter()
    stream = CloudFilter(FilterParameters().changed(SETTINGS))
    try:
        results = [*stream.push(cloud), *stream.flush()]
    except CloudError as err:
        assert str(err).isprintable()  # noqa: PT017  either is right
        assert ' must be ' in str(err)  # noqa: PT017
        return False
    finally:
        assert perf_counter() - begin < SLOW
    if not results:
        assert stream.statistics.refusals
        return False
    (result,) = results
    parts = [rows for one in (result.cleaned, result.outliers) for rows in point_bytes(one)]
    assert sorted(parts) == sorted(point_bytes(cloud))
    return True


# Files --------------------------------------------------------------------------------------------

COUNT = 40
FORMATS = (
    'las',
    'laz',
    'pcd ascii',
    'pcd binary',
    'pcd binary_compressed',
    'ply ascii',
    'ply binary_little_endian',
    'ply binary_big_endian',
    'ptx',
    'e57',
    'csv',
    'parquet',
    'db',
)


def whole_file(kind: str, path: Path) -> None:
    """Write a small cloud that is right in every byte."""
    name, _, form = kind.partition(' ')
    rows = np.random.default_rng(1).normal(size=(COUNT, 3)).astype(np.float32)
    text = '\n'.join(' '.join(map(str, row)) for row in rows.tolist()).encode() + b'\n'
    if name in {'las', 'laz'}:
        x, y, z = (rows * 1000).T
        write_las(path, COUNT, record='note', X=x, Y=y, Z=z)
    elif name == 'pcd':
        head = f'FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH {COUNT}\nHEIGHT 1\n'
        body = text if form == 'ascii' else rows.tobytes()
        if form == 'binary_compressed':
            columns = rows.T.tobytes()
            packed = lzf.compress(columns, 2 * len(columns))
            body = struct.pack('<II', len(packed), len(columns)) + packed
        path.write_bytes(f'{head}POINTS {COUNT}\nDATA {form}\n'.encode() + body)
    elif name == 'ply':
        order = '>' if 'big' in form else '<'
        body, faces = text, b'3 0 1 2\n'
        if form != 'ascii':
            body, faces = (
                rows.astype(order + 'f4').tobytes(),
                struct.pack(order + 'B3i', 3, 0, 1, 2),
            )
        properties = ''.join(f'property float {axis}\n' for axis in 'xyz')
        head = f'ply\nformat {form} 1.0\nelement vertex {COUNT}\n{properties}element face 1\n'
        head += 'property list uchar int vertex_indices\nend_header\n'
        path.write_bytes(head.encode() + body + faces)
    elif name == 'ptx':
        grid = (
            b'%d\n%d\n' + b'0 0 0\n1 0 0\n0 1 0\n0 0 1\n' + b'1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n'
        )
        half = COUNT // 2
        lines = text.replace(b'\n', b' 0.25\n').splitlines(keepends=True)
        parts = (b''.join(lines[:half]), b''.join(lines[half:]))
        path.write_bytes(b''.join(grid % (half // 5, 5) + part for part in parts))
    elif name == 'e57':
        names = (f'cartesian{axis}' for axis in 'XYZ')
        write_e57(path, [dict(zip(names, rows.T, strict=True))])
    elif name == 'csv':
        path.write_bytes(b'x y z\n' + text)
    elif name == 'parquet':
        parquet.write_table(pa.table(dict(zip('xyz', rows.T, strict=True))), path)
    else:
        with closing(sqlite3.connect(path)) as database, database:
            database.execute('CREATE TABLE t (x REAL, y REAL, z REAL)')
            database.executemany('INSERT INTO t VALUES (?, ?, ?)', rows.tolist())


def broken(data: bytes, seed: int) -> bytes:
    """Break a file: flip bytes, put in wild numbers or words, cut, repeat or leave out a part."""
    rng = np.random.default_rng(seed)
    made = bytearray(data)
    for _ in range(int(rng.integers(1, 4))):
        # Headers are what is believed.
        high = len(made) if rng.random() < 0.4 else min(len(made), 400)
        at = int(rng.integers(0, max(1, high)))
        way = int(rng.integers(0, 7))
        if way == 0:
            made[at : at + 1] = bytes([int(rng.integers(256))])
        elif way == 1:
            size = int(rng.choice([1, 2, 4, 8]))
            number = int(rng.choice(np.array(WILD, np.int64))) % 256**size
            made[at : at + size] = number.to_bytes(size, 'little')
        elif way == 2:
            made[at : at + 8] = b'\xff' * 8
        elif way == 3:
            del made[at:]
        elif way == 4:
            del made[at : at + int(rng.integers(1, 30))]
        elif way == 5:
            made[at:at] = made[at : at + int(rng.integers(1, 60))]
        else:
            words = (b'-3', b'99999999999', b'nan', b'element q 9', b'1e999', b'\n', b'"', b'\0')
            made[at : at + 1] = words[int(rng.integers(len(words)))]
    return bytes(made)


def read_and_copy(path: Path, target: Path) -> bool:
    """Read all of a file, copy it, and read the copy; or it is refused in one sentence.

    Return whether it was read.
    """
    begin = perf_counter()
    target = target.with_suffix(copy_suffix(path))
    try:
        table = 't' if path.suffix == '.db' else None
        file = open_cloud(path, table)
        for _ in cloud_file.read(file, list(file.columns), exact=True):
            pass
        for _ in cloud_file.copy(file, target, Change()):
            pass
        if table is None:  # a verdict there already is refused
            assert len(open_cloud(target)) == len(file)
    except CloudError as err:
        assert str(err).isprintable()  # noqa: PT017  either is right
        assert ' must be ' in str(err)  # noqa: PT017
        return False
    finally:
        target.unlink(missing_ok=True)
        assert perf_counter() - begin < SLOW
    return True
