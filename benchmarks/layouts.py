# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What the default makes of one spinning street in every layout that drivers and files give it.

    scripts/environment python benchmarks/layouts.py [--sensors street-16 ...] [--layouts utm ...]
        [--write]

Lone returns are put at least 2 m in front of 1 % of four sweeps, simulated or real. Printed are the
share of them that is found, the share of good points that is lost, and the methods that judged, as
a stream, and one sweep as an array, the worst first, compared with the sensor's own layout. What
the default rejects of a real sweep before is not counted. ``--write`` puts the table into the page.
"""

# ruff: noqa: INP001, T201  a script, no package

import argparse
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.lib.recfunctions import drop_fields, rename_fields
from rosbags.typesys import Stores, get_typestore

from lidar_outlier_filter import CloudFilter, detect_outliers
from lidar_outlier_filter.errors import FilterError
from lidar_outlier_filter.messages.decoder import Decoder
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.recordings.bags import Recording
from lidar_outlier_lab.results.markdown import table, write
from lidar_outlier_lab.simulation.scenes import spinning_streets as streets
from lidar_outlier_lab.simulation.world.drive import gather
from lidar_outlier_lab.simulation.world.prisms import MID_40
from lidar_outlier_lab.simulation.world.recording import START, messages

PAGE = Path(__file__).resolve().parents[1] / 'doc' / 'results' / 'layouts.md'
SECTION, COMMAND = 'layouts', 'benchmarks/layouts.py --write'
BAGS = Path(__file__).resolve().parents[2] / 'shared' / 'data' / 'bags'
REAL = {'HDL-32E': 'hdl32_mrpt_mcap', 'OS1-128': 'os1_128_db3', 'VLP-16': 'vlp16_mrpt_mcap',
        'XT32': 'hesai_xt32_nebula_mcap'}  # fmt: skip
SIMULATED = {'street-16': 16, 'street-32': 32, 'street-64': 64}
SWEEPS, SHARE, MIN_APART_M, MIN_RANGE_M, SEED, SECOND = 4, 0.01, 2.0, 0.5, 63, 10**9
GOOD, LONE, UNCOUNTED = 0, 1, 2
REFERENCE = 'ring and t (reference)'
HEAD = ('layout', 'sensor', 'found %', 'lost %', 'array: found %', 'array: lost %', 'judged by')
LOST_WEIGHS = 10.0  # times as much as what is not found
POINT = np.dtype([('x', 'f4'), ('y', 'f4'), ('z', 'f4'), ('intensity', 'f4'), ('t', 'u4'),
                  ('ring', 'u2'), ('truth', 'u1')])  # fmt: skip


class Sweep(NamedTuple):
    """A message: its stamp, nanoseconds, and its points in the order of firing."""

    stamp: int
    points: Any


def spoil(points: Any, rng: np.random.Generator) -> None:
    """Put lone returns in front of what 1 % of the shots met: in a small room less far."""
    distance = np.sqrt(sum(points[axis].astype(float) ** 2 for axis in 'xyz'))
    # In a small room, as that of the VLP-16, half of the way has to do.
    apart = MIN_APART_M if np.median(distance) > 2.0 * MIN_APART_M else distance / 2.0
    can = np.flatnonzero((distance - apart > MIN_RANGE_M) & (points['truth'] == GOOD))
    some = rng.choice(can, round(SHARE * len(points)), replace=False)
    part = rng.uniform(MIN_RANGE_M, (distance - apart)[some]) / distance[some]
    for axis in 'xyz':
        points[axis][some] *= part
    points['truth'][some] = LONE


def simulated(
    count: int, mount: tuple[float, float, float] = (0.0, 0.0, 1.9), sweeps: int = SWEEPS
) -> list[Sweep]:
    """Simulate dry sweeps."""
    sensor: Any = MID_40 if count == 0 else streets.SENSORS[count]
    drive = streets._drive(sensor, streets.Weather(sweeps, 0.0), SEED)  # noqa: SLF001
    drive = replace(drive, trajectory=replace(drive.trajectory, mount=mount))
    made, rng = messages(drive, [(drive.shots, gather(drive).clean)], 1), np.random.default_rng(1)
    spoilt = []
    for cloud in made:
        points = np.zeros(len(cloud.points), POINT)
        for name in POINT.names[:6]:
            points[name] = cloud.points[name] if name in cloud.points.dtype.names else 0
        points['truth'] = np.where(cloud.points['label'] > 0, UNCOUNTED, GOOD)
        spoil(points, rng)
        spoilt.append(Sweep(cloud.stamp, points))
    return spoilt


def recorded(path: Path) -> list[Sweep]:
    """Read real sweeps, and leave out of the count what the default rejects of them."""
    store = get_typestore(Stores.ROS2_JAZZY)
    reading = {'time_field': 'stamp'} if 'nebula' in path.name else {}
    decoder = Decoder(FilterParameters().changed(reading))
    sweeps, rng = [], np.random.default_rng(1)
    with Recording(path) as source:
        for topic, _, data in source.messages():
            if topic.msgtype != 'sensor_msgs/msg/PointCloud2' or len(sweeps) == SWEEPS:
                continue
            decoded = decoder.decode(store.deserialize_cdr(data, topic.msgtype))
            decoded = decoded.take(decoded.valid)
            decoded = decoded.take(np.argsort(decoded.t, kind='stable'))
            points = np.zeros(len(decoded), POINT)
            points['x'], points['y'], points['z'] = decoded.xyz.T
            points['intensity'], points['ring'] = decoded.intensity, decoded.line
            points['t'] = decoded.t - decoded.t[0]
            found = detect_outliers(points[[*POINT.names[:6]]])
            points['truth'] = np.where(found.outlier, UNCOUNTED, GOOD)
            spoil(points, rng)
            sweeps.append(Sweep(START + int(decoded.t[0]) % (1000 * SECOND), points))
    return sweeps


# Layouts: each makes the messages that a driver would send of the sweeps --------------------------

Layout = Callable[[list[Sweep]], Iterable[Sweep]]


def each(change: Callable[[Any], Any]) -> Layout:
    """Change the points of each sweep."""
    return lambda sweeps: [Sweep(one.stamp, change(one.points)) for one in sweeps]


def grid(points: Any, *, columns_first: bool, packed: bool = False) -> Any:
    """Put points in a range image; ``packed``: those of a ring from the first column on."""
    rings, ring = np.unique(points['ring'], return_inverse=True)
    order = np.lexsort((points['t'], ring))
    first = np.searchsorted(ring[order], np.arange(len(rings)))
    rank = np.empty(len(points), np.int64)
    rank[order] = np.arange(len(points)) - first[ring[order]]
    step = np.median(np.concatenate([np.diff(points['t'][ring == k].astype(float))
                                     for k in range(len(rings))]))  # fmt: skip
    column = rank if packed else (points['t'] / step).astype(np.int64)
    image = np.zeros((len(rings), column.max() + 1), points.dtype)
    for axis in 'xyz':
        image[axis] = np.nan
    image['t'] = (np.arange(image.shape[1]) * step).astype(np.uint32)
    times = image['t'].copy()
    image[ring, column] = points
    if packed:
        image['t'] = times
    return np.ascontiguousarray(image.T) if columns_first else image


def stretched(points: Any, *, timed: bool) -> Any:
    """Fill rows of a range image as KITTI's are: evenly, from a ring's first return to its last.

    Missing returns are not in its files, so azimuth is not linear in the column.
    """
    parts = np.split(by_ring(points), np.flatnonzero(np.diff(np.sort(points['ring']))) + 1)
    width = max(map(len, parts))
    image = np.zeros((len(parts), width), points.dtype)
    for axis in 'xyz':
        image[axis] = np.nan
    for row, part in zip(image, parts, strict=True):
        row[np.arange(len(part)) * width // len(part)] = part
    image['t'] = (np.arange(width) * (float(np.ptp(points['t'])) / width)).astype(np.uint32)
    return bare(image, 'ring') if timed else bare(image)


def bare(points: Any, *names: str) -> Any:
    """Leave fields out."""
    return drop_fields(points, names or ('ring', 't'))


def by_ring(points: Any) -> Any:
    """Sort as rows of a range image."""
    return points[np.lexsort((points['t'], points['ring']))]


def shifted(x: float, y: float, z: float, kind: str = 'f4') -> Layout:
    """Give coordinates in another frame."""

    def shift(points: Any) -> Any:
        wide = [(n, kind if n in 'xyz' else points.dtype[n]) for n in points.dtype.names]
        moved = points.astype(wide)
        for axis, by in zip('xyz', (x, y, z), strict=True):
            moved[axis] = points[axis].astype(float) + by
        return moved

    return each(shift)


def with_field(name: str, values: Callable[[Any], Any], kind: str) -> Layout:
    """Replace a field by values of another kind."""

    def change(points: Any) -> Any:
        changed = points.astype([(n, kind if n == name else points.dtype[n])
                                 for n in points.dtype.names])  # fmt: skip
        changed[name] = values(points)
        return changed

    return each(change)


def restamped(*milliseconds: float) -> Layout:
    """Let stamps jitter."""
    return lambda sweeps: [
        Sweep(one.stamp + round(1e6 * milliseconds[k % len(milliseconds)]), one.points)
        for k, one in enumerate(sweeps)
    ]


def pieces(count: int) -> Layout:
    """Cut all sweeps into so many messages each."""

    def cut(sweeps: list[Sweep]) -> Iterable[Sweep]:
        for one in sweeps:
            for part in np.array_split(one.points, count):
                start, copy = int(part['t'][0]), part.copy()
                copy['t'] -= start
                yield Sweep(one.stamp + start, copy)

    return cut


def two(sweeps: list[Sweep]) -> list[Sweep]:
    """Merge two sensors, of the same ring numbers, in the vehicle's frame."""
    rings = len(np.unique(sweeps[0].points['ring']))
    heads = [
        list(shifted(0.5, left, 1.9)(simulated(rings, (0.5, left, 1.9), len(sweeps))))
        for left in (1.0, -1.0)
    ]
    return [
        Sweep(a.stamp, np.concatenate([a.points, b.points])) for a, b in zip(*heads, strict=True)
    ]


LAYOUTS: dict[str, Layout] = {
    REFERENCE: each(lambda p: p),
    'rows are columns, x y z i': each(lambda p: bare(grid(p, columns_first=True))),
    'rows are columns, x y z i t': each(lambda p: bare(grid(p, columns_first=True), 'ring')),
    'rows are rings, x y z i t': each(lambda p: bare(grid(p, columns_first=False), 'ring')),
    'x y z i in ring order': each(lambda p: bare(by_ring(p))),
    'x y z i in firing order': each(bare),
    'raised 5 m': shifted(0.0, 0.0, 5.0),
    'raised 10 m': shifted(0.0, 0.0, 10.0),
    'raised 20 m': shifted(0.0, 0.0, 20.0),
    'raised 110 m': shifted(0.0, 0.0, 110.0),
    'utm float64': shifted(450e3, 5400e3, 110.0, 'f8'),
    'utm float64, 2 km off': shifted(2e3, 0.0, 0.0, 'f8'),
    'utm float64, 100 km off': shifted(1e5, 0.0, 0.0, 'f8'),
    'stamps equal, t 0': with_field('t', lambda _: 0, 'u4'),
    'whole seconds': lambda s: [Sweep(o.stamp // SECOND * SECOND, o.points) for o in s],
    'no ring': each(lambda p: bare(p, 'ring')),
    'ring float': with_field('ring', lambda p: p['ring'], 'f4'),
    'ring 0': with_field('ring', lambda _: 0, 'u2'),
    'ring called layer': each(lambda p: rename_fields(p, {'ring': 'layer'})),
    'ring called beam_id': each(lambda p: rename_fields(p, {'ring': 'beam_id'})),
    'intensity 0': with_field('intensity', lambda _: 0, 'f4'),
    'intensity half 0': with_field(
        'intensity', lambda p: np.where(np.arange(len(p)) % 2, 0, p['intensity']), 'f4'
    ),
    'stamps +- 10 ms': restamped(10, -10, -3, 8),
    'stamps +- 30 ms': restamped(30, -30, 12, -25),
    'eighths, one 15 ms early': lambda s: restamped(0, 0, 0, -15, 0, 0, 0, 0)(list(pieces(8)(s))),
    'two sensors, the same rings': two,
    'float milliseconds': with_field('t', lambda p: p['t'] * 1e-6, 'f4'),
    'rows packed to the left, t of columns': each(
        lambda p: bare(grid(p, columns_first=False, packed=True), 'ring')
    ),
    'KITTI rows, x y z i': each(lambda p: stretched(p, timed=False)),
    'KITTI rows, t of columns': each(lambda p: stretched(p, timed=True)),
    'rosette, 4 messages': lambda _: each(lambda p: bare(p, 'ring'))(simulated(0)),
    'rosette, 41 messages': lambda _: each(lambda p: bare(p, 'ring'))(
        list(pieces(10)(simulated(0)))
    ),
}


class Cell(NamedTuple):
    """What the default makes of a layout: shares in percent, of a stream and of one sweep."""

    found: float
    lost: float
    array_found: float
    array_lost: float
    method: str

    def behind(self, other: 'Cell') -> float:
        """Return by how much it is worse, percent of lone returns."""
        stream = other.found - self.found, self.lost - other.lost
        array = other.array_found - self.array_found, self.array_lost - other.array_lost
        return max(not_found + LOST_WEIGHS * lost for not_found, lost in (stream, array))

    def row(self, layout: str, sensor: str) -> list[str]:
        """Return its row of the table."""
        shares = (self.found, 1), (self.lost, 3), (self.array_found, 1), (self.array_lost, 3)
        return [layout, sensor, *(f'{value:.{digits}f}' for value, digits in shares), self.method]


def judge(sweeps: list[Sweep]) -> Cell:
    """Judge messages as a stream, and the first one as an array."""
    stream = CloudFilter()
    truth, outputs = np.concatenate([one.points['truth'].ravel() for one in sweeps]), []
    for one in sweeps:
        with suppress(FilterError):  # refused, which is counted
            outputs += stream.push(one.points, stamp=one.stamp)
    outputs += stream.flush()
    bad = np.concatenate([np.ravel(one.outliers['truth']) for one in outputs] or [truth[:0]])
    method = ', '.join(f'{k} {v.removeprefix("trees on the ")}'
                       for v, k in stream.statistics.methods.items())  # fmt: skip
    refused = stream.statistics.refused
    method += f', {refused} refused' * bool(refused)
    first = sweeps[0].points
    whole = first['truth'][np.reshape(detect_outliers(first).outlier, first.shape)]
    found, lost = _shares(bad, truth)
    return Cell(found, lost, *_shares(whole, first['truth'].ravel()), method=method)


def _shares(rejected: Any, truth: Any) -> tuple[float, float]:
    """Return the shares of lone returns that are found, and of good ones that are lost, percent."""
    found, lost = (100.0 * (rejected == k).sum() / max((truth == k).sum(), 1) for k in (LONE, GOOD))
    return found, lost


def worst_first(cells: dict[tuple[str, str], Cell]) -> str:
    """Lay out the table of cells by layout and sensor."""

    def behind(key: tuple[str, str]) -> float:
        return cells[key].behind(cells.get((REFERENCE, key[1]), cells[key]))

    return table(HEAD, [cells[key].row(*key) for key in sorted(cells, key=behind, reverse=True)])


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description='Judge a street in every layout.')
    parser.add_argument('--sensors', nargs='+', default=[*SIMULATED, *REAL])
    parser.add_argument('--layouts', nargs='+', default=[''], help='parts of their names')
    parser.add_argument('--bags', type=Path, default=BAGS, help='folder of the recordings')
    parser.add_argument('--write', action='store_true', help='put the table into the page')
    asked, cells = parser.parse_args(), dict[tuple[str, str], Cell]()
    for sensor in asked.sensors:
        made = (
            simulated(SIMULATED[sensor])
            if sensor in SIMULATED
            else recorded(asked.bags / REAL[sensor])
        )
        for name, layout in LAYOUTS.items():
            only_once = name.startswith(('two', 'rosette')) and sensor != 'street-32'
            if only_once or not any(part in name for part in asked.layouts):
                continue
            cells[name, sensor] = judge(list(layout(made)))
            print(' | '.join(cells[name, sensor].row(name, sensor)), flush=True)
    print(f'\n{worst_first(cells)}')
    if asked.write:
        write(PAGE, SECTION, worst_first(cells), command=COMMAND)


if __name__ == '__main__':
    main()
