# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""How the node starts and stops. Imports nothing heavy: a signal may end it while it loads."""

from __future__ import annotations

import os
import signal
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from lidar_outlier_filter.errors import ParameterError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from lidar_outlier_filter.ros.node import OutlierFilterNode

STOP_SIGNALS = (signal.SIGINT, signal.SIGTERM)


def main(*, lifecycle: bool = False, attach: Callable[[OutlierFilterNode], object] = id) -> int:
    """Run the node until SIGINT or SIGTERM; pending clouds are filtered and published first.

    A second signal ends the process at once, and pending clouds are lost.

    Parameters
    ----------
    lifecycle : bool
        Whether the node is a managed one.
    attach : callable
        Called with the node before it starts.

    Returns
    -------
    int
        The exit status: 0, or 1 where the arguments are invalid; stderr says why.

    """
    # Until there is a node: not by an exception, which an import or a destructor would swallow.
    on_stop(lambda: os._exit(0))
    # ROS and NumPy take a second or two.
    from lidar_outlier_filter.ros.node import ManagedFilterNode, OutlierFilterNode, run  # noqa: PLC0415

    return run(ManagedFilterNode if lifecycle else OutlierFilterNode, attach, on_stop)


def on_stop(react: Callable[[], object]) -> None:
    """Call ``react`` at the next SIGINT or SIGTERM; the one after it ends the process at once.

    The system ends it: Python would handle a signal only when its current call returns.
    """

    def first(*_: object) -> None:
        for number in STOP_SIGNALS:
            signal.signal(number, signal.SIG_DFL)
        react()

    for number in STOP_SIGNALS:
        signal.signal(number, first)


def split_namespaces(text: str, topics: Iterable[str]) -> list[str]:
    """Return the comma-separated namespaces of a launch; a single one may be empty.

    Raises
    ------
    ParameterError
        If there are several, and two are equal, or a topic would be the same in all.

    """
    names = [name.strip() for name in text.split(',')]
    if len(names) > 1:
        full = {name.strip('/') for name in names}
        if '' in full or len(full) < len(names):
            raise ParameterError('namespace', 'different names, comma-separated', repr(text))
        for topic in topics:
            if topic.startswith('/'):
                must_be = 'without a leading slash for several namespaces'
                raise ParameterError('input_topic', must_be, repr(topic))
    return names


def split_files(what: str, text: str, count: int) -> list[str]:
    """Return the file of each of ``count`` namespaces, '' without one; ``what`` names them.

    Raises
    ------
    ParameterError
        If there are several files, but not one for each namespace, or a file does not exist.

    """
    paths = [path.strip() for path in text.split(',')]
    if len(paths) not in {1, count}:
        must_be = f'one file, or one for each of the {count} namespaces'
        raise ParameterError(what, must_be, repr(text))
    for path in paths:
        # launch_ros would warn of it, and start with the defaults.
        if path and not Path(path).is_file():
            raise ParameterError(what, 'a file that exists', repr(path))
    return paths if len(paths) == count else paths * count


def whole_number(what: str, text: str) -> int:
    """Return the depth of a queue, which ``what`` names; refuse other words and 0."""
    if not (text.isascii() and text.isdecimal() and int(text)):
        raise ParameterError(what, 'a whole number above 0', repr(text))
    return int(text)


if __name__ == '__main__':
    sys.exit(main())
