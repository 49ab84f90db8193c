# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""New files that appear whole, together, or not at all."""

from __future__ import annotations

import os
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING

from lidar_outlier_filter.errors import CloudError
from lidar_outlier_filter.files.hidden_folder import hidden_folder

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
        If a path is that of another or exists, or cannot be written.

    """
    if len({path.resolve() for path in paths}) < len(paths):
        names = ', '.join(str(path) for path in paths)
        raise CloudError('the outputs', 'different files', names)
    for path in paths:
        if os.path.lexists(path):
            raise CloudError('the output', 'a new file', f'{path}, which exists')
    with ExitStack() as stack:
        hidden = [stack.enter_context(_hidden(path)) / path.name for path in paths]
        yield hidden
        for built, path in zip(hidden, paths, strict=True):
            try:
                built.rename(path)
            except OSError as err:
                raise CloudError(f'the output {path}', 'written', f'"{err.strerror}"') from err


@contextmanager
def _hidden(path: Path) -> Iterator[Path]:
    with ExitStack() as stack:
        try:
            folder = stack.enter_context(hidden_folder(path))
        except OSError as err:
            raise CloudError(f'the output {path}', 'written', f'"{err.strerror}"') from err
        yield folder
