# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Says on stderr that kernels are compiled: the first run of a command takes a minute longer."""

from __future__ import annotations

from functools import cache
from importlib.metadata import entry_points
from threading import Lock
from typing import TYPE_CHECKING

from lidar_outlier_filter.core.kernels.compile_listeners import listeners

if TYPE_CHECKING:
    from collections.abc import Callable

PACKAGE = 'lidar_outlier_filter'
COMMAND_GROUP = f'{PACKAGE}.commands'  # the group of entry points by which others add commands


def say_what_is_compiled() -> None:
    """Say it in this process, from now on."""
    listeners.append(notice())


def notice() -> Callable[[str], None]:
    """Return what takes the module of each kernel that is compiled, and says each part once."""
    said: set[str] = set()
    lock = Lock()

    def say_once(module: str) -> None:
        sentence = _sentence(module)
        with lock:
            if not sentence or sentence in said:
                return
            said.add(sentence)
        # Not before it is needed: help is instant.
        from lidar_outlier_filter.cli.terminal import say  # noqa: PLC0415

        say(sentence)

    return say_once


def _sentence(module: str) -> str:
    """Name the part of the package that a kernel belongs to; nothing for kernels of others."""
    from lidar_outlier_filter.core.detectors.registry import DETECTORS  # noqa: PLC0415

    for one in DETECTORS.values():
        if f'{module}.'.startswith(f'{one.home}.'):
            return f'the kernels of {one.name} are compiled, this once'
    if (package := module.partition('.')[0]) != PACKAGE:
        return f'the kernels of {package} are compiled, this once' if package in _others() else ''
    return 'the kernels that all share are compiled, this once'


@cache
def _others() -> frozenset[str]:
    """Name the packages that add commands."""
    return frozenset(one.module.partition('.')[0] for one in entry_points(group=COMMAND_GROUP))
