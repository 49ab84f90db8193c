# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Completes the command line in a shell: verbs, options, parameters and detectors.

The shell sets ``_ARGCOMPLETE`` when it asks; argcomplete answers it.
"""

# ruff: noqa: PLC0415  nobody else waits for these imports

from __future__ import annotations

import os
from argparse import _SubParsersAction
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from argparse import ArgumentParser
    from collections.abc import Iterable

ASKED = '_ARGCOMPLETE'  # the variable of the environment that argcomplete's shell code sets


def complete(parser: ArgumentParser) -> None:
    """Answer a shell that asks how a line may go on, and end; do nothing otherwise."""
    if ASKED not in os.environ:
        return
    try:
        import argcomplete
    except ModuleNotFoundError:
        return
    _add_completers(parser)
    argcomplete.autocomplete(parser)


def _add_completers(parser: ArgumentParser) -> None:
    """Let values of ``--set`` and ``--chain`` be completed, in each command."""
    for action in parser._actions:  # noqa: SLF001  argparse has no other way to list them
        if '--set' in action.option_strings:
            action.completer = parameter_names  # type: ignore[attr-defined]
        elif '--chain' in action.option_strings:
            action.completer = chains  # type: ignore[attr-defined]
        if isinstance(action, _SubParsersAction):
            for one in action.choices.values():
                _add_completers(one)


def parameter_names(**_asked: object) -> Iterable[str]:
    """List what ``--set`` may begin with."""
    from lidar_outlier_filter.parameters.filter import describe

    return [f'{one.name}=' for one in describe()]


def chains(prefix: str, **_asked: object) -> Iterable[str]:
    """List how a chain may go on: with one more detector."""
    from lidar_outlier_filter.parameters.filter import installed

    before = prefix.rpartition(',')[0]
    chosen = before.split(',') if before else []
    return [','.join([*chosen, one]) for one in installed().detectors if one not in chosen]
