# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The main job in one command: two simulated drives, filtered, scored and drawn."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING

import numpy as np
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn
from rich.table import Table

from lidar_outlier_filter.core.points.points import is_return
from lidar_outlier_filter.disk.new_files import replaced
from lidar_outlier_filter.errors import RecordingError
from lidar_outlier_filter.evaluation.confusion import Share
from lidar_outlier_filter.evaluation.judged import CAUSES, answers, read_recording
from lidar_outlier_filter.evaluation.report import evaluate, percent
from lidar_outlier_filter.messages.cloud import AXES
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.parameters.yaml_files import write_yaml
from lidar_outlier_filter.recordings.replay import replay
from lidar_outlier_filter.report.gather import gather
from lidar_outlier_filter.report.page import write_page
from lidar_outlier_filter.report.sources import RecordedSource
from lidar_outlier_lab.results import pictures as picture
from lidar_outlier_lab.results.papers.methods import SMOOTHER
from lidar_outlier_lab.simulation.scenes.demo_street import SENSOR, demo_drive, snow_drive
from lidar_outlier_lab.simulation.world.recording import record

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

    from numpy.typing import NDArray
    from rich.console import Console

    from lidar_outlier_filter.core.annotations import Bools
    from lidar_outlier_filter.evaluation.report import Evaluation
    from lidar_outlier_lab.simulation.world.drive import Drive
    from lidar_outlier_lab.simulation.world.recording import Truth

MARKER = '.lidar_outlier_filter_demo'  # in a folder that a demo made, and may replace
DRIVE, PARAMETERS, PICTURE = 'drive', 'demo.yaml', 'before_after.png'
PAGE, MOST_DRAWN = 'report.html', 3_000_000
SNOW, SNOW_FILTERED, SNOW_PICTURE = 'snow', 'snow_default', 'snow_before_after.png'
FORMS: dict[str, Mapping[str, object]] = {'paper': SMOOTHER, 'default': {}}


def run(
    output: Path, console: Console, drive: Drive | None = None, snow: Drive | None = None
) -> int:
    """Simulate, filter, score and draw; everything is left in ``output``. Returns the exit status.

    The folder appears whole or not at all. One of an earlier demo is replaced.

    Parameters
    ----------
    output : folder to be made
    console : where progress and results go
    drive : what a profile scanner does; None: four seconds through a street
    snow : what a sensor that spins does; None: three turns on the same street in snow

    Raises
    ------
    FilterError
        If ``output`` is there and not a demo's, or cannot be written.

    """
    drive, snow = drive or demo_drive(), snow or snow_drive()
    with _new_folder(output) as folder, _progress(console) as progress:
        scanned = _scan(folder, drive, progress)
        snowed = _turn(folder, snow, progress)
    _report(console, drive, *scanned)
    _report_snow(console, snow, *snowed)
    _list(console, output)
    return 0


def _scan(folder: Path, drive: Drive, progress: Progress) -> tuple[Truth, dict[str, Evaluation]]:
    """Make everything that the demo leaves of the profile scanner."""
    task = progress.add_task('simulating', total=1.0)
    truth = record(
        drive, folder / DRIVE, progress=lambda done: progress.update(task, completed=done)
    )
    for form, values in FORMS.items():
        _filter(folder / DRIVE, folder / form, {**SENSOR, **values}, progress)
    task = progress.add_task('scoring and drawing', total=None)
    results = {form: evaluate(read_recording(folder / form), CAUSES) for form in FORMS}
    form = list(FORMS)[-1]
    picture.draw(*_points(folder / form), folder / PICTURE, form)
    progress.update(task, total=1.0, completed=1.0)
    (folder / PARAMETERS).write_text(write_yaml(SENSOR), encoding='utf-8')
    _write_page(folder, progress)
    return truth, results


def _write_page(folder: Path, progress: Progress) -> None:
    """Make the page on the drive of the profile scanner."""
    task = progress.add_task('making the page', total=None)
    source = RecordedSource(folder / DRIVE, FilterParameters().changed(SENSOR))
    write_page(gather(source, CAUSES, MOST_DRAWN), folder / PAGE)
    progress.update(task, total=1.0, completed=1.0)


def _turn(folder: Path, drive: Drive, progress: Progress) -> tuple[Truth, Evaluation]:
    """Make everything that it leaves of the sensor that spins; draw the turn in the middle."""
    task = progress.add_task('simulating snow', total=1.0)
    truth = record(
        drive,
        folder / SNOW,
        lines_per_message=1,
        progress=lambda done: progress.update(task, completed=done),
    )
    _filter(folder / SNOW, folder / SNOW_FILTERED, {}, progress)
    task = progress.add_task('scoring and drawing', total=None)
    result = evaluate(read_recording(folder / SNOW_FILTERED), CAUSES)
    turn = _points(folder / SNOW_FILTERED, number=drive.lines // 2)
    picture.draw_sweep(*turn, folder / SNOW_PICTURE, 'default, one turn')
    progress.update(task, total=1.0, completed=1.0)
    return truth, result


def _points(recording: Path, number: int | None = None) -> tuple[NDArray[np.void], Bools]:
    """Read the points of a cloud, or of all, and whether each was rejected."""
    points, rejected = [], []
    for answer in answers(recording, None):
        if number in {None, answer.number}:
            xyz = np.stack([answer.points[axis] for axis in AXES], axis=1).astype(np.float64)
            points.append(answer.points[is_return(xyz)])
            rejected.append(np.full(len(points[-1]), answer.rejected))
    return np.concatenate(points), np.concatenate(rejected)


def _filter(
    recording: Path, output: Path, parameters: Mapping[str, object], progress: Progress
) -> None:
    task = progress.add_task(f'filtering, {output.name}', total=None)
    replay(
        recording,
        output,
        parameters=parameters,
        progress=lambda done, total: progress.update(task, completed=done, total=total),
    )


def _progress(console: Console) -> Progress:
    name = TextColumn('{task.description}')
    return Progress(name, BarColumn(), TaskProgressColumn(), TimeElapsedColumn(), console=console)


@contextmanager
def _new_folder(output: Path) -> Iterator[Path]:
    """Give a hidden folder beside ``output`` that takes its name if all goes well."""
    output = output.absolute()
    _check(output)
    try:
        output.parent.mkdir(parents=True, exist_ok=True)
        with replaced(output) as new:
            new.mkdir()
            (new / MARKER).touch()
            yield new
            _check(output)
    except OSError as err:
        reason = err.strerror or err
        raise RecordingError(f'the folder {output}', 'written in full', reason) from err


def _check(output: Path) -> None:
    """Refuse to replace anything but the folder of an earlier demo, or an empty one."""
    if output.is_symlink() or (output.exists() and not output.is_dir()):
        raise RecordingError('the output', 'a folder', output)
    if output.is_dir() and any(output.iterdir()) and not (output / MARKER).is_file():
        must_be = 'a new folder, or that of an earlier demo'
        raise RecordingError('the output', must_be, f'{output}, which holds something else')


def _report(console: Console, drive: Drive, truth: Truth, results: dict[str, Evaluation]) -> None:
    outliers = next(iter(results.values())).whole.outliers
    seconds = drive.lines / drive.sensor.lines_per_second
    for text in (
        '',
        f'Simulated {seconds:g} s of a drive: {drive.lines} scan lines, {truth.points} points,',
        f'{outliers} ({100 * outliers / max(truth.points, 1):.2f} %) of them outliers.',
        '',
        'Filtered twice. paper: by the α-β-γ smoother of Leslar, Wang and Hu (2010), which looks',
        f'along each line. default: by {", ".join(FilterParameters().chain)}.',
        '',
    ):
        console.print(text, soft_wrap=True, highlight=False)
    console.print(summary(results))


def _report_snow(console: Console, drive: Drive, truth: Truth, result: Evaluation) -> None:
    share = 100 * truth.outliers / max(truth.points, 1)
    for text in (
        '',
        f'Simulated {drive.lines} turns of a sensor that spins, on the same street in snow:',
        f'{truth.points} points, {truth.outliers} ({share:.2f} %) of them outliers.',
        '',
    ):
        console.print(text, soft_wrap=True, highlight=False)
    console.print(summary({'default': result}))
    console.print()


def _list(console: Console, output: Path) -> None:
    """Say what is left, and how to go on."""
    left = {
        PAGE: 'the page to look at: open it in a browser',
        PICTURE: 'before and after',
        SNOW_PICTURE: 'before and after, in snow',
        DRIVE: 'the recording; its fields label and surface are the truth',
        **{form: f'the recording, cleaned and outlier clouds, {form}' for form in FORMS},
        SNOW: 'the recording in snow',
        SNOW_FILTERED: 'the recording in snow, cleaned and outlier clouds',
        PARAMETERS: 'the parameters; change them and try again:',
    }
    width = max(len(str(output / name)) for name in left)
    for name, text in left.items():
        console.print(f'{output / name!s:{width}}  {text}', soft_wrap=True, highlight=False)
    files = f'{output / DRIVE} --params {output / PARAMETERS}'
    command = f'scripts/environment lidar-outlier-filter replay {files}'
    console.print(f'{"":{width}}  {command}', soft_wrap=True, highlight=False)


def summary(results: Mapping[str, Evaluation]) -> Table:
    """Lay out several runs on the same recording beside each other, one column each."""
    answer = Table(title_justify='left', box=None, pad_edge=False, header_style='bold')
    answer.add_column('')
    for name in results:
        answer.add_column(name, justify='right')
    runs = list(results.values())

    def row(name: str, texts: list[str], style: str = '') -> None:
        answer.add_row(name, *texts, style=style)

    row('precision', [percent(run.whole.precision.ratio) for run in runs], 'bold')
    row('recall', [percent(run.whole.recall.ratio) for run in runs], 'bold')
    row('F1', [percent(run.whole.f1) for run in runs], 'bold')
    row('outliers found', [_of(run.whole.recall) for run in runs])
    for name in dict.fromkeys(name for run in runs for name in run.causes):
        row(f'  {name}', [_of(run.causes.get(name, Share(0, 0))) for run in runs], 'dim')
    row('good points lost', [_of(run.whole.false_rejections) for run in runs])
    for name in dict.fromkeys(name for run in runs for name in run.surfaces):
        row(f'  {name}', [_of(run.surfaces.get(name, Share(0, 0))) for run in runs], 'dim')
    return answer


def _of(share: Share) -> str:
    return f'{share.part} of {share.total}  {percent(share.ratio):>8}'
