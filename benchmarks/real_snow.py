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

from __future__ import annotations

import argparse
import sys
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(Path(__file__).resolve().parent))

from real_snow_judges import PEERS, by_default, by_network, features, load_network  # noqa: E402
from real_snow_sweeps import (  # noqa: E402
    CLASSES,
    FORMS,
    RANGES,
    SNOW,
    cloud,
    count,
    read_rings,
    read_sweeps,
)

from lidar_outlier_filter.errors import FilterError  # noqa: E402
from lidar_outlier_filter.evaluation.confusion import Confusion, Share  # noqa: E402
from lidar_outlier_filter.evaluation.report import percent  # noqa: E402
from lidar_outlier_lab.results.markdown import (  # noqa: E402
    NOTHING,
    number,
    paragraphs,
    table,
    write,
)

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from real_snow_sweeps import Cloud, Figures, Sweep, Verdict

    Judged = dict[str, Figures]  # by judge
    All = dict[str, Judged]  # by form

DEFAULT, NETWORK = 'default', '3D-OutDet'
JUDGES = (DEFAULT, NETWORK, *PEERS)
RINGS = Path(__file__).resolve().parent / 'pandar64.csv'
PAGE = ROOT / 'doc' / 'results' / 'real_snow.md'
SECTION, COMMAND = 'real-snow', 'benchmarks/real_snow.py'


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
    add('--write', nargs='?', type=Path, const=PAGE, metavar='PAGE', help='default: %(const)s')
    options = parser.parse_args(arguments)
    if options.every < 1:
        parser.error('--every: must be at least 1')
    return options


def run(options: argparse.Namespace) -> All:
    """Judge the requested forms by the requested judges; return the figures by form and judge."""
    everything: All = {}
    sweeps = read_sweeps(options.folder, read_rings(options.rings), options.every)
    for form in options.forms:
        judge(form, sweeps, options, everything)
    text = text_of(everything)
    print(text)
    if options.write is not None:
        write(options.write, SECTION, text, command=COMMAND)
    return everything


def judge(form: str, sweeps: Sequence[Sweep], options: argparse.Namespace, everything: All) -> None:
    """Judge one form, and put the figures to those that are there."""
    clouds = [cloud(sweep, FORMS[form]) for sweep in sweeps]
    judged = {**everything.get(FORMS[form].like, {})}
    for name, verdict in verdicts(clouds, requested(form, options), options.outdet):
        judged[name] = count(clouds, verdict)
        print(f'{form}: {name} judged', file=sys.stderr, flush=True)
    everything[form] = {name: judged[name] for name in JUDGES if name in judged}


def requested(form: str, options: argparse.Namespace) -> list[str]:
    """List who judges a form; what peers say of one that is like another is known from there."""
    known = FORMS[form].like in options.forms
    return [name for name in options.judges if name == DEFAULT or not known]


def verdicts(
    clouds: Sequence[Cloud], judges: Sequence[str], network: Path | None
) -> Iterator[tuple[str, Verdict]]:
    """Judge clouds of one form by those that are wanted and can be had."""
    if DEFAULT in judges:
        yield DEFAULT, by_default(clouds)
    if NETWORK in judges and network is not None:
        yield NETWORK, by_network(clouds, load_network(network))
    peers = [name for name in PEERS if name in judges]
    if peers:
        seen = features(clouds)
        for name in peers:
            yield name, PEERS[name](seen)


def text_of(everything: All) -> str:
    """Write up all figures, form by form."""
    forms = [form for form in FORMS if everything.get(form)]
    return paragraphs(in_short(everything), *(of_form(form, everything[form]) for form in forms))


def in_short(everything: All) -> str:
    """Lay out F1, and the share of the good points that is lost, of each judge in each form."""
    forms = [form for form in FORMS if everything.get(form)]
    judges = dict.fromkeys(judge for form in forms for judge in everything[form])
    rows = [
        (_bold(judge, judge), *(_short(everything[form].get(judge)) for form in forms))
        for judge in judges
    ]
    return paragraphs(
        '## In short',
        'F1, and in brackets the good points lost:',
        table(('', *(FORMS[form].title for form in forms)), rows),
    )


def _short(figures: Figures | None) -> str:
    if figures is None:
        return NOTHING
    return f'{number(figures.whole.f1)} ({percent(figures.whole.false_rejections.ratio)})'


def _bold(judge: str, said: str) -> str:
    return f'**{said}**' if judge == DEFAULT else said


def of_form(form: str, judged: Judged) -> str:
    """Write up one form: all judges, by class, by range, and where the default is worse."""
    title = FORMS[form].title
    return paragraphs(
        f'## {title[0].upper()}{title[1:]}',
        *(f'Given to {names}: {said}.' for said, names in _given(judged).items()),
        whole(judged),
        'Rejected, by class. Of falling snow much is good, of all others little:',
        by_class(judged),
        'Found of the snow, and lost of the rest, by range:',
        by_range(judged),
        worse(judged),
    )


def _given(judged: Judged) -> dict[str, str]:
    """Say what was judged by whom; most often all judge the same."""
    said: dict[str, list[str]] = {}
    for judge, one in judged.items():
        sweeps, points, snow = one.sweeps, one.whole.total, one.whole.outliers
        text = f'{sweeps} sweeps, {points:,} points, {snow:,} of them falling snow'
        said.setdefault(text, []).append(judge)
    return {text: 'all' if len(said) == 1 else '; '.join(names) for text, names in said.items()}


def whole(judged: Judged) -> str:
    """Lay out what each judge does to all points."""
    head = ('', 'F1', 'precision', 'recall', 'good points lost', 'million points/s', 'chosen')
    rows = [
        (
            _bold(judge, judge),
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
    rows = [
        (said, *(_of_range(one, index) for one in judged.values()))
        for index, said in enumerate(range_names())
    ]
    return table(('', *judged), rows)


def _of_range(figures: Figures, index: int) -> str:
    part = Confusion(*figures.ranges[index])
    return f'{percent(part.recall.ratio)}, {percent(part.false_rejections.ratio)}'


def range_names() -> list[str]:
    """Name the ranges."""
    return [*(f'{low:g} to {high:g} m' for low, high in pairwise(RANGES)), f'from {RANGES[-1]:g} m']


def worse(judged: Judged) -> str:
    """Say which peers have a better F1 than the default."""
    if DEFAULT not in judged:
        return 'The default was not judged.'
    own = judged[DEFAULT].whole.f1
    better = [name for name, one in judged.items() if one.whole.f1 > own]
    return f'Peers with a better F1 than the default: {", ".join(better) or "none"}.'


if __name__ == '__main__':
    sys.exit(main())
