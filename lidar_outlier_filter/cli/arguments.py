# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The arguments of most commands. What runs these is imported later, so that help is instant."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from lidar_outlier_filter.errors import FilterError

if TYPE_CHECKING:
    from argparse import ArgumentParser, Namespace, _SubParsersAction

    Commands = _SubParsersAction[ArgumentParser]  # argparse gives it no other name

MAX_DRAWN_POINTS = 10_000_000  # points


def add_replay(commands: Commands) -> None:
    """Add the command ``replay``."""
    parser = commands.add_parser(
        'replay',
        help='filter the clouds of a recording',
        description='Copy a recording and add, for each topic of clouds, TOPIC/cleaned and '
        'TOPIC/outliers. For a folder of recordings, or a pattern, each recording gets an output '
        'folder; recordings that are already done are skipped. Exit status: 0 all done; 1 refused, '
        'or all clouds refused: nothing is written; 3 written, but clouds or recordings '
        'were refused and have no output, no point of a topic could be tested, or part of a '
        'damaged recording is lost; 4 written, but more was rejected than --accept-share allows. '
        'Recordings without clouds are ignored.',
        epilog='examples:\n  lidar-outlier-filter replay drive --output cleaned\n'
        "  lidar-outlier-filter replay 'drives/*' --output cleaned --set chain=[lof,sor]",
    )
    add = parser.add_argument
    add(
        'recording',
        metavar='RECORDING',
        help='bag folder, .mcap, .db3 or ROS 1 .bag; a folder of those; a pattern in quotes; an '
        'address such as s3://…',
    )
    add('--output', metavar='DIR', help='new folder; default: RECORDING_cleaned, beside it')
    add(
        '--topic',
        action='append',
        default=[],
        dest='topics',
        metavar='T',
        help='filter this topic only; may be repeated; default: all topics of clouds and scans',
    )
    add_parameter_options(parser, chain=True)
    add('--drop-input', action='store_true', help='do not copy the input clouds')
    _add_accepted_share(parser, 'the exit status is 4')
    add(
        '--salvage',
        action='store_true',
        help='filter what can be read of a damaged recording, and count what is lost',
    )
    add(
        '--largest-message',
        type=int,
        default=256,
        metavar='MB',
        help='maximum unpacked size of a message or chunk; default: %(default)s',
    )
    add_worker_options(parser)


def add_clean(commands: Commands) -> None:
    """Add the command ``clean``."""
    parser = commands.add_parser(
        'clean',
        help='filter files of points',
        description='Judge all points of a file together, and write a copy with every attribute '
        'kept. Reads and writes LAS, LAZ, PCD, PLY, PTX, CSV, Parquet, and tables of SQLite '
        'databases; reads E57, written as PLY. Each copy gets a log, NAME.json. '
        'alpha_beta_gamma needs a time and scan lines (LAS: gps_time, and the scan direction, '
        'angle or edges; others: columns such as time and ring); boosted_trees uses them if there '
        'are any. Exit status: 0 all done; 1 all refused, nothing written; 3 a file was refused '
        'or fully untested, or matplotlib is missing.',
        epilog='examples:\n'
        '  lidar-outlier-filter clean street.laz --dry-run --picture worst.png\n'
        '  lidar-outlier-filter clean strips --output cleaned --ignore-classes 7,18',
    )
    add = parser.add_argument
    add('files', type=Path, nargs='+', metavar='FILE', help='clouds, or folders of clouds')
    _add_outputs(parser)
    _add_marks(parser)
    add(
        '--strips',
        action='store_true',
        help='judge the points of each point_source_id (LAS) separately: the strips of a flight',
    )
    add(
        '--buffer',
        type=float,
        default=0.0,
        metavar='METRES',
        help='see the points of the other LAS and LAZ files in the folder of a tile, up to this '
        'far beside it; they are not written. Default: 0, none',
    )
    track = 'where the scanner of LAS was when: SBET, or time, x, y, z [roll, pitch, heading]'
    add('--trajectory', type=Path, metavar='FILE', help=track)
    _add_accepted_share(parser, 'the file is refused')
    add_worker_options(parser)
    add(
        '--tile',
        type=float,
        default=0.0,
        metavar='METRES',
        help='keep large arrays in files, for clouds larger than memory; quadric judges, otherwise '
        'than in one piece, in tiles of this side with a million points or so. Default: 0, not',
    )
    add(
        '--columns',
        metavar='X,Y[,Z]',
        help='the two or three coordinates; default: x,y,z. Columns of a text file without a '
        'header are called 1, 2, 3: --columns 1,2,3',
    )
    add(
        '--unit',
        choices=('m', 'cm', 'mm', 'ft', 'us-ft'),
        help='unit of the coordinates; default: from the LAS or LAZ header, else metres',
    )
    add('--table', metavar='NAME', help='table of a database; default: the only one')
    add_parameter_options(parser, chain=True)


def _add_accepted_share(parser: ArgumentParser, beyond: str) -> None:
    parser.add_argument(
        '--accept-share',
        type=float,
        metavar='SHARE',
        help=f'share of the points that may be rejected; beyond, {beyond}; default: 0.15 for '
        'boosted_trees, 1 for others',
    )


def check_accepted_share(options: Namespace) -> None:
    """Refuse a share that is none."""
    if options.accept_share is not None and not 0 <= options.accept_share <= 1:
        raise FilterError('--accept-share', 'from 0 to 1', options.accept_share)


def _add_outputs(parser: ArgumentParser) -> None:
    add = parser.add_argument
    add(
        '--output',
        type=Path,
        metavar='PATH',
        help='new file, or the folder for it (for several files: a folder, which is created); '
        'default: FILE_cleaned',
    )
    add(
        '--outliers',
        type=Path,
        metavar='FILE',
        help='new file for the rejected points (--rejected separate); default: FILE_outliers',
    )
    add(
        '--dry-run',
        action='store_true',
        help='write no cloud; print rejected points by detector, class and place, and the '
        'largest groups',
    )
    add(
        '--list',
        type=Path,
        metavar='csv|gpkg|FILE',
        help='list rejected points, with reasons, as a new CSV or GeoPackage beside each output, '
        'x_cleaned.laz.rejected.gpkg, or those of one file as FILE.gpkg; also in its dry run',
    )
    add(
        '--picture',
        type=Path,
        metavar='FILE.png',
        help='draw a map of rejected points, and the largest groups from the side, as a new PNG; '
        'also in a dry run',
    )


def _add_marks(parser: ArgumentParser) -> None:
    """Add the options for marking rejected points, and for excluding points by class."""
    add = parser.add_argument
    add(
        '--rejected',
        choices=('mark', 'remove', 'separate'),
        help='mark (default): by classification 7 in LAS, by columns outlier, outlier_score and '
        'outlier_detectors elsewhere (in a database: in a new table), in PTX as missing returns; '
        'remove: leave them out; separate: write them to another file',
    )
    add(
        '--mark',
        choices=('class', 'noise', 'withheld', 'column'),
        default='class',
        help='how rejected points of LAS are marked: class (default): 7; noise: 7 below, 18 above '
        'kept points around; withheld: the withheld flag; column: an extra byte outlier alone',
    )
    add('--mark-class', type=int, default=7, metavar='C', help='instead of 7, for --mark class')
    add('--old-class', action='store_true', help='add the old class as an extra byte old_class')
    add(
        '--scores',
        action='store_true',
        help='add outlier_score, outlier_detectors and outlier_reason, in LAS as extra bytes',
    )
    classes = 'C[,C…]'
    add(
        '--only-classes',
        metavar=classes,
        help='LAS classes whose points may be rejected; all others stay as they are',
    )
    add('--keep-classes', metavar=classes, help='LAS classes whose points stay as they are')
    add(
        '--ignore-classes',
        metavar=classes,
        help='LAS classes, such as 7,18 for known noise, whose points stay as they are and are not '
        'used as neighbours',
    )


def add_report(commands: Commands) -> None:
    """Add the command ``report``."""
    parser = commands.add_parser(
        'report',
        help='make a page: rejected points, reasons, and the effect of other thresholds',
        description='Judge a recording or a file, and write one page that needs no network: the '
        'points in 3-D, a slider for the threshold of each detector, reasons, groups, histograms. '
        'Exit status: 0 all done; 1 refused, nothing is written; 3 written, but some clouds were '
        'refused, or --figures lacks matplotlib.',
        epilog='examples:\n  lidar-outlier-filter report drive --output drive.html\n'
        '  lidar-outlier-filter report street.laz --points 2000000',
    )
    add = parser.add_argument
    add(
        'data',
        type=Path,
        metavar='RECORDING_OR_FILE',
        help='bag folder, .mcap, .db3 or ROS 1 .bag; or a file as for clean',
    )
    add('--output', type=Path, metavar='FILE', help='new file; default: NAME_report.html')
    add(
        '--figures',
        type=Path,
        metavar='DIR',
        help='new folder for figures as SVG and PNG; the page is then written only with --output',
    )
    add('--topic', metavar='T', help='topic of the clouds; default: the only one')
    add(
        '--points',
        type=int,
        default=MAX_DRAWN_POINTS,
        metavar='N',
        help='draw at most N points, 16 bytes each; counts are of all points; default: %(default)s',
    )
    add_parameter_options(parser)
    add_truth(parser)


def add_info(commands: Commands) -> None:
    """Add the command ``info``."""
    parser = commands.add_parser(
        'info',
        help='print what a recording or file contains; try the defaults on recordings',
        description='Print the topics of a recording, their rates, gaps and time jumps, how its '
        'clouds are read, the layout of their scan lines, the share of points that the defaults '
        'reject in a sample, and the filter speed. For a file of points: columns and extent. '
        'Exit status: 0 all done; 1 refused; 3 done, but messages of the recording are missing.',
        epilog='examples:\n  lidar-outlier-filter info drive\n'
        '  lidar-outlier-filter info street.laz',
    )
    add = parser.add_argument
    add(
        'path',
        metavar='PATH',
        help='recording, here or at s3://…, or a file of points such as .las',
    )
    add(
        '--sample',
        type=float,
        default=3.0,
        metavar='SECONDS',
        help='seconds of a recording that the defaults judge; default: 3',
    )


def add_mask(commands: Commands) -> None:
    """Add the command ``mask``."""
    parser = commands.add_parser(
        'mask',
        help='learn the returns of the own vehicle from a drive',
        description='Write a file for --set mask=FILE: directions and ranges of returns that '
        'stay the same while the vehicle moves. Draw a picture beside it. Exit status: 0 all '
        'done; 1 refused, for example because the vehicle stands still.',
        epilog='examples:\n  lidar-outlier-filter mask drive --output car.csv\n'
        '  lidar-outlier-filter mask drive --output car.csv --reach 15',
    )
    add = parser.add_argument
    add('recording', type=Path, metavar='RECORDING', help='recording of a drive')
    add('--output', type=Path, required=True, metavar='FILE', help='new mask, such as car.csv')
    add('--topic', metavar='T', help='topic of the clouds; default: the only one')
    add(
        '--reach',
        type=float,
        default=10.0,
        metavar='METRES',
        help='largest range of a point of the vehicle; default: 10',
    )
    add_parameter_options(parser)


def add_truth(parser: ArgumentParser) -> None:
    """Add the options that say where the truth is."""
    add = parser.add_argument
    add(
        '--labels',
        type=Path,
        action='append',
        metavar='FILE',
        help='the truth: SemanticKITTI .label, LAS, CSV, Parquet or another table, or .npy; for a '
        'recording one file per cloud: repeat the option in order, or name a folder, whose files '
        'are ordered by the number in their names; default: a field of the clouds',
    )
    add(
        '--label',
        default='',
        metavar='NAME',
        help='field or column with the truth; default: label (files: classification, then label)',
    )
    add(
        '--codes',
        metavar='N,N-N,...',
        help='labels of outliers; default: all but 0 (LAS: 7 and 18; .label: 1)',
    )
    add(
        '--ignore',
        metavar='N,N-N,...',
        help='labels of points that do not count; default: none (.label: 0)',
    )


def add_worker_options(parser: ArgumentParser) -> None:
    """Add --jobs, --scheduler and --scheduler-file, which :func:`check_workers` checks."""
    add = parser.add_argument
    add(
        '--jobs',
        type=int,
        metavar='N',
        help='number of recordings or files processed at once; default: 1 for '
        'recordings below 300 MB in total or if Dask is missing, else all cores',
    )
    add(
        '--scheduler',
        metavar='ADDRESS',
        help='address of a Dask cluster whose workers process whole recordings or files of a '
        'folder, e.g. tcp://host:8786; inputs and outputs need the same paths there',
    )
    add('--scheduler-file', metavar='FILE', help='scheduler file, instead of ADDRESS')


def check_workers(options: Namespace, *, is_archive: bool) -> None:
    """Refuse options that contradict one another."""
    if options.jobs is not None and options.jobs < 1:
        raise FilterError('--jobs', 'at least 1', options.jobs)
    cluster = options.scheduler or options.scheduler_file
    if options.jobs is not None and cluster:
        must_be = 'left out with --scheduler, whose cluster has its own processes'
        raise FilterError('--jobs', must_be, options.jobs)
    if cluster and not is_archive:
        raise FilterError('--scheduler', 'for several recordings or files', 'one')


def add_parameter_options(parser: ArgumentParser, *, chain: bool = False) -> None:
    """Add --params, --set and perhaps --chain, which :func:`read_parameters` reads."""
    add = parser.add_argument
    add(
        '--params',
        type=Path,
        action='append',
        default=[],
        metavar='FILE',
        help='ROS parameter file (YAML), as for the node; may be repeated, later files win',
    )
    add(
        '--set',
        action='append',
        default=[],
        dest='settings',
        metavar='NAME=VALUE',
        help='set one parameter, which overrides the files; may be repeated',
    )
    if chain:
        add('--chain', metavar='D[,D…]', help='detectors, in the order in which they run')
