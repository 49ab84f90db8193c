# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The features of all models: their names, what each means, and the rows that kernels write.

A model file names the features that its trees ask about. A feature keeps its name as long as its
values are the same.
"""

from collections.abc import Iterable
from typing import Any, NamedTuple

# Users read them as reasons. What is compared with something, or said for it, is divided by it.
# Of the window in the scan pattern. Lengths are divided by the spacing of the beams at that range.
# Of unknown intensity, `bright` and `rank` are -1.
WINDOW = {
    'step': 'gap to the nearer neighbour on its scan line',
    'leap': 'gap to the farther neighbour on its scan line',
    'along': 'how far it leaves the course of its scan line',
    'along_m': 'how far it leaves the course of its scan line, metres',
    'between': 'how far it is off the line between its two neighbours',
    'beside': 'gap to the nearest point on other scan lines',
    'across': 'how far it leaves the course across the scan lines',
    'near3': 'mean distance to the 3 nearest points, for its range',
    'near5': 'mean distance to the 5 nearest points, for its range',
    'near5_m': 'mean distance to the 5 nearest points, metres',
    'before_own': 'share of its scan line beside it that is nearer',
    'behind_own': 'share of its scan line beside it that is farther',
    'before_other': 'share of the scan lines beside it that is nearer',
    'behind_other': 'share of the scan lines beside it that is farther',
    'level_own': 'share of its scan line beside it at the same range',
    'level_other': 'share of the scan lines beside it at the same range',
    'there_own': 'share of the beams beside it, on its line, that hit',
    'there_other': 'share of the beams beside it, on other lines, that hit',
    'rough_own': 'how rough its scan line is around it',
    'rough_other': 'how rough the scan lines beside it are',
    'range': 'distance from the sensor',
    'range_ratio_glare': 'range² ÷ background range: a particle there must outshine it',
    'depth': 'how far it is, compared with the background',
    'dense': 'share of the beams around it that hit within 2 beam spacings',
    'sparse': 'share of the beams around it that hit within 6 beam spacings',
    'bright': 'how bright it is, compared with what is usual at its range',
    'uneven': 'how unevenly the scan lines beside it are spaced',
    'rank': 'share of all points that are less bright for their range',
}
# Of profile scanners besides: predictions by opposite returns, the free group of a point, and its
# height. Without such returns, or a group, features are -1; the slope is a sine.
PROFILE = {
    'middle': 'median deviation from the predictions of opposite points',
    'agree': 'share of opposite points that predict its range',
    'group': 'number of points in its free group',
    'group_slope': 'how steep its group is',
    'group_width': 'how wide its group is for its length',
    'group_advance': 'how far its group moves on from scan line to scan line',
    'group_length': 'length of its group, metres',
    'height': 'how high it is above the floor around, metres; below 0: under it',
}
# Of the second pass besides. How suspect is the log-odds of the first pass, clipped to ±4, or their
# mean, which is -5 without points.
SECOND_PASS = {
    'first': 'how suspect it is by itself',
    'first_own': 'how suspect its scan line is around it',
    'first_other': 'how suspect the scan lines beside it are',
    'first_close': 'how suspect the points around it are, the nearest most of all',
    'first_level': 'how suspect the points around it at the same range are',
    'first_behind': 'how suspect farther points around it are',
    'first_before': 'how suspect nearer points around it are',
    'wide_own': 'share of suspects in a long stretch of its scan line',
    'wide_other': 'share of suspects in a long stretch of other lines',
    'share': 'share of suspects in the whole cloud',
    'share_range': 'share of suspects at its range',
}
# Of trees on ghosts besides: the plane through nearer points around, which the beam of the point
# passes, and which may have mirrored it.
PANE = {
    'nearer': 'share of the points around it that are nearer',
    'pane': 'share of these that are on the plane',
    'pane_uneven': 'how far these are off the plane, metres',
    'pane_level': 'how level the plane is: the sine of its slope to the scan lines',
    'pane_behind': 'how far it is behind the plane, metres',
    'pane_cosine': 'cosine between its beam and the normal of the plane',
    'pane_hole': 'gap on the plane between its beam and the nearest point',
}
# Of the eight nearest neighbours. Lengths are divided by s, the median distance of these to their
# own eighth neighbour. The last two are of the floor of the whole cloud.
NEAR = {
    'near1': 'distance to the nearest point',
    'near3': 'mean distance to the 3 nearest points',
    'near8': 'distance to the 8th nearest point',
    'denser': 'how sparse it is around it, compared with its densest neighbour',
    'sparser': 'how sparse it is around its sparsest neighbour',
    'jump': 'how suddenly its neighbours get farther',
    'jump_at': 'number of neighbours nearer than the greatest gap',
    'listed': 'number of neighbours that have it among their nearest',
    'steps2': 'number of points within two steps to a neighbour',
    'off': 'distance from the plane through its 8 neighbours',
    'flat': 'how uneven its 8 neighbours are',
    'off_flat': 'distance from the plane of its 8 neighbours, for how uneven they are',
    'thin': 'whether its neighbours lie on a line',
    'aside': 'how far it is from the middle of its neighbours, for their spread',
    'level': 'how level the plane through its neighbours is',
    'below': 'how far it is below its neighbours',
    'above': 'how far it is above its neighbours',
    'sunk': 'how far it is below its neighbours, for how uneven they are',
    'raised': 'how far it is above its neighbours, for how uneven they are',
    'rare': 'how sparse it is around it, compared with the whole cloud',
    'component_size': 'number of points in its cluster, up to 61',
    'deep': 'how far it is below the floor around',
    'deep_steep': 'how far it is below the floor around, for how steep that is',
}
# Of a sweep besides, which a sensor at the origin saw; of other clouds they are 0.
SWEEP = {
    'range': WINDOW['range'],
    'near8_range': 'distance to the 8th nearest point, for its range',
}
# Of the sixty nearest neighbours. Lengths are divided by S, the same median of sixty; `contrast` is
# S ÷ s. Gaps are the edges of their spanning tree, grown from the point; wide ones exceed 2 S.
FAR = {
    'wide8': 'distance to the 8th nearest point',
    'wide20': 'distance to the 20th nearest point',
    'wide60': 'distance to the 60th nearest point',
    'densest': 'how sparse it is around it, compared with its six densest neighbours',
    'contrast': 'how much the density changes around it',
    'first_edge': 'first gap, from it to its 60 neighbours',
    'longest': 'widest gap among its 60 neighbours',
    'before': 'number of points on its side of the widest gap',
    'against': 'widest gap among its neighbours, compared with the others on its side',
    'group': 'number of points around it up to a wide gap',
    'off20': 'distance from the plane through 20 neighbours',
    'flat20': 'how uneven 20 neighbours are',
    'off_flat20': 'distance from the plane of 20 neighbours, for how uneven they are',
    'off60': 'distance from the plane through 60 neighbours',
    'flat60': 'how uneven 60 neighbours are',
    'off_flat60': 'distance from the plane of 60 neighbours, for how uneven they are',
    'below20': 'how far it is below 20 neighbours',
    'above20': 'how far it is above 20 neighbours',
    'below60': 'how far it is below 60 neighbours',
    'above60': 'how far it is above 60 neighbours',
    'sunk20': 'how far it is below 20 neighbours, for how uneven they are',
    'raised20': 'how far it is above 20 neighbours, for how uneven they are',
    'sunk60': 'how far it is below 60 neighbours, for how uneven they are',
    'raised60': 'how far it is above 60 neighbours, for how uneven they are',
    'rare60': 'how sparse it is farther around it, compared with the whole cloud',
    'higher': 'share of 60 neighbours that are higher',
    'under': 'how far it is below the line between opposite neighbours',
    'over': 'how far it is above the line between opposite neighbours',
    'first': 'how suspect it is by its 8 neighbours alone',
    'near_odds': 'how suspect its 8 neighbours are',
    'rejected_neighbour_share8': 'share of suspects among 8 neighbours',
    'rejected_neighbour_share60': 'share of suspects among 60 neighbours',
}
# Of trees on one cause alone, mixed pixels and ghosts: their only reasons.
CAUSES = {
    'between_surfaces': 'between two surfaces at an edge',
    'mirrored': 'mirrored by glass, metal or water',
}


# A number never changes its meaning, so each group has numbers to spare: of the window, of the
# second pass, of profile scanners, and of single causes. 0: no feature.
FIRST_NUMBERS = ((1, WINDOW), (65, SECOND_PASS), (129, PROFILE), (193, CAUSES))
LIKELY = ('range', 'range_ratio_glare', 'uneven', 'share', 'share_range')  # no reasons
REASON_NAMES = {
    first + k: name
    for first, names in FIRST_NUMBERS
    for k, name in enumerate(names)
    if name not in LIKELY
}
REASON_NUMBERS = {name: number for number, name in REASON_NAMES.items()}
# Of points without a scan pattern; some have names that others have above.
SURVEY_REASON_NAMES = dict(
    enumerate((name for name in {**NEAR, **FAR, **SWEEP} if name not in LIKELY), 197)
)


def rows(names: Iterable[str], begin: int = 0) -> Any:
    """Return the row of each feature as an attribute, which kernels take as a constant."""
    listed = [(name, int) for name in names]
    made: Any = NamedTuple('Rows', listed)  # type: ignore[misc]
    return made(*range(begin, begin + len(listed)))
