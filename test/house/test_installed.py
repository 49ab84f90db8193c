# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A detector that another distribution brings: it is installed, and every command has it."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
from dataclasses import dataclass, replace
from importlib.metadata import EntryPoint, PathDistribution
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from helpers import ROOT
from helpers.cloud_files import columns
from helpers.detectors import BITS
from helpers.drives import ROW
from helpers.labelled import write
from helpers.live import (
    ARRIVAL,
    collector,
    diagnoser,
    environment,
    filtering,
    next_status,
    publisher,
)
from helpers.programs import Program, ended
from helpers.replays import cloud as recorded
from helpers.watching import RELIABLE
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import PointCloud2

from lidar_outlier_filter.core.annotations import Floats
from lidar_outlier_filter.core.detectors.declaration import Detector, resolve
from lidar_outlier_filter.core.detectors.plugins import (
    BUILTIN,
    GROUP,
    add_plugins,
    entry_points,
)
from lidar_outlier_filter.core.detectors.registry import DETECTORS, table
from lidar_outlier_filter.core.detectors.scores import Scores
from lidar_outlier_filter.core.detectors.thresholds import threshold
from lidar_outlier_filter.errors import ParameterError
from lidar_outlier_filter.parameters.declaration import MASKED, Installed, Section, declare, walk
from lidar_outlier_filter.parameters.filter import FilterParameters, describe, installed
from lidar_outlier_filter.parameters.yaml_files import read_yaml
from lidar_outlier_filter.recordings.bags import Recording
from lidar_outlier_filter.report.page import COLOURS

COMMAND = [sys.executable, '-P', '-m', 'lidar_outlier_filter.cli.main']
BIT = 8192
LIMIT = 0.3  # metres
CHAIN = ('--chain', 'isolated', '--set', f'isolated.limit={LIMIT}')
BROKEN = (
    'the detector broken of broken must be a declaration that can be imported, '
    "got ModuleNotFoundError: No module named 'nothing_of_this_name'"
)
SET = ('--set', 'chain=[isolated]', '--set', f'isolated.limit={LIMIT}')


def write_installed(folder: Path, name: str, code: str) -> dict[str, str]:
    """Write a module with a ``DETECTOR`` as if it had been installed; return what finds it."""
    about = folder / f'{name}-1.0.dist-info'
    about.mkdir(parents=True)
    (folder / f'{name}.py').write_text(code, 'utf-8')
    (about / 'METADATA').write_text(f'Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n', 'utf-8')
    entry = f'[lidar_outlier_filter.detectors]\n{name} = {name}:DETECTOR\n'
    (about / 'entry_points.txt').write_text(entry, 'utf-8')
    return _found_in(folder)


def install(folder: Path) -> dict[str, str]:
    """Install the example into a folder; return what finds it there: the environment.

    The source is copied, as building writes beside it.
    """
    copy = Path(shutil.copytree(ROOT / 'doc/examples/new_detector', folder / 'source'))
    target = folder / 'installed'
    words = ['--quiet', '--no-deps', '--no-build-isolation', '--no-index', '--target', str(target)]
    subprocess.run([sys.executable, '-m', 'pip', 'install', *words, str(copy)], check=True)
    return _found_in(target)


def _found_in(folder: Path) -> dict[str, str]:
    paths = [str(folder), *filter(None, [os.environ.get('PYTHONPATH')])]
    return {'PYTHONPATH': os.pathsep.join(paths)}


@pytest.fixture(scope='module')
def env(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Install the example."""
    return install(tmp_path_factory.mktemp('stranger'))


@pytest.fixture(scope='module')
def drives(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Record two drives."""
    folder = tmp_path_factory.mktemp('drives')
    for name in ('a', 'b'):
        write(folder / name, {'/lidar': [serialize_message(recorded(n)) for n in range(3)]})
    return folder


def run(env: dict[str, str], *words: str | Path) -> str:
    """Run a command, as one who has installed the detector does; return what it says."""
    done = ended(*COMMAND, *words, env=env)
    assert done.returncode == 0, done.stderr
    return done.stdout


def naive(xyz: Floats) -> list[bool]:
    """Return which points are farther from all others than the limit."""
    far = []
    for i, one in enumerate(xyz):
        others = [float(np.linalg.norm(one - two)) for j, two in enumerate(xyz) if j != i]
        far.append(min(others) > LIMIT)
    return far


def expected() -> list[int]:
    """Count what is to be rejected of each recorded cloud."""
    counts = []
    for index in range(3):
        rows = np.frombuffer(recorded(index).data, ROW)
        xyz = np.stack([rows['x'], rows['y'], rows['z']], axis=1).astype(np.float64)
        counts.append(sum(naive(xyz)))
    assert min(counts) > 0
    return counts


def scattered() -> Floats:
    """Make points, the last of which float far from all others."""
    xyz = np.random.default_rng(1).random((200, 3)) * [5, 2, 0.01]
    xyz[-3:, 2] += [2.0, 20.0, 200.0]
    return xyz


def widths(bag: Path) -> list[int]:
    """Count the points of the outlier clouds."""
    with Recording(bag) as recording:
        data = [one for topic, _, one in recording.messages() if topic.name == '/lidar/outliers']
    return [deserialize_message(one, PointCloud2).width for one in data]


def test_a_file(env: dict[str, str], tmp_path: Path) -> None:
    """`clean` has its parameters and its bit."""
    path = tmp_path / 'cloud.csv'
    np.savetxt(path, scattered(), '%.17g', ',', header='x,y,z', comments='')
    run(env, 'clean', path, *CHAIN)
    outlier, bits = columns(tmp_path / 'cloud_cleaned.csv', 'outlier', 'outlier_detectors')
    assert outlier.tolist() == naive(scattered())
    assert set(bits.tolist()) == {0, BIT}


def test_a_recording(env: dict[str, str], drives: Path, tmp_path: Path) -> None:
    """`replay` has it too."""
    run(env, 'replay', drives / 'a', *SET, '--output', tmp_path / 'out')
    assert widths(tmp_path / 'out') == expected()


def test_an_archive(env: dict[str, str], drives: Path, tmp_path: Path) -> None:
    """Workers have it: they judge, and the process that writes does not."""
    run(env, 'replay', drives, *SET, '--jobs', '2', '--output', tmp_path / 'out')
    found = [json.loads((tmp_path / 'out' / f'{name}.json').read_text()) for name in 'ab']
    for entry in (one['archive'] for one in found):
        assert entry['topics']['/lidar']['rejected_by'] == {'isolated': sum(expected())}
        assert entry['worker'] != 'this process'
    assert widths(tmp_path / 'out' / 'b') == expected()


def test_the_tuner(env: dict[str, str], tmp_path: Path) -> None:
    """The tuner sweeps its threshold."""
    xyz = scattered()
    path = tmp_path / 'a.csv'
    label = np.arange(len(xyz)) >= len(xyz) - 3
    table = np.column_stack([xyz, label])
    np.savetxt(path, table, '%.17g', ',', header='x,y,z,label', comments='')
    said = run(env, 'tune', path, *SET, '--set', 'isolated.limit=900.0', '--folds', '3')
    values = read_yaml(tmp_path / 'a_tuned.yaml')
    assert values['chain'] == ['isolated']
    assert 0.1 < float(str(values['isolated.limit'])) < 3
    assert 'isolated.limit' in said


def test_a_node(env: dict[str, str], drives: Path, tmp_path: Path) -> None:
    """The node has it, with nothing but a parameter."""
    env = environment() | env
    given = (RELIABLE, 'chain:=[isolated]', f'isolated.limit:={LIMIT}', 'blocks:=message')
    words = [word for one in given for word in ('-p', one)]
    with (
        collector(tmp_path, ['/points/cleaned', '/points/outliers'], env) as collecting,
        filtering(*words, env=env) as node,
        publisher(drives / 'a', '/points', env) as publishing,
    ):
        collecting.wait_for('matched')
        node.wait_for('filters')
        publishing.send('go')
        publishing.wait_for('published')
        for _ in 2 * expected():
            collecting.wait_for('received', ARRIVAL)
        node.signal(signal.SIGTERM)
        assert node.wait() == 0
        collecting.close()
        assert collecting.wait() == 0
    assert any('chain isolated' in line for line in node.output)
    found = sorted(tmp_path.glob('outliers_*.cdr'))
    clouds = [deserialize_message(one.read_bytes(), PointCloud2) for one in found]
    assert [one.width for one in clouds] == expected()


def test_a_node_names_what_is_refused(tmp_path: Path) -> None:
    """Once in its log, and in each status of its diagnostics."""
    env = write_installed(tmp_path / 'installed', 'broken', 'import nothing_of_this_name')
    env |= environment()
    node_words = ('-P', '-m', 'lidar_outlier_filter.cli.node')
    with diagnoser(env) as diagnosing, Program(*node_words, env=env) as node:
        status = next_status(diagnosing)
        node.signal(signal.SIGTERM)
        assert node.wait() == 0
    (warning,) = (line for line in node.output if 'broken' in line)
    assert warning.startswith('[WARN]')
    assert warning.endswith(f'[outlier_filter_node]: {BROKEN}')
    assert status['values']['refused detector broken'] == BROKEN


# What is refused -----------------------------------------------------------------------------


@dataclass(frozen=True)
class Other(Section):
    """One parameter."""

    limit: float = declare(0.5, 'Longest distance that is kept.', 'm', 1e-3, 1e3)


@dataclass
class NotFrozen(Section):
    """Has no hash."""


@dataclass(frozen=True)
class WrongDefault(Section):
    """A default beyond its range."""

    limit: float = declare(5.0, 'A distance.', 'm', 0.0, 1.0)


@dataclass(frozen=True)
class WrongTogether(Section):
    """Defaults that make no sense with each other."""

    def check(self) -> None:
        """Refuse them."""
        raise ParameterError('a', 'less than b', 1)


def declared(name: str, bit: int = BIT, **changed: Any) -> Any:
    """Declare a detector."""
    whole = Detector(name, bit, Other, lambda _seen, _parameters: Scores(np.empty(0)), 'is alone')
    return replace(whole, **changed)


def found(monkeypatch: pytest.MonkeyPatch, *others: object) -> Installed:
    """Load what another distribution declares, beside the built-in detectors."""
    module = ModuleType('plugin')
    monkeypatch.setitem(sys.modules, 'plugin', module)
    points = []
    for number, one in enumerate(others):
        setattr(module, f'x{number}', one)
        name = one.name if isinstance(one, Detector) and isinstance(one.name, str) else 'x'
        points.append(('', EntryPoint(name, f'plugin:x{number}', GROUP)))
    return add_plugins(points, ['block', 'motion'])


def bits(result: Installed) -> dict[str, int]:
    """Return the bits of the detectors that were accepted."""
    return {name: one.bit for name, one in result.detectors.items()}


def test_bits_belong_to_one_detector(monkeypatch: pytest.MonkeyPatch) -> None:
    """A bit that is taken or invalid is refused in a sentence; all others stay."""
    wrong = [declared(f'other{bit}', bit) for bit in (0, 3, 64, 1 << 15)]
    result = found(monkeypatch, *wrong, declared('good'), declared('late'))
    assert bits(result) == {**BITS, 'good': BIT}
    assert set(result.refused) == {*(one.name for one in wrong), 'late'}
    assert str(result.refused['other64']) == (
        'the bit of the detector other64 of a distribution without a name must be a free one '
        '(none is left), got 64'
    )


@pytest.mark.parametrize('name', ['block', 'motion', *BITS])
def test_names_belong_to_one_detector(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    """A name that is taken is refused, and what has it stays usable."""
    result = found(monkeypatch, declared(name))
    assert bits(result) == BITS
    (sentence,) = map(str, result.refused.values())
    assert f"must be a new one, got '{name}'" in sentence
    assert not set(result.refused) & set(BITS)
    assert result.detectors == BUILTIN


@pytest.mark.parametrize(
    'wrong',
    [
        5,
        replace(declared('x'), name=5),
        replace(declared('x'), name='a b'),
        replace(declared('x'), bit=True),
        replace(declared('x'), bit='8192'),
        replace(declared('x'), bit=8192.0),
        declared('x', section=5),
        declared('x', section=Section),
        declared('x', section=NotFrozen),
        declared('x', section=WrongDefault),
        declared('x', section=WrongTogether),
        declared('x', score=5),
        declared('x', score='no_colon'),
        declared('x', rejects=None),
        declared('x', neighbours=3),
        declared('x', lines='some'),
        declared('x', columns=['intensity']),
        declared('x', field='intensity'),
        declared('x', large='some'),
        declared('x', usual=5),
    ],
)
def test_wrong_declarations(monkeypatch: pytest.MonkeyPatch, wrong: object) -> None:
    """Each is refused in one sentence that names it."""
    result = found(monkeypatch, wrong, declared('good'))
    assert bits(result) == {**BITS, 'good': BIT}
    (sentence,) = map(str, result.refused.values())
    assert re.search('detector .* of a distribution without a name must be ', sentence)
    assert '\n' not in sentence


@pytest.mark.parametrize('leaves', [SystemExit(0), GeneratorExit(), ValueError('no')], ids=repr)
def test_what_leaves_a_plugin(monkeypatch: pytest.MonkeyPatch, leaves: BaseException) -> None:
    """Whatever importing it raises is a reason to refuse it, except an interrupt."""

    def load(_point: EntryPoint) -> object:
        raise leaves

    monkeypatch.setattr(EntryPoint, 'load', load)
    point = EntryPoint('x', 'plugin:x', GROUP)
    sentence = str(add_plugins([('p', point)], []).refused['x'])
    assert sentence.startswith('the detector x of p must be a declaration that can be imported')
    assert type(leaves).__name__ in sentence
    leaves = KeyboardInterrupt()
    with pytest.raises(KeyboardInterrupt):
        add_plugins([('p', point)], [])


def test_an_entry_point_has_the_name_of_its_detector(monkeypatch: pytest.MonkeyPatch) -> None:
    """Or it could take the place of a built-in one."""
    monkeypatch.setattr(EntryPoint, 'load', lambda _point: declared('x'))
    result = add_plugins([('p', EntryPoint('sor', 'plugin:x', GROUP))], [])
    assert result.detectors == BUILTIN
    assert len(result.refused) == 1


def test_a_distribution_without_a_name(tmp_path: Path) -> None:
    """Its detectors are found all the same."""
    write_installed(tmp_path, 'broken', 'raise SystemExit(0)')
    twice = [PathDistribution(tmp_path / 'broken-1.0.dist-info')] * 2
    assert [name for name, _ in entry_points(twice)] == ['broken']
    (tmp_path / 'broken-1.0.dist-info/METADATA').write_text('Metadata-Version: 2.1\n')
    assert [name for name, _ in entry_points(twice)] == ['', '']


def test_a_refused_one_costs_nothing_else(tmp_path: Path) -> None:
    """Its sentence names its distribution, and is said where it is asked for."""
    env = write_installed(tmp_path / 'installed', 'broken', 'import nothing_of_this_name')
    path = tmp_path / 'cloud.csv'
    np.savetxt(path, scattered(), '%.17g', ',', header='x,y,z', comments='')
    run(env, 'clean', path, '--chain', 'sor')
    for words in (('--chain', 'broken'), ('--chain', 'sor', '--set', 'broken.limit=1')):
        done = ended(*COMMAND, 'clean', path, *words, env=env)
        assert done.returncode == 1
        assert done.stderr == BROKEN + '\n'


def test_only_the_packages_own_are_here() -> None:
    """In this environment nobody else has installed one."""
    assert set(installed().detectors) == set(BITS)
    assert installed().refused == {}


def test_declarations_agree_with_the_parameters() -> None:
    """Names, sections, thresholds and searches of all detectors are those of the parameters."""
    items = {item.name: item for item in describe()}
    assert tuple(DETECTORS) == items['chain'].choices
    names = set(items)
    for name, detector in DETECTORS.items():
        assert detector.name == name
        assert {item.name for item in walk(detector.section, f'{name}.')} <= names
        assert FilterParameters().of(detector.section) == detector.section()
        swept = threshold(detector, FilterParameters())
        assert swept is not None
        assert swept.name in names
        assert f'| `{name}` | {detector.bit} | {detector.rejects} |' in table()
        assert callable(resolve(detector.score))
    assert len(set(COLOURS)) == MASKED.bit_length()
