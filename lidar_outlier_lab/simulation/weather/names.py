# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The weathers by name, with a sentence on each."""

from __future__ import annotations

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
