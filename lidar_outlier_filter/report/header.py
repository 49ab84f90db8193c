# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What the page knows beside the points: an object that is written as JSON."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from lidar_outlier_filter import __version__
from lidar_outlier_filter.core.detectors.registry import DETECTORS, rejecting
from lidar_outlier_filter.core.points.points import SECOND
from lidar_outlier_filter.evaluation.curves import curve
from lidar_outlier_filter.parameters.filter import FilterParameters, describe
from lidar_outlier_filter.parameters.installed import MASK, MASKED
from lidar_outlier_filter.parameters.yaml_files import as_yaml, ros_lines
from lidar_outlier_filter.report.colours import colour
from lidar_outlier_filter.report.pack import reason_names, reason_numbers, reason_texts
from lidar_outlier_filter.report.reasons import REST, vocabulary
from lidar_outlier_filter.report.tally import LARGEST_SCORE, RANGES

if TYPE_CHECKING:
    from lidar_outlier_filter.report.frames import Frames
    from lidar_outlier_filter.report.gather import Gathered
    from lidar_outlier_filter.report.pack import Packed
    from lidar_outlier_filter.report.sliders import Slider
    from lidar_outlier_filter.report.sources import SourceFacts
    from lidar_outlier_filter.report.tally import Counts

MOST_ON_CURVE = 200
MOST_ON_PATH = 1000
VEHICLE = '#8c564b'  # of points on the own vehicle
FARTHEST_ORIGIN = 1000.0  # metres
MOST_LISTED = 8  # reasons
SECTION = 1 << 20  # points of a buffer, or one frame that has more


def header(gathered: Gathered, frames: Frames, packed: Packed) -> dict[str, Any]:
    """Collect all that is not in the buffers."""
    found, tally = gathered.found, gathered.tally
    sections = split(frames)
    period, gaps = found.period_and_gaps()
    return {
        'version': __version__,
        'name': gathered.name,
        'topic': found.topic,
        'clouds': found.clouds,
        'invalid': found.invalid,
        'masked': found.masked,
        'untested': tally.untested,
        'drawn': len(gathered.kept),
        'refusals': found.refusals,
        'unmoved': found.unmoved,
        'moved': found.moved,
        'path': _path(found),
        'convention': found.convention,
        'period': None if math.isnan(period) else period,
        'seconds': (found.span[1] - found.span[0]) / SECOND if found.span else None,
        'gaps': [list(gap) for gap in gaps],
        'chain': list(rejecting(gathered.parameters)),
        'ways': list(gathered.ways),
        'hasFrames': gathered.has_frames,
        'together': frames.together,
        'sliders': [
            _slider(gathered, frames, number, slider)
            for number, slider in enumerate(gathered.sliders)
        ],
        'all': _counts(tally.all),
        'ranges': list(RANGES),
        'largestScore': LARGEST_SCORE,
        'hasRange': near_origin(gathered),
        'scores': tally.scores.tolist(),
        'hasTruth': tally.has_truth,
        'curve': _curve(gathered),
        'sections': len(sections),
        'frames': _frames(gathered, frames, packed, sections),
        'features': [list(one) for one in (*vocabulary().features, *REST)],
        'ofSum': vocabulary().of_sum,
        'reasons': reason_names(),
        'reasonTexts': reason_texts(),
        'explained': len(packed.reasons),
        'detectors': detectors(),
        'intensity': list(packed.intensity),
    }


def detectors() -> list[dict[str, Any]]:
    """Name each detector, its number in the words of points, its colour, and what it rejects."""
    return [
        {
            'name': one.name,
            'number': one.bit.bit_length(),
            'colour': colour(one.name, one.bit),
            'rejects': one.rejects.replace('`', ''),
        }
        for one in DETECTORS.values()
    ] + [
        {
            'name': MASK,
            'number': MASKED.bit_length(),
            'colour': VEHICLE,
            'rejects': 'lies on the own vehicle',
        }
    ]


def _path(found: SourceFacts) -> list[list[float]]:
    """Thin the way of the sensor: positions in metres."""
    each = max(1, len(found.path) // MOST_ON_PATH)
    return [_rounded(position) for position in found.path[::each]]


def near_origin(gathered: Gathered) -> bool:
    """Return whether a sensor may be at the origin: no range of a georeferenced cloud is one."""
    ranges = gathered.kept.range
    return bool(len(ranges)) and float(ranges.min()) < FARTHEST_ORIGIN


def split(frames: Frames) -> list[tuple[int, int]]:
    """Cut the points into buffers: the first and the last frame of each, the last excluded."""
    sections: list[tuple[int, int]] = []
    begin = 0
    for number in range(len(frames)):
        if frames.first[number + 1] - frames.first[begin] > SECTION and number > begin:
            sections.append((begin, number))
            begin = number
    if len(frames):
        sections.append((begin, len(frames)))
    return sections


def _frames(
    gathered: Gathered, frames: Frames, packed: Packed, sections: list[tuple[int, int]]
) -> list[dict[str, Any]]:
    """Say of each frame where its points are, and what they are."""
    first = int(frames.start.min()) if len(frames) else 0
    result = []
    for section, (begin, end) in enumerate(sections):
        for number in range(begin, end):
            low, high = frames.first[number], frames.first[number + 1]
            clouds = frames.clouds[number].tolist() if frames.clouds else []
            points = sum(gathered.tally.clouds[cloud] for cloud in clouds) if clouds else high - low
            result.append(
                {
                    'section': section,
                    'begin': int(low - frames.first[begin]),
                    'count': int(high - low),
                    'points': int(points),
                    'explained': int(frames.explained[number]),
                    'marked': int(frames.marked[number]),
                    'start': (int(frames.start[number]) - first) / SECOND,
                    'origin': packed.origin[number].tolist(),
                    'step': packed.step[number].tolist(),
                }
            )
    return result


def _slider(gathered: Gathered, frames: Frames, number: int, slider: Slider) -> dict[str, Any]:
    tally, parameters = gathered.tally, gathered.parameters
    steps = range(len(slider.values))
    changed = [slider.changed(parameters, step) for step in steps]
    return {
        'detector': slider.detector,
        'name': slider.name,
        'texts': [as_yaml(value) for value in slider.values],
        'given': slider.given,
        'first': slider.first,
        'limits': [_finite(limit) for limit in slider.limits.tolist()],
        'counts': [_counts(tally.at[number][step]) for step in steps],
        'byFrame': [
            [int(tally.of_clouds(number, step, clouds.tolist()).sum()) for clouds in frames.clouds]
            for step in steps
        ],
        'yaml': [parameter_file(one) for one in changed],
        'lines': [ros_lines(FilterParameters(), _not_fixed(one)) for one in changed],
    }


def _not_fixed(parameters: FilterParameters) -> dict[str, Any]:
    """List what differs from the defaults and can be set while a node runs."""
    fixed = {parameter.name for parameter in describe() if parameter.fixed}
    defaults = FilterParameters().flat()
    return {
        name: value
        for name, value in parameters.flat().items()
        if value != defaults[name] and name not in fixed
    }


def parameter_file(parameters: FilterParameters) -> str:
    """Write a ROS parameter file of what is not as by default."""
    defaults = FilterParameters().flat()
    lines = [
        f'    {name}: {as_yaml(value)}'
        for name, value in parameters.flat().items()
        if value != defaults[name]
    ]
    return '\n'.join(['/**:', f'  ros__parameters:{"" if lines else " {}"}', *lines]) + '\n'


def _counts(counts: Counts) -> dict[str, Any]:
    return {
        'points': counts.points,
        'bad': counts.bad,
        'good': counts.good,
        'ranges': counts.by_range.tolist(),
        'detectors': dict(counts.detectors),
        'reasons': [
            [int(reason_numbers()[number]), count]
            for number, count in counts.reasons.most_common(MOST_LISTED)
        ],
    }


def _curve(gathered: Gathered) -> dict[str, Any] | None:
    """Thin the ROC curve of the score; None without a truth of both kinds."""
    score, bad = gathered.tally.truth()
    if not bad.any() or bad.all():
        return None
    whole = curve(bad, score)
    thin = whole.thinned(MOST_ON_CURVE)
    return {
        'recall': _rounded((thin.found / whole.found[-1]).tolist(), 5),
        'lost': [float(f'{one:.4g}') for one in (thin.lost / whole.lost[-1]).tolist()],
        'auc': round(whole.auc, 5),
    }


def _rounded(values: Any, digits: int = 3) -> list[float]:
    return [round(float(value), digits) for value in np.asarray(values).tolist()]


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
