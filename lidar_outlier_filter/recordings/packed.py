# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Bags of ROS 2 whose files are compressed as a whole: unpacked to a folder, within a bound.

rosbags unpacks such files to the end of the disk. They are unpacked here, to at most ``MOST_TIMES``
their size or the largest message that is allowed, whichever is more.
"""

from __future__ import annotations

from contextlib import contextmanager
from pathlib import Path, PurePath
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import yaml

from lidar_outlier_filter.errors import RecordingError, said_by
from lidar_outlier_filter.recordings.storage import read_metadata
from lidar_outlier_filter.recordings.unpack import decompressor

if TYPE_CHECKING:
    from collections.abc import Iterator

    from lidar_outlier_filter.recordings.remote_path import RecordingPath

MOST_TIMES = 100  # the size of a compressed file
_PART = 2**20  # bytes read, and unpacked, at once


@contextmanager
def unpacked(path: RecordingPath, largest: int) -> Iterator[RecordingPath]:
    """Give a recording as it is, or a folder with its files where they are packed as a whole.

    Raises
    ------
    RecordingError
        If a file cannot be unpacked, or unpacks to more than is allowed.

    """
    bag = read_metadata(path)
    if not is_packed(bag):
        yield path
        return
    with TemporaryDirectory() as name:
        folder = Path(name)
        for file in bag['relative_file_paths']:
            source = path / PurePath(file).name
            if wrong := unpack_file(source, folder / source.stem, largest):
                raise RecordingError(f'the file {source}', 'readable', f'"{wrong}"')
        names = [PurePath(file).stem for file in bag['relative_file_paths']]
        plain = {'relative_file_paths': names, 'compression_mode': '', 'compression_format': ''}
        text = yaml.safe_dump({'rosbag2_bagfile_information': bag | plain})
        (folder / 'metadata.yaml').write_text(text, 'utf-8')
        yield folder


def is_packed(bag: dict[str, Any]) -> bool:
    """Return whether metadata say that the files of their bag are compressed as we can unpack."""
    mode, form = bag.get('compression_mode'), bag.get('compression_format')
    return isinstance(mode, str) and mode.lower() == 'file' and form == 'zstd'


def unpack_file(source: RecordingPath, target: Path, largest: int) -> str:
    """Unpack a file as far as it can be; return what is wrong with the rest, or an empty text."""
    left = max(MOST_TIMES * source.stat().st_size, largest)
    frame = decompressor('zstd')
    data, whole = b'', False  # whether the last frame has ended
    with source.open('rb') as stream, target.open('wb') as out:
        while True:
            if not data and frame.needs_input and not (data := stream.read(_PART)):
                return '' if whole else 'its end within a frame'
            try:
                part = frame.decompress(data, _PART)
            except Exception as err:  # noqa: BLE001  of several versions of the library
                return said_by(err).strip('"')
            left -= len(part)
            if left < 0:
                return f'more than {MOST_TIMES} times its size when it is unpacked'
            try:
                out.write(part)
            except OSError as err:  # of the disk, not of the recording
                raise RecordingError(f'the file {target}', 'written in full', said_by(err)) from err
            data, whole = b'', frame.eof
            if whole:
                data, frame = frame.unused_data, decompressor('zstd')
