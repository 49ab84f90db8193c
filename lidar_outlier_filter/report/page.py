# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The page: one file with all its data, which needs no network; and the page of a running node."""

import base64
import gzip
import html
import json
import math
from collections.abc import Iterator
from functools import cache
from importlib.resources import files
from typing import Any

import numpy as np

from lidar_outlier_filter import __version__
from lidar_outlier_filter.core.annotations import Floats
from lidar_outlier_filter.core.detectors.registry import DETECTORS, rejecting
from lidar_outlier_filter.core.points.points import SECOND
from lidar_outlier_filter.evaluation.confusion import curve
from lidar_outlier_filter.parameters.declaration import MASK, MASKED
from lidar_outlier_filter.parameters.filter import FilterParameters, describe
from lidar_outlier_filter.parameters.yaml_files import as_yaml, ros_lines
from lidar_outlier_filter.report.chains import features
from lidar_outlier_filter.report.gather import Gathered
from lidar_outlier_filter.report.points import (
    intensity_limits,
    message,
    pack,
    reason_numbers,
    reason_texts,
)
from lidar_outlier_filter.report.sources import SAVED, SourceFacts
from lidar_outlier_filter.report.steps import MAX_SCORE, RANGE_EDGES_M, Counts, Slider

# The modules of a page, by the names under which they import each other.
MODULES = {
    name: f'{name}.js'
    for name in (
        *('three', 'data', 'shaders', 'scene', 'stage', 'map', 'colours'),
        *('charts', 'panel', 'groups', 'tools', 'recorded', 'live'),
    )
}
MAX_ON_CURVE, MAX_ON_PATH = 200, 1000
MAX_REASONS_LISTED = 8
COLOURS = (  # by the number of a detector; the last one is the own vehicle's
    *('#0072b2', '#cc79a7', '#d55e00', '#009e73', '#e69f00', '#56b4e9', '#000000', '#aa4499'),
    *('#bcbd22', '#17becf', '#7f7f7f', '#8b0000', '#a5732a', '#4b6a53', '#8c564b'),
)
FARTHEST_ORIGIN = 1000.0  # metres
SECTION = 1 << 20  # points of a message, or one frame with more
# How well gzip shrinks exact values hardly depends on this; how long it takes does.
GZIP_LEVEL = 3


def header(gathered: Gathered) -> dict[str, Any]:
    """Collect what the page knows beside its points."""
    found, tally, points = gathered.found, gathered.tally, gathered.points
    every = gathered.all
    period, gaps = found.period_and_gaps()
    return {
        'name': gathered.name,
        'topic': found.topic,
        'clouds': found.clouds,
        'invalid': found.invalid,
        'masked': found.masked,
        'untested': tally.untested,
        'drawn': len(points),
        'refusals': found.refusals,
        'without_pose': found.without_pose,
        'moved': found.moved,
        'path': _path(found),
        'units': list(found.units),
        'unit': found.unit,
        'convention': found.convention,
        'period': None if math.isnan(period) else period,
        'seconds': (found.span[1] - found.span[0]) / SECOND if found.span else None,
        'gaps': [list(gap) for gap in gaps],
        'chain': list(rejecting(gathered.parameters)),
        'methods': list(gathered.methods),
        'hasFrames': gathered.has_frames,
        'together': gathered.frames.together,
        'sliders': [_slider(gathered, number) for number in range(len(gathered.sliders))],
        'all': _counts(every),
        'ranges': list(RANGE_EDGES_M),
        'largestScore': MAX_SCORE,
        'hasRange': near_origin(gathered),
        'scores': tally.scores.tolist(),
        'hasTruth': every.bad > 0,
        'curve': _curve(gathered),
        'features': [[name, text] for (_, name), text in features().items()],
        'intensity': list(intensity_limits(points['intensity'])),
        **constants(),
    }


def constants() -> dict[str, Any]:
    """Return what is the same on all pages: names, words and colours."""
    return {
        'version': __version__,
        'reasons': [name for name, _ in reason_texts()],
        'reasonTexts': [text for _, text in reason_texts()],
        'detectors': _detectors(),
        'colours': colour_maps(),
    }


def _detectors() -> list[dict[str, Any]]:
    """Return name, number in the words of points, colour and purpose of each detector."""
    listed = [(one.bit.bit_length(), one.name, one.rejects) for one in DETECTORS.values()]
    listed.append((MASKED.bit_length(), MASK, 'lies on the own vehicle'))
    return [
        {'name': name, 'number': n, 'colour': COLOURS[n - 1], 'rejects': rejects.replace('`', '')}
        for n, name, rejects in listed
    ]


def _path(found: SourceFacts) -> list[list[float]]:
    each = max(1, len(found.path) // MAX_ON_PATH)
    return [[round(value, 3) for value in position] for position in found.path[::each]]


def near_origin(gathered: Gathered) -> bool:
    """Return whether a sensor may be at the origin, so that distances from there are ranges."""
    ranges = gathered.points['range']
    return bool(len(ranges)) and float(ranges.min()) < FARTHEST_ORIGIN


def _slider(gathered: Gathered, number: int) -> dict[str, Any]:
    slider, counts = gathered.sliders[number], gathered.counts[number]
    steps = range(len(slider.values))
    changed = [slider.changed(gathered.parameters, step) for step in steps]
    return {
        **slider_facts(slider),
        'given': slider.given,
        'first': slider.first,
        'limits': [limit if math.isfinite(limit) else None for limit in slider.limits.tolist()],
        'counts': [_counts(one) for one in counts],
        'byFrame': [
            [one.of_clouds(clouds.tolist()) for clouds in gathered.frames.clouds] for one in counts
        ],
        'yaml': [parameter_file(one) for one in changed],
        'lines': [ros_lines(FilterParameters(), _not_fixed(one)) for one in changed],
    }


def slider_facts(slider: Slider) -> dict[str, Any]:
    """Return what every page knows of a slider."""
    texts = ['–' if math.isnan(value) else as_yaml(value) for value in slider.values]
    return {'detector': slider.detector, 'name': slider.name, 'texts': texts}


def _changed(parameters: FilterParameters) -> dict[str, Any]:
    """Return the parameters that differ from their defaults."""
    defaults = FilterParameters().flat()
    return {name: one for name, one in parameters.flat().items() if one != defaults[name]}


def _not_fixed(parameters: FilterParameters) -> dict[str, Any]:
    """Return the changed parameters that can be set while a node runs."""
    fixed = {parameter.name for parameter in describe() if parameter.fixed}
    return {name: one for name, one in _changed(parameters).items() if name not in fixed}


def parameter_file(parameters: FilterParameters) -> str:
    """Write a ROS parameter file with the changed parameters."""
    lines = [f'    {name}: {as_yaml(value)}' for name, value in _changed(parameters).items()]
    return '\n'.join(['/**:', f'  ros__parameters:{"" if lines else " {}"}', *lines]) + '\n'


def _counts(counts: Counts) -> dict[str, Any]:
    often = sorted(counts.reasons.items(), key=lambda one: -one[1])[:MAX_REASONS_LISTED]
    return {
        'points': counts.points,
        'bad': counts.bad,
        'good': counts.good,
        'ranges': counts.by_range.tolist(),
        'detectors': dict(counts.detectors),
        'reasons': [[int(reason_numbers()[number]), count] for number, count in often],
    }


def _curve(gathered: Gathered) -> dict[str, Any] | None:
    """Thin the ROC curve of the score; None without good and bad points."""
    score, bad = gathered.tally.truth()
    if not bad.any() or bad.all():
        return None
    whole = curve(bad, score)
    few = whole.thinned(MAX_ON_CURVE)
    return {
        'recall': [round(one, 5) for one in (few.found / whole.found[-1]).tolist()],
        'lost': [float(f'{one:.4g}') for one in (few.lost / whole.lost[-1]).tolist()],
        'auc': round(whole.auc, 5),
    }


def messages(gathered: Gathered) -> Iterator[bytes]:
    """Write the points, about ``SECTION`` in each message."""
    frames, points = gathered.frames, gathered.points
    limits = intensity_limits(points['intensity'])
    begin = 0
    while begin < len(frames):
        most = frames.first[begin] + SECTION
        end = max(int(np.searchsorted(frames.first, most, side='right')) - 1, begin + 1)
        first = frames.first[begin : end + 1]
        mine = points[first[0] : first[-1]]
        words, origin, step = pack(mine, first - first[0], limits)
        facts = [_frame(gathered, begin + k, origin[k], step[k]) for k in range(end - begin)]
        yield message({'frames': facts}, [words], {k: [v] for k, v in _columns(mine).items()})
        begin = end


def _columns(points: Any) -> dict[str, Any]:
    """Return the exact values of points, as far as they are known."""
    marked = (points['bits'] != 0) | points['rejected'] | (points['why'] != 0).any(axis=1)
    columns = {
        'index': points['index'],
        'score': np.where(marked, points['score'], np.float32(np.nan)),
        'why': points['why'],
        'added': points['added'],
    }
    if points['t'].any() and 'gps_time' not in points.dtype.names:
        columns['time'] = points['t']
    there = [name for name in SAVED if name in points.dtype.names]
    if not np.isfinite(points['intensity']).any():
        there.remove('intensity')
    return columns | {name: points[name] for name in there}


def _frame(gathered: Gathered, number: int, origin: Floats, step: Floats) -> dict[str, Any]:
    frames, every = gathered.frames, gathered.all.clouds
    count = int(frames.first[number + 1] - frames.first[number])
    clouds = frames.clouds[number].tolist() if frames.clouds else []
    return {
        'count': count,
        'points': sum(every.get(cloud, 0) for cloud in clouds) if clouds else count,
        'marked': int(frames.marked[number]),
        'start': int(frames.start[number] - frames.start.min()) / SECOND,
        'origin': origin.tolist(),
        'step': step.tolist(),
    }


def page(gathered: Gathered) -> str:
    """Write a page that holds all of its data."""
    known = json.dumps(header(gathered), separators=(',', ':'), allow_nan=False)
    # In a script element only its end has a meaning.
    safe = known.replace('<', '\\u003c')
    data = [f'<script type="application/json" id="header">{safe}</script>']
    for content in messages(gathered):
        text = base64.b64encode(gzip.compress(content, GZIP_LEVEL, mtime=0)).decode('ascii')
        data.append(f'<script type="text/plain" class="points">{text}</script>')
    return _shell(gathered.name, 'recorded', '\n'.join(data))


def live_page(name: str) -> str:
    """Write the page of a running node, which fetches its clouds."""
    return _shell(name, 'live', '')


def _shell(title: str, kind: str, data: str) -> str:
    """Write the page around its data; ``kind`` is 'recorded' or 'live'."""
    modules = {name: _inline(asset(path)) for name, path in MODULES.items()}
    whole = asset('page.html')
    for mark, text in (
        ('title', html.escape(title)),
        ('kind', kind),
        ('style', f'<style>{asset("style.css")}</style>'),
        ('licence', f'<!--\n{asset("three.LICENSE")}\n-->'),
        ('imports', f'<script type="importmap">{json.dumps({"imports": modules})}</script>'),
        ('start', f'<script type="module">import "{kind}";</script>'),
        ('data', data),
    ):
        whole = whole.replace(f'<!--{mark}-->', text)
    return whole


def asset(name: str) -> str:
    """Read a file of the page."""
    return (files(__package__) / 'assets' / name).read_text(encoding='utf-8')


def _inline(code: str) -> str:
    return 'data:text/javascript;base64,' + base64.b64encode(code.encode()).decode('ascii')


@cache
def colour_maps() -> dict[str, str]:
    """Return maps of 256 colours as base64, three bytes each."""
    maps: dict[str, str] = json.loads(asset('colour_maps.json'))
    return maps
