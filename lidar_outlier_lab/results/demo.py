# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The main job in one command: two simulated drives, filtered, scored and drawn."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from rich.table import Table

from lidar_outlier_filter.cli.evaluate import read_recording
from lidar_outlier_filter.cli.terminal import Advance, progress_bar, show
from lidar_outlier_filter.core.annotations import Bools, Rows
from lidar_outlier_filter.core.points.points import is_return
from lidar_outlier_filter.disk.new_files import replaced, writable
from lidar_outlier_filter.errors import RecordingError
from lidar_outlier_filter.evaluation.confusion import Share
from lidar_outlier_filter.evaluation.judged import CAUSES, joined_clouds
from lidar_outlier_filter.evaluation.labels import CloudLabels
from lidar_outlier_filter.evaluation.report import Evaluation, evaluate, number_table, percent
from lidar_outlier_filter.evaluation.truth import Cause
from lidar_outlier_filter.messages.cloud import AXES
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.parameters.yaml_files import write_yaml
from lidar_outlier_filter.recordings.bags import Recording
from lidar_outlier_filter.recordings.recorded_clouds import filtered_topic, split_clouds
from lidar_outlier_filter.recordings.replay import replay
from lidar_outlier_filter.report.gather import gather
from lidar_outlier_filter.report.page import page
from lidar_outlier_filter.report.sources import RecordedSource
from lidar_outlier_lab.results import pictures as picture
from lidar_outlier_lab.results.papers.methods import CLASSIC
from lidar_outlier_lab.simulation.scenes.demo_street import SENSOR, demo_drive, snow_drive
from lidar_outlier_lab.simulation.world.drive import Drive
from lidar_outlier_lab.simulation.world.recording import record

MARKER = '.lidar_outlier_filter_demo'  # in a folder that a demo made, and may replace
DRIVE, PARAMETERS, PICTURE = 'drive', 'demo.yaml', 'before_after.png'
PAGE, MAX_DRAWN = 'report.html', 3_000_000
SNOW, SNOW_FILTERED, SNOW_PICTURE = 'snow', 'snow_default', 'snow_before_after.png'
FORMS: dict[str, Mapping[str, object]] = {'classic': {**SENSOR, **CLASSIC}, 'default': SENSOR}


def run(output: Path, drive: Drive | None = None, snow: Drive | None = None) -> int:
    """Simulate, filter, score and draw; everything is left in ``output``. Returns the exit status.

    The folder appears whole or not at all. One of an earlier demo is replaced.

    Parameters
    ----------
    output : folder to be made
    drive : what a profile scanner does; None: four seconds through a street
    snow : what a sensor that spins does; None: three turns on the same street in snow

    Raises
    ------
    FilterError
        If ``output`` is there and not a demo's, or cannot be written.

    """
    drive, snow = drive or demo_drive(), snow or snow_drive()
    with _new_folder(output) as folder, progress_bar('demo', lines=True) as advance:
        scanned = _filter(folder / DRIVE, drive, FORMS, advance)
        advance(0, 1, 'drawing')
        (folder / PARAMETERS).write_text(write_yaml(SENSOR), encoding='utf-8')
        form = list(FORMS)[-1]
        picture.draw(*_points(folder / form), folder / PICTURE, form)
        source = RecordedSource(folder / DRIVE, FilterParameters().changed(SENSOR))
        text = page(gather(source, CAUSES, MAX_DRAWN))
        (folder / PAGE).write_text(text, encoding='utf-8')
        snowed = _filter(folder / SNOW, snow, {SNOW_FILTERED: {}}, advance, lines_per_message=1)
        advance(0, 1, 'drawing snow')
        turn = _points(folder / SNOW_FILTERED, number=snow.lines // 2)
        picture.draw_sweep(*turn, folder / SNOW_PICTURE, 'default, one turn')
    seconds = drive.lines / drive.sensor.lines_per_second
    show(
        '',
        f'Simulated {seconds:g} s of a drive: {drive.lines} scan lines, {_said(scanned[0])}',
        '',
        'Filtered twice. classic: by config/classic.yaml, three methods of papers in sequence.',
        f'default: by {", ".join(FilterParameters().chain)}.',
        '',
        summary(scanned[1]),
        '',
        f'Simulated {snow.lines} turns of a sensor that spins, on the same street in snow:',
        _said(snowed[0]),
        '',
        summary({'default': snowed[1][SNOW_FILTERED]}),
        '',
        *_left(output),
    )
    return 0


def _filter(
    bag: Path,
    drive: Drive,
    forms: Mapping[str, Mapping[str, object]],
    advance: Advance,
    lines_per_message: int = 10,
) -> tuple[dict[Cause, int], dict[str, Evaluation]]:
    """Record a drive, filter it in each form into a folder beside it, and score each."""

    def simulating(done: float) -> None:
        advance(round(100 * done), 100, f'simulating, {bag.name}')

    causes = record(drive, bag, lines_per_message=lines_per_message, progress=simulating)
    results = {}
    for form, values in forms.items():

        def filtering(done: int, total: int, form: str = form) -> None:
            advance(done, total, f'filtering, {form}')

        replay(bag, bag.parent / form, parameters=values, progress=filtering)
        results[form] = evaluate(read_recording(bag.parent / form), CAUSES)
    return causes, results


def _points(recording: Path, number: int | None = None) -> tuple[Rows, Bools]:
    """Read the points of a cloud, or of all, and whether each was rejected."""
    points, rejected = [], []
    with Recording(recording) as source:
        topic = filtered_topic(source, None)
        for cloud in joined_clouds(split_clouds(source, topic), CloudLabels(topic)):
            if number in {None, cloud.number}:
                xyz = np.stack([cloud.points[axis] for axis in AXES], axis=1).astype(np.float64)
                points.append(cloud.points[is_return(xyz)])
                rejected.append(np.full(len(points[-1]), cloud.rejected))
    return np.concatenate(points), np.concatenate(rejected)


@contextmanager
def _new_folder(output: Path) -> Iterator[Path]:
    """Give a hidden folder beside ``output`` that takes its name if all goes well."""
    output = output.absolute()
    _check(output)
    with writable(output):
        output.parent.mkdir(parents=True, exist_ok=True)
        with replaced(output) as new:
            new.mkdir()
            (new / MARKER).touch()
            yield new
            _check(output)


def _check(output: Path) -> None:
    """Refuse to replace anything but the folder of an earlier demo, or an empty one."""
    if output.is_symlink() or (output.exists() and not output.is_dir()):
        raise RecordingError('the output', 'a folder', output)
    if output.is_dir() and any(output.iterdir()) and not (output / MARKER).is_file():
        must_be = 'a new folder, or that of an earlier demo'
        raise RecordingError('the output', must_be, f'{output}, which holds something else')


def _said(causes: Mapping[Cause, int]) -> str:
    points = sum(causes.values())
    bad = points - causes[Cause.GOOD]
    return f'{points} points, {bad} ({100 * bad / max(points, 1):.2f} %) of them outliers.'


def _left(output: Path) -> Iterator[str]:
    """Say what is left, and how to go on."""
    left = {
        PAGE: 'the page: open it in a browser',
        PICTURE: 'before and after',
        SNOW_PICTURE: 'before and after, in snow',
        DRIVE: 'the recording; its fields label and surface are the truth',
        **{form: f'the recording, cleaned and outlier clouds, {form}' for form in FORMS},
        SNOW: 'the recording in snow',
        SNOW_FILTERED: 'the recording in snow, cleaned and outlier clouds',
        PARAMETERS: 'the parameters; change them and try again:',
    }
    width = max(len(str(output / name)) for name in left)
    yield from (f'{output / name!s:{width}}  {text}' for name, text in left.items())
    files = f'{output / DRIVE} --params {output / PARAMETERS}'
    yield f'{"":{width}}  scripts/environment lidar-outlier-filter replay {files}'


def summary(results: Mapping[str, Evaluation]) -> Table:
    """Lay out several runs on the same recording beside each other, one column each."""
    runs = list(results.values())
    table = number_table('', *results)
    for name, figures in (
        ('precision', [run.whole.precision.ratio for run in runs]),
        ('recall', [run.whole.recall.ratio for run in runs]),
        ('F1', [run.whole.f1 for run in runs]),
    ):
        table.add_row(name, *map(percent, figures), style='bold')
    for name, share, of in (
        ('outliers found', 'recall', 'causes'),
        ('good points lost', 'false_rejections', 'surfaces'),
    ):
        table.add_row(name, *(_of(run.whole.share(share)) for run in runs))
        parts = [getattr(run, of) for run in runs]
        for part in dict.fromkeys(part for one in parts for part in one):
            cells = (_of(one.get(part, Share(0, 0))) for one in parts)
            table.add_row(f'  {part}', *cells, style='dim')
    return table


def _of(share: Share) -> str:
    return f'{share.part} of {share.total}  {percent(share.ratio):>8}'
