# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A detector that raises an error: it costs its block, and the next one is judged."""

import gc
import weakref
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.clouds import SECOND, STAMP, cloud, table
from helpers.drives import content
from helpers.nodes import Ros, line, receive, wait_for_thread
from helpers.replays import check_outputs, write_drive
from helpers.replays import cloud as sweep
from helpers.streams import BLOCK, HALO, TaggedCloud, held, points_at, push, stream

from lidar_outlier_filter.cli.main import main
from lidar_outlier_filter.core.detectors import sor
from lidar_outlier_filter.core.detectors.builtin import Sor
from lidar_outlier_filter.core.engine.blocks import Blocks
from lidar_outlier_filter.errors import FilterError, JudgingError
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.pipeline.pipeline import Pipeline
from lidar_outlier_filter.recordings.replay import replay

RAISED = [FilterError('k', 'less', 3), ValueError('a\nb'), FloatingPointError(), MemoryError()]
SENTENCE = 'detection must be free of errors, got ValueError: an error of the test'
FAR = 1000.0  # metres; the detector of these tests raises at a point farther away
SHORT = {'chain': ['sor'], 'block': 0.01, 'halo': 0.0, 'max_delay': 60.0}


def raising(error: Exception, at: int) -> Blocks[TaggedCloud]:
    """Make a stream with short blocks whose chain raises in those that see a time."""

    def check(times: list[int]) -> None:
        if at in times:
            raise error

    made, census = stream()
    census.check = check
    return made


def test_frames_that_are_judged_apart_share_their_block() -> None:
    """The block is what an error costs, whatever the frames in it."""
    made = raising(ValueError(), 5)
    push(made, points_at([4]), 'moved')
    push(made, points_at([5]), 'own', 'own')
    outputs = push(made, points_at([BLOCK + HALO]), 'next') + made.flush()
    kinds = [(cloud.tag, cloud.error is not None) for cloud in outputs]
    assert kinds == [('moved', True), ('own', True), ('next', False)]


@pytest.mark.parametrize('error', RAISED, ids=lambda error: type(error).__name__)
def test_the_error_is_told(error: Exception) -> None:
    """In one sentence, with its place and its traceback, and without the points."""
    made = raising(error, 5)
    push(made, points_at([5]))
    (cloud,) = made.flush()
    result = cloud.error
    assert result is not None
    sentence = str(result)
    assert sentence.startswith('detection must be free of errors, got ')
    assert type(error).__name__ in sentence
    assert '\n' not in sentence
    assert result.place.startswith(__file__)
    assert result.trace.startswith('Traceback')
    assert [result.__traceback__, result.__cause__, result.__context__] == [None] * 3


def test_nothing_is_kept_of_a_block_that_failed() -> None:
    """Neither its points nor its messages, however many there are."""

    def check(_: list[int]) -> None:
        raise ValueError

    made, census = stream()
    census.check = check
    seen: list[weakref.ref[Any]] = []
    for number in range(100):
        points = points_at([number * BLOCK])
        census.blocks.clear()
        seen.append(weakref.ref(points.xyz))
        push(made, points)
        del points
    gc.collect()
    assert sum(points() is not None for points in seen) <= 4
    assert held(made) <= 4


# Clouds -----------------------------------------------------------------------------------------


@pytest.fixture
def broken_sor(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let ``sor`` raise an error where a point is far away."""
    measure: Callable[..., Any] = sor.measure

    def measure_or_raise(neighbourhood: Any, *rest: Any) -> Any:
        if len(neighbourhood) and neighbourhood.xyz.max() > FAR:
            raise ValueError('an error of the test')
        return measure(neighbourhood, *rest)

    monkeypatch.setattr(sor, 'measure', measure_or_raise)


def far(begin: float) -> Any:
    """Make a cloud of 10 ms with a point that is far away."""
    t = np.arange(100) * 1e-4
    rows = table(100, ring=('u2', 1), y=('f4', 10 * t), time=('f4', t))
    rows['x'][50] = 2 * FAR
    return cloud(rows, STAMP + round(begin * SECOND))


@pytest.mark.usefixtures('broken_sor')
def test_clouds_of_the_block_are_refused() -> None:
    """Counted by the reason, said of once for each, the place of the error once."""
    clean = Pipeline(FilterParameters().changed(SHORT))
    refused: list[str] = []
    failed: list[JudgingError] = []
    clean.refuse = lambda err: refused.append(str(err))
    clean.fail = failed.append
    messages = [line(0), far(0.01), line(0.02), far(0.03), far(0.04), line(0.05)]
    outputs = [
        output for number, msg in enumerate(messages) for output in clean.process(msg, number)
    ] + clean.flush()
    assert [output.tag for output in outputs] == [0, 2, 5]
    assert [output.outliers.width > 0 for output in outputs] == [True] * 3
    assert refused == [SENTENCE] * 3
    assert [str(err) for err in failed] == [SENTENCE]
    counts = clean.statistics
    assert counts.refusals == {'detection': 3}
    assert (counts.messages, counts.points, counts.refused, counts.failures) == (3, 300, 3, 3)


@pytest.mark.usefixtures('broken_sor')
def test_clouds_of_the_block_pass() -> None:
    """Where that is asked for: unfiltered, in their turn, and counted as such."""
    clean = Pipeline(FilterParameters().changed(SHORT | {'scores': True}))
    clean.pass_failed = True
    messages = [line(0), far(0.01), line(0.02)]
    outputs = [output for msg in messages for output in clean.process(msg)] + clean.flush()
    assert [output.outliers.width for output in outputs] == [outputs[0].outliers.width, 0, 1]
    assert outputs[1].cleaned.width == 100
    counts = clean.statistics
    assert (counts.bypassed, counts.refused, counts.failures) == ({'failure': 1}, 0, 1)


def test_an_error_at_a_change_of_parameters(monkeypatch: pytest.MonkeyPatch) -> None:
    """The new chain is not tried before: an error costs the clouds of a block, and no more."""
    clean = Pipeline(FilterParameters().changed(SHORT))
    failed: list[JudgingError] = []
    clean.fail = failed.append
    measure = sor.measure
    monkeypatch.setattr(sor, 'measure', None)
    clean.change(clean.parameters.changed({'sor.k': 9}))
    assert clean.parameters.of(Sor).k == 9
    clean.process(line(0))
    assert clean.flush() == []
    assert len(failed) == clean.statistics.failures == 1
    monkeypatch.setattr(sor, 'measure', measure)
    clean.process(line(1))
    assert len(clean.flush()) == 1


# Live and in a replay ---------------------------------------------------------------------------


@pytest.mark.usefixtures('broken_sor')
def test_live(ros: Ros, capfd: pytest.CaptureFixture[str]) -> None:
    """The clouds are refused, the next one is published; diagnostics and log say why."""
    node = ros.filter(parameters=SHORT)
    sensor = ros.sensor(node)
    messages = [line(0), far(0.01), far(0.02), line(0.03), line(0.04)]
    for msg in messages:
        sensor.publish(msg, expected=2)
        received = node.channels[0].health._tally.clouds
        while node.channels[0].health._tally.clouds == received:
            ros.executor.spin_once(0.05)
    sensor.wait_for_outputs()
    assert [msg.header for msg in sensor.cleaned] == [messages[0].header, messages[3].header]
    found = ros.diagnosis(lambda found: found['refused'] == 2)
    assert found.level == 2
    assert 'a detector raised an error in 2 blocks: see the log' in found.message
    assert found['refused for detection'] == found['failures'] == 2
    assert ros.diagnosis(lambda found: found.level < 2)['refused'] == 2
    node.finish()
    said = capfd.readouterr().err
    assert said.count('Traceback') == said.count('in measure_or_raise') == 1
    assert SENTENCE in said


@pytest.mark.usefixtures('broken_sor')
def test_live_they_pass_by_the_policy(ros: Ros) -> None:
    """Under ``pass_through``, which may be set at any time."""
    node = ros.filter(parameters=SHORT)
    node.start()
    channel = node.channels[0]
    for begin, policy in ((0.0, 'drop_oldest'), (0.1, 'pass_through'), (0.2, 'degrade')):
        assert ros.set(load__policy=policy) == ['']
        for msg in (far(begin), line(begin + 0.01)):
            receive(channel, msg)
        wait_for_thread(node)
    assert node.channels[0].statistics.refusals == {'detection': 2}
    assert node.channels[0].statistics.bypassed == {'failure': 1}
    node.finish()
    assert node.channels[0].statistics.messages == 4


@pytest.mark.usefixtures('broken_sor')
@pytest.mark.parametrize('policy', ['drop_oldest', 'pass_through'])
def test_replay(tmp_path: Path, policy: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Refused, whatever the policy, which is for live clouds; the others have their outputs."""
    messages = [sweep(number) for number in range(6)]
    rows = np.frombuffer(messages[3].data, '<f4').copy()
    rows[0] = 2 * FAR
    messages[3].data = rows.tobytes()
    source = write_drive(tmp_path / 'drive', messages)
    values = {'chain': ('sor',), 'halo': 0.0, 'load.policy': policy}
    report = replay(source, tmp_path / 'out', parameters=values)
    assert not report.is_complete
    (topic,) = report.topics
    assert (topic.messages, topic.refused) == (6, 1)
    assert topic.refusals == {'detection': 1}
    before, after = content(source), content(tmp_path / 'out')
    del before['/lidar'][3]
    check_outputs(before, after, '/lidar')
    options = [f'{name}={value}' for name, value in {'chain': '[sor]', 'halo': '0.0'}.items()]
    assert main(['replay', str(source), *(word for o in options for word in ('--set', o))]) == 3
    reason = 'detection must be free of errors, got ValueError: an error of the test'
    assert f'for: {reason} (1)' in capsys.readouterr().err
