# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A detector that takes too long: that is said while it runs, and the verdict stays what it is."""

import io
import os
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.clouds import STAMP
from helpers.drives import content
from helpers.nodes import Ros, line, receive
from helpers.replays import cloud as sweep
from helpers.replays import write_drive
from helpers.scans import points_of

from lidar_outlier_filter.cli.main import main
from lidar_outlier_filter.core.detectors import sor
from lidar_outlier_filter.core.engine.slow import SlowDetector, watched
from lidar_outlier_filter.core.points.points import SECOND
from lidar_outlier_filter.pipeline.library import CloudFilter

LONGEST = 30.0  # seconds that a test waits for what must come
VALUES = {'chain': ('sor',), 'blocks': 'message', 'halo': 0.0, 'max_delay': 0.001}
NEVER = {**VALUES, 'max_delay': 60.0}
SENTENCE = 'sor takes more than 0.01 s for '
POINTS = points_of(np.ones((3, 3)))


@pytest.fixture
def held(monkeypatch: pytest.MonkeyPatch) -> threading.Event:
    """Let ``sor`` take until this is set, or until the test has failed."""
    measure: Callable[..., Any] = sor.measure
    said = threading.Event()

    def measure_late(neighbourhood: Any, *rest: Any) -> Any:
        # With so many points kernels are made ready.
        assert said.wait(LONGEST)
        return measure(neighbourhood, *rest)

    monkeypatch.setattr(sor, 'measure', measure_late)
    return said


class Listening(io.StringIO):
    """Standard error that lets go of what is held once the sentence is on it."""

    def __init__(self, said: threading.Event) -> None:
        super().__init__()
        self._said = said

    def write(self, text: str) -> int:
        """Take a part of what is said."""
        count = super().write(text)
        if SENTENCE in self.getvalue():
            self._said.set()
        return count


def test_it_is_said_while_it_runs(held: threading.Event) -> None:
    """Once for each detector in words, each time to whom it is counted by."""
    warnings: list[str] = []
    clean = CloudFilter(VALUES, warn=warnings.append)
    noted: list[SlowDetector] = []

    def note(slow: SlowDetector) -> None:
        noted.append(slow)
        # Let go only of those that wait now.
        held.set()

    clean.slow = note
    messages = [line(0.1 * number) for number in range(3)]
    results = []
    for msg in messages:
        held.clear()
        results += clean.push(msg)
    assert [(one.name, one.limit, one.points) for one in noted] == [('sor', 0.01, 100)] * 3
    assert [one.begin for one in noted] == [STAMP + number * SECOND // 10 for number in range(3)]
    assert [text for text in warnings if 'takes' in text] == [
        f'{SENTENCE}100 points, from sensor time {STAMP / SECOND:.3f} s'
    ]
    quick = CloudFilter(NEVER)
    expected = [result for msg in messages for result in quick.push(msg)]
    assert [result.outliers for result in results] == [result.outliers for result in expected]


def test_who_is_in_time_is_not_named() -> None:
    """Neither a detector that ends in time, nor one that ends without anybody who asks."""
    noted: list[SlowDetector] = []
    with watched('late', 0.001, POINTS, noted.append):
        done = threading.Event()
        with watched('later', 0.05, POINTS, lambda _: done.set()):
            assert done.wait(LONGEST)
        with watched('in time', 60.0, POINTS, noted.append), watched('nobody', 0.0, POINTS, None):
            pass
    assert [one.name for one in noted] == ['late']


def test_what_is_said_raises(monkeypatch: pytest.MonkeyPatch) -> None:
    """An error of what is called with it ends nothing: the next one is watched as well."""
    raised = threading.Event()
    monkeypatch.setattr(threading, 'excepthook', lambda _: raised.set())

    def fail(_slow: SlowDetector) -> None:
        raise ValueError

    with watched('first', 0.001, POINTS, fail):
        assert raised.wait(LONGEST)
    said = threading.Event()
    with watched('second', 0.001, POINTS, lambda _: said.set()):
        assert said.wait(LONGEST)


def test_in_a_process_that_was_forked_off() -> None:
    """It has a watcher of its own."""
    said = threading.Event()
    with watched('parent', 0.001, POINTS, lambda _: said.set()):
        assert said.wait(LONGEST)
    child = os.fork()
    if child == 0:
        said.clear()
        with watched('child', 0.001, POINTS, lambda _: said.set()):
            os._exit(0 if said.wait(LONGEST) else 1)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0


def test_live(ros: Ros, held: threading.Event, capfd: pytest.CaptureFixture[str]) -> None:
    """Diagnostics warn, with the name, while the cloud has no output yet; the log says it once."""
    longest = {'health.delay_warn': 1000.0}
    node = ros.filter(parameters={**VALUES, 'max_delay': 0.05, **longest})
    node.start()
    receive(node.channels[0], line(0))
    sentence = SENTENCE.replace('0.01', '0.5')
    found = ros.diagnosis(lambda found: sentence in found.message)
    assert found.level >= 1  # an error where the cloud has waited too long, besides
    assert not held.is_set()
    held.set()
    node.finish()
    assert capfd.readouterr().err.count(sentence) == 1
    assert node.channels[0].statistics.messages == 1


def test_replay(tmp_path: Path, held: threading.Event, monkeypatch: pytest.MonkeyPatch) -> None:
    """On standard error, once, with the topic; the outputs are the same."""
    source = write_drive(tmp_path / 'drive', [sweep(number) for number in range(3)])
    options = [f'--set={name}={value}' for name, value in VALUES.items() if name != 'chain']
    listening = Listening(held)
    monkeypatch.setattr(sys, 'stderr', listening)
    target = ['--output', str(tmp_path / 'slow')]
    assert main(['replay', str(source), *target, *options, '--set=chain=[sor]']) == 0
    assert listening.getvalue().count(f'/lidar: {SENTENCE}') == 1
    assert 'max_delay' not in listening.getvalue()
    target = ['--output', str(tmp_path / 'quick')]
    quick = ['--set=chain=[sor]', '--set=blocks=message', '--set=halo=0.0']
    assert main(['replay', str(source), *target, *quick]) == 0
    assert content(tmp_path / 'slow') == content(tmp_path / 'quick')


def test_clean(tmp_path: Path, held: threading.Event, monkeypatch: pytest.MonkeyPatch) -> None:
    """On standard error, once, with the file."""
    path = tmp_path / 'cloud.csv'
    rows = np.random.default_rng(1).normal(size=(60, 3))
    path.write_text('x,y,z\n' + ''.join(f'{x},{y},{z}\n' for x, y, z in rows.tolist()))
    listening = Listening(held)
    monkeypatch.setattr(sys, 'stderr', listening)
    options = [f'--set={name}={value}' for name, value in VALUES.items() if name != 'chain']
    assert main(['clean', str(path), '--chain', 'sor', *options]) == 0
    assert listening.getvalue().count(f'{path}: {SENTENCE}60 points\n') == 1
    assert 'max_delay' not in listening.getvalue()
