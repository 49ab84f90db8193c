# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What to type instead, where a command was given what another one takes."""

from __future__ import annotations

import re
import shlex
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import argparse

    from lidar_outlier_filter.errors import FilterError

GIVEN = ('recording', 'path', 'data', 'files')  # the options that name what a command works on
OF_RECORDINGS = ('replay', 'info', 'report', 'evaluate', 'tune')
OF_FILES = ('clean', 'info', 'report', 'evaluate', 'tune')
UNNAMED = re.compile(r'columns 1, 2(, 3)?')


def hint(options: argparse.Namespace, err: FilterError) -> str:
    """Name the command that takes what was given; empty where it was the right one."""
    given = next((getattr(options, name) for name in GIVEN if hasattr(options, name)), None)
    paths = [Path(one) for one in (given if isinstance(given, list) else [given]) if one]
    verb = options.command
    for path in filter(Path.exists, paths):
        right = _right(verb, path)
        if right:
            return f'; {right}'
        unnamed = UNNAMED.search(str(err))
        if verb == 'clean' and unnamed and path.is_file():
            columns = '1,2,3' if unnamed[1] else '1,2'
            return f'; it has no names on top: {_line(verb, path)} --columns {columns} counts them'
    return ''


def _right(verb: str, path: Path) -> str:
    """Say what to type for a path of another kind than the command takes."""
    if (path.is_dir() and _is_recording(path)) or path.suffix in _recorded():
        return '' if verb in OF_RECORDINGS else f'{_line("replay", path)} filters a recording'
    if path.is_dir():
        return _in_folder(verb, path)
    if path.suffix.lower() in _readable() and verb not in OF_FILES:
        return f'{_line("clean", path)} filters a file of points'
    return ''


def _in_folder(verb: str, folder: Path) -> str:
    """Say what to type for the first thing in a folder that a command takes one by one."""
    inside = sorted(path for path in folder.iterdir() if not path.name.startswith('.'))
    recording = next((p for p in inside if p.suffix in _recorded() or _is_recording(p)), None)
    if recording is not None and verb != 'replay':
        if verb == 'clean':
            return f'{_line("replay", folder)} filters a folder of recordings'
        return f'it is a folder of recordings, so name one: {_line(verb, recording)}'
    file = next((path for path in inside if path.suffix.lower() in _readable()), None)
    if recording is None and file is not None:
        name = verb if verb in OF_FILES else 'clean'
        some = folder / f'*{file.suffix}' if name == 'clean' else file
        return f'it is a folder of files, so name them: lidar-outlier-filter {name} {some}'
    return ''


def _line(verb: str, path: Path) -> str:
    return f'lidar-outlier-filter {verb} {shlex.quote(str(path))}'


def _is_recording(path: Path) -> bool:
    return (path / 'metadata.yaml').is_file() or (
        path.is_dir()
        and any(one.suffix in {'.mcap', '.db3'} for one in path.iterdir())
        and any(one.name.startswith(path.name) for one in path.iterdir())
    )


def _recorded() -> tuple[str, ...]:
    from lidar_outlier_filter.archive.locations import SUFFIXES  # noqa: PLC0415  help is instant

    return SUFFIXES


def _readable() -> tuple[str, ...]:
    from lidar_outlier_filter.files.cloud_file import SUFFIXES  # noqa: PLC0415  help is instant

    return SUFFIXES
