# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The arguments of ``outlier_filter_node``, and the page that it may have.

ROS is imported when the node runs, and what the page needs when there is one.
"""

from __future__ import annotations

import argparse
import sys
from functools import partial
from typing import TYPE_CHECKING

from lidar_outlier_filter import __version__
from lidar_outlier_filter.cli.terminal import REFUSED, missing_module, say
from lidar_outlier_filter.ros.executable import main as run

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lidar_outlier_filter.report.served import PageServer
    from lidar_outlier_filter.ros.node import OutlierFilterNode

LARGEST_PORT = 65535
DESCRIPTION = """\
Split each cloud of a lidar into a cleaned and an outlier cloud, until SIGINT or SIGTERM.

topics:
  points           clouds, or by input_type 2-D scans, the input; -r renames it
  points/cleaned   kept points, including missing returns
  points/outliers  rejected points
  /diagnostics     once a second, one status for each input

ROS arguments follow --ros-args. Some of them:
  -r points:=/velodyne_points                 the topic of the sensor
  -p chain:="['alpha_beta_gamma', 'lof']"     a parameter
  --params-file my.yaml                       a file of parameters
  --log-level warn                            minimum severity of log messages

share/lidar_outlier_filter/config/defaults.yaml has all parameters; where ROS is installed, also:
  ros2 param list /outlier_filter_node
  ros2 param describe /outlier_filter_node chain
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the node; return the exit status."""
    parser = argparse.ArgumentParser(
        prog='outlier_filter_node',
        description=DESCRIPTION,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        usage='%(prog)s [-h] [--version] [--lifecycle] [--page [PORT]] [--ros-args ...]',
        allow_abbrev=False,
        epilog='examples:\n'
        '  outlier_filter_node --ros-args -r points:=/velodyne_points\n'
        '  outlier_filter_node --page --ros-args --params-file my.yaml',
    )
    parser.add_argument('--version', action='version', version=__version__)
    parser.add_argument(
        '--lifecycle',
        action='store_true',
        help='wait for the transitions of a managed node: configure, activate, deactivate, '
        'cleanup, shutdown',
    )
    parser.add_argument(
        '--page',
        nargs='?',
        type=port,
        const=0,
        metavar='PORT',
        help='show clouds, diagnostics and sliders in a browser of this machine; the log names the '
        'address; PORT: on 127.0.0.1, default: any free port',
    )
    options = parser.parse_args(_own(sys.argv[1:] if arguments is None else arguments))
    attach = id if options.page is None else partial(serve_page, port=options.page)
    try:
        return run(lifecycle=options.lifecycle, attach=attach)
    except ModuleNotFoundError as err:
        say(str(missing_module(err)))
        return REFUSED


def port(text: str) -> int:
    """Read a port; 0: any free one."""
    number = int(text) if text.isascii() and text.isdecimal() else -1
    if not 0 <= number <= LARGEST_PORT:
        raise argparse.ArgumentTypeError(f'must be from 0 to {LARGEST_PORT}, got {text!r}')
    return number


def _own(arguments: Sequence[str]) -> list[str]:
    """Leave out what is for ROS: from ``--ros-args`` to ``--``, or to the end."""
    own, is_ros = [], False
    for argument in arguments:
        if argument == '--ros-args':
            is_ros = True
        elif is_ros:
            is_ros = argument != '--'
        else:
            own.append(argument)
    return own


def serve_page(node: OutlierFilterNode, port: int = 0) -> PageServer:
    """Serve the page of a node that is not started yet, and log its address once."""
    # Without a page none of this is loaded.
    from lidar_outlier_filter.report.served import PageServer  # noqa: PLC0415
    from lidar_outlier_filter.ros.live_parameters import NodeAccess  # noqa: PLC0415

    server = PageServer(NodeAccess(node), port)
    node.show(server.show)
    server.start()
    node.get_logger().info(f'page: {server.address}')
    return server


if __name__ == '__main__':
    sys.exit(main())
