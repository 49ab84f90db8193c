# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Real snow, labelled by people: the default and its peers on WADS, sequence 36.

    scripts/environment python benchmarks/real_snow.py FOLDER [--outdet FILE.onnx] [--write]

FOLDER holds `sequences/36/velodyne/*.bin` and `sequences/36/labels/*.label`, as the data set and
https://github.com/dut-mdmu/CRFOR have them. Its licence, CC BY-NC-SA, does not allow them here.
`doc/real_snow.md` says how to get them. Rings, times and returns are found again. Then
tables are printed: F1, precision, recall, the good points lost, by class and by range, and speed.

Nothing of the default may be chosen by these figures: they are the proof, and prove nothing else.
The peers take long; the default does not.
"""

# ruff: noqa: INP001, T201  a script, no package

import argparse
import sys
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path

from real_snow_judges import PEERS, by_default, by_network, features, load_network
from real_snow_sweeps import (
    CLASSES,
    FORMS,
    RANGES,
    SNOW,
    Figures,
    Sweep,
    Verdict,
    cloud,
    count,
    read_rings,
    read_sweeps,
)

from lidar_outlier_filter.evaluation.confusion import Confusion, Share
from lidar_outlier_filter.evaluation.report import percent
from lidar_outlier_lab.results.markdown import number, paragraphs, table, write

Judged = dict[str, Figures]  # by judge
All = dict[str, Judged]  # by form

DEFAULT, NETWORK = 'default', '3D-OutDet'
JUDGES = (DEFAULT, NETWORK, *PEERS)
HERE = Path(__file__).resolve().parent
RINGS = HERE / 'pandar64.csv'
PAGE = HERE.parent / 'doc' / 'results' / 'real_snow.md'
SECTION, COMMAND = 'real-snow', 'benchmarks/real_snow.py'


def main(arguments: Sequence[str] | None = None) -> All:
    """Judge the requested forms by the requested judges; return the figures by form and judge."""
    parser = argparse.ArgumentParser(description=(__doc__ or '').splitlines()[0])
    add = parser.add_argument
    add('folder', type=Path, metavar='FOLDER')
    add('--every', type=int, default=1, metavar='N', help='judge every so many-th sweep')
    add('--forms', nargs='+', choices=FORMS, default=tuple(FORMS), metavar='F')
    add('--judges', nargs='*', choices=JUDGES, default=JUDGES, metavar='J')
    add('--outdet', type=Path, metavar='FILE.onnx', help="3D-OutDet's network; needs onnxruntime")
    add('--write', nargs='?', type=Path, const=PAGE, metavar='PAGE', help='default: %(const)s')
    options = parser.parse_args(arguments)
    sweeps = read_sweeps(options.folder, read_rings(RINGS), options.every)
    everything: All = {}
    for form in options.forms:
        clouds = [cloud(sweep, form) for sweep in sweeps]
        everything[form] = {}
        for name, verdict in verdicts(clouds, options.judges, options.outdet):
            everything[form][name] = count(clouds, verdict)
            print(f'{form}: {name} judged', file=sys.stderr, flush=True)
    text = paragraphs(in_short(everything), *(of_form(*one) for one in everything.items()))
    print(text)
    if options.write is not None:
        write(options.write, SECTION, text, command=COMMAND)
    return everything


def verdicts(
    clouds: Sequence[Sweep], judges: Sequence[str], network: Path | None
) -> Iterator[tuple[str, Verdict]]:
    """Judge clouds of one form by the requested and available methods."""
    if DEFAULT in judges:
        yield DEFAULT, by_default(clouds)
    if NETWORK in judges and network is not None:
        yield NETWORK, by_network(clouds, load_network(network))
    peers = [name for name in PEERS if name in judges]
    if peers:
        seen = features(clouds)
        for name in peers:
            yield name, PEERS[name](seen)


def in_short(everything: All) -> str:
    """Lay out F1, and the share of the good points that is lost, of each judge in each form."""
    judges = next(iter(everything.values()))
    rows = []
    for judge in judges:
        wholes = [judged[judge].whole for judged in everything.values()]
        cells = [f'{number(one.f1)} ({percent(one.false_rejections.ratio)})' for one in wholes]
        rows.append((_bold(judge), *cells))
    return paragraphs(
        '## In short',
        'F1, and in brackets the good points lost:',
        table(('', *(FORMS[form][0] for form in everything)), rows),
    )


def _bold(judge: str) -> str:
    return f'**{judge}**' if judge == DEFAULT else judge


def of_form(form: str, judged: Judged) -> str:
    """Write up one form: all judges, by class, by range, and where the default is worse."""
    title, one = FORMS[form][0], next(iter(judged.values()))
    return paragraphs(
        f'## {title[0].upper()}{title[1:]}',
        f'Given to all: {one.sweeps} sweeps, {one.whole.total:,} points, '
        f'{one.whole.outliers:,} of them falling snow.',
        whole(judged),
        'Rejected, by class. Of falling snow much is good, of all others little:',
        by_class(judged),
        'Found of the snow, and lost of the rest, by range:',
        by_range(judged),
        worse(judged),
    )


def whole(judged: Judged) -> str:
    """Lay out what each judge does to all points."""
    head = ('', 'F1', 'precision', 'recall', 'good points lost', 'million points/s', 'chosen')
    rows = [
        (
            _bold(judge),
            number(one.whole.f1),
            number(one.whole.precision.ratio),
            number(one.whole.recall.ratio),
            percent(one.whole.false_rejections.ratio),
            number(one.speed, 2),
            one.setting or 'nothing',
        )
        for judge, one in judged.items()
    ]
    return table(head, rows)


def by_class(judged: Judged) -> str:
    """Lay out the share of each class that is rejected."""
    present = [label for label in CLASSES if any(label in one.classes for one in judged.values())]
    present.sort(key=lambda label: label != SNOW)
    rows = []
    for label in present:
        pairs = [one.classes.get(label, (0, 0)) for one in judged.values()]
        points = max(points for points, _ in pairs)
        shares = [percent(Share(rejected, count).ratio) for count, rejected in pairs]
        rows.append((CLASSES[label], f'{points:,}', *shares))
    return table(('', 'points', *judged), rows)


def by_range(judged: Judged) -> str:
    """Lay out recall, and the share of the good points that is lost, by range."""
    names = [f'{low:g} to {high:g} m' for low, high in pairwise(RANGES)]
    rows = [[name] for name in (*names, f'from {RANGES[-1]:g} m')]
    for one in judged.values():
        for row, counts in zip(rows, one.ranges.tolist(), strict=True):
            part = Confusion(*counts)
            row.append(f'{percent(part.recall.ratio)}, {percent(part.false_rejections.ratio)}')
    return table(('', *judged), rows)


def worse(judged: Judged) -> str:
    """Say which peers have a better F1 than the default."""
    if DEFAULT not in judged:
        return 'The default was not judged.'
    own = judged[DEFAULT].whole.f1
    better = [name for name, one in judged.items() if one.whole.f1 > own]
    return f'Peers with a better F1 than the default: {", ".join(better) or "none"}.'


if __name__ == '__main__':
    main()
