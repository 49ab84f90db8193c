# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Kernels are made ready in a thread beside the filter, and compiled in processes. Knows no ROS."""

import threading
from collections.abc import Callable
from time import monotonic, sleep

from lidar_outlier_filter.core.kernels import kernel_cache
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.pipeline.compiling import (
    Processes,
    is_ready,
    kernels_of,
    load,
    make_ready,
    shares,
)

SETTLE_S = 1.0  # nothing is compiled for a request that is followed by another within this time


class Compiler:
    """Makes the kernels of parameters ready; the last request wins.

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
        between_clouds: Callable[[Callable[[], None]], object],
    ) -> None:
        """Pass parameters with loaded kernels to ``ready``; text to the next two."""
        self.compiling = ''
        self._ready, self._inform, self._warn = ready, inform, warn
        self._between_clouds = between_clouds
        self._lock = threading.RLock()
        self._requested: FilterParameters | None = None
        self._now: FilterParameters | None = None  # whose chain filters until then
        self._processes = Processes()  # of the work that is not cancelled
        self._thread = threading.Thread()
        self._is_working = False  # the thread will look at what is requested

    @property
    def reply(self) -> str:
        """Say which chain filters until the new one is ready; empty if no change is pending."""
        requested, now = self._requested, self._now
        if requested is None or now is None:
            return ''
        return (
            f'chain {", ".join(requested.chain)} starts when its kernels are ready; '
            f'until then: {", ".join(now.chain)}'
        )

    def request(self, parameters: FilterParameters) -> None:
        """Pass these to ``ready`` once their kernels are loaded; at once if they are."""
        with self._lock:
            before, self._requested = self._requested, parameters
            if is_ready(parameters):
                if before is not None:
                    self._processes.stop()
                self._take_over(parameters)
            elif before is None or kernels_of(before) != kernels_of(parameters):
                self._processes.stop()
                self.compiling = f'loading the kernels of {", ".join(parameters.chain)}'
                if not self._is_working:
                    self._is_working = True
                    self._thread = threading.Thread(target=self._work, name='compile', daemon=True)
                    self._thread.start()

    def stop(self) -> None:
        """Compile no more."""
        with self._lock:
            self._requested = None
            self._processes.stop()
        if self._thread.ident is not None:
            self._thread.join()

    def _work(self) -> None:
        """Make the kernels ready that were requested last, until none are; one at a time."""
        while True:
            with self._lock:
                requested = self._requested
                if requested is None:
                    self._is_working = False
                    return
                processes = self._processes = Processes(patient=self._now is not None)
            self._make_ready(requested, processes)

    def _make_ready(self, parameters: FilterParameters, processes: Processes) -> None:
        """Make kernels ready; then apply the last requested parameters, if not cancelled."""
        try:
            if not load(parameters):
                self._compile(parameters, processes)
        except Exception as err:  # noqa: BLE001  the first block raises it again, and is counted
            self._warn(f'a detector raised an error while it was compiled: {err}')
        with self._lock:
            if not processes.is_stopped and self._requested is not None:
                self._take_over(self._requested)
        if kernel_cache.portable:
            self._replace_portable(parameters, processes)

    def _replace_portable(self, parameters: FilterParameters, before: Processes) -> None:
        """Compile for this processor in the background; switch kernels between two clouds."""
        with self._lock:
            if before.is_stopped:
                return
            processes = self._processes = Processes(patient=True)
        begin = monotonic()
        problems = processes.run(shares(parameters))
        for problem in problems:
            self._warn(problem)
        if processes.is_stopped or problems:
            return
        replace, took = kernel_cache.read_host(), monotonic() - begin

        def take_over() -> None:
            replace()
            self._inform(f'now using kernels for this processor, compiled in {took:.0f} s')

        self._between_clouds(take_over)

    def _take_over(self, parameters: FilterParameters) -> None:
        if self.compiling and self._now is not None:
            self._inform(f'{", ".join(parameters.chain)} takes over from the next block')
        self._requested, self._now, self.compiling = None, parameters, ''
        self._ready(parameters)

    def _compile(self, requested: FilterParameters, processes: Processes) -> None:
        if self._now is not None:
            sleep(SETTLE_S)
        if processes.is_stopped:
            return
        passes = requested.load.policy == 'pass_through'
        until = 'clouds pass unfiltered meanwhile' if passes else 'no output until then'
        if self._now is not None:
            until = f'{", ".join(self._now.chain)} filters meanwhile'
        sentence = f'compiling {", ".join(requested.chain)}; {until}'
        begin = monotonic()

        def inform(text: str) -> None:
            if not processes.is_stopped:
                self.compiling = text
                self._inform(text)

        def show(done: int, total: int, _part: str) -> None:
            took = monotonic() - begin
            if done < total:
                left = took * (total - done) / done
                parts = f'{done} of {total} parts took {took:.0f} s, about {left:.0f} s left'
                inform(f'{sentence}; {parts}')

        inform(sentence)
        for problem in (*processes.run(shares(requested), show), *kernel_cache.complaints):
            self._warn(problem)
        if not processes.is_stopped:
            make_ready(requested)
