# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The command line: every command has a module of its own beside this one."""

from __future__ import annotations

import argparse
import sys
from io import TextIOWrapper
from typing import TYPE_CHECKING

from lidar_outlier_filter import __version__
from lidar_outlier_filter.cli.bench import add_bench
from lidar_outlier_filter.cli.clean import add_clean
from lidar_outlier_filter.cli.compile import add_compile
from lidar_outlier_filter.cli.demo import add_demo
from lidar_outlier_filter.cli.evaluate import add_evaluate
from lidar_outlier_filter.cli.info import add_info
from lidar_outlier_filter.cli.interrupts import INTERRUPTED, handlers_kept
from lidar_outlier_filter.cli.replay import add_replay
from lidar_outlier_filter.cli.report import add_report
from lidar_outlier_filter.cli.results import add_results
from lidar_outlier_filter.cli.right_verb import hint
from lidar_outlier_filter.cli.simulate import add_simulate
from lidar_outlier_filter.cli.terminal import REFUSED, say
from lidar_outlier_filter.cli.train import add_train
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
    for add in COMMANDS:
        add(commands)
    options = parser.parse_args(arguments)
    try:
        status: int = options.run(options)
    except FilterError as err:
        say(f'{err}{hint(options, err)}')
        return REFUSED
    except ModuleNotFoundError as err:
        # Of what the commands need, Ubuntu packages all but this.
        if (err.name or '').partition('.')[0] != 'rosbags':
            raise
        must_be = 'installed for recordings (the page on installation has the line)'
        say(str(FilterError('the module rosbags', must_be, 'none')))
        return REFUSED
    except KeyboardInterrupt:
        return INTERRUPTED
    return status


# A command is a function that adds its parser; `run` in the parser's defaults runs it.
COMMANDS: tuple[Callable[[Commands], None], ...] = (
    add_replay,
    add_clean,
    add_report,
    add_info,
    add_simulate,
    add_evaluate,
    add_tune,
    add_train,
    add_results,
    add_demo,
    add_bench,
    add_compile,
)


if __name__ == '__main__':
    from lidar_outlier_filter.cli.compile_notice import say_what_is_compiled

    say_what_is_compiled()
    sys.exit(main())
