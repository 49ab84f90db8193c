# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Real snow, labelled by people: the default and its peers on WADS, sequence 36.

    scripts/environment python benchmarks/real_snow.py FOLDER [--outdet FILE.onnx] [--write]

FOLDER holds `sequences/36/velodyne/*.bin` and `sequences/36/labels/*.label`, as the data set and
https://github.com/dut-mdmu/CRFOR have them. Its licence, CC BY-NC-SA, does not allow them here.
`doc/real_snow.md` says how to get them. Rings, times and returns are found again. Then
tables are printed: F1, precision, recall, the good points lost, by class and by range, and speed.

Nothing of the default may be chosen by these figures: they are the proof, and prove nothing else.
`--figures FILE.json` keeps what was counted, so that a later run may judge a part anew. The peers
take long; the default does not.
"""

# ruff: noqa: INP001, T201  a script, no package

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(Path(__file__).resolve().parent))

import real_snow_default as default  # noqa: E402
import real_snow_outdet as outdet  # noqa: E402
import real_snow_page as page  # noqa: E402
from real_snow_forms import FORMS, cloud, count  # noqa: E402
from real_snow_peers import PEERS, features  # noqa: E402
from real_snow_sweeps import read_rings, read_sweeps  # noqa: E402

from lidar_outlier_filter.errors import FilterError  # noqa: E402
from lidar_outlier_lab.results.markdown import write  # noqa: E402
from lidar_outlier_lab.results.pictures import draw_sweep  # noqa: E402

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from real_snow_forms import Cloud, Verdict
    from real_snow_page import All
    from real_snow_sweeps import Sweep

JUDGES = (page.DEFAULT, page.NETWORK, *PEERS)
RINGS = Path(__file__).resolve().parent / 'pandar64.csv'
PAGE = ROOT / 'doc' / 'results' / 'real_snow.md'
SECTION, COMMAND = 'real-snow', 'benchmarks/real_snow.py'
PICTURE = [('x', 'f4'), ('y', 'f4'), ('z', 'f4'), ('intensity', 'f4'), ('label', 'u1')]


def main(arguments: Sequence[str] | None = None) -> int:
    """Judge, print, and write what is wanted."""
    options = parse(arguments)
    try:
        run(options)
    except FilterError as err:
        print(err, file=sys.stderr)
        return 1
    return 0


def parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or '').splitlines()[0])
    add = parser.add_argument
    add('folder', type=Path, metavar='FOLDER')
    add('--every', type=int, default=1, metavar='N', help='judge every so many-th sweep')
    add('--forms', nargs='+', choices=FORMS, default=tuple(FORMS), metavar='F')
    add('--judges', nargs='*', choices=JUDGES, default=JUDGES, metavar='J')
    add('--outdet', type=Path, metavar='FILE.onnx', help="3D-OutDet's network; needs onnxruntime")
    add('--rings', type=Path, default=RINGS, metavar='FILE', help='the lasers, as pandar64.csv')
    add('--figures', type=Path, metavar='FILE.json', help='keep figures, and take kept ones')
    add('--pictures', type=Path, metavar='FOLDER', help="draw the default's first sweep there")
    add('--write', nargs='?', type=Path, const=PAGE, metavar='PAGE', help='default: %(const)s')
    options = parser.parse_args(arguments)
    if options.every < 1:
        parser.error('--every: must be at least 1')
    return options


def run(options: argparse.Namespace) -> None:
    """Judge all forms by all judges that are wanted."""
    everything = {} if options.figures is None else page.load(options.figures)
    sweeps = read_sweeps(options.folder, read_rings(options.rings), options.every)
    for form in options.forms:
        judge(form, sweeps, options, everything)
        if options.figures is not None:
            page.save(options.figures, everything)
    text = page.text(everything)
    print(text)
    if options.write is not None:
        write(options.write, SECTION, text, command=COMMAND)


def judge(form: str, sweeps: Sequence[Sweep], options: argparse.Namespace, everything: All) -> None:
    """Judge one form, and put the figures to those that are there."""
    clouds = [cloud(sweep, FORMS[form]) for sweep in sweeps]
    judged = {**everything.get(FORMS[form].like, {}), **everything.get(form, {})}
    for name, verdict in verdicts(clouds, wanted(form, options), options.outdet):
        judged[name] = count(clouds, verdict)
        print(f'{form}: {name} judged', file=sys.stderr, flush=True)
        if name == page.DEFAULT and options.pictures is not None:
            draw(clouds[0], verdict, options.pictures / f'{form}.png')
    everything[form] = {name: judged[name] for name in JUDGES if name in judged}


def wanted(form: str, options: argparse.Namespace) -> list[str]:
    """List who judges a form; what peers say of one that is like another is known from there."""
    known = FORMS[form].like in options.forms
    return [name for name in options.judges if name == page.DEFAULT or not known]


def verdicts(
    clouds: Sequence[Cloud], judges: Sequence[str], network: Path | None
) -> Iterator[tuple[str, Verdict]]:
    """Judge clouds of one form by those that are wanted and can be had."""
    if page.DEFAULT in judges:
        yield page.DEFAULT, default.judge(clouds)
    if page.NETWORK in judges and network is not None:
        yield page.NETWORK, outdet.judge(clouds, outdet.load(network))
    peers = [name for name in PEERS if name in judges]
    if peers:
        seen = features(clouds)
        for name in peers:
            yield name, PEERS[name](seen)


def draw(given: Cloud, verdict: Verdict, path: Path) -> None:
    """Draw a sweep before and after."""
    points = np.zeros(len(given), PICTURE)
    points['x'], points['y'], points['z'] = given.xyz.T
    points['intensity'], points['label'] = given.intensity, given.snow
    path.parent.mkdir(parents=True, exist_ok=True)
    draw_sweep(points, verdict.rejected[0], path, f'{given.name}: {path.stem}')


if __name__ == '__main__':
    sys.exit(main())
