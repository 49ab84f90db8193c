# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What an output was made of: the hash of its recording, of the parameters, the code, the model."""

from __future__ import annotations

import json
from functools import cache
from hashlib import file_digest, sha256
from pathlib import Path
from typing import TYPE_CHECKING

import lidar_outlier_filter
from lidar_outlier_filter.core.detectors.registry import DETECTORS
from lidar_outlier_filter.core.kernels import kernel_cache
from lidar_outlier_filter.core.points.mask import content_of

if TYPE_CHECKING:
    from collections.abc import Iterable

    from lidar_outlier_filter.archive.locations import Location
    from lidar_outlier_filter.parameters.filter import FilterParameters

WITHOUT_EFFECT = ('threads', 'save_to')  # on verdicts
_JUDGE = 'lidar_outlier_filter.recordings.replay'


def content_hash(location: Location) -> str:
    """Return what changes with the content: SHA-256 of the files, or the mark of a store.

    A folder is hashed by the names and the hashes of its files.
    """
    if not isinstance(location.path, Path):
        return location.state
    if location.path.is_file():
        return _file_hash(location.path)
    total = sha256()
    for file in sorted(location.path.iterdir()):
        if file.is_file():
            total.update(f'{file.name} {_file_hash(file)}\n'.encode())
    return total.hexdigest()


def _file_hash(path: Path) -> str:
    with path.open('rb') as stream:
        return file_digest(stream, 'sha256').hexdigest()


def parameters_hash(parameters: FilterParameters, **options: object) -> str:
    """Hash the values that decide what is written, and others' detectors of the chain."""
    options['detectors'] = _code_of(name for name in parameters.chain if not _is_own(name))
    values = {k: v for k, v in parameters.flat().items() if k not in WITHOUT_EFFECT}
    values['mask'] = content_of(parameters)
    return sha256(json.dumps([values, options], sort_keys=True).encode()).hexdigest()


@cache
def version(judge: str = _JUDGE) -> str:
    """Return the version of the package with the hash of the code that judges: of a module."""
    code = [kernel_cache.stamp(judge), *_code_of(name for name in DETECTORS if _is_own(name))]
    return f'{lidar_outlier_filter.__version__}+{sha256("".join(code).encode()).hexdigest()[:12]}'


def _code_of(names: Iterable[str]) -> list[str]:
    """Hash the code of detectors: nothing imports them but who asks for their declarations."""
    return [kernel_cache.stamp(DETECTORS[name].home) for name in names]


def _is_own(name: str) -> bool:
    return DETECTORS[name].home.startswith(f'{lidar_outlier_filter.__name__}.')


@cache
def model_hash() -> str:
    """Hash the files of the trained models."""
    folder = Path(str(lidar_outlier_filter.__file__)).parent / 'core'
    total = sha256()
    for path in sorted(folder.rglob('*.json')):
        total.update(f'{path.name} {_file_hash(path)}\n'.encode())
    return total.hexdigest()


def judging_code(judge: str = _JUDGE) -> str:
    """Return what two processes have in common that judge alike: the code and the models."""
    others = ''.join(_code_of(name for name in DETECTORS if not _is_own(name)))
    added = f'+{sha256(others.encode()).hexdigest()[:12]}' if others else ''
    return f'{version(judge)}+{model_hash()[:12]}{added}'
