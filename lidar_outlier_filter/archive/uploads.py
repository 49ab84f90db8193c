# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Recordings on their way to a store: their bytes are there first, and their names come at the end.

Who sends the bytes of a recording to S3 may be another process than the one that names it. So of
several that send the same, one gets the name. Other stores have nothing like it: there the files
have their names when they are sent.
"""

from __future__ import annotations

from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from lidar_outlier_filter.archive.locations import METADATA
from lidar_outlier_filter.disk.new_files import FOLDER, taken
from lidar_outlier_filter.recordings.remote_path import written

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from lidar_outlier_filter.recordings.remote_path import RecordingPath, RemotePath

PART = 32 * 2**20  # bytes of a part of an upload: S3 takes 10 000 of them
_COPIED = 2**23  # bytes copied at once


@dataclass(frozen=True)
class Upload:
    """A file whose parts are on S3, and are no object yet."""

    target: RemotePath
    number: str
    parts: Sequence[Mapping[str, Any]]

    def finish(self) -> None:
        """Make the parts one object, under its name."""
        self._call('complete_multipart_upload', MultipartUpload={'Parts': [*self.parts]})
        self.target.system.invalidate_cache(self.target.key)

    def give_up(self) -> None:
        """Remove the parts."""
        with suppress(Exception):  # whatever it is, a rule of the bucket removes them later
            self._call('abort_multipart_upload')

    def _call(self, name: str, **given: object) -> None:
        bucket, key, _ = self.target.system.split_path(self.target.key)
        self.target.system.call_s3(name, Bucket=bucket, Key=key, UploadId=self.number, **given)


@contextmanager
def published(path: RecordingPath, scratch: Path | None = None) -> Iterator[Path]:
    """Give a path of this machine to build a bag folder at; at the end it is at ``path``, whole.

    Where that is on a store, it is uploaded in parts. Nothing is under the final name until all
    parts are there; ``metadata.yaml``, without which a folder is no recording, comes last. After
    an error the parts are given up.

    Raises
    ------
    RecordingError
        If something is there already, or it cannot be written.

    """
    if isinstance(path, Path):
        yield path
        return
    if path.exists():
        raise taken(path, FOLDER)
    with TemporaryDirectory(prefix='.lidar_outlier_filter-', dir=scratch) as folder:
        built = Path(folder, path.name)
        yield built
        finish(path, upload(built, path))


def upload(built: Path, path: RemotePath) -> list[Upload]:
    """Send the files of a bag folder to a store, ``metadata.yaml`` last; return what has no name.

    Raises
    ------
    RecordingError
        If they cannot be sent. Then none of them is there.

    """
    sent: list[Upload] = []
    with written(path):
        try:
            for file in sorted(built.iterdir(), key=lambda file: file.name == METADATA):
                sent += _send(file, path / file.name)
        except BaseException:
            give_up(sent)
            raise
    return sent


def finish(path: RemotePath, sent: Sequence[Upload]) -> None:
    """Give the files of a bag folder their names, in their order.

    Raises
    ------
    RecordingError
        If the store refuses.

    """
    with written(path):
        for number, one in enumerate(sent):
            try:
                one.finish()
            except BaseException:
                give_up(sent[number:])
                raise


def give_up(sent: Sequence[Upload]) -> None:
    """Remove from the store what has no name."""
    for one in sent:
        one.give_up()


def _send(file: Path, target: RemotePath) -> list[Upload]:
    """Send a file in parts; where the store is none of S3, it has its name then."""
    with file.open('rb') as source:
        stream: Any = target.system.open(target.key, 'wb', block_size=PART, autocommit=False)
        try:
            while data := source.read(_COPIED):
                stream.write(data)
            stream.close()
        except BaseException:
            stream.discard()
            stream.closed = True  # or it would try to write the rest when it is collected
            raise
    if hasattr(target.system, 'call_s3') and getattr(stream, 'parts', None):
        return [Upload(target, stream.mpu['UploadId'], stream.parts)]
    stream.commit()
    return []
