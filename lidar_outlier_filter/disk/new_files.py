# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""New files and folders that appear whole, together, or not at all."""

from __future__ import annotations

import os
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING

from lidar_outlier_filter.disk.hidden_folder import hidden_folder
from lidar_outlier_filter.disk.publication import FILE, FOLDER, check_new, publish
from lidar_outlier_filter.errors import CloudError, FilterError, RecordingError, said_by

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path


@contextmanager
def new_files(paths: Sequence[Path]) -> Iterator[list[Path]]:
    """Give, for each new file, a path to write it at; move all to their names at the end.

    Until then they are, under their own names, in hidden folders beside them; no error, no Ctrl-C
    and no full disk leaves anything behind; what a killed run leaves, the next one removes.

    Raises
    ------
    CloudError
        If a path is that of another or exists, at the start or at the end, or cannot be written.

    """
    if len({path.resolve() for path in paths}) < len(paths):
        names = ', '.join(str(path) for path in paths)
        raise CloudError('the outputs', 'different files', names)
    for path in paths:
        check_new(path, FILE, CloudError)
    with ExitStack() as stack:
        hidden = [stack.enter_context(_hidden(path)) / path.name for path in paths]
        yield hidden
        _publish_all(hidden, paths)


def _publish_all(hidden: Sequence[Path], paths: Sequence[Path]) -> None:
    """Give all files their names, or none: where one is refused, those before it lose theirs."""
    with ExitStack() as undo:
        for built, path in zip(hidden, paths, strict=True):
            try:
                publish(built, path, CloudError)
            except OSError as err:
                raise CloudError(f'the output {path}', 'written', f'"{err.strerror}"') from err
            undo.callback(path.rename, built)
        undo.pop_all()


@contextmanager
def _hidden(path: Path) -> Iterator[Path]:
    with ExitStack() as stack:
        try:
            folder = stack.enter_context(hidden_folder(path))
        except OSError as err:
            raise CloudError(f'the output {path}', 'written', f'"{err.strerror}"') from err
        yield folder


@contextmanager
def new_output(
    path: Path, must_be: str = FILE, error: type[FilterError] = RecordingError
) -> Iterator[Path]:
    """Give a path to write a new file at, or an empty new folder; move it to its name at the end.

    Until then it is, under its own name, in a hidden folder beside it, as :func:`new_files`.

    Parameters
    ----------
    path : of the output
    must_be : ``FILE`` or ``FOLDER``
    error : what is raised

    Raises
    ------
    FilterError
        The ``error``, if the path exists, at the start or at the end, or cannot be written.

    """
    check_new(path, must_be, error)
    try:
        with hidden_folder(path) as folder:
            built = folder / path.name
            if must_be == FOLDER:
                built.mkdir()
            yield built
            publish(built, path, error)
    except OSError as err:
        raise error(f'the output {path}', 'written in full', said_by(err)) from err


@contextmanager
def replaced(path: Path) -> Iterator[Path]:
    """Give a path to write a file or a folder at; at the end it takes the place of an older one.

    Until then, and after an error, the older one stays; see :func:`new_output`.

    Raises
    ------
    RecordingError
        If there was no older one, and the name has been taken meanwhile.
    OSError
        If it cannot be written.

    """
    older = os.path.lexists(path)
    with hidden_folder(path) as folder:
        built = folder / path.name
        yield built
        if not older:
            publish(built, path)
        elif built.is_dir():
            with ExitStack() as undo:
                undo.callback(path.rename(folder / 'older').rename, path)
                publish(built, path)
                undo.pop_all()
        else:
            built.replace(path)
