# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A detector of one's own: declared in one file, registered, and known everywhere."""

from __future__ import annotations

import runpy
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from helpers.cloud_files import columns
from helpers.nodes import Sensor, line
from helpers.replays import ROW, write_drive
from helpers.replays import cloud as recorded
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import PointCloud2

from lidar_outlier_filter.cli.main import main
from lidar_outlier_filter.core.detectors.declaration import Detector, Measured, Tiled
from lidar_outlier_filter.core.detectors.dials import Dial, decades, each, plain
from lidar_outlier_filter.core.detectors.registry import (
    BITS,
    DETECTORS,
    register,
    registered,
    table,
    unregister,
)
from lidar_outlier_filter.core.detectors.scores import Scores
from lidar_outlier_filter.core.judging.chain import Chain
from lidar_outlier_filter.core.points.points import Points
from lidar_outlier_filter.core.verdict import SECOND_PHASE
from lidar_outlier_filter.errors import FilterError, ParameterError
from lidar_outlier_filter.parameters.declaration import Section, declare
from lidar_outlier_filter.parameters.filter import FilterParameters, describe
from lidar_outlier_filter.parameters.yaml_files import read_yaml, write_yaml
from lidar_outlier_filter.recordings.bags import Recording
from lidar_outlier_filter.recordings.replay import replay
from lidar_outlier_filter.tuning.dials import searches

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from helpers.nodes import Ros
    from numpy.typing import NDArray

    from lidar_outlier_filter.core.neighbours.neighbourhood import Neighbourhood

    Floats = NDArray[np.float64]

ROOT = Path(__file__).parents[3]
EXAMPLE = ROOT / 'doc' / 'examples' / 'new_detector.py'
BIT = 128
EXTRA = SECOND_PHASE


# What one who adds a detector writes ---------------------------------------------------------


@dataclass(frozen=True)
class Toy(Section):
    """Distance to the nearest other point."""

    limit: float = declare(0.5, 'Longest distance that is kept.', 'm', 1e-3, 1e3)
    rank: int = declare(1, 'The neighbour that counts.', '', 1, 10)

    def check(self) -> None:
        """Refuse what makes no sense together."""
        if self.rank > 5 and self.limit < 0.01:
            raise ParameterError('toy.limit', 'at least 0.01 m with such a rank', self.limit)


def _rank(parameters: FilterParameters) -> int:
    return parameters.of(Toy).rank


def _measure(neighbourhood: Neighbourhood, parameters: FilterParameters) -> Floats:
    rank = _rank(parameters)
    result = np.full(len(neighbourhood), np.nan)
    if len(neighbourhood) > rank:
        xyz, other = neighbourhood.xyz, neighbourhood.nearest(rank).index[:, -1]
        result[neighbourhood.order] = np.linalg.norm(xyz - xyz[other], axis=1)
    return result


def _score(measured: Floats, _range: Callable[[], Floats], parameters: FilterParameters) -> Scores:
    extra = np.where(measured > 10, np.uint16(EXTRA), np.uint16(0))
    return Scores(measured / parameters.of(Toy).limit, extra)


MEASURED = Measured(_measure, _score, steps=1)


def _dials(_parameters: FilterParameters) -> list[Dial]:
    return [each('toy.rank', (1, 2))]


TOY = Detector(
    name='toy',
    bit=BIT,
    section=Toy,
    detect=MEASURED.detect,
    threshold=lambda _: plain('toy.limit', decades(-3, 3)),
    dials=_dials,
    neighbours=_rank,
    tiled=MEASURED,
    colour='#123456',
    rejects='has no other beside it',
    source='this test',
)


# What follows from it ------------------------------------------------------------------------


@pytest.fixture
def toy() -> Iterator[Detector]:
    """Register it for a test."""
    with registered(TOY):
        yield TOY


def naive(xyz: Floats, limit: float) -> list[bool]:
    """Return which points are farther from all others than the limit."""
    far = []
    for i, one in enumerate(xyz):
        others = [float(np.linalg.norm(one - two)) for j, two in enumerate(xyz) if j != i]
        far.append(min(others) > limit)
    return far


def scattered(count: int = 200) -> Points:
    """Make points, the last of which float far from all others."""
    xyz = np.random.default_rng(1).random((count, 3)) * [10, 5, 0.1]
    xyz[-3:, 2] += [2.0, 20.0, 200.0]
    zeros = np.zeros(count, np.int64)
    return Points(xyz, zeros, zeros, np.ones(count, np.bool_))


@pytest.mark.usefixtures('toy')
def test_chain() -> None:
    """It judges in a chain, alone and after another, and its bits say."""
    points = scattered()
    parameters = FilterParameters().changed({'chain': ['toy'], 'toy.limit': 1.0})
    verdict = Chain(parameters).judge(points)
    assert verdict.rejected.tolist() == naive(points.xyz, 1.0)
    assert verdict.detectors[-3:].tolist() == [BIT, BIT | EXTRA, BIT | EXTRA]
    both = Chain(parameters.changed({'chain': ['sor', 'toy']})).judge(points)
    assert set(both.detectors.tolist()) >= {0, BITS['sor']}
    assert (both.rejected >= verdict.rejected).all()


@pytest.mark.usefixtures('toy')
def test_parameters(tmp_path: Path) -> None:
    """Its parameters are among all others: checked, written to and read from files."""
    names = [item.name for item in describe()]
    assert names[-2:] == ['toy.limit', 'toy.rank']
    changed = FilterParameters().changed({'toy.limit': 2, 'chain': ['lof', 'toy'], 'vote': 2})
    assert changed.of(Toy) == Toy(limit=2.0)
    assert FilterParameters().of(Toy) == Toy()
    assert changed.flat()['toy.limit'] == 2.0
    again = changed.changed({'toy.rank': 3})
    assert again.of(Toy) == Toy(limit=2.0, rank=3)
    assert again.changed({'toy.limit': 0.5, 'toy.rank': 1, 'chain': ['lof'], 'vote': 0}).flat() == (
        FilterParameters().changed({'chain': ['lof']}).flat()
    )
    path = tmp_path / 'toy.yaml'
    path.write_text(write_yaml(again.flat()))
    assert FilterParameters().changed(read_yaml(path)) == again
    with pytest.raises(ParameterError, match=r"toy\.limit must be a number, got '2'"):
        changed.changed({'toy.limit': '2'})
    with pytest.raises(ParameterError, match=r'toy\.limit must be at least 0\.01 m with such'):
        changed.changed({'toy.limit': 0.005, 'toy.rank': 6})


@pytest.mark.usefixtures('toy')
def test_a_node(ros: Ros) -> None:
    """A node has its parameters, which are set while it runs, and its bit is in the clouds."""
    node = ros.filter('-p', 'chain:=[toy]', '-p', 'toy.limit:=0.4', '-p', 'scores:=true')
    node.start()
    sensor = Sensor(ros, '/points')
    sensor.wait_for_filter(node)
    listed = ros.wait(ros.parameters().list_parameters()).result.names
    assert {'toy.limit', 'toy.rank'} <= set(listed)
    sensor.publish(line(0.0), 1)
    sensor.wait_for_answers()
    (outliers,) = sensor.outliers
    assert outliers.width == 1
    offset = next(field.offset for field in outliers.fields if field.name == 'outlier_detectors')
    assert np.frombuffer(outliers.data, '<u2', 1, offset).tolist() == [BIT]
    (reason,) = ros.set(toy__limit=0.0)
    assert reason == 'toy.limit must be from 0.001 to 1000 m, got 0.0'
    assert ros.set(toy__limit=3.0) == ['']
    assert node.filter_parameters.of(Toy).limit == 3.0
    sensor.publish(line(1.0), 2)
    sensor.wait_for_answers()
    assert [msg.width for msg in sensor.outliers] == [1, 0]


@pytest.mark.usefixtures('toy')
def test_a_recording(tmp_path: Path) -> None:
    """A recording is filtered by it, and the table counts what it rejected."""
    clouds = [recorded(index) for index in range(3)]
    source = write_drive(tmp_path / 'drive', clouds)
    report = replay(source, tmp_path / 'out', parameters={'chain': ['toy'], 'toy.limit': 0.5})
    rows = [np.frombuffer(cloud.data, ROW) for cloud in clouds]
    xyz = [np.stack([one['x'], one['y'], one['z']], axis=1).astype(np.float64) for one in rows]
    expected = [sum(naive(one, 0.5)) for one in xyz]
    (topic,) = report.topics
    assert dict(topic.rejected_by) == {'toy': sum(expected)}
    with Recording(tmp_path / 'out') as bag:
        written = [data for topic, _, data in bag.messages() if topic.name == '/lidar/outliers']
    assert [deserialize_message(data, PointCloud2).width for data in written] == expected
    assert min(expected) > 0


@pytest.mark.usefixtures('toy')
@pytest.mark.parametrize('tile', ['0', '2'])
def test_a_file(tmp_path: Path, tile: str) -> None:
    """A file is cleaned by it, in one piece and in tiles."""
    points = scattered()
    path = tmp_path / 'cloud.csv'
    np.savetxt(path, points.xyz, '%.17g', ',', header='x,y,z', comments='')
    wanted = ['--chain', 'toy', '--set', 'toy.limit=1.0', '--tile', tile]
    assert main(['clean', str(path), *wanted]) == 0
    outlier, bits = columns(tmp_path / 'cloud_cleaned.csv', 'outlier', 'outlier_detectors')
    assert outlier.tolist() == naive(points.xyz, 1.0)
    assert bits[-3:].tolist() == [BIT, BIT | EXTRA, BIT | EXTRA]


@pytest.mark.usefixtures('toy')
def test_tuner() -> None:
    """The tuner tries its dial and sweeps its threshold."""
    (search,) = searches(FilterParameters().changed({'chain': ['toy']}))
    assert search.threshold.name == 'toy.limit'
    assert list(search.settings) == [{'toy.rank': 1}, {'toy.rank': 2}]


def test_it_goes_as_it_came() -> None:
    """Behind the context nobody knows it."""
    before = describe(), dict(DETECTORS), dict(BITS)
    with registered(TOY):
        assert DETECTORS['toy'] is TOY
        assert BITS['toy'] == BIT
        assert 'toy' in describe()[1].choices
    assert (describe(), dict(DETECTORS), dict(BITS)) == before
    with pytest.raises(ParameterError, match='a section of parameters must be an added one'):
        FilterParameters().of(Toy)
    with pytest.raises(ParameterError, match='chain must be a list, without repetition, of one of'):
        FilterParameters().changed({'chain': ['toy']})
    register(TOY)
    unregister('toy')
    assert (describe(), dict(DETECTORS), dict(BITS)) == before


@pytest.mark.parametrize('bit', [0, 3, 64, SECOND_PHASE, -1])
def test_bits_are_one_detectors_own(bit: int) -> None:
    """A bit that is taken, or is none for detectors, is refused; nothing is left of it."""
    before = describe()
    with (
        pytest.raises(FilterError, match='the bit of toy must be one of 128, 256, 512, 1024'),
        registered(replace(TOY, bit=bit)),
    ):
        pass
    assert describe() == before
    assert 'toy' not in DETECTORS


@pytest.mark.parametrize('name', ['lof', 'evidence', 'evidence_profile', 'block', 'motion'])
def test_names_are_one_detectors_own(name: str) -> None:
    """So is a name that is taken by a detector or a parameter."""
    with (
        pytest.raises(ParameterError, match='the name of a section must be a new one'),
        registered(replace(TOY, name=name)),
    ):
        pass
    assert DETECTORS['lof'].bit == 4
    assert BIT not in BITS.values()


# The example of CONTRIBUTING -------------------------------------------------------------------


def test_the_example(tmp_path: Path) -> None:
    """It registers itself, and cleans a file as its formula says."""
    points = scattered()
    path = tmp_path / 'cloud.csv'
    np.savetxt(path, points.xyz, '%.17g', ',', header='x,y,z', comments='')
    runpy.run_path(str(EXAMPLE))
    try:
        assert DETECTORS['lonely'].bit == BIT
        assert main(['clean', str(path), '--chain', 'lonely', '--set', 'lonely.limit=1.0']) == 0
    finally:
        unregister('lonely')
    outlier, bits = columns(tmp_path / 'cloud_cleaned.csv', 'outlier', 'outlier_detectors')
    assert outlier.tolist() == naive(points.xyz, 1.0)
    assert set(bits.tolist()) == {0, BIT}


def test_contributing_quotes_the_example() -> None:
    """CONTRIBUTING shows the example as it is, and names every field of a declaration."""
    text = (ROOT / 'CONTRIBUTING.md').read_text(encoding='utf-8')
    code = EXAMPLE.read_text(encoding='utf-8').split('\n', 2)[2]
    assert f'```python\n{code}```\n' in text
    for item in fields(Detector):
        assert f'| `{item.name}` |' in text


# What the package declares -------------------------------------------------------------------


def test_declarations_agree_with_the_parameters() -> None:
    """Names, sections, thresholds and dials of all detectors are those of the parameters."""
    assert tuple(DETECTORS) == describe()[1].choices
    names = {item.name for item in describe()}
    for name, detector in DETECTORS.items():
        assert detector.name == name
        assert type(getattr(FilterParameters(), name)) is detector.section
        assert detector.threshold(FilterParameters()).name in names
        assert BITS[name] == detector.bit
        assert f'| `{name}` | {detector.bit} | {detector.rejects} |' in table()
    assert len({one.colour for one in DETECTORS.values()}) == len(DETECTORS)
    assert DETECTORS['alpha_beta_gamma'].tiled is Tiled.BY_LINE
