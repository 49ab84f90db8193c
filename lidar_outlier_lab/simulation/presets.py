# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The clouds and the weathers that can be simulated by name. Their makers are imported late."""

from __future__ import annotations

import math
from pkgutil import resolve_name
from typing import TYPE_CHECKING

from lidar_outlier_filter.errors import FilterError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from lidar_outlier_lab.simulation.world.recording import Cloud

_SURVEY, _FLIGHT = 'papers.surveyed_streets:survey', 'papers.aerial:flight'
_STREET, _MAPPING = 'scenes.spinning_streets:street', 'forms:mapping'

# Where the function is that makes the clouds, a module in simulation/, and a sentence about them.
PRESETS = {
    'leslar-a': (_SURVEY, 'street, wet, cold; 1 098 689 points, 1 % outliers in clumps'),
    'leslar-b': (_SURVEY, 'street, wet; 295 147 points, 0.30 % scattered, a barrier arm'),
    'leslar-c': (_SURVEY, 'street, dry; 237 740 points, 0.01 % just above the road'),
    'pirotti-sfm': ('papers.aerial:photogrammetry', '1 002 596 points from images, 2596 shifted'),
    'pirotti-fcd': ('papers.bus_tracks:lines', 'positions of two bus lines, 2-D and 3-D'),
    'sotoodeh-hod': ('papers.sotoodeh_clusters:cloud', '656 points, 84 outliers'),
    'kang-urban': (_FLIGHT, 'houses from the air; 500 000 points, 0.05 % gross errors'),
    'kang-mountain': (_FLIGHT, 'mountain flight; 1 000 000 points, 0.024 % errors'),
    'street-16': (_STREET, '16 rings, rain and spray; 2 % outliers'),
    'street-32': (_STREET, '32 rings, snow; 3 % outliers'),
    'street-64': (_STREET, '64 rings, rain; 2.5 % outliers'),
    'street-128': (_STREET, '128 rings, rain and spray; 2.5 % outliers'),
    'mapping-a': (_MAPPING, 'two heads of 250 turns/s: fences, hedges, wires, sun'),
    'mapping-b': (_MAPPING, 'two heads of 200 turns/s: tramway, traffic, wet road, panes'),
}


def make(
    name: str,
    seed: int = 1,
    share: float | None = None,
    progress: Callable[[float], object] = lambda _: None,
    form: str | None = None,
) -> Iterator[Cloud]:
    """Simulate a preset: clouds in the order in which they are recorded.

    Parameters
    ----------
    name : one of ``PRESETS``
    seed : from 0; the same seed gives the same bytes
    share : of the points that are outliers, 0 to 1; None: the preset's own
    progress : is called with the share done
    form : in which a driver sends it, one of ``forms.FORMS``; None: the preset's own

    Raises
    ------
    FilterError
        If there is no such preset, or it cannot have such a share or form.

    """
    if name not in PRESETS:
        raise FilterError('the preset', f'one of {", ".join(PRESETS)}', name)
    if seed < 0:
        raise FilterError('the seed', 'at least 0', seed)
    if share is not None and not (math.isfinite(share) and 0.0 <= share <= 1.0):
        raise FilterError('the share', 'from 0 to 1', share)
    maker = resolve_name(f'{__package__}.{PRESETS[name][0]}')
    if form is None:
        return maker(name, seed, share, progress)
    if PRESETS[name][0] != _MAPPING:
        raise FilterError('the form', 'of a preset mapping-...', f'{form} of {name}')
    return maker(name, seed, share, progress, form)


WEATHER_NAMES = {
    'light_snow': 'snow of 0.05 to 0.4 mm/h of water',
    'heavy_snow': 'snow of 0.6 to 5 mm/h of water',
    'rain': 'rain of 5 to 80 mm/h',
    'fog': 'uneven fog, 25 to 150 m of sight',
    'spray': 'water behind the wheels of vehicles',
    'dust': 'broad plumes behind vehicles',
    'exhaust': 'small, dense clouds near the ground',
    'mixed': 'points between two surfaces at edges',
    'ghosts': 'points mirrored by panes and by water',
}
RETURN_NAMES = ('strongest', 'first', 'last', 'dual')
