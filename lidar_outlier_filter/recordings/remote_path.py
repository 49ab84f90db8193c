# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A recording on a store such as S3, as a path: bytes are read by ranges; the last are cached.

It has the methods of a path that rosbags and this package call, for any file system of fsspec.
The file system is given: this module imports none.
"""

from collections.abc import Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from types import SimpleNamespace
from typing import Any, BinaryIO, cast

from lidar_outlier_filter.errors import RecordingError, refusing

BLOCK = 4 * 2**20  # bytes of a range
BLOCKS = 8  # ranges that an open file keeps


def reached(address: object) -> AbstractContextManager[None]:
    """Refuse, in one sentence, an address that is missing, forbidden or not reached."""
    return refusing(RecordingError, f'the address {address}', 'reached')


def written(address: object) -> AbstractContextManager[None]:
    """Refuse, in one sentence, an output that could not be written to an address."""
    return refusing(RecordingError, f'the output {address}', 'written in full')


@dataclass(frozen=True)
class RemotePath:
    """A file or folder of ``system``, a file system of fsspec, under its ``key``.

    Any error of the file system becomes a :class:`RecordingError`.
    """

    system: Any
    key: str

    def __str__(self) -> str:
        """Return the address, such as ``s3://bucket/drive.mcap``."""
        return str(self.system.unstrip_protocol(self.key))

    def __truediv__(self, name: object) -> 'RemotePath':
        """Return the path of an entry of the folder."""
        return RemotePath(self.system, f'{self.key}/{name}')

    @property
    def name(self) -> str:
        """The last part."""
        return PurePosixPath(self.key).name

    @property
    def stem(self) -> str:
        """The last part without its suffix."""
        return PurePosixPath(self.key).stem

    @property
    def suffix(self) -> str:
        """The suffix of the last part."""
        return PurePosixPath(self.key).suffix

    @property
    def parent(self) -> 'RemotePath':
        """The folder that it lies in."""
        return RemotePath(self.system, str(PurePosixPath(self.key).parent))

    def with_name(self, name: str) -> 'RemotePath':
        """Return the path of another entry of its folder."""
        return RemotePath(self.system, str(PurePosixPath(self.key).with_name(name)))

    def exists(self) -> bool:
        """Return whether it exists."""
        with reached(self):
            return bool(self.system.exists(self.key))

    def is_dir(self) -> bool:
        """Return whether it is a folder."""
        with reached(self):
            return bool(self.system.isdir(self.key))

    def is_file(self) -> bool:
        """Return whether it is a file."""
        with reached(self):
            return bool(self.system.isfile(self.key))

    def iterdir(self) -> Iterator['RemotePath']:
        """List the entries of the folder."""
        with reached(self):
            keys = self.system.ls(self.key, detail=False)
        return (RemotePath(self.system, key) for key in keys)

    def glob(self, pattern: str) -> Iterator['RemotePath']:
        """List the entries of the folder that match a pattern."""
        return (path for path in self.iterdir() if PurePosixPath(path.key).match(pattern))

    def stat(self, **_: bool) -> SimpleNamespace:
        """Return its size, ``st_size``."""
        with reached(self):
            return SimpleNamespace(st_size=int(self.system.info(self.key)['size']))

    def open(self, mode: str = 'rb') -> BinaryIO:
        """Open it; it is read by ranges, and the last ones are cached."""
        with reached(self):
            opened = self.system.open(
                self.key,
                mode,
                block_size=BLOCK,
                cache_type='blockcache',
                cache_options={'maxblocks': BLOCKS},
            )
        return cast('BinaryIO', opened)

    def read_text(self, encoding: str | None = None) -> str:
        """Read it whole."""
        with reached(self):
            return bytes(self.system.cat_file(self.key)).decode(encoding or 'utf-8')

    def write_text(self, text: str, encoding: str = 'utf-8') -> None:
        """Write it in one step."""
        with written(self):
            self.system.pipe_file(self.key, text.encode(encoding))

    def unlink(self) -> None:
        """Remove it."""
        with written(self):
            self.system.rm_file(self.key)


RecordingPath = Path | RemotePath
