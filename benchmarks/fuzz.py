# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Hard inputs in large numbers: clouds, files and recordings damaged at random, and killed runs.

    scripts/environment python benchmarks/fuzz.py --clouds 10000 --files 200 --cuts 50 --kills 50
    scripts/environment python benchmarks/fuzz.py --coverage 600 [--target las] [--found FOLDER]

The second way is guided by coverage: so many seconds on the processor for each reader, by
``test/helpers/covering.py``.
What has been reached is kept in the folder, and the next run goes on from there.

The strategies are those of the tests, in ``test/helpers/hostile.py`` and
``test/helpers/damaged.py``. What breaks a promise is printed
with the number that draws it again. At the end a table counts what was tried, as
``doc/reliability.md`` quotes it. The exit status is 1 if anything broke.
"""

# ruff: noqa: INP001, T201  a script, no package

from __future__ import annotations

import argparse
import re
import resource
import shutil
import subprocess
import sys
import traceback
from collections import Counter
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import TYPE_CHECKING, Any

TESTS = Path(__file__).resolve().parents[1] / 'test'
sys.path.insert(0, str(TESTS))

import numpy as np  # noqa: E402
from helpers.damaged import (  # noqa: E402  after the path is known
    FAST,
    KINDS,
    WAYS,
    Damage,
    check,
    content,
    inflict,
    write_large,
    write_recording,
)
from helpers.hostile import (  # noqa: E402  after the path is known
    FORMATS,
    broken,
    broken_clouds,
    judge,
    legal_clouds,
    read_and_copy,
    whole_file,
)
from hypothesis import HealthCheck, given, seed, settings  # noqa: E402

from lidar_outlier_filter.errors import RecordingError  # noqa: E402
from lidar_outlier_filter.recordings.bags import Recording  # noqa: E402
from lidar_outlier_filter.recordings.replay import replay  # noqa: E402

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

DATA = Path(__file__).resolve().parents[2] / 'shared' / 'data'
BAGS = ('vlp16_mrpt_mcap/vlp16_mrpt_mcap.mcap', 'vlp16_mrpt_db3/vlp16_mrpt_db3.db3', 'os0_32.bag')
TARGETS = (
    *('decoder', 'cdr'),
    *('las', 'laz', 'pcd', 'ply', 'ptx', 'csv', 'parquet', 'sqlite'),
    *('mcap', 'db3', 'bag'),
)


class Table:
    """What was tried, how often, and how it went."""

    def __init__(self) -> None:
        """Begin with nothing."""
        self.rows: dict[str, Counter[str]] = {}
        self.seconds: Counter[str] = Counter()

    def note(self, name: str, check: Callable[[], object], label: str) -> None:
        """Check something, and count it as read, refused or broken."""
        begin, row = perf_counter(), self.rows.setdefault(name, Counter())
        try:
            row['answered' if check() else 'refused'] += 1
        except Exception:  # noqa: BLE001  whatever it is, it breaks the promise
            row['broken'] += 1
            print(f'{name}, {label}:', traceback.format_exc(limit=-3))
        self.seconds[name] += perf_counter() - begin

    def show(self) -> int:
        """Print the table in Markdown; return the exit status."""
        print('| what | tried | answered | refused | broken | seconds |')
        print('| --- | ---: | ---: | ---: | ---: | ---: |')
        for name, row in self.rows.items():
            counts = ' | '.join(f'{row[key]:,}' for key in ('answered', 'refused', 'broken'))
            print(f'| {name} | {row.total():,} | {counts} | {self.seconds[name]:.0f} |')
        return int(any(row['broken'] for row in self.rows.values()))


def clouds(table: Table, count: int, start: int) -> None:
    """Draw clouds, one half legal."""
    for name, strategy in (('legal clouds', legal_clouds()), ('broken clouds', broken_clouds())):
        check = partial(_judge, table, name)
        drawn = settings(
            max_examples=count // 2,
            deadline=None,
            database=None,
            suppress_health_check=list(HealthCheck),
        )(seed(start)(given(strategy)(_taking_one(check))))
        drawn()


def _taking_one(check: Callable[[Any], None]) -> Callable[[Any], None]:
    """Make a function of one cloud, as hypothesis wants it."""

    def draw(cloud: Any) -> None:
        check(cloud)

    return draw


def _judge(table: Table, name: str, cloud: Any) -> None:
    table.note(name, lambda: judge(cloud), repr(cloud)[:1000])


def files(table: Table, count: int, start: int, folder: Path) -> None:
    """Break so many files of each format."""
    for kind in FORMATS:
        path = folder / f'cloud.{kind.partition(" ")[0]}'
        path.unlink(missing_ok=True)
        whole_file(kind, path)
        data, target = path.read_bytes(), folder / f'copy{path.suffix}'
        for number in range(start, start + count):
            path.write_bytes(broken(data, number))
            table.note(f'{kind} files', lambda p=path, t=target: read_and_copy(p, t), f'{number}')


def cuts(table: Table, count: int, folder: Path) -> None:
    """Cut real recordings off at so many offsets, and read what is left."""
    for name in BAGS:
        data = (DATA / 'bags' / name).read_bytes()
        path = folder / Path(name).name
        for i in range(count):
            path.write_bytes(data[: (2 * i + 1) * len(data) // (2 * count)])
            table.note(f'truncated {path.suffix}', lambda p=path: _read(p), f'{i} of {count}')


def _read(path: Path) -> bool:
    """Read a recording that was cut off: it must be refused."""
    try:
        with Recording(path) as recording:
            sum(1 for _ in recording.messages())
    except RecordingError:
        return False
    raise AssertionError('read without a word')


def salvages(table: Table, count: int, start: int, folder: Path) -> None:
    """Damage so many recordings of all kinds, and salvage them."""
    rng = np.random.default_rng(start)
    whole = {}
    for i, kind in enumerate(KINDS):
        (folder / f'{i}').mkdir()
        whole[kind] = write_recording(kind, folder / f'{i}')
    replay(whole['mcap'], folder / 'unbroken', parameters=FAST)
    unbroken, broken_ones = content(folder / 'unbroken'), folder / 'broken'
    for _ in range(count):
        kind = KINDS[int(rng.integers(len(KINDS)))]
        broken_ones.mkdir()
        path = broken_ones / whole[kind].name
        (shutil.copytree if whole[kind].is_dir() else shutil.copyfile)(whole[kind], path)
        done = [
            Damage(WAYS[int(rng.integers(len(WAYS)))], rng.random(), int(rng.integers(2**32)))
            for _ in range(int(rng.integers(1, 4)))
        ]
        for damage in done:
            inflict(path, damage)
        out = broken_ones / 'out'
        table.note(
            'salvaged recordings',
            lambda p=path, o=out: check(p, o, unbroken) is not None,
            f'{kind} {done}',
        )
        shutil.rmtree(broken_ones)


def kills(table: Table, counts: dict[str, int], folder: Path) -> None:
    """Kill so many runs of each command; replays also go on from what they left."""
    sources = {
        'clean': DATA / 'clouds' / 'plane.laz',
        'replay': DATA / 'bags' / 'vlp16_mrpt_mcap',
        'resume': write_large(folder / 'large'),
    }
    for what, source in sources.items():
        if not counts[what]:
            continue
        empty = folder / what
        empty.mkdir()
        program = [sys.executable, str(TESTS / 'killing.py')]
        command = [*program, what, str(source), str(empty), str(counts[what])]
        name = 'killed replays that go on' if what == 'resume' else f'killed runs of {what}'
        begin = perf_counter()
        done = subprocess.run(command, capture_output=True, text=True, check=True)  # noqa: S603  ours
        row = table.rows.setdefault(name, Counter())
        for line in done.stdout.splitlines():
            if line.startswith(('good', 'bad', 'torn')):
                row['answered' if line.startswith('good') else 'broken'] += 1
        table.seconds[name] += perf_counter() - begin


def cover(targets: Sequence[str], seconds: int, folder: Path) -> int:
    """Let coverage guide a run of each target; print a table, and return the exit status."""
    folder.mkdir(parents=True, exist_ok=True)
    print('| reader | seconds | inputs | edges reached | features | corpus | exit status |')
    print('| --- | ---: | ---: | ---: | ---: | ---: | ---: |')
    worst = 0
    for name in targets:
        *counts, status = guide(name, seconds, folder)
        cells = [name, *(f'{count:,}' for count in counts), f'{status}']
        print('|', ' | '.join(cells), '|', flush=True)
        worst = max(worst, abs(status))
    return worst


def guide(name: str, seconds: int, folder: Path) -> tuple[int, ...]:
    """Run a target until it had its seconds on the processor, however busy the machine is.

    Return these seconds, how many inputs it ran, what libFuzzer counts at the end, and the status.
    """
    worked, inputs, covered = 0.0, 0, (0, 0, 0)
    while True:
        piece = str(max(1, round(seconds - worked)))
        command = [sys.executable, str(TESTS / 'covering.py'), name, piece, str(folder)]
        before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
        done = subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603  ours
        worked += resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before
        for count in re.findall(r'number_of_executed_units: (\d+)', done.stderr):
            inputs += int(count)
        for counts in re.findall(r'cov: (\d+) ft: (\d+) corp: (\d+)', done.stderr)[-1:]:
            covered = tuple(map(int, counts))
        if done.returncode or worked >= seconds:
            print(done.stderr[-4000:] if done.returncode else '', end='')
            return round(worked), inputs, *covered, done.returncode


def main() -> int:
    """Try it all, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0] if __doc__ else '')
    parser.add_argument('--clouds', type=int, default=20_000)
    parser.add_argument('--files', type=int, default=200, help='of each of the formats')
    parser.add_argument('--cuts', type=int, default=170, help='of each kind of recording')
    parser.add_argument('--salvages', type=int, default=500, help='damaged recordings')
    parser.add_argument('--kills', type=int, default=50, help='of each command')
    parser.add_argument('--resumes', type=int, default=10, help='killed replays that go on')
    parser.add_argument('--seed', type=int, default=0)
    parser.add_argument(
        '--coverage', type=int, metavar='SECONDS', help='on the processor, for each reader'
    )
    parser.add_argument('--target', action='append', choices=TARGETS, help='default: all')
    parser.add_argument('--found', type=Path, metavar='FOLDER', help='what coverage finds')
    options = parser.parse_args()
    if options.coverage:
        with TemporaryDirectory() as name:
            folder = options.found or Path(name)
            return cover(options.target or TARGETS, options.coverage, folder)
    table = Table()
    with TemporaryDirectory() as name:
        if options.clouds:
            clouds(table, options.clouds, options.seed)
        files(table, options.files, options.seed, Path(name))
        cuts(table, options.cuts, Path(name))
        salvages(table, options.salvages, options.seed, Path(name))
        counts = {'clean': options.kills, 'replay': options.kills, 'resume': options.resumes}
        kills(table, counts, Path(name))
    return table.show()


if __name__ == '__main__':
    sys.exit(main())
