# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The command line: every command has a module of its own beside this one.

Other packages add theirs by entry points, as the laboratory does. Where a command was given what
another one takes, the sentence says what to type instead.
"""

from __future__ import annotations

import argparse
import re
import shlex
import sys
from importlib.metadata import entry_points
from io import TextIOWrapper
from pathlib import Path
from typing import TYPE_CHECKING

from lidar_outlier_filter import __version__
from lidar_outlier_filter.cli.clean import add_clean
from lidar_outlier_filter.cli.compile import add_compile
from lidar_outlier_filter.cli.compile_notice import COMMAND_GROUP
from lidar_outlier_filter.cli.completion import complete
from lidar_outlier_filter.cli.evaluate import add_evaluate
from lidar_outlier_filter.cli.info import add_info
from lidar_outlier_filter.cli.interrupts import INTERRUPTED, handlers_kept
from lidar_outlier_filter.cli.replay import add_replay
from lidar_outlier_filter.cli.report import add_report
from lidar_outlier_filter.cli.terminal import REFUSED, missing_module, say
from lidar_outlier_filter.cli.tune import add_tune
from lidar_outlier_filter.errors import FilterError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from lidar_outlier_filter.cli.terminal import Commands

GIVEN = ('recording', 'path', 'data', 'files')  # the options that name what a command works on
OF_RECORDINGS = ('replay', 'info', 'report', 'evaluate', 'tune')
OF_FILES = ('clean', 'info', 'report', 'evaluate', 'tune')
UNNAMED = re.compile(r'columns 1, 2(, 3)?')


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command that the arguments name; return the exit status."""
    with handlers_kept():
        return run(arguments)


def run(arguments: Sequence[str] | None = None) -> int:
    """Run a command as the last thing of a process: after it, signals are ignored."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors='backslashreplace')  # a name of a file may be no text
    parser = argparse.ArgumentParser(
        prog='lidar-outlier-filter', description='Clean lidar clouds from a moving vehicle.'
    )
    parser.add_argument('--version', action='version', version=__version__)
    commands = parser.add_subparsers(dest='command', metavar='COMMAND', required=True)
    words = sys.argv[1:] if arguments is None else arguments
    for add in commands_for(words):
        add(commands)
    complete(parser)
    options = parser.parse_args(words)
    try:
        status: int = options.run(options)
    except FilterError as err:
        say(f'{err}{hint(options, err)}')
        return REFUSED
    except ModuleNotFoundError as err:
        say(str(missing_module(err)))
        return REFUSED
    except KeyboardInterrupt:
        return INTERRUPTED
    return status


# A command is a function that adds its parser; `run` in the parser's defaults runs it.
COMMANDS: dict[str, Callable[[Commands], None]] = {
    'replay': add_replay,
    'clean': add_clean,
    'report': add_report,
    'info': add_info,
    'evaluate': add_evaluate,
    'tune': add_tune,
    'compile': add_compile,
}


def commands_for(words: Sequence[str]) -> list[Callable[[Commands], None]]:
    """List the commands; those of other packages only where none of the product is asked for."""
    known = list(COMMANDS.values())
    if words and words[0] in COMMANDS:
        return known
    found = sorted(entry_points(group=COMMAND_GROUP), key=lambda one: one.name)
    return known + [one.load() for one in found]


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


if __name__ == '__main__':
    from lidar_outlier_filter.cli.compile_notice import say_what_is_compiled

    say_what_is_compiled()
    sys.exit(main())
