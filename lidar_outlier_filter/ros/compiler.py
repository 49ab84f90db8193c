# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Kernels are made ready in a thread beside the filter, and compiled in processes. Knows no ROS."""

from __future__ import annotations

import threading
from time import monotonic
from typing import TYPE_CHECKING

from lidar_outlier_filter.core.kernels import kernel_cache
from lidar_outlier_filter.pipeline.compiling import (
    Processes,
    is_ready,
    load,
    make_ready,
    shares,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from lidar_outlier_filter.parameters.filter import FilterParameters


class Compiler:
    """Makes the kernels of parameters ready; those that are wanted last win.

    Attributes
    ----------
    compiling : str
        A sentence on what is compiled; empty where nothing is.

    """

    def __init__(
        self,
        ready: Callable[[FilterParameters], object],
        inform: Callable[[str], object],
        warn: Callable[[str], object],
    ) -> None:
        """Call ``ready`` with parameters whose kernels are; the others with sentences."""
        self.compiling = ''
        self._ready, self._inform, self._warn = ready, inform, warn
        self._lock = threading.RLock()
        self._wanted: FilterParameters | None = None
        self._now: FilterParameters | None = None  # whose chain filters until then
        self._thread: threading.Thread | None = None
        self._processes = Processes()

    @property
    def reply(self) -> str:
        """Say what answers until what was set is in force; empty where it is, or nothing does."""
        wanted, now = self._wanted, self._now
        if wanted is None or now is None:
            return ''
        return (
            f'{", ".join(wanted.chain)} takes over when its kernels are ready; '
            f'{", ".join(now.chain)} answers until then'
        )

    def want(self, parameters: FilterParameters) -> None:
        """Call ``ready`` with these when their kernels are; at once, if they are now."""
        with self._lock:
            before, self._wanted = self._wanted, parameters
            if before is not None and shares(before) != shares(parameters):
                self._processes.stop()
            if is_ready(parameters):
                self._take_over(parameters)
                return
            self.compiling = f'loading the kernels of {", ".join(parameters.chain)}'
            if self._thread is None:
                self._thread = threading.Thread(target=self._work, name='compile', daemon=True)
                self._thread.start()

    def stop(self) -> None:
        """Compile no more."""
        with self._lock:
            self._wanted = None
            self._processes.stop()
            thread = self._thread
        if thread is not None:
            thread.join()

    def _work(self) -> None:
        while (wanted := self._next()) is not None:
            try:
                self._make_ready(wanted)
            except Exception as err:  # noqa: BLE001  the first block raises it again, and is counted
                self._warn(f'a detector raised an error while it was compiled: {err}')
            with self._lock:
                if self._wanted is wanted:
                    self._take_over(wanted)

    def _take_over(self, parameters: FilterParameters) -> None:
        if self.compiling and self._now is not None:
            self._inform(f'{", ".join(parameters.chain)} takes over from the next block')
        self._wanted, self._now, self.compiling = None, parameters, ''
        self._ready(parameters)

    def _next(self) -> FilterParameters | None:
        """Return what is wanted; None ends the thread."""
        with self._lock:
            if self._wanted is None:
                self._thread = None
            else:
                self._processes = Processes(patient=self._now is not None)
            return self._wanted

    def _make_ready(self, wanted: FilterParameters) -> None:
        if load(wanted):
            return
        self.compiling = self._sentence(wanted)
        self._inform(self.compiling)
        begin = monotonic()

        def show(done: int, total: int, _part: str) -> None:
            took = monotonic() - begin
            if done < total and self._wanted is wanted:
                left = took * (total - done) / done
                parts = f'{done} of {total} parts took {took:.0f} s, about {left:.0f} s left'
                self.compiling = f'{self._sentence(wanted)}; {parts}'
                self._inform(self.compiling)

        for sentence in self._processes.run(shares(wanted), show):
            self._warn(sentence)
        for sentence in kernel_cache.complaints:
            self._warn(sentence)
        if self._wanted is wanted:
            make_ready(wanted)

    def _sentence(self, parameters: FilterParameters) -> str:
        """Say what is compiled, and what is done until then."""
        said = f'compiling {", ".join(parameters.chain)}'
        if self._now is None:
            return f'{said}; clouds pass unfiltered until then'
        return f'{said}; until then {", ".join(self._now.chain)} answers'
