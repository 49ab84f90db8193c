# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A detector with all that can be declared: it is known everywhere."""

from collections.abc import Iterator
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
import pytest
from helpers import ROOT
from helpers.cloud_files import columns
from helpers.detectors import BITS, added
from helpers.strangers import EXAMPLE

from lidar_outlier_filter.cli.main import main
from lidar_outlier_filter.core.annotations import Floats
from lidar_outlier_filter.core.detectors.declaration import Detector, resolve
from lidar_outlier_filter.core.detectors.detector_input import DetectorInput
from lidar_outlier_filter.core.detectors.registry import DETECTORS, table
from lidar_outlier_filter.core.detectors.scores import Scores
from lidar_outlier_filter.core.detectors.thresholds import threshold
from lidar_outlier_filter.core.engine.chain import Chain
from lidar_outlier_filter.core.neighbours.neighbourhood import Neighbourhood
from lidar_outlier_filter.core.points.points import Points
from lidar_outlier_filter.core.verdict import EXTRA
from lidar_outlier_filter.errors import ParameterError
from lidar_outlier_filter.parameters.declaration import Section, declare, walk
from lidar_outlier_filter.parameters.filter import FilterParameters, describe
from lidar_outlier_filter.parameters.yaml_files import read_yaml, write_yaml
from lidar_outlier_filter.report.page import colour

BIT = 128


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


def _score(seen: DetectorInput, parameters: FilterParameters) -> Scores:
    measured = _measure(seen.neighbourhood, parameters)
    extra = np.where(measured > 10, np.uint16(EXTRA), np.uint16(0))
    return Scores(measured / parameters.of(Toy).limit, extra)


TOY = Detector(
    name='toy',
    bit=BIT,
    section=Toy,
    score=_score,
    neighbours=_rank,
    large='files',
    rejects='has no other beside it',
)


# What follows from it ------------------------------------------------------------------------


@pytest.fixture
def toy() -> Iterator[Detector]:
    """Let a test know it."""
    with added(TOY):
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
    assert [name for name in names if name.startswith('toy.')] == ['toy.limit', 'toy.rank']
    changed = FilterParameters().changed({'toy.limit': 2, 'chain': ['lof', 'toy'], 'vote': 2})
    assert changed.of(Toy) == Toy(limit=2.0)
    assert FilterParameters().of(Toy) == Toy()
    assert changed.flat()['toy.limit'] == 2.0
    again = changed.changed({'toy.rank': 3})
    assert again.of(Toy) == Toy(limit=2.0, rank=3)
    assert again.changed({'toy.limit': 0.5, 'toy.rank': 1, 'chain': ['lof'], 'vote': 0}) == (
        FilterParameters().changed({'chain': ['lof']})
    )
    path = tmp_path / 'toy.yaml'
    path.write_text(write_yaml(again.flat()))
    assert FilterParameters().changed(read_yaml(path)) == again
    with pytest.raises(ParameterError, match=r"toy\.limit must be a number, got '2'"):
        changed.changed({'toy.limit': '2'})
    with pytest.raises(ParameterError, match=r'toy\.limit must be at least 0\.01 m with such'):
        changed.changed({'toy.limit': 0.005, 'toy.rank': 6})


@pytest.mark.usefixtures('toy')
def test_a_large_file(tmp_path: Path) -> None:
    """A file is cleaned by it with arrays in files."""
    points = scattered()
    path = tmp_path / 'cloud.csv'
    np.savetxt(path, points.xyz, '%.17g', ',', header='x,y,z', comments='')
    requested = ['--chain', 'toy', '--set', 'toy.limit=1.0', '--tile', '2']
    assert main(['clean', str(path), *requested]) == 0
    outlier, bits = columns(tmp_path / 'cloud_cleaned.csv', 'outlier', 'outlier_detectors')
    assert outlier.tolist() == naive(points.xyz, 1.0)
    assert bits[-3:].tolist() == [BIT, BIT | EXTRA, BIT | EXTRA]


# The example of CONTRIBUTING, and what the package declares --------------------------------------


def test_contributing_quotes_the_example() -> None:
    """CONTRIBUTING shows the example as it is, and names every field of a declaration."""
    text = (ROOT / 'CONTRIBUTING.md').read_text(encoding='utf-8')
    code = (EXAMPLE / 'isolated.py').read_text(encoding='utf-8').split('\n', 2)[2]
    assert f'```python\n{code}```\n' in text
    project = (EXAMPLE / 'pyproject.toml').read_text(encoding='utf-8')
    assert f'```toml\n{project}```\n' in text
    for item in fields(Detector):
        assert f'| `{item.name}` |' in text


def test_declarations_agree_with_the_parameters() -> None:
    """Names, sections, thresholds and dials of all detectors are those of the parameters."""
    assert tuple(DETECTORS) == describe()[1].choices
    names = {item.name for item in describe()}
    for name, detector in DETECTORS.items():
        assert detector.name == name
        for section, kind in detector.sections.items():
            assert {item.name for item in walk(kind, f'{section}.')} <= names
            assert FilterParameters().of(kind) == kind()
        swept = threshold(detector, FilterParameters())
        assert swept is not None
        assert swept.name in names
        assert BITS[name] == detector.bit
        assert f'| `{name}` | {detector.bit} | {detector.rejects} |' in table()
        assert callable(resolve(detector.score))
    colours = {colour(name, bit) for name, bit in BITS.items()}
    assert len(colours) == len(BITS)
    assert colour('toy', BIT) not in colours
