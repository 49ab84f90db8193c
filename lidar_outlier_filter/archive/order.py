# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What is to be done with each recording or file of many, and what was made of one."""

from __future__ import annotations

import shutil
from abc import ABC, abstractmethod
from dataclasses import dataclass
from pathlib import Path
from tempfile import mkdtemp
from typing import TYPE_CHECKING, Any, ClassVar, Generic, TypeVar

from lidar_outlier_filter.archive.task import Task
from lidar_outlier_filter.archive.worker_start import name_of_worker
from lidar_outlier_filter.parameters.filter import FilterParameters

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from contextlib import ExitStack
    from typing import Self

    from lidar_outlier_filter.archive.locations import Location
    from lidar_outlier_filter.archive.manifest import Manifest
    from lidar_outlier_filter.errors import FilterError
    from lidar_outlier_filter.recordings.remote_path import RecordingPath

    # So many of so many messages or points are done, and the share of the work, where it is
    # another; may leave.
    NoteDone = Callable[[int, int, float | None], object]

HERE = 'this process'
One = TypeVar('One', bound=Task)


@dataclass(frozen=True)
class Made:
    """What was made of a recording or a file.

    Attributes
    ----------
    report : what became of its clouds
    built : what has no name yet: paths of this machine, or what is on a store
    hash, output_hash : of source and output; a store marks the output when it has its name
    seconds : that it took
    found : what was looked for in it
    said : what is to be said of it
    worker, code : who made it, and by what, as :func:`.fingerprints.judging_code` says

    """

    report: Any
    built: Any
    hash: str = ''
    output_hash: str = ''
    seconds: float = 0.0
    found: Any = None
    said: Sequence[str] = ()
    worker: str = HERE
    code: str = ''


class Order(ABC, Generic[One]):
    """What is to be done with each: it goes to the workers.

    Attributes
    ----------
    what, verb, failed, unit : what each is, what is done with it, what it is otherwise, and what
        it consists of
    new : what an output must be
    error : why one is refused
    judge : the module whose code decides what is written
    waits : whether some wait at each worker, which is for what takes less than a second

    """

    what: ClassVar[str]
    verb: ClassVar[str]
    failed: ClassVar[str]
    unit: ClassVar[str]
    new: ClassVar[str]
    error: ClassVar[type[FilterError]]
    judge: ClassVar[str]
    waits: ClassVar[bool]

    @property
    @abstractmethod
    def values(self) -> Mapping[str, object]:
        """The parameters of the filter that are given."""

    @property
    @abstractmethod
    def options(self) -> dict[str, Any]:
        """What the bytes of an output depend on, beside the parameters."""

    @property
    def filter(self) -> FilterParameters:
        """All parameters."""
        return FilterParameters().changed(self.values)

    @abstractmethod
    def on_one_thread(self) -> Self:
        """Return the same for a worker, whose kernels have one thread."""

    @abstractmethod
    def make(
        self,
        task: One,
        folder: Path | None,
        note: NoteDone,
        inform: Callable[[str], object],
        prefix: str = '',
    ) -> Made:
        """Read, judge and write one, into a new folder within ``folder`` that begins so.

        Raises
        ------
        FilterError
            If it cannot be read, or has changed meanwhile, or the output cannot be written.

        """

    @abstractmethod
    def give_names(self, task: One, built: Any, *, replaces: bool = False) -> None:
        """Put what was built under its names; whether it ``replaces`` what is ours is known.

        Raises
        ------
        FilterError
            If it cannot be written, or a name has been taken meanwhile.

        """

    @abstractmethod
    def counted(self, report: Any) -> dict[str, Any]:
        """Give the counts of a report as an entry has them."""

    @abstractmethod
    def made(self, tasks: Sequence[One], folder: RecordingPath) -> Mapping[str, Location]:
        """Describe the outputs that are there, by their paths."""

    def is_ours(self, task: One, manifest: Manifest) -> bool:
        """Return whether what has the names of the outputs is that of an earlier run."""
        return manifest.writer(task.made) is not None


def new_folder(folder: Path, prefix: str, undo: ExitStack, error: type[FilterError]) -> Path:
    """Make a folder that hides, for one attempt, which :class:`ExitStack` removes."""
    try:
        own = Path(mkdtemp(prefix=prefix, dir=folder))
    except OSError as err:
        must_be = f'a folder that {name_of_worker()} can write to'
        raise error(f'{folder}', must_be, f'"{err.strerror}"') from err
    undo.callback(shutil.rmtree, own, ignore_errors=True)
    return own
