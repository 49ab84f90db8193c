# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Kernels are compiled in background processes; only compiled ones are used where asked."""

import os
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import pytest
from helpers import TESTS
from helpers.watching import fresh_copy
from numba import njit

from lidar_outlier_filter.cli.compile import _requested
from lidar_outlier_filter.cli.main import main
from lidar_outlier_filter.core.detectors.builtin import BUILTIN
from lidar_outlier_filter.core.kernels import listeners
from lidar_outlier_filter.errors import ParameterError
from lidar_outlier_filter.parameters.filter import FilterParameters, installed
from lidar_outlier_filter.pipeline import compiling
from lidar_outlier_filter.pipeline.compiling import (
    SENSORS,
    KernelShare,
    Processes,
    is_ready,
    kernels_of,
    shares,
)

QUICK = ('sor',)
# Says of each chain whether it can be loaded.
LOADING = """
import sys
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.pipeline.compiling import load
for chain in sys.argv[1:]:
    print(load(FilterParameters().changed({'chain': chain.split(',')})))
"""
# Lists the kernels of the package that were called so far, each with its types.
CALLED = """
import gc
import sys
from pathlib import Path
import numpy as np
from numba.core.dispatcher import Dispatcher
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.pipeline.compiling import make_ready

def called():
    every = [one for one in gc.get_objects() if isinstance(one, Dispatcher)]
    mine = [one for one in every if one.py_func.__module__.startswith('lidar_outlier_filter.core')]
    return {(one.py_func.__name__, str(how)) for one in mine for how in one.signatures}

def parameters(**values):
    return FilterParameters().changed(values)

xyz = np.random.default_rng(1).uniform((0, 0, 0), (20, 20, 0.02), (5000, 3))
survey = parameters(**{'boosted_trees.sensor': 'survey'})
"""
# What is judged after a chain was made ready. Each must call no other kernels.
LATER = {
    # Of both kinds of sensors, with scores and reasons: else a stream would wait for them.
    'stream': """
from helpers.live import clouds
from helpers.profile_scanner import Drive
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import PointCloud2
from lidar_outlier_filter.pipeline.library import CloudFilter

make_ready(parameters(scores=True))
before = called()
spinning = [deserialize_message(data, PointCloud2) for data in clouds(Path(sys.argv[1]))]
profile = Drive(0.5)
for messages in (spinning, profile.clouds(profile.own)):
    stream = CloudFilter(parameters(scores=True), str, str)
    for msg in messages:
        stream.push(msg)
    stream.flush()
    assert stream.statistics.points > stream.statistics.untested
    assert stream.statistics.rejected
""",
    # However they send.
    'blocks': """
from helpers.scans import Drive, sweep
from lidar_outlier_filter.core.engine.chain import Chain

make_ready(parameters())
before, chain = called(), Chain(parameters())
for points in (Drive(1, strays=0.1).points, sweep(1, 0.1, columns=300), Drive(3, 0.2).points):
    mixed = points.take(np.random.default_rng(1).permutation(len(points)))
    for cloud in (points, mixed, points.take(slice(0, 400)), points.take(slice(0, 20))):
        chain.judge(cloud)
""",
    # With many points at one place, and two at another.
    'copies': """
from lidar_outlier_filter.core.engine.chain import Chain
from lidar_outlier_filter.core.points.points import Points

xyz[:25], xyz[30], none = xyz[0], xyz[31], np.zeros(5000, int)
for name in ('hierarchical', 'lof'):
    one = parameters(chain=(name,))
    make_ready(one)
    before = called()
    Chain(one).judge(Points(xyz, none, none, none == 0))
    assert called() == before, name
""",
    # A file without lines.
    'survey': """
from lidar_outlier_filter import detect_outliers

make_ready(survey)
before = called()
xyz[77] = 1, 2, 3
assert detect_outliers(xyz).outlier[77]
""",
    # What ``compile`` has run includes kernels of large clouds, files, masks and explanations.
    'commands': """
import os
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from tempfile import TemporaryDirectory
from lidar_outlier_filter.cli.main import main

make_ready(parameters(), offline=True)
make_ready(survey, offline=True)
before, drive = called(), str(Path(sys.argv[1]).absolute())
said = StringIO()
with TemporaryDirectory() as folder, redirect_stdout(said), redirect_stderr(said):
    os.chdir(folder)
    large = np.random.default_rng(1).uniform((0, 0, 0), (20, 20, 0.02), (40_000, 3))
    large[::1000, 2] += 3.0
    np.savetxt('a.csv', large, '%.4f', ',', header='x,y,z', comments='')
    for words in ('clean a.csv', 'clean a.csv --output b.csv --tile 5', 'report a.csv'):
        assert main(words.split()) == 0, said.getvalue()
    assert main(['mask', drive, '--output', 'car.csv']) in {0, 1}, said.getvalue()  # it stands
    os.chdir('/')
""",
}
NEW = """
assert len(before) > 10
print(sorted({name for name, _ in called() - before}))
"""


def run(env: dict[str, str], *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run Python in that environment."""
    command = [sys.executable, '-P', *arguments]  # not what lies in this folder
    return subprocess.run(command, env=env, capture_output=True, text=True, check=False)


def parameters(*chain: str, **values: object) -> FilterParameters:
    """Make parameters with a chain."""
    return FilterParameters().changed({'chain': chain, **values})


@pytest.mark.slow
def test_compile_fills_the_cache(tmp_path: Path) -> None:
    """Nothing can be loaded before; then all can, beside the sources, and nothing is left."""
    env = os.environ | fresh_copy(tmp_path, 'sor._average*.nb?', 'gabriel.*.nb?')
    assert run(env, '-c', LOADING, 'sor').stdout == 'False\n'
    command = ('-m', 'lidar_outlier_filter.cli.main', 'compile', '--chain', 'sor')
    done = run(env, *command)
    assert done.returncode == 0
    assert done.stderr.endswith(': sor\ncompiled 1 of 1: sor\nthe kernels of sor are compiled\n')
    assert list(tmp_path.rglob('sor._average*.nbi'))
    assert run(env, '-c', LOADING, 'sor', 'sor,hierarchical').stdout == 'True\nFalse\n'
    assert run(env, *command).stderr == 'the kernels of sor are compiled\n'


@pytest.mark.parametrize(
    'what',
    [pytest.param(what, marks=pytest.mark.slow) for what in LATER if what != 'blocks'] + ['blocks'],
)
def test_a_ready_chain_calls_no_other_kernels(recordings: Path, what: str) -> None:
    """In a process of its own: what other tests have compiled does not count in it."""
    paths = [str(TESTS), *filter(None, [os.environ.get('PYTHONPATH')])]
    env = {**os.environ, 'PYTHONPATH': os.pathsep.join(paths)}
    done = run(env, '-c', CALLED + LATER[what] + NEW, str(recordings / 'bags' / 'vlp16_mrpt_mcap'))
    assert (done.stdout, done.stderr) == ('[]\n', '')


def test_scores_have_kernels_of_their_own() -> None:
    """Reasons come with them: who is ready without is not ready with them."""
    work = shares(parameters('boosted_trees', scores=True))
    assert [share.values for share in work] == [{'scores': True}] * len(SENSORS)
    assert kernels_of(parameters('sor', scores=True)) != kernels_of(parameters('sor'))


def test_surveys_are_compiled_once() -> None:
    """Their kernels are the same for all sensors, and `compile` makes them, too."""
    survey = parameters('boosted_trees', **{'boosted_trees.sensor': 'survey'})
    assert [share.sensors for share in shares(survey)] == [SENSORS]
    assert survey in _requested(None, portable=False)


def test_a_wheel_brings_all_detectors() -> None:
    """Portable kernels are compiled for each of them, and for each chain that ships."""
    requested = _requested(None, portable=True)
    assert {name for one in requested for name in one.chain} == set(BUILTIN)
    assert all(one in requested for one in _requested(None, portable=False)[1:])


def test_an_unknown_detector_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    """In one sentence."""
    assert main(['compile', '--chain', 'lof,lov']) == 1
    assert 'chain' in capsys.readouterr().err


def test_only_this_thread_is_kept_from_compiling(monkeypatch: pytest.MonkeyPatch) -> None:
    """Another one may compile meanwhile; what is compiled can be used; listeners learn of it."""
    # Without a cache: what was kept of another run would be used.
    add: Any = njit(lambda x: x + 1)
    results: list[object] = []
    compiled: list[str] = []

    def make_ready(*_arguments: object, **_options: object) -> None:
        if not results:
            add(1)
        results.append(add(2))

    monkeypatch.setattr(compiling, 'make_ready', make_ready)
    listeners.append(compiled.append)
    try:
        chain = parameters('quadric', vote=1)
        assert not compiling.load(chain)
        assert compiled == []
        thread = threading.Thread(target=lambda: results.append(add(1)))
        thread.start()
        thread.join()
        assert compiled == [__name__]
        assert compiling.load(chain)
    finally:
        listeners.remove(compiled.append)
    assert results == [2, 3]


def test_shares_are_all_the_work() -> None:
    """Each detector once for each kind of sensor, with what was changed of its parameters."""
    chain = tuple(installed().detectors)
    work = shares(parameters(*chain, **{'lof.statistic': 'lof2', 'threads': 1}))
    done = [(one.detector, sensor) for one in work for sensor in one.sensors]
    assert len(set(done)) == len(done) == len(chain) * len(SENSORS)
    assert next(one.values for one in work if one.text == 'lof') == {'lof.statistic': 'lof2'}


def test_a_failed_share_is_one_sentence() -> None:
    """The others are compiled all the same, and each is counted."""
    good, bad = shares(parameters(*QUICK))[0], KernelShare('lov', {}, SENSORS)
    steps: list[tuple[int, int]] = []
    errors = Processes().run([bad, good], lambda done, total, _: steps.append((done, total)))
    assert len(errors) == 1
    assert 'could not be compiled' in errors[0]
    assert '\n' not in errors[0]
    assert steps == [(1, 2), (2, 2)]


def test_stopped_processes_begin_nothing() -> None:
    """And it is no error."""
    processes = Processes()
    processes.stop()
    assert not processes.run(shares(parameters(*QUICK)))


def test_what_chooses_kernels_is_not_the_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    """A threshold needs no other kernels; a method may."""
    monkeypatch.setattr(compiling, '_ready', set())  # whatever other tests of the process needed
    compiling.make_ready(parameters(*QUICK))
    assert is_ready(parameters(*QUICK, **{'sor.multiplier': 3.0, 'max_delay': 2.0}))
    assert not is_ready(parameters(*QUICK, **{'sor.statistic': 'radius'}))
    assert not is_ready(parameters('lof', 'sor', vote=2))


def test_an_error_is_raised_through() -> None:
    """Parameters that make no sense are refused, and the thread may compile again."""
    before = list(listeners)
    with pytest.raises(ParameterError):
        compiling.load(parameters('lov'))
    assert listeners == before
