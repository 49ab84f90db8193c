# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What the default rejects of public LAS, LAZ and PCD files, by class.

    scripts/environment python benchmarks/public_files.py DIR [DIR ...] [--write]

Files are named ``SOURCE__NAME``. Noise is of the classes 7 and 18, and of IGN's 65.
With ``--write`` the table goes into ``doc/results/public_files.md``.
"""
# ruff: noqa: INP001, T201  a script, no package

import argparse
from collections.abc import Iterable, Sequence
from pathlib import Path
from time import perf_counter

from lidar_outlier_filter.errors import FilterError
from lidar_outlier_filter.files.cloud_file import open_cloud
from lidar_outlier_filter.files.judged_file import CleanOptions, JudgedFile, judge_file
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_lab.results.markdown import paragraphs, table, write

PAGE = Path(__file__).resolve().parents[1] / 'doc' / 'results' / 'public_files.md'
CLASSES = {'ground': (2,), 'vegetation': (3, 4, 5), 'building': (6,), 'noise': (7, 18, 65)}
MIN_POINTS, MAX_POINTS = 5000, 1_500_000  # of a file: fewer show no share
MAX_LOST_SHARE = 0.01  # of ground, or of buildings
SUFFIXES = ('.las', '.laz', '.pcd')
HEAD = ('file', 'source', 'points', 'rejected', *CLASSES, 'method')


def share(rejected: int, points: int) -> str:
    """Write how many of so many points are rejected; empty where there are none."""
    return f'{rejected} of {points} ({100 * rejected / points:.2g} %)' if points else ''


def of_class(judged: JudgedFile, codes: Iterable[int]) -> tuple[int, int]:
    """Count the rejected points of classes, and all of them."""
    counts = [judged.by_class.get(code, (0, 0)) for code in codes]
    return sum(rejected for _, rejected in counts), sum(points for points, _ in counts)


def row(path: Path) -> tuple[list[str], bool] | None:
    """Judge a file; return its row, and whether it loses too much. None: too few or many points."""
    file = open_cloud(path)
    if not MIN_POINTS <= len(file) <= MAX_POINTS:
        return None
    judged = judge_file(file, CleanOptions(dry=True), FilterParameters())
    source, _, name = path.name.rpartition('__')
    counts = {name: of_class(judged, codes) for name, codes in CLASSES.items()}
    lost = max(counts[name][0] / max(counts[name][1], 1) for name in ('ground', 'building'))
    rejected = judged.verdict.rejected
    cells = [f'`{name}`', source, str(len(rejected)), share(int(rejected.sum()), len(rejected))]
    cells += [share(*one) for one in counts.values()]
    return [*cells, '; '.join(judged.methods)], lost > MAX_LOST_SHARE


def judge_all(folders: Sequence[Path]) -> str:
    """Judge the files of folders; return the table, and what is refused."""
    rows, refused, bad = [], [], 0
    paths = (path for folder in folders for path in sorted(folder.iterdir()))
    for path in (one for one in paths if one.suffix.lower() in SUFFIXES):
        begin = perf_counter()
        try:
            found = row(path)
        except FilterError as err:
            refused.append(path.name)
            print(path.name, 'refused:', str(err).replace(str(path.parent), ''))
            continue
        if found is not None:
            rows.append(found[0])
            bad += found[1]
            print(*found[0], f'{perf_counter() - begin:.1f} s', sep=' | ', flush=True)
    said = f'{len(rows)} files; {bad} lose over {MAX_LOST_SHARE:.0%} of ground or buildings.'
    return paragraphs(
        said, table(list(HEAD), rows), f'Refused with a reason: {len(refused)} files.'
    )


def main() -> None:
    """Print the table, or write it."""
    parser = argparse.ArgumentParser(description=(__doc__ or '').partition('\n')[0])
    parser.add_argument('folders', nargs='+', type=Path, metavar='DIR')
    parser.add_argument('--write', action='store_true', help=f'into doc/results/{PAGE.name}')
    options = parser.parse_args()
    text = judge_all(options.folders)
    if options.write:
        write(PAGE, 'public-files', text, command='benchmarks/public_files.py DIR --write')
    else:
        print(text)


if __name__ == '__main__':
    main()
