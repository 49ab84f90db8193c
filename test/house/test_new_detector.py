# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A detector with all that can be declared: it is known everywhere."""

from collections.abc import Iterator
from dataclasses import dataclass, fields
from pathlib import Path

import pytest
from helpers import ROOT
from helpers.detectors import BITS, added
from helpers.strangers import EXAMPLE

from lidar_outlier_filter.core.detectors.declaration import Detector, resolve
from lidar_outlier_filter.core.detectors.registry import DETECTORS, table
from lidar_outlier_filter.core.detectors.thresholds import threshold
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


TOY = Detector(
    name='toy',
    bit=BIT,
    section=Toy,
    score=f'{__name__}:none',
    neighbours=_rank,
    rejects='has no other beside it',
)


# What follows from it ------------------------------------------------------------------------


@pytest.fixture
def toy() -> Iterator[Detector]:
    """Let a test know it."""
    with added(TOY):
        yield TOY


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
    """Names, sections, thresholds and searches of all detectors are those of the parameters."""
    assert tuple(DETECTORS) == describe()[1].choices
    names = {item.name for item in describe()}
    for name, detector in DETECTORS.items():
        assert detector.name == name
        for section, kind in {detector.name: detector.section}.items():
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
