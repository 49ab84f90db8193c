# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The command line: every command has a module of its own beside this one.

Other packages add theirs by entry points, as the laboratory does.
"""

from __future__ import annotations

import argparse
import sys
from importlib.metadata import entry_points
from io import TextIOWrapper
from typing import TYPE_CHECKING

from lidar_outlier_filter import __version__
from lidar_outlier_filter.cli.clean import add_clean
from lidar_outlier_filter.cli.compile import add_compile
from lidar_outlier_filter.cli.compile_notice import COMMAND_GROUP
from lidar_outlier_filter.cli.completion import complete
from lidar_outlier_filter.cli.evaluate import add_evaluate
from lidar_outlier_filter.cli.info import add_info
from lidar_outlier_filter.cli.interrupts import INTERRUPTED, handlers_kept
from lidar_outlier_filter.cli.mask import add_mask
from lidar_outlier_filter.cli.replay import add_replay
from lidar_outlier_filter.cli.report import add_report
from lidar_outlier_filter.cli.right_verb import hint
from lidar_outlier_filter.cli.terminal import REFUSED, missing_module, say
from lidar_outlier_filter.cli.tune import add_tune
from lidar_outlier_filter.errors import FilterError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from lidar_outlier_filter.cli.terminal import Commands


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
    'mask': add_mask,
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


if __name__ == '__main__':
    from lidar_outlier_filter.cli.compile_notice import say_what_is_compiled

    say_what_is_compiled()
    sys.exit(main())
