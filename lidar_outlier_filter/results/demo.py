# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The main job in one command: a simulated drive, filtered in two ways, scored and drawn."""

from __future__ import annotations

from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn

from lidar_outlier_filter.errors import RecordingError
from lidar_outlier_filter.evaluation import pictures as picture
from lidar_outlier_filter.evaluation.judged import CAUSES, read_points, read_recording
from lidar_outlier_filter.evaluation.report import evaluate, summary
from lidar_outlier_filter.parameters.filter import PAPER, FilterParameters
from lidar_outlier_filter.parameters.yaml_files import write_yaml
from lidar_outlier_filter.recordings.replay import replay
from lidar_outlier_filter.simulation.demo_street import SENSOR, demo_drive
from lidar_outlier_filter.simulation.recording import record

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from rich.console import Console

    from lidar_outlier_filter.evaluation.report import Evaluation
    from lidar_outlier_filter.simulation.drive import Drive
    from lidar_outlier_filter.simulation.recording import Truth

MARKER = '.lidar_outlier_filter_demo'  # in a folder that a demo made, and may replace
DRIVE, PARAMETERS, PICTURE = 'drive', 'demo.yaml', 'before_after.png'
FORMS: dict[str, Mapping[str, object]] = {'paper': PAPER, 'default': {}}


def run(output: Path, console: Console, drive: Drive | None = None) -> int:
    """Simulate, filter, score and draw; everything is left in ``output``. Returns the exit status.

    The folder appears whole or not at all. One of an earlier demo is replaced.

    Parameters
    ----------
    output : folder to be made
    console : where progress and results go
    drive : what to simulate; None: four seconds through a street

    Raises
    ------
    FilterError
        If ``output`` is there and not a demo's, or cannot be written.

    """
    drive = drive or demo_drive()
    with _new_folder(output) as folder:
        truth, results = _work(folder, drive, console)
    _report(console, output, drive, truth, results)
    return 0


def _work(folder: Path, drive: Drive, console: Console) -> tuple[Truth, dict[str, Evaluation]]:
    """Make everything that the demo leaves."""
    with _progress(console) as progress:
        task = progress.add_task('simulating', total=1.0)
        truth = record(
            drive, folder / DRIVE, progress=lambda done: progress.update(task, completed=done)
        )
        for form in FORMS:
            _filter(folder, form, progress)
        task = progress.add_task('scoring and drawing', total=None)
        results = {form: evaluate(read_recording(folder / form), CAUSES) for form in FORMS}
        form = list(FORMS)[-1]
        picture.draw(*read_points(folder / form), folder / PICTURE, form)
        progress.update(task, total=1.0, completed=1.0)
    (folder / PARAMETERS).write_text(write_yaml(SENSOR), encoding='utf-8')
    return truth, results


def _filter(folder: Path, form: str, progress: Progress) -> None:
    task = progress.add_task(f'filtering, {form}', total=None)
    replay(
        folder / DRIVE,
        folder / form,
        parameters={**SENSOR, **FORMS[form]},
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
        with TemporaryDirectory(prefix=f'.{output.name}.partial-', dir=output.parent) as hidden:
            new, old = Path(hidden, 'new'), Path(hidden, 'old')
            new.mkdir()
            (new / MARKER).touch()
            yield new
            _check(output)
            if output.exists():
                output.rename(old)
            new.rename(output)
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


def _report(
    console: Console, output: Path, drive: Drive, truth: Truth, results: dict[str, Evaluation]
) -> None:
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
    console.print()
    left = {
        PICTURE: 'before and after',
        DRIVE: 'the recording; its fields label and surface are the truth',
        **{form: f'the recording, cleaned and outlier clouds, {form}' for form in FORMS},
        PARAMETERS: 'the parameters; change them and try again:',
    }
    width = max(len(str(output / name)) for name in left)
    for name, text in left.items():
        console.print(f'{output / name!s:{width}}  {text}', soft_wrap=True, highlight=False)
    files = f'{output / DRIVE} --params {output / PARAMETERS}'
    command = f'scripts/environment lidar-outlier-filter replay {files}'
    console.print(f'{"":{width}}  {command}', soft_wrap=True, highlight=False)
