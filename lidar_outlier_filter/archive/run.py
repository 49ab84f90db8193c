# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A run over recordings or files: what is done already is left, what fails costs itself only."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime
from time import perf_counter
from typing import TYPE_CHECKING, Any, Generic

from lidar_outlier_filter.archive.fingerprints import model_hash, parameters_hash, version
from lidar_outlier_filter.archive.locations import location_of
from lidar_outlier_filter.archive.manifest import DONE, NO_CLOUDS, How, begun
from lidar_outlier_filter.archive.order import One
from lidar_outlier_filter.archive.proof import is_proved
from lidar_outlier_filter.archive.step import Progress
from lidar_outlier_filter.archive.work import work_through
from lidar_outlier_filter.disk.new_files import taken
from lidar_outlier_filter.errors import FilterError, NoCloudsError, SchedulerError, said_by

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from lidar_outlier_filter.archive.hands import ByWhom
    from lidar_outlier_filter.archive.manifest import Entry, Manifest
    from lidar_outlier_filter.archive.order import Made, Order
    from lidar_outlier_filter.archive.task import Task


def pending(tasks: Sequence[One], order: Order[One], manifest: Manifest) -> list[One]:
    """Choose the recordings or files whose outputs the manifest does not prove."""
    if manifest.folder is None:
        return list(tasks)
    how, made = _how(order), order.made(tasks, manifest.folder)
    return [
        task for task in tasks if not is_proved(task, how, manifest, made.get(str(task.output)))
    ]


def run_all(
    tasks: Sequence[One],
    order: Order[One],
    manifest: Manifest,
    by: ByWhom,
    keep: Callable[[One, Made], object] = lambda _task, _made: None,
) -> list[Entry]:
    """Work on recordings or files, and write into the manifest what became of each.

    What fails costs itself only; ``keep`` is called with what was made.

    Raises
    ------
    SchedulerError
        If the scheduler goes away.

    """
    progress = Progress({task.source: task.location.size for task in tasks}, order.unit)
    run = _Run(order, manifest, progress, keep)
    tick = by.tick(progress)
    work_through(tasks, by.hands(order, progress), run.begin, manifest.flush, run.end, tick)
    return [manifest.entries[task.source] for task in tasks]


def run_alone(task: One, order: Order[One], by: ByWhom) -> Any:
    """Work on a single one, without a manifest; return the report.

    Raises
    ------
    FilterError
        If it is refused, or something has the name of the output.

    """
    if task.output.exists():
        raise taken(task.output, order.new)
    progress = Progress({task.source: task.location.size}, order.unit)
    found: list[Made] = []

    def end(_task: Task, take: Callable[[], Made]) -> None:
        found.append(take())
        order.give_names(task, found[0].built)

    hands, tick = by.hands(order, progress), by.tick(progress)
    work_through([task], hands, lambda _task: True, lambda: None, end, tick)
    return replace(found[0].report, output=task.output)


class _Run(Generic[One]):
    """Notes of each that it is begun, and what became of it."""

    def __init__(
        self,
        order: Order[One],
        manifest: Manifest,
        progress: Progress,
        keep: Callable[[One, Made], object],
    ) -> None:
        self._order, self._how, self._keep = order, _how(order), keep
        self._manifest, self._progress = manifest, progress
        self._begun: dict[One, tuple[Entry, float, bool]] = {}

    def begin(self, task: One) -> bool:
        """Note that one is begun; return whether its outputs may have their names."""
        entry, began = begun(task, self._how), perf_counter()
        try:
            replaces = self._replaces(task)
        except FilterError as err:
            self._note(replace(entry, error=str(err)), began)
            return False
        self._manifest.add(entry)
        self._begun[task] = entry, began, replaces
        return True

    def _replaces(self, task: One) -> bool:
        """Return whether there is an older output, which is ours; refuse another one's."""
        if self._manifest.folder is None:
            return False  # whoever writes it says so
        there = [path for path in task.outputs if path.exists()]
        if there and not self._order.is_ours(task, self._manifest):
            must_be = f'{self._order.new}, or one of the manifest'
            raise taken(there[0], must_be, self._order.error)
        return bool(there)

    def end(self, task: One, take: Callable[[], Made]) -> None:
        """Note what became of one, whose outputs get their names."""
        entry, began, replaces = self._begun.pop(task)
        try:
            made = take()
            self._order.give_names(task, made.built, replaces=replaces)
            entry = noted(entry, task, self._order, made)
            self._keep(task, made)
        except SchedulerError:
            raise
        except NoCloudsError as err:
            entry = replace(entry, state=NO_CLOUDS, error=str(err))
        except FilterError as err:
            entry = replace(entry, error=str(err))
        except Exception as err:  # noqa: BLE001  whatever it is, the next one is worked on
            what = f'the {self._order.what} {task.location.path}'
            wrong = self._order.error(what, self._order.verb, said_by(err))
            entry = replace(entry, error=str(wrong))
        self._note(entry, began)

    def _note(self, entry: Entry, began: float) -> None:
        finished = datetime.now(UTC).isoformat(timespec='seconds')
        seconds = entry.seconds or round(perf_counter() - began, 3)
        entry = replace(entry, seconds=seconds, finished=finished)
        self._manifest.add(entry)
        self._progress.finish(entry.source)


def noted(entry: Entry, task: One, order: Order[One], made: Made) -> Entry:
    """Say in an entry what was made."""
    state = location_of(task.output).state
    return replace(
        entry,
        **order.counted(made.report),
        hash=made.hash,
        output_hash=made.output_hash or state,
        output_state=state,
        worker=made.worker,
        seconds=round(made.seconds, 3),
        state=DONE,
        error=None,
    )


def _how(order: Order[One]) -> How:
    options = parameters_hash(order.filter, **order.options)
    return How(options, version(order.judge), model_hash())
