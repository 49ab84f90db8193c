# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The command ``evaluate``. What recordings and pictures need is imported for them only."""

# ruff: noqa: PLC0415  as said above

import argparse
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from lidar_outlier_filter import __version__
from lidar_outlier_filter.cli.terminal import DONE, INCOMPLETE, can_draw, show
from lidar_outlier_filter.disk.new_files import FOLDER, check_new, new_output
from lidar_outlier_filter.errors import RecordingError
from lidar_outlier_filter.evaluation import judged
from lidar_outlier_filter.evaluation.judged import CAUSES, Judged, read_clouds
from lidar_outlier_filter.evaluation.labels import (
    ALL_BUT_0,
    USUAL_CODES,
    CloudLabels,
    Codes,
    by_number,
    is_recording,
    parse_codes,
)
from lidar_outlier_filter.evaluation.report import Evaluation, evaluate, tables, to_json
from lidar_outlier_filter.parameters.declaration import read_small

MAX_LOG_BYTES = 1_000_000
NUMBERS, ROC, PRECISION_RECALL = 'evaluation.json', 'roc', 'precision_recall'


def truth_of(options: argparse.Namespace, data: Path) -> tuple[list[Path], Codes]:
    """Find the files with the truth of some data, and say what its codes mean."""
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
    return by_number(paths[0]) if len(paths) == 1 and paths[0].is_dir() else paths


def run_evaluate(options: argparse.Namespace) -> int:
    """Compare verdicts with the truth."""
    draw = True
    if options.output is not None:
        draw = can_draw()
        check_new(options.output, FOLDER)
    points, codes = _read(options)
    result = evaluate(points, codes)
    if options.output is not None:
        write(result, options.output, _how(options), draw=draw)
    for number, table in enumerate(tables(result)):
        if number:
            show('')
        show(table)
    if options.output is not None:
        show(f'written to {options.output}')
    return DONE if draw else INCOMPLETE


def _read(options: argparse.Namespace) -> tuple[Judged, Codes]:
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
    from lidar_outlier_filter.recordings.bags import Recording
    from lidar_outlier_filter.recordings.recorded_clouds import filtered_topic, split_clouds

    with Recording(path) as source:
        topic = filtered_topic(source, topic)
        clouds = split_clouds(source, topic, with_inputs=bool(files))
        return read_clouds(clouds, CloudLabels(topic, label, files), codes or CAUSES)


def _how(options: argparse.Namespace) -> dict[str, Any]:
    """Say what was compared, and how it was made: versions, seeds and parameters."""
    names = ('label', 'codes', 'ignore', 'topic', 'score', 'verdict', 'threshold')
    given = {name: getattr(options, name) for name in names if getattr(options, name)}
    labels = [path.name for path in options.labels or []]
    how = {'version': __version__, 'verdicts': options.verdicts.name, 'labels': labels, **given}
    if is_recording(options.verdicts):
        from lidar_outlier_filter.recordings.bags import Recording, history

        with Recording(options.verdicts) as source:
            return {**how, 'history': history(source.custom_data)}
    return {**how, 'history': _log_of(options.verdicts)}


def _log_of(path: Path) -> dict[str, Any]:
    """Return how ``clean`` made a file, by the log beside it; nothing without one."""
    try:
        log = json.loads(read_small(path.with_name(f'{path.name}.json'), MAX_LOG_BYTES))
        return {'clean': {name: log[name] for name in ('versions', 'options', 'parameters')}}
    except (OSError, ValueError, LookupError, TypeError, RecursionError):
        return {}


def write(result: Evaluation, folder: Path, how: Mapping[str, Any], *, draw: bool = True) -> None:
    """Write numbers, and pictures on request, to a new folder, which appears whole or not."""
    with new_output(folder, FOLDER) as built:
        text = json.dumps({**to_json(result), 'made': how}, indent=1) + '\n'
        (built / NUMBERS).write_text(text, encoding='utf-8')
        if draw and result.curve is not None:
            from lidar_outlier_filter.evaluation.plots import draw_precision_recall, draw_roc

            curves, settings = {'score': result.curve}, {'score': result.whole}
            draw_roc(curves, built / ROC, settings)
            draw_precision_recall(curves, built / PRECISION_RECALL, settings)
