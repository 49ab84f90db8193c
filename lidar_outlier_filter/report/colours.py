# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The colour of each detector in pictures."""

from __future__ import annotations

_COLOURS = {
    'alpha_beta_gamma': '#0072b2',
    'boosted_trees': '#000000',
    'elevation': '#56b4e9',
    'hierarchical': '#e69f00',
    'lof': '#d55e00',
    'quadric': '#cc79a7',
    'sor': '#009e73',
}
_OF_PLUGINS = ('#7f3c8d', '#a5732a', '#4b6a53', '#8c8c00')


def colour(name: str, bit: int) -> str:
    """Return '#rrggbb' for a detector; plug-ins get theirs by their bit."""
    return _COLOURS.get(name) or _OF_PLUGINS[bit.bit_length() % len(_OF_PLUGINS)]
