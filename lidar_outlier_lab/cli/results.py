# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The command ``results``. It imports what is heavy when it runs, so that help is instant."""

# ruff: noqa: PLC0415  as said above

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from lidar_outlier_filter.cli.terminal import DONE, show, stoppable_bar
from lidar_outlier_filter.errors import FilterError
from lidar_outlier_lab.simulation.presets import PRESETS

if TYPE_CHECKING:
    import argparse
    from collections.abc import Callable

    from lidar_outlier_filter.cli.arguments import Commands
    from lidar_outlier_filter.core.annotations import Progress

    # Takes the folder for pictures; returns the text of each of its parts of the page, by its name.
    WriteSection = Callable[[argparse.Namespace, Path, Progress], dict[str, str]]

PAGE = Path('doc/results/tables.md')
DATA = Path('../shared/data')
SEEDS = (101, 102, 103, 104, 105)
# The module of each paper; its ``section`` writes what stands on the page.
PAPERS = {
    'leslar2010': 'leslar',
    'sotoodeh2006': 'sotoodeh_lof',
    'sotoodeh2007': 'sotoodeh_hod',
    'kang2018': 'kang',
    'pirotti2018': 'pirotti',
}
QUICK_PRESETS = ('leslar-c', 'pirotti-fcd', 'sotoodeh-hod')


def add_results(commands: Commands) -> None:
    """Add the command ``results``."""
    parser = commands.add_parser(
        'results',
        help='compare all detectors with the papers and with other programs, and write tables',
        description='Simulate all presets, judge them with every detector, some chains and '
        'other programs, and write tables and pictures between markers of a page; its other '
        'text is kept. It takes half an hour on two cores, and half an hour more for the '
        'papers.',
        epilog='examples:\n  lidar-outlier-filter results --quick\n'
        '  lidar-outlier-filter results --sections papers',
    )
    parser.add_argument(
        '--output', type=Path, default=PAGE, metavar='FILE', help=f'the page; default: {PAGE}'
    )
    parser.add_argument(
        '--presets', nargs='+', metavar='P', choices=PRESETS, help='only these; default: all'
    )
    parser.add_argument(
        '--seeds',
        nargs='+',
        type=int,
        metavar='N',
        help=f'nonnegative; default: {" ".join(map(str, SEEDS))}, never used for tuning',
    )
    parser.add_argument(
        '--full',
        type=int,
        default=1,
        metavar='N',
        help='run all detectors on N seeds, then only default, sor and other '
        'programs, on presets with F1 targets; default: 1',
    )
    parser.add_argument(
        '--quick',
        action='store_true',
        help='small presets, one seed, few points: a few minutes',
    )
    parser.add_argument(
        '--sections',
        nargs='+',
        choices=tuple(SECTIONS),
        metavar='S',
        help=f'sections to write: {", ".join(SECTIONS)}; default: all, with --quick all but papers',
    )
    parser.add_argument(
        '--papers',
        nargs='+',
        choices=PAPERS,
        default=tuple(PAPERS),
        metavar='P',
        help=f'papers to write pages for, in papers/ beside FILE: {", ".join(PAPERS)}',
    )
    parser.add_argument(
        '--data',
        type=Path,
        default=DATA,
        metavar='DIR',
        help=f'folder of real recordings and clouds; default: {DATA}',
    )
    parser.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> int:
    from tempfile import TemporaryDirectory

    from lidar_outlier_lab.results import markdown

    for module in ('matplotlib', 'PIL'):
        import_module(module)  # before the work
    if options.full < 1:
        raise FilterError('--full', 'at least 1', options.full)
    options.presets = options.presets or (QUICK_PRESETS if options.quick else tuple(PRESETS))
    options.seeds = options.seeds or (SEEDS[:1] if options.quick else SEEDS)
    options.sections = options.sections or [
        name for name in SECTIONS if not (options.quick and name == 'papers')
    ]
    with stoppable_bar('results', lines=True) as progress:
        for number, name in enumerate(options.sections):
            # Before the first step there are imports, simulations and compilation.
            progress(number, len(options.sections), f'section {name}')
            with TemporaryDirectory() as folder:
                texts = SECTIONS[name](options, Path(folder), progress)
                pictures = sorted(Path(folder).glob('*.png'))
                page = options.output.parent / 'papers' if name == 'papers' else options.output
                for index, (part, text) in enumerate(texts.items()):
                    one = page / f'{part}.md' if name == 'papers' else page
                    markdown.write(one, part, text, () if index else pictures)
            show(f'{name} written to {page}')
    return DONE


def _contest(options: argparse.Namespace, _pictures: Path, progress: Progress) -> dict[str, str]:
    from lidar_outlier_lab.results.contest import section

    return section(options.presets, options.seeds, options.full, progress)


def _real(options: argparse.Namespace, _pictures: Path, progress: Progress) -> dict[str, str]:
    from lidar_outlier_lab.results.real_clouds import section

    return {'real': section(options.data, progress)}


def _forms(_options: argparse.Namespace, _pictures: Path, progress: Progress) -> dict[str, str]:
    from lidar_outlier_lab.results.forms import section

    return {'forms': section(progress)}


def _papers(options: argparse.Namespace, pictures: Path, progress: Progress) -> dict[str, str]:
    texts = {}
    for name in options.papers:
        paper = import_module(f'lidar_outlier_lab.results.papers.{PAPERS[name]}')
        text = paper.section(options.presets, options.seeds[0], pictures, progress)
        texts[name] = f'## Theirs and ours\n\n{text}'
    return texts


SECTIONS: dict[str, WriteSection] = {
    'contest': _contest,
    'real': _real,
    'forms': _forms,
    'papers': _papers,
}
