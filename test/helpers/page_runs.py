# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The commands of the pages, run where the files and recordings are that each page speaks of."""

from __future__ import annotations

import os
import re
import shlex
import shutil
from contextlib import chdir, redirect_stderr, redirect_stdout
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import laspy
import numpy as np

from helpers import ROOT
from helpers.clouds import NAME, STAMP, STORE, cloud, table, to_bytes
from helpers.drives import topic_of, write_messages
from lidar_outlier_filter.cli.main import main
from lidar_outlier_filter.recordings.bags import NewBag, Recording

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    Stage = Callable[[Path, Path], object]  # where the data are, and what is to be made

DATA = ROOT.parent / 'shared' / 'data'
FENCE = re.compile(r'^```bash\n(.*?)^```', re.DOTALL | re.MULTILINE)
COMMAND = 'lidar-outlier-filter '
SECOND = 1_000_000_000
PERIOD = SECOND // 10
POINTS = 2000  # of a file of points

# What is not run here, and why: the beginnings of commands.
NOT_RUN: Mapping[str, str] = {
    'ros2 ': 'needs an installed ROS; test_readme.py checks its arguments',
    'outlier_filter_node ': 'runs until it is stopped; test_executable.py starts it',
    'python doc/examples/operate.py ': 'needs a running node; test_executable.py runs it',
    'python doc/examples/play.py ': 'publishes to a node; test_executable.py runs it',
    'rviz2 ': 'needs a screen',
    'export FASTRTPS': 'needs an installed ROS; test_executable.py sets it',
    'ssh ': 'needs another machine',
    'eval "$(register-python-argcomplete': 'test_cli.py asks as a shell does',
    'git clone ': 'needs the network',
    'lidar-outlier-filter replay my_recording --params my.yaml': 'the page shows the file',
    'rosdep ': 'needs apt',
    'list=$(ros2 ': 'needs an installed ROS',
    'colcon ': 'test_package.py runs it',
    'source install/': 'test_package.py runs it',
    'python3 -m venv ': 'needs the network',
    'pip install ': 'needs the network',
    '~/recordings/bin/': 'needs the network',
    'scripts/': 'runs everything, or for hours; test_scripts.py runs the scripts',
    'lidar-outlier-filter clean street.csv --chain isolated': 'test_installed.py runs the like',
    'lidar-outlier-filter replay s3://': 'needs a store and a cluster',
    'lidar-outlier-filter train ': 'takes an hour',
    'lidar-outlier-filter results ': 'takes half an hour',
    'lidar-outlier-filter mask drive': 'needs a drive; test_learn_mask.py runs it',
    'lidar-outlier-filter replay drive --output cleaned --set mask': 'the same',
    'lidar-outlier-filter bench --write doc/results/speed.md': (
        'takes minutes; test_bench.py runs its parts'
    ),
    'python benchmarks/large_clouds.py': 'takes ten minutes',
    'RMW_IMPLEMENTATION=': 'needs another middleware',
    'lidar-outlier-filter tune drive --set': 'takes minutes; test_tune.py runs it on less',
}


def commands(page: Path) -> list[str]:
    """List the commands of a page, each in one line, without what is said beside them."""
    text = ''.join(FENCE.findall(page.read_text('utf-8'))).replace('\\\n', ' ')
    lines = (re.sub(r'(^|\s+)#.*', '', line).strip() for line in text.splitlines())
    return [' '.join(line.split()) for line in lines if line]


def reason(command: str) -> str:
    """Say why a command is not run here; nothing where it is."""
    return next((why for start, why in NOT_RUN.items() if command.startswith(start)), '')


@dataclass
class PageRun:
    """The commands of one page, run in their order in a folder of its own.

    ``said`` has what each one wrote, first to stderr and then to stdout, and its status.
    """

    folder: Path
    said: dict[str, tuple[int, str]]

    def output(self, start: str) -> str:
        """Return what the first command that begins so has written."""
        return next(text for line, (_, text) in self.said.items() if line.startswith(start))


def run_page(name: str, folder: Path) -> PageRun:
    """Run the commands of a page that can be run, where everything is that it speaks of."""
    for path, make in STAGES.get(name, {}).items():
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        make(DATA, folder / path)
    (folder / 'config').symlink_to(ROOT / 'config')
    lines = [line for line in commands(ROOT / name) if not reason(line)]
    with chdir(folder):
        return PageRun(folder, {line: run(line) for line in dict.fromkeys(lines)})


class Pages:
    """Runs each page once, in a folder of its own."""

    def __init__(self, folder: Path) -> None:
        """Begin with none."""
        self.folder = folder
        self._done: dict[str, PageRun] = {}

    def run(self, name: str) -> PageRun:
        """Run a page, or return what its run has said before."""
        if name not in self._done:
            self._done[name] = run_page(name, self.new(name.replace('/', '_')))
        return self._done[name]

    def new(self, name: str) -> Path:
        """Make a folder."""
        folder = self.folder / name
        folder.mkdir()
        return folder


def run(line: str) -> tuple[int, str]:
    """Run a command of the package in this process; return its status and what it wrote."""
    assert line.startswith(COMMAND), f'{line}: neither run, nor in NOT_RUN'
    words = [match for word in shlex.split(line)[1:] for match in _expanded(word)]
    out, err = StringIO(), StringIO()
    os.environ['COLUMNS'] = '80'
    with redirect_stdout(out), redirect_stderr(err):
        status = main(words)
    return status, err.getvalue() + out.getvalue()


def _expanded(word: str) -> list[str]:
    found = sorted(str(path) for path in Path().glob(word)) if '*' in word else []
    return found or [word]


# What is staged -----------------------------------------------------------------------------------


def copy(source: str) -> Stage:
    """Copy a recording, or a file."""

    def make(data: Path, path: Path) -> None:
        (shutil.copytree if (data / source).is_dir() else shutil.copyfile)(data / source, path)

    return make


def renamed(source: str, topic: str, fields: Mapping[str, str]) -> Stage:
    """Copy the clouds of a recording to another topic, some of their fields by other names."""

    def make(data: Path, path: Path) -> None:
        with Recording(data / source) as recording, NewBag(path) as bag:
            new = topic_of(topic, NAME)
            bag.add(new)
            for _, time, raw in recording.messages():
                message: Any = STORE.deserialize_cdr(raw, NAME)
                for field in message.fields:
                    field.name = fields.get(field.name, field.name)
                bag.write(new, time, bytes(STORE.serialize_cdr(message, NAME)))

    return make


def absolute(topic: str, unit: int, line: str) -> Stage:
    """Record two sweeps of 16 rings in a round hall; times are floats, absolute, of a unit."""

    def make(_data: Path, path: Path) -> None:
        stamps = (STAMP, STAMP + PERIOD)
        sent = [(topic, at, to_bytes(cloud(_hall(at, unit, line), at))) for at in stamps]
        write_messages(path, {topic: NAME}, sent)

    return make


def _hall(stamp: int, unit: int, line: str) -> Any:
    rings, columns = 16, 256
    turned = np.tile(np.arange(columns) / columns, rings)
    ring = np.repeat(np.arange(rings), columns)
    up = np.deg2rad(2.0 * ring - 15.0)
    positions = {
        'x': 10 * np.cos(up) * np.cos(2 * np.pi * turned),
        'y': 10 * np.cos(up) * np.sin(2 * np.pi * turned),
        'z': 10 * np.sin(up),
    }
    times = (stamp + turned * PERIOD) / unit
    cells = {name: ('f4', values) for name, values in positions.items()}
    return table(len(ring), timestamp=('f8', times), **{line: ('u2', ring)}, **cells)


def points(source: str) -> Stage:
    """Copy the first points of a LAZ file."""

    def make(data: Path, path: Path) -> None:
        file = laspy.read(data / source)
        file.points = file.points[:POINTS]
        file.write(path)

    return make


VELODYNE, OUSTER = 'bags/vlp16_mrpt_mcap', 'bags/os1_128_db3'
HESAI = renamed('bags/hesai_xt32_nebula_mcap', '/lidar_points', {'stamp': 'timestamp'})
AIRBORNE, PATCH = 'clouds/autzen_trim.laz', 'clouds/plane.laz'


def settings(_data: Path, path: Path) -> None:
    """Write the parameter file of a user."""
    path.write_text('/**:\n  ros__parameters:\n    chain: [sor]\n', encoding='utf-8')


DRIVES: Mapping[str, Stage] = {'drives/a': copy(VELODYNE), 'drives/b': copy(VELODYNE)}
STAGES: Mapping[str, Mapping[str, Stage]] = {
    'README.md': {'my_recording': copy(VELODYNE), **DRIVES, 'survey.laz': points(AIRBORNE)},
    'doc/bags.md': {'my_recording': copy(VELODYNE)},
    'doc/archives.md': DRIVES,
    'doc/files.md': {
        'street.laz': points(PATCH),
        'strips/a.laz': points(PATCH),
        'strips/b.laz': points(AIRBORNE),
    },
    'doc/evaluate.md': {'my_drive': copy('bags/hdl32_mrpt_mcap')},
    'doc/report.md': {'my_recording': copy(VELODYNE)},
    'doc/parameters.md': {'my_recording': copy(VELODYNE), 'my.yaml': settings},
    'doc/surveys.md': {'survey.laz': points(AIRBORNE)},
    'doc/detectors/elevation.md': {'survey.laz': points(AIRBORNE)},
    'doc/papers/kang2018.md': {'hills.laz': points(AIRBORNE)},
    'doc/papers/leslar2010.md': {'drive.laz': points(AIRBORNE)},
    'doc/papers/pirotti2018.md': {'images.laz': points(PATCH)},
    'doc/papers/sotoodeh2006.md': {'city.laz': points(AIRBORNE)},
    'doc/papers/sotoodeh2007.md': {'facade.laz': points(PATCH)},
    'doc/quickstart/velodyne.md': {'my_recording': copy(VELODYNE)},
    'doc/quickstart/ouster.md': {'my_recording': copy(OUSTER)},
    'doc/quickstart/hesai.md': {'my_recording': HESAI},
    'doc/quickstart/robosense.md': {'my_recording': absolute('/rslidar_points', SECOND, 'ring')},
    'doc/quickstart/livox.md': {'my_recording': absolute('/livox/lidar', 1, 'line')},
    'doc/quickstart/profile_scanner.md': {},
}


def pages() -> Iterator[str]:
    """Name all pages that have commands."""
    first = (ROOT / 'README.md', ROOT / 'CONTRIBUTING.md')
    for path in (*first, *sorted((ROOT / 'doc').rglob('*.md'))):
        if commands(path):
            yield str(path.relative_to(ROOT))
