# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""How far a run over many recordings or files is: bars in a terminal, lines elsewhere."""

# ruff: noqa: PLC0415  help is instant

from __future__ import annotations

from contextlib import contextmanager
from time import monotonic
from typing import TYPE_CHECKING

from lidar_outlier_filter.cli.interrupts import stopping
from lidar_outlier_filter.cli.terminal import LINE_PERIOD, say

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from rich.console import Console

    from lidar_outlier_filter.archive.step import Step

    ShowStep = Callable[[Step], None]

MINUTE, HOUR = 60, 3600


@contextmanager
def progress_of_all(text: str) -> Iterator[tuple[ShowStep, Callable[[], None]]]:
    """Give what shows a step, and what leaves if SIGINT or SIGTERM has come."""
    from rich.console import Console

    console = Console(stderr=True)
    with stopping() as leave_if_asked:
        if console.is_terminal:
            with _bars(console, text) as show:
                yield show, leave_if_asked
        else:
            yield _lines(text), leave_if_asked


def _lines(text: str) -> ShowStep:
    """Write a line each ``LINE_PERIOD``; none of a run that is done before."""
    began = monotonic()
    due = began + LINE_PERIOD

    def show(step: Step) -> None:
        nonlocal due
        now = monotonic()
        if now >= due:
            due = now + LINE_PERIOD
            within = f', {step.done} of {step.messages} {step.unit}' if step.messages else ''
            shown = f'{text}: {step.number} of {step.total}: {step.recording}{within}'
            say(f'{shown}{_rate(step, now - began)}')

    return show


@contextmanager
def _bars(console: Console, text: str) -> Iterator[ShowStep]:
    """Show a bar for all recordings, and one for the recording that is written."""
    from rich.progress import Progress

    began, due = monotonic(), 0.0
    with Progress(console=console, transient=True) as bars:
        whole, one = bars.add_task(text, total=None), bars.add_task('', total=None)

        def show(step: Step) -> None:
            nonlocal due
            now = monotonic()
            if now < due and step.done:
                return
            due = now + 1 / 10  # s
            shown = f'{text}: {step.number} of {step.total}{_rate(step, now - began)}'
            bars.update(whole, completed=step.bytes_done, total=step.bytes_total, description=shown)
            total = step.messages or None  # not known
            bars.update(one, completed=step.done, total=total, description=step.recording)

        yield show


def _rate(step: Step, elapsed: float) -> str:
    """Say how many bytes are done in a second, and how long those that are left will take."""
    if not step.bytes_done or elapsed <= 0:
        return ''
    rate = step.bytes_done / elapsed
    left = round((step.bytes_total - step.bytes_done) / rate)
    return f'; {rate / 1e6:.1f} MB/s, {duration(left)} left'


def duration(seconds: int) -> str:
    """Write a time for people: 42 s, 3 min, 2 h 5 min."""
    if seconds < MINUTE:
        return f'{seconds} s'
    hours, minutes = divmod(round(seconds / MINUTE), MINUTE)
    return f'{hours} h {minutes} min' if hours else f'{minutes} min'
