# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Fingerprints of inputs, outputs, parameters and code."""

from __future__ import annotations

import json
from functools import cache
from hashlib import sha256
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import lidar_outlier_filter
from lidar_outlier_filter.archive.storage import file_hash, file_state
from lidar_outlier_filter.core.detectors.registry import DETECTORS
from lidar_outlier_filter.core.points.mask import content_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from lidar_outlier_filter.archive.locations import Location
    from lidar_outlier_filter.parameters.filter import FilterParameters
    from lidar_outlier_filter.recordings.remote_path import RecordingPath

WITHOUT_EFFECT = ('threads', 'save_to')  # parameters that do not change outputs
# Folders of the package whose code decides the bytes of an output.
ROOMS = ('core', 'files', 'messages', 'parameters', 'pipeline', 'recordings')


class FileMark(NamedTuple):
    """The fingerprint of one file: bytes, SHA-256, and the state that spares reading it again.

    ``state`` is the time of modification on a file system, the ETag on a store.
    """

    size: int
    sha256: str
    state: str


def mark_of(path: RecordingPath) -> FileMark:
    """Read a file and return its fingerprint."""
    size, state = file_state(path)
    return FileMark(size, file_hash(path), state)


def agrees(path: RecordingPath, mark: FileMark, *, read: bool = False) -> bool:
    """Return whether a file has the fingerprint; ``read`` does not trust an equal state."""
    if isinstance(path, Path) and (path.is_symlink() or not path.is_file()):
        return False
    try:
        size, state = file_state(path)
        is_same = state == mark.state and not read
        return size == mark.size and (is_same or file_hash(path) == mark.sha256)
    except FileNotFoundError:  # moved by a run at the same time
        return False


def content_hash(location: Location) -> str:
    """Return the SHA-256 of an input, for a folder of its names and hashes; on a store its state.

    A file of a store is not read a second time for this.
    """
    path = location.path
    if not isinstance(path, Path):
        return location.state
    if path.is_file():
        return file_hash(path)
    files = (
        f'{file.name} {file_hash(file)}\n' for file in sorted(path.iterdir()) if file.is_file()
    )
    return sha256(''.join(files).encode(errors='surrogateescape')).hexdigest()


def parameters_hash(parameters: FilterParameters, options: Mapping[str, object]) -> str:
    """Hash the parameters and options that decide the bytes of an output."""
    values = {k: v for k, v in parameters.flat().items() if k not in WITHOUT_EFFECT}
    values['mask'] = content_of(parameters)
    homes = (DETECTORS[name].home for name in parameters.chain)
    plugins = sorted({home for home in homes if not home.startswith(lidar_outlier_filter.__name__)})
    said = json.dumps([values, options, [_sources(home) for home in plugins]], sort_keys=True)
    return sha256(said.encode()).hexdigest()


@cache
def code_version() -> str:
    """Return the version of the package with a hash of the code and models that judge."""
    root = Path(str(lidar_outlier_filter.__file__)).parent
    files = [file for room in ROOMS for file in (root / room).rglob('*')]
    own = _hash_files(file for file in files if file.suffix in {'.py', '.json'})
    return f'{lidar_outlier_filter.__version__}+{own[:12]}'


@cache
def _sources(module: str) -> str:
    """Hash the source of a plug-in: its module, or all modules of its package."""
    spec = find_spec(module)
    folders = spec.submodule_search_locations if spec is not None else None
    if folders:
        return _hash_files(file for one in folders for file in Path(one).rglob('*.py'))
    return _hash_files([Path(spec.origin)] if spec is not None and spec.origin else [])


def _hash_files(files: Iterable[Path]) -> str:
    return sha256(
        ''.join(f'{one.name} {file_hash(one)}\n' for one in sorted(files)).encode()
    ).hexdigest()
