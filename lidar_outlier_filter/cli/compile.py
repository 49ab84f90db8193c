# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The command ``compile``, and the notice on stderr of every command that compiles kernels.

It imports what is heavy when it runs, so that help is instant.
"""

# ruff: noqa: PLC0415  as said above

from __future__ import annotations

import os
import sys
from typing import TYPE_CHECKING

from lidar_outlier_filter.cli.terminal import DONE, INCOMPLETE, progress_bar, say
from lidar_outlier_filter.core.kernels import PORTABLE, listeners

if TYPE_CHECKING:
    import argparse

    from lidar_outlier_filter.parameters.filter import FilterParameters

COMMAND_GROUP = 'lidar_outlier_filter.commands'  # entry points by which others add commands
SENTENCE = 'kernels are compiled once, on the first run; this takes up to a minute'


def run_compile(options: argparse.Namespace) -> int:
    """Compile what is not on disk yet."""
    if options.portable:  # before numba is there, and for the processes that this one starts
        os.environ.update(NUMBA_CPU_NAME=PORTABLE, NUMBA_CPU_FEATURES='')
    from lidar_outlier_filter.core.kernels.kernel_cache import CacheFile, complaints
    from lidar_outlier_filter.core.kernels.threads import cores
    from lidar_outlier_filter.pipeline.compiling import KernelShare, Processes, load, shares

    CacheFile.allows_portable = False
    requested = _requested(options.chain, portable=options.portable)
    work = list[KernelShare]()
    for parameters in requested:
        # What is on disk already, in whatever order it was written, is not done again.
        if not load(parameters, offline=True):
            work += [share for share in shares(parameters) if share not in work]
    processes = Processes(offline=True)
    with progress_bar('compiling') as bar:

        def advance(done: int, total: int, text: str) -> None:
            bar(done, total, text)
            if not sys.stderr.isatty():
                say(f'compiled {done} of {total}: {text}')

        if work:
            parts = '; '.join(share.text for share in work)
            say(f'compiling, {cores()} at once, for a minute or more: {parts}')
        bar(0, len(work))
        try:
            errors = processes.run(work, advance)
        except KeyboardInterrupt:
            processes.stop()
            raise
    for sentence in [*errors, *complaints]:
        say(sentence)
    if not errors:
        names = dict.fromkeys(name for one in requested for name in one.chain)
        say(f'the kernels of {", ".join(names)} are compiled')
    return INCOMPLETE if errors else DONE


def _requested(chain: str | None, *, portable: bool) -> list[FilterParameters]:
    """Return the parameters of the chain that was asked for, or of all that the package brings."""
    from lidar_outlier_filter.core.detectors.builtin import BUILTIN
    from lidar_outlier_filter.parameters.filter import FilterParameters
    from lidar_outlier_filter.parameters.yaml_files import config_folder, read_yaml

    if chain is not None:
        return [FilterParameters().changed({'chain': chain.split(',')})]
    known = FilterParameters().flat()
    files = [read_yaml(path) for path in sorted(config_folder().glob('*.yaml'))]
    first = FilterParameters().changed({'chain': [*BUILTIN]}) if portable else FilterParameters()
    return [
        first,
        FilterParameters().changed({'boosted_trees.sensor': 'survey'}),  # for `clean`
        *(FilterParameters().changed({k: file[k] for k in file if k in known}) for file in files),
    ]


def say_what_is_compiled() -> None:
    """Say once in this process that kernels are compiled, before the first one is."""

    def say_once(_module: str) -> None:
        listeners.remove(say_once)
        say(SENTENCE)

    listeners.append(say_once)
