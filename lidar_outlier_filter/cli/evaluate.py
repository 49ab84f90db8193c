# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The command ``evaluate``. It imports what is heavy when it runs, so that help is instant."""

# ruff: noqa: PLC0415  as said above

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from lidar_outlier_filter.cli.terminal import DONE, INCOMPLETE, can_draw, show
from lidar_outlier_filter.errors import RecordingError

if TYPE_CHECKING:
    import argparse
    from collections.abc import Sequence

    from lidar_outlier_filter.cli.terminal import Commands
    from lidar_outlier_filter.evaluation.judged import Judged
    from lidar_outlier_filter.evaluation.labels import Codes
    from lidar_outlier_filter.evaluation.report import Evaluation

NUMBERS, ROC, PRECISION_RECALL = 'evaluation.json', 'roc', 'precision_recall'


def add_evaluate(commands: Commands) -> None:
    """Add the command ``evaluate``."""
    parser = commands.add_parser(
        'evaluate',
        help='compare rejected points with labels',
        description='Count the outliers found and the good points lost, by labels in the clouds or '
        'in separate files. With scores (scores: true) also by detector, with ROC curves. '
        'Exit status: 0 all done; 1 refused; 3 written without pictures: matplotlib is missing.',
        epilog='examples:\n  lidar-outlier-filter evaluate drive_cleaned\n'
        '  lidar-outlier-filter evaluate street_cleaned.laz --labels truth.laz --codes 7,18',
    )
    parser.add_argument(
        'verdicts',
        type=Path,
        metavar='OUTPUT',
        help='recording with TOPIC/cleaned and TOPIC/outliers; or a file: an output of clean, or '
        'any file with a column of scores',
    )
    add_truth(parser)
    parser.add_argument(
        '--topic', metavar='T', help='topic that was filtered; default: the only one'
    )
    parser.add_argument(
        '--score',
        default='',
        metavar='NAME',
        help='column of a file with the scores; default: outlier_score',
    )
    parser.add_argument(
        '--verdict',
        default='',
        metavar='NAME',
        help='column that is nonzero for rejected points (classification: 7 or 18); default: '
        'outlier, else the score, else classification',
    )
    parser.add_argument(
        '--threshold',
        type=float,
        metavar='X',
        help='points of a file with a larger score are rejected; default: 1',
    )
    parser.add_argument(
        '--output',
        type=Path,
        metavar='DIR',
        help=f'new folder for {NUMBERS} and, with scores, the curves as PNG and SVG',
    )
    parser.set_defaults(run=_run)


def add_truth(parser: argparse.ArgumentParser) -> None:
    """Add the options that say where the truth is."""
    parser.add_argument(
        '--labels',
        type=Path,
        action='append',
        metavar='FILE',
        help='the truth: SemanticKITTI .label, LAS, CSV, Parquet or another table, or .npy; for a '
        'recording one file per cloud: repeat the option in order, or name a folder, whose files '
        'are ordered by the number in their names; default: a field of the clouds',
    )
    parser.add_argument(
        '--label',
        default='',
        metavar='NAME',
        help='field or column with the truth; default: label (files: classification, then label)',
    )
    parser.add_argument(
        '--codes',
        metavar='N,N-N,...',
        help='labels of outliers; default: all but 0 (LAS: 7 and 18; .label: 1)',
    )
    parser.add_argument(
        '--ignore',
        metavar='N,N-N,...',
        help='labels of points that do not count; default: none (.label: 0)',
    )


def truth_of(options: argparse.Namespace, data: Path) -> tuple[list[Path], Codes]:
    """Find the files with the truth of some data, and say what its codes mean."""
    from lidar_outlier_filter.evaluation.judged import CAUSES
    from lidar_outlier_filter.evaluation.labels import (
        ALL_BUT_0,
        USUAL_CODES,
        Codes,
        is_recording,
        parse_codes,
    )

    files = label_files(options.labels or [])
    if len(files) > 1 and not is_recording(data):
        raise RecordingError('the labels of one file', 'one file', f'{len(files)} files')
    ours = CAUSES if is_recording(data) and not files else ALL_BUT_0
    usual = USUAL_CODES.get((files[0] if files else data).suffix.lower(), ours)
    outliers = usual.outliers if options.codes is None else parse_codes(options.codes)
    ignored = usual.ignored if options.ignore is None else parse_codes(options.ignore)
    # Codes of somebody else are not called what ours are.
    names = usual.names if options.codes is None else {}
    return files, Codes(outliers, ignored - outliers, names)


def label_files(paths: list[Path]) -> list[Path]:
    """List the files named, or those of the one folder that is named, by their numbers."""
    from lidar_outlier_filter.evaluation.labels import by_number

    return by_number(paths[0]) if len(paths) == 1 and paths[0].is_dir() else paths


def _run(options: argparse.Namespace) -> int:
    from lidar_outlier_filter.disk.new_files import FOLDER, check_new
    from lidar_outlier_filter.evaluation.report import evaluate, tables

    draw = True
    if options.output is not None:
        draw = can_draw()
        check_new(options.output, FOLDER)
    points, codes = _read(options)
    result = evaluate(points, codes)
    for number, table in enumerate(tables(result)):
        if number:
            show('')
        show(table)
    if options.output is not None:
        write(result, options.output, draw=draw)
        show(f'written to {options.output}')
    return DONE if draw else INCOMPLETE


def _read(options: argparse.Namespace) -> tuple[Judged, Codes]:
    from lidar_outlier_filter.evaluation import judged
    from lidar_outlier_filter.evaluation.labels import is_recording

    files, codes = truth_of(options, options.verdicts)
    if is_recording(options.verdicts):
        given = (options.verdicts, options.topic, options.label, codes, files)
        return read_recording(*given), codes
    columns = {name: getattr(options, name) for name in ('label', 'score', 'verdict', 'threshold')}
    truth = files[0] if files else options.verdicts
    return judged.read_files(options.verdicts, truth, codes, **columns), codes


def read_recording(
    path: Path,
    topic: str | None = None,
    label: str = '',
    codes: Codes | None = None,
    files: Sequence[Path] = (),
) -> Judged:
    """Read verdicts and truth of a recording; by default its labels are causes."""
    from lidar_outlier_filter.evaluation.judged import CAUSES, read_clouds
    from lidar_outlier_filter.evaluation.labels import CloudLabels
    from lidar_outlier_filter.recordings.bags import Recording
    from lidar_outlier_filter.recordings.split_clouds import filtered_topic, split_clouds

    with Recording(path) as source:
        topic = filtered_topic(source, topic)
        clouds = split_clouds(source, topic, with_inputs=bool(files))
        return read_clouds(clouds, CloudLabels(topic, label, files), codes or CAUSES)


def write(result: Evaluation, folder: Path, *, draw: bool = True) -> None:
    """Write numbers, and pictures on request, to a new folder, which appears whole or not."""
    import json

    from lidar_outlier_filter.disk.new_files import FOLDER, new_output
    from lidar_outlier_filter.evaluation.report import to_json

    with new_output(folder, FOLDER) as built:
        text = json.dumps(to_json(result), indent=1) + '\n'
        (built / NUMBERS).write_text(text, encoding='utf-8')
        if draw and result.curve is not None:
            from lidar_outlier_filter.evaluation.plots import draw_precision_recall, draw_roc

            curves, settings = {'score': result.curve}, {'score': result.whole}
            draw_roc(curves, built / ROC, settings)
            draw_precision_recall(curves, built / PRECISION_RECALL, settings)
