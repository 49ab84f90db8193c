# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The parameters of the default detector."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from lidar_outlier_filter.parameters.declaration import Section, declare

if TYPE_CHECKING:
    from collections.abc import Mapping


# What each feature compares, in the order in which the tables show them.
_FEATURES = {
    'spacing': 'Distance to 3 neighbours against what the sensor leads to.',
    'step': 'Distance along the line against the usual.',
    'lonely': 'Distance to 5 neighbours against the usual.',
    'amid': 'Density at the neighbours against that around: not at an edge.',
    'along': 'Difference from the line against the median.',
    'surface': 'Standard deviations from an even surface all around.',
    'alone': 'Few neighbours of other lines.',
    'company': 'From the second pass on: more than a third of the neighbours rejected.',
}


def _weight(name: str, default: float) -> Any:
    return declare(default, _FEATURES[name], '', 0.0, 1000.0)


def _statistic(default: float) -> Any:
    return declare(default, 'Rejected above this weighted sum.', '', 1e-6, 1e6)


def _passes(default: int) -> Any:
    text = 'How often the features are computed, each time without the rejected.'
    return declare(default, text, '', 1, 10)


def _slanted(*, default: bool) -> Any:
    text = 'Reject straight, slanted groups that touch nothing, too: arms of barriers.'
    return declare(default=default, text=text)


@dataclass(frozen=True)
class Weights(Section):
    """Weight of each feature, for a profile scanner."""

    threshold: float = _statistic(18.0)
    passes: int = _passes(6)
    spacing: float = _weight('spacing', 2.8)
    step: float = _weight('step', 1.8)
    lonely: float = _weight('lonely', 2.6)
    amid: float = _weight('amid', 4.8)
    along: float = _weight('along', 3.4)
    surface: float = _weight('surface', 1.6)
    alone: float = _weight('alone', 1.5)
    company: float = _weight('company', 9.0)
    slanted: bool = _slanted(default=True)


@dataclass(frozen=True)
class SpinningWeights(Weights):
    """The same for a spinning sensor."""

    threshold: float = _statistic(10.3)
    passes: int = _passes(2)
    spacing: float = _weight('spacing', 2.5)
    step: float = _weight('step', 1.5)
    lonely: float = _weight('lonely', 1.0)
    amid: float = _weight('amid', 1.3)
    along: float = _weight('along', 0.3)
    surface: float = _weight('surface', 0.3)
    alone: float = _weight('alone', 0.0)
    company: float = _weight('company', 3.0)
    slanted: bool = _slanted(default=False)


@dataclass(frozen=True)
class BoostedTrees(Section):
    """Features, weighed."""

    sensor: str = declare(
        'auto',
        'Whose weights count, boosted_trees_profile or boosted_trees_spinning; auto: spinning '
        'where lines are measured at the same time; survey: none, '
        'the cloud is judged without scan lines; '
        'free: a scanner without rings, in its own frame, as those of Livox.',
        choices=('auto', 'profile', 'spinning', 'survey', 'free'),
    )
    threshold: float = declare(
        1.0, "Rejected above this many times the sensor's own threshold.", '', 1e-6, 1e6
    )

    list_length: ClassVar[int] = 20  # of the neighbour lists that the weighted sum needs
    further: ClassVar[Mapping[str, type[Section]]] = {
        'boosted_trees_profile': Weights,
        'boosted_trees_spinning': SpinningWeights,
    }

    @property
    def columns(self) -> tuple[str, ...]:
        """What it reads of a cloud besides points and times."""
        return ('intensity', 'ring') if self.sensor in {'auto', 'spinning'} else ('intensity',)
