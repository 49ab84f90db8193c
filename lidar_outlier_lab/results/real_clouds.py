# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Real clouds: labelled artefacts that are found, and clean recordings of which little may go."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from lidar_outlier_filter.core.annotations import Progress
from lidar_outlier_filter.core.detectors.registry import DETECTORS
from lidar_outlier_filter.errors import FilterError
from lidar_outlier_filter.evaluation.labels import Codes
from lidar_outlier_filter.evaluation.report import percent
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.recordings.recorded_clouds import RecordedClouds
from lidar_outlier_filter.tuning.training import Training, read_training
from lidar_outlier_lab.results.contest import Standing, details, leader, score
from lidar_outlier_lab.results.contestants import DEFAULT, OURS, Ours, peers
from lidar_outlier_lab.results.markdown import NOTHING, paragraphs, share_of, table
from lidar_outlier_lab.results.samples import Sample

NOISE = Codes(frozenset({7, 18, 65}))  # LAS: low noise, high noise, IGN's artefacts
RECORDINGS: Mapping[str, tuple[str, Mapping[str, object]]] = {
    'Velodyne VLP-16': ('vlp16_mrpt_mcap', {}),
    'Velodyne HDL-32E': ('hdl32_mrpt_mcap', {}),
    'Velodyne VLP-32C': ('vlp32_nebula_db3', {}),
    'Ouster OS1-128': ('os1_128_db3', {}),
    'Hesai XT32': ('hesai_xt32_nebula_mcap', {'time_field': 'stamp'}),
}
CLEAN = (DEFAULT, '`quadric`', '`lof`', '`sor`', '`hierarchical`')
MAX_REJECTED = 0.003  # of a clean recording
MIN_FOUND, MAX_LOST = 0.5, 0.0005  # of labelled artefacts, and of the good points


def section(data: Path, progress: Progress) -> str:
    """Write up what can be reached of the labelled clouds and of the clean recordings."""
    title = '## Real clouds'
    if not data.is_dir():
        return paragraphs(title, f'There was no folder `{data}` with real clouds in this run.')
    return paragraphs(title, _labelled(data / 'clouds', progress), _clean(data / 'bags', progress))


def labelled(path: Path) -> Sample | None:
    """Read a cloud with classes, with its scan lines if it says them; None: no class is noise."""
    along = tuple(name for name, one in DETECTORS.items() if one.lines != 'no')
    for chain in (along, ('lof',)):
        try:
            found = read_training(path, FilterParameters().changed({'chain': chain}), NOISE)
        except FilterError:
            continue
        nothing = np.zeros(len(found), np.int64)
        return Sample(path.name, 0, found, nothing, chain == along, in_own_frame=False)
    return None


def _labelled(folder: Path, progress: Progress) -> str:
    found: dict[str, dict[str, Standing]] = {}
    counts = []
    everybody = [*OURS, *peers()]
    for path in sorted([*folder.glob('*.las'), *folder.glob('*.laz')]):
        sample = labelled(path)
        if sample is None:
            continue
        for number, one in enumerate(everybody):
            progress(number, len(everybody), f'{one.name} on {path.name}')
            if one.suits(sample):
                found.setdefault(path.name, {})[one.name] = Standing((score(one, sample),))
        bad = np.count_nonzero(sample.data.bad)
        counts.append(f'`{path.name}`: {bad} of {len(sample.data):,} points')
    if not counts:
        return f'No cloud in `{folder.name}` has points of the classes 7, 18 or 65.'
    reached = [
        f'`{name}`, {one}: {percent(standing.whole.recall.ratio)} found, '
        f'{percent(standing.whole.false_rejections.ratio)} lost'
        for name, rows in found.items()
        for one, standing in rows.items()
        if standing.whole.recall.ratio >= MIN_FOUND
        and standing.whole.false_rejections.ratio <= MAX_LOST
    ]
    return paragraphs(
        'Airborne clouds whose classes name noise (7, 18) or artefacts (65), judged as a whole, as '
        f'by `clean`; all other classes count as good. {"; ".join(counts)}. Aimed at: at '
        f'least {percent(MIN_FOUND)} found and at most {percent(MAX_LOST)} lost. It is reached '
        f'by: {"; ".join(reached) if reached else "none"}.',
        'Where others have a higher F1 than the default:',
        leader(found, [DEFAULT], [one.name for one in everybody if one.name != DEFAULT]),
        details(found, [one.name for one in everybody]),
    )


def recorded(path: Path, values: Mapping[str, object]) -> Training:
    """Read all clouds of a recording as good points."""
    read = RecordedClouds(path, FilterParameters().changed(values))
    clouds = tuple(taken.cloud.points for taken in read)
    count = sum(map(len, clouds))
    bad, stretch = np.zeros(count, np.bool_), np.zeros(count, np.int64)
    return Training(clouds, bad, ~bad, stretch, 1)


def _clean(folder: Path, progress: Progress) -> str:
    ours = [one for one in OURS if one.name in CLEAN]
    rows = []
    for number, (sensor, (name, values)) in enumerate(RECORDINGS.items()):
        progress(number, len(RECORDINGS), name)
        if (folder / name).is_dir():
            data = recorded(folder / name, values)
            rows.append((sensor, f'{len(data):,}', *(_rejected(data, one) for one in ours)))
    if not rows:
        return 'None of the clean recordings could be reached.'
    return paragraphs(
        'Recordings of real sensors in dry air, through the stream; share of the points that is '
        'rejected. Nothing is known of true outliers in them. Aimed at, for the default: at most '
        f'{percent(MAX_REJECTED)}.',
        table(('sensor', 'points', *(one.name for one in ours)), rows),
    )


def _rejected(data: Training, one: Ours) -> str:
    try:
        return share_of(data.judge(one.parameters).rejected)
    except FilterError:
        return NOTHING
