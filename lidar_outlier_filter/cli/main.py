# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The command line; a command is imported when it runs.

Other packages add commands by entry points, as the laboratory does.
"""

from __future__ import annotations

import argparse
import os
import shlex
import sys
from contextlib import suppress
from functools import partial
from importlib import import_module
from importlib.metadata import entry_points
from io import TextIOWrapper
from pathlib import Path
from typing import TYPE_CHECKING

from lidar_outlier_filter import __version__
from lidar_outlier_filter.cli.arguments import add_clean, add_info, add_mask, add_replay, add_report
from lidar_outlier_filter.cli.terminal import (
    INTERRUPTED,
    REFUSED,
    handlers_kept,
    missing_module,
    say,
)
from lidar_outlier_filter.cli.truth_arguments import add_evaluate, add_tune
from lidar_outlier_filter.errors import FilterError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from lidar_outlier_filter.cli.arguments import Commands

# `run_COMMAND` in the module of that name runs it; that of `mask` is in `replay`.
ADDING = (add_replay, add_clean, add_report, add_info, add_mask, add_evaluate, add_tune)
COMMANDS = {add.__name__.removeprefix('add_'): add for add in ADDING}
PROGRAM = 'lidar-outlier-filter'
COMMAND_GROUP = 'lidar_outlier_filter.commands'  # entry points by which others add commands
COMPLETING = '_ARGCOMPLETE'  # the environment variable by which a shell asks for completions
INPUTS = ('recording', 'path', 'data', 'files')  # the arguments that name what a command works on
OF_RECORDINGS = ('replay', 'info', 'report', 'evaluate', 'tune', 'mask')
OF_FILES = ('clean', 'info', 'report', 'evaluate', 'tune')


class CommandHelp(argparse.HelpFormatter):
    """Wraps all text but the examples at the end."""

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        if not text.startswith('examples:'):
            return super()._fill_text(text, width, indent)
        return text + '\n'


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command that the arguments name; return the exit status."""
    with handlers_kept():
        return run(arguments)


def run(arguments: Sequence[str] | None = None) -> int:
    """Run a command as the last thing of a process: after it, signals are ignored."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors='backslashreplace')  # a name of a file may be any bytes
    parser = argparse.ArgumentParser(
        prog=PROGRAM,
        description='Find outliers in lidar clouds: in recordings of a vehicle, in LAS and other '
        'files of a survey, and in labelled clouds for research.',
        formatter_class=CommandHelp,
        epilog='examples:\n  lidar-outlier-filter replay drive --output cleaned\n'
        '  lidar-outlier-filter clean street.laz --output cleaned.laz',
    )
    parser.add_argument('--version', action='version', version=__version__)
    commands = parser.add_subparsers(  # type: ignore[call-overload]
        dest='command',
        metavar='COMMAND',
        required=True,
        parser_class=partial(argparse.ArgumentParser, formatter_class=CommandHelp),
    )
    words = sys.argv[1:] if arguments is None else arguments
    for add in commands_for(words):
        add(commands)
    if COMPLETING in os.environ:
        _complete(parser)
    options = parser.parse_args(words)
    try:
        _check(words)
        status: int = _runner(options)(options)
    except FilterError as err:
        say(f'{err}{_hint(options)}')
        return REFUSED
    except UnicodeEncodeError as err:  # in a file that must be UTF-8, as a page
        say(str(FilterError('a name', 'UTF-8', repr(err.object[max(0, err.start - 20) : err.end]))))
        return REFUSED
    except ModuleNotFoundError as err:
        say(str(missing_module(err)))
        return REFUSED
    except KeyboardInterrupt:
        return INTERRUPTED
    return status


def commands_for(words: Sequence[str]) -> list[Callable[[Commands], None]]:
    """List the command that is asked for, or all, those of other packages too."""
    names = [name for name in COMMANDS if name in words[:1]]
    known: list[Callable[[Commands], None]] = [COMMANDS[name] for name in names or COMMANDS]
    if names:
        return known
    found = sorted(entry_points(group=COMMAND_GROUP), key=lambda one: one.name)
    return known + [one.load() for one in found]


def _runner(options: argparse.Namespace) -> Callable[[argparse.Namespace], int]:
    """Import the function that runs a command; those of other packages bring theirs."""
    if hasattr(options, 'run'):
        return options.run  # type: ignore[no-any-return]
    module = import_module(f'{__package__}.{options.command.replace("mask", "replay")}')
    return getattr(module, f'run_{options.command}')  # type: ignore[no-any-return]


def _check(words: Sequence[str]) -> None:
    """Refuse empty arguments, and names of pipes and devices: to read one could take for ever."""
    for word in words:
        if not word or (word.startswith('--') and word.endswith('=')):
            raise FilterError('an argument', 'not empty', repr(word))
        parts = word.split('=')
        for name in ('='.join(parts[i:]) for i in range(len(parts))):
            with suppress(OSError, ValueError):  # too long for a name, or with zeros
                path = Path(name)
                if path.exists() and not (path.is_file() or path.is_dir()):
                    raise FilterError(name, 'a file or a folder', 'a pipe or device')


def _hint(options: argparse.Namespace) -> str:
    """Say what to type, if another command takes what was given, or this one what is inside."""
    given = next((getattr(options, name) for name in INPUTS if hasattr(options, name)), None)
    paths = [Path(one) for one in (given if isinstance(given, list) else [given]) if one]
    verb = options.command
    for path in filter(Path.exists, paths):
        kind, takes, right, inside = _kind(path)
        if kind and verb not in takes:
            other = OF_RECORDINGS if right == 'replay' else OF_FILES
            if inside is not None and verb in other:
                line = f'{PROGRAM} {verb} {shlex.quote(str(inside))}'
                return f'; it is a {kind}, so name one: {line}'
            return f'; {PROGRAM} {right} {shlex.quote(str(path))} filters a {kind}'
    return ''


def _kind(path: Path) -> tuple[str, Sequence[str], str, Path | None]:
    """Return the kind of a path, its commands, its filter command, and its first entry."""
    # Help is instant.
    from lidar_outlier_filter.archive.locations import is_recording  # noqa: PLC0415
    from lidar_outlier_filter.files.cloud_file import SUFFIXES as READABLE  # noqa: PLC0415

    if is_recording(path):
        return 'recording', OF_RECORDINGS, 'replay', None
    inside = sorted(path.iterdir()) if path.is_dir() else [path]
    for one in inside if path.is_dir() else ():
        if is_recording(one):
            return 'folder of recordings', ('replay',), 'replay', one
    for one in inside:
        if one.suffix.lower() in READABLE and one.is_file():
            if one is path:
                return 'file of points', OF_FILES, 'clean', None
            return 'folder of files', ('clean',), 'clean', one
    return '', (), '', None


def _complete(parser: argparse.ArgumentParser) -> None:
    """Complete a line for the shell, and exit."""
    try:
        import argcomplete  # noqa: PLC0415  nobody else waits for it
    except ModuleNotFoundError:
        return
    _add_completers(parser)
    argcomplete.autocomplete(parser)


def _add_completers(parser: argparse.ArgumentParser) -> None:
    """Complete values of ``--set`` and ``--chain``, in each command."""
    for action in parser._actions:  # noqa: SLF001  argparse has no other way to list them
        if '--set' in action.option_strings:
            action.completer = _parameter_names  # type: ignore[attr-defined]
        elif '--chain' in action.option_strings:
            action.completer = _chains  # type: ignore[attr-defined]
        if isinstance(action, argparse._SubParsersAction):  # noqa: SLF001  it has no other name
            for one in action.choices.values():
                _add_completers(one)


def _parameter_names(**_asked: object) -> Iterable[str]:
    from lidar_outlier_filter.parameters.filter import describe  # noqa: PLC0415

    return [f'{one.name}=' for one in describe()]


def _chains(prefix: str, **_asked: object) -> Iterable[str]:
    """List the chains with one more detector."""
    from lidar_outlier_filter.parameters.filter import installed  # noqa: PLC0415

    before = prefix.rpartition(',')[0]
    chosen = before.split(',') if before else []
    return [','.join([*chosen, one]) for one in installed().detectors if one not in chosen]


if __name__ == '__main__':
    sys.exit(main())
