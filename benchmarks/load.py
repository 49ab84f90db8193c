# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A node under load: a sensor, the filter and a listener, each a process, over the real middleware.

    python benchmarks/load.py [--rings N] [--rate HZ] [--columns N] [--seconds S] [--then HZ]
                              [--write TITLE] [--sensors N] [--processes N] [NAME:=VALUE ...]

A spinning sensor, 48 bytes per point, publishes best effort; with --then, at another rate for ten
seconds more. Several sensors publish in turn, to one filter or to several processes. Prints
/diagnostics in each second, and at the end clouds sent and received, the processor time per cloud,
delays, growth of memory, and the time to recover. --write puts the row TITLE into the table in
doc/results; with --then, into that of the policies.
"""

# ruff: noqa: INP001, T201, PLC0415  a script, which prints, and imports ROS in each process

import argparse
import os
import sys
import time
from contextlib import ExitStack
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

import numpy as np
import psutil

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / 'test')]

SHAPE = {'rings': 128, 'columns': 1024, 'rate': 10.0, 'seconds': 60.0, 'then': 0.0}
SHAPE |= {'sensors': 1, 'processes': 1}
PAGE = ROOT / 'doc' / 'results' / 'load.md'
OUTLIERS = 0.005
WARM = 5  # seconds until memory counts
REST = 10.0  # seconds to watch afterwards
NODE, TOPIC = 'lidar_outlier_filter.cli.node', '/sensor{}/points'
COUNTED = ('messages', 'degraded', 'unfiltered for overload', 'dropped', 'lost')
PERIOD_S = 1.0  # seconds between two messages on /diagnostics
KEEP = ('MALLOC_MMAP_THRESHOLD_', 'MALLOC_TRIM_THRESHOLD_')  # of glibc: memory for the next cloud
POINT = np.dtype(
    {
        'names': ['x', 'y', 'z', 'intensity', 't', 'reflectivity', 'ring', 'ambient', 'range'],
        'formats': ['f4', 'f4', 'f4', 'f4', 'u4', 'u2', 'u2', 'u2', 'u4'],
        'offsets': [0, 4, 8, 16, 20, 24, 26, 28, 32],
        'itemsize': 48,
    }
)


def sweep(rings: int, columns: int, period: float, seed: int) -> np.ndarray:
    """Make a revolution in a hall of 20 m by 30 m, half a percent of it outliers."""
    rng = np.random.default_rng(seed)
    azimuth = 2 * np.pi * np.arange(columns) / columns
    elevation = np.deg2rad(np.linspace(-22.5, 22.5, rings))
    rows = np.zeros((rings, columns), POINT)
    c, s = np.cos(azimuth), np.sin(azimuth)
    flat = np.minimum(10 / np.maximum(abs(c), 1e-6), 15 / np.maximum(abs(s), 1e-6))
    height = np.where(elevation < 0, 2.0, 6.0) / np.maximum(abs(np.tan(elevation)), 1e-6)
    reach = np.minimum(flat[None, :], height[:, None]) / np.cos(elevation)[:, None]
    reach += rng.normal(0, 0.02, reach.shape)
    wrong = rng.uniform(size=reach.shape) < OUTLIERS
    reach[wrong] *= rng.uniform(0.2, 0.9, np.count_nonzero(wrong))
    rows['x'] = reach * np.cos(elevation)[:, None] * c
    rows['y'] = reach * np.cos(elevation)[:, None] * s
    rows['z'] = reach * np.sin(elevation)[:, None]
    rows['t'] = np.arange(columns) * (period * 1e9 / columns)
    rows['ring'] = np.arange(rings)[:, None]
    return rows


def publish(options: argparse.Namespace) -> None:
    """Publish at a steady rate; the process of the sensor."""
    import rclpy
    from helpers.clouds import cloud
    from helpers.live import BEST_EFFORT
    from rclpy.time import Time
    from sensor_msgs.msg import PointCloud2

    rclpy.init(args=[])
    node = rclpy.create_node('sensor')
    names = [TOPIC.format(number) for number in range(options.sensors)]
    publishers = [node.create_publisher(PointCloud2, name, BEST_EFFORT) for name in names]
    rate, then = (each * options.sensors for each in (options.rate, options.then))
    sweeps = (sweep(options.rings, options.columns, 1 / options.rate, seed) for seed in range(4))
    messages = [cloud(rows) for rows in sweeps]
    while not all(one.get_subscription_count() for one in publishers):
        time.sleep(0.05)
    print('ready', flush=True)
    sys.stdin.readline()
    for frequency, duration in ((rate, options.seconds), (then, REST if then else 0.0)):
        begin, late, count = time.monotonic(), 0.0, round(duration * frequency)
        stamp = node.get_clock().now().nanoseconds
        for number in range(count):
            due = begin + number / frequency
            time.sleep(max(due - time.monotonic(), 0))
            late = max(late, time.monotonic() - due)
            msg = messages[number % len(messages)]
            # As even as a sensor's, however busy the machine is.
            msg.header.stamp = Time(nanoseconds=stamp + round(number / frequency * 1e9)).to_msg()
            publishers[number % len(names)].publish(msg)
        text = f'sent {count} in {time.monotonic() - begin:.1f} s, at most {1e3 * late:.0f} ms late'
        print(f'{text}\n{time.monotonic()}', flush=True)
    sys.stdin.read()


class Sample(NamedTuple):
    """What /diagnostics said of a second: delays in milliseconds, the filter's memory in MB."""

    at: float
    p95: float
    longest: float
    memory: float
    is_well: bool


def sample(status: dict[str, Any], memory: float) -> Sample:
    """Print what /diagnostics says, and keep what is summed up."""
    values, clouds = status['values'], float(status['values']['clouds/s'])
    p95, longest = (float(values[f'delay since received, {name}, ms']) for name in ('p95', 'max'))
    print(
        f'{clouds:6.1f} clouds/s {float(values["points/s"]) / 1e6:6.2f} M points/s'
        f'  published {values["messages"]:>5} lost {values["lost"]:>3}'
        f' dropped {values["dropped"]:>4} unfiltered'
        f' {values.get("unfiltered for overload", 0):>4} degraded {values["degraded"]:>4}'
        f'  backlog {values["backlog, clouds"]:>4} ({values["backlog, MB"]} MB)'
        f'  delay p95 {p95:7.1f} max {longest:7.1f} ms'
        f'  processing p95 {values["processing time, p95, ms"]:>7} ms'
        f'  {memory:6.0f} MB  {status["level"]} {status["message"]}',
        flush=True,
    )
    return Sample(time.monotonic(), p95, longest, memory, status['level'] == 0 and clouds > 0)


def recovery(samples: list[Sample], end: float) -> str:
    """Say how long after the first rate all was well again."""
    # A sample describes the second before it.
    well = [max(one.at - PERIOD_S - end, 0.0) for one in samples if one.at > end and one.is_well]
    return f'{well[0]:.1f} s' if well else 'never'


def delays(samples: list[Sample], end: float) -> tuple[float, float]:
    """Return the median of the seconds' p95, and the longest delay, at the first rate; ms."""
    counted = [one for one in samples if one.at <= end][WARM:]
    return median(one.p95 for one in counted), max(one.longest for one in counted)


def put(
    options: argparse.Namespace, samples: list[Sample], end: float, values: Any, clouds: int
) -> None:
    """Put the run as a row into the table of loads, or with ``--then`` of policies."""
    from lidar_outlier_lab.results.markdown import write_row

    published = f'{values["messages"]} of {clouds}'
    p95, longest = delays(samples, end)
    if options.then:
        cells = [str(values[name] or '') for name in COUNTED[1:4]]
        row = [published, *cells, f'{longest / 1e3:.1f} s', recovery(samples, end)]
    else:
        chains = [item for item in options.settings if item.startswith('chain:=')]
        chain = f'`{chains[0]}`' if chains else 'the default'
        row = [chain, published, f'{p95:.0f} ms', f'{longest:.0f} ms']
    section = 'policies' if options.then else 'load'
    write_row(PAGE, section, [options.write, *row], 'benchmarks/load.py --write')


def summary(samples: list[Sample], end: float) -> str:
    """Say what was seen until the first rate ended, and when all was well after that."""
    p95, longest = delays(samples, end)
    growth = max(one.memory for one in samples[WARM:]) - samples[WARM].memory
    return (
        f'delay p95 {p95:.0f} ms (median of seconds), longest {longest:.0f} ms; memory '
        f'+{growth:.0f} MB after {WARM} s; recovered after {recovery(samples, end)}'
    )


def _spent(processes: list[psutil.Process]) -> float:
    """Return the processor time that processes have taken, ms."""
    times = [process.cpu_times() for process in processes]
    return 1e3 * sum(one.user + one.system for one in times)


def measure(options: argparse.Namespace) -> None:
    """Run the processes, and print the counts of clouds."""
    from helpers.live import counter, diagnoser, environment, next_status
    from helpers.programs import Program

    env = environment() | {'PYTHONPATH': os.pathsep.join(sys.path[:2])}
    # As the node does: what the others need is taken from the filter's two cores.
    thrifty = {'MALLOC_ARENA_MAX': '1'} | dict.fromkeys(KEEP, str(1 << 29))
    settings = [word for item in options.settings for word in ('-p', item)]
    shape = [f'--{name}={getattr(options, name)}' for name in SHAPE]
    names = [TOPIC.format(number) for number in range(options.sensors)]
    samples, last, count = [], {}, options.processes
    sensor = Program(__file__, '--publish', *shape, env=env | thrifty)
    with diagnoser(env) as listening, ExitStack() as stack:
        programs = {
            'filter': [
                Program('-m', NODE, '--ros-args', '-p', f'inputs:={one}', *settings, env=env)
                for one in (names[first::count] for first in range(count))
            ],
            'sensor': [sensor],
            'listener': [counter(f'{name}/cleaned', env | thrifty) for name in names],
        }
        processes = {
            name: [psutil.Process(stack.enter_context(one).pid) for one in some]
            for name, some in programs.items()
        }
        for listener in programs['listener']:
            listener.wait_for('matched')
        next_status(listening)
        sensor.wait_for('ready')
        # The sensor has found the filter; until the filter has found the sensor, clouds are lost.
        time.sleep(2 * PERIOD_S)
        busy = {name: -_spent(some) for name, some in processes.items()}
        sensor.send('go')
        begin = time.monotonic()
        while time.monotonic() < begin + options.seconds + REST + 1:
            status = next_status(listening)
            memory = sum(process.memory_info().rss for process in processes['filter'])
            samples.append(sample(status, memory / 1e6))
            last[status['name']] = status['values']
        print(sensor.wait_for('sent'))
        end = float(sensor.wait_for(''))
        print('then', sensor.wait_for('sent'))
        values = {name: sum(int(one.get(name, 0)) for one in last.values()) for name in COUNTED}
        clouds = round(options.seconds * options.rate + REST * options.then) * len(names)
        for name, some in processes.items():
            print(f'{name}: {(busy[name] + _spent(some)) / clouds:.1f} ms of processor a cloud')
        for listener in programs['listener']:
            listener.close()
            listener.wait()
            print(f'received {listener.output[-1]}')
        print(f'{values} of {clouds}; {summary(samples, end)}')
    if options.write:
        put(options, samples, end, values, clouds)


def main() -> None:
    """Read the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    for name, default in SHAPE.items():
        parser.add_argument(f'--{name}', type=type(default), default=default)
    parser.add_argument('--publish', action='store_true', help=argparse.SUPPRESS)
    parser.add_argument('--write', default='', metavar='TITLE')
    parser.add_argument('settings', nargs='*', metavar='NAME:=VALUE')
    options = parser.parse_args()
    (publish if options.publish else measure)(options)


if __name__ == '__main__':
    main()
