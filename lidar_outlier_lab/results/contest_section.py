# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The section of the results in which all detectors, chains and peers meet on all presets."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lidar_outlier_lab.results import contest_tables
from lidar_outlier_lab.results.contest import compete, standings
from lidar_outlier_lab.results.contest_tables import TARGETS
from lidar_outlier_lab.results.contestants import (
    DEFAULT,
    MOST,
    OURS,
    RULES,
    missing,
    peers,
)
from lidar_outlier_lab.results.markdown import paragraphs

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lidar_outlier_filter.core.annotations import Progress
    from lidar_outlier_lab.results.contest import Record, Standings
    from lidar_outlier_lab.results.contestants import Contestant

    Contest = tuple[str, int, Sequence[Contestant]]


def entries(presets: Sequence[str], seeds: Sequence[int], full: int) -> list[Contest]:
    """Say who judges what.

    Parameters
    ----------
    presets : names
    seeds : where there is a target, the default, the rules and the peers judge all of them
    full : so many of the seeds, the first, are judged by everybody, on all presets

    """
    few: list[Contestant] = [*(one for one in OURS if one.name in {DEFAULT, *RULES}), *peers()]
    everybody: list[Contestant] = [*OURS, *peers()]
    return [
        (preset, seed, everybody if number < full else few)
        for preset in presets
        for number, seed in enumerate(seeds)
        if number < full or preset in TARGETS
    ]


def section(
    presets: Sequence[str], seeds: Sequence[int], full: int, progress: Progress
) -> dict[str, str]:
    """Run the contest and write it up: the sections ``default`` and ``contest``."""
    return written(compete(entries(presets, seeds, full), progress), seeds, full)


def written(records: Sequence[Record], seeds: Sequence[int], full: int) -> dict[str, str]:
    """Write up what the contest gave; everybody is compared on seeds that everybody has judged."""
    found = standings(records)
    alike = standings([record for record in records if record.seed in seeds[:full]])
    return {
        'default': _default(found, seeds),
        'contest': _contest(alike, seeds[:full]),
    }


def _default(found: Standings, seeds: Sequence[int]) -> str:
    others = [*RULES, *(peer.name for peer in peers())]
    table = contest_tables.targets(found, DEFAULT, others)
    if not table:
        return paragraphs('## The default', 'None of its presets were in this run.')
    return paragraphs(
        '## The default',
        f'Defaults as they are, without knowledge of the scene, on seeds {_list(seeds)}. None of '
        'them trained the trees. Intervals are of 95 %, drawn from the seeds with replacement; '
        'with few seeds they are rather too narrow. On streets, the F1 to reach is that of the '
        'best rule or peer in this run, each drive judged at the threshold that is best for it.',
        table,
        'The rules and the peers in the same run. The best F1 is that at the threshold that suits '
        'each drive best, which nobody knows in the field:',
        contest_tables.beside(found, [DEFAULT, *others]),
        'Rules and peers with a higher F1 than the default, both as they are:',
        contest_tables.worse(found, DEFAULT, others),
    )


def _contest(found: Standings, seeds: Sequence[int]) -> str:
    absent, others = missing(), [peer.name for peer in peers()]
    everybody = [*(one.name for one in OURS), *others]
    return paragraphs(
        '## All detectors, chains and peers on simulated clouds',
        'Protocol: `lidar-outlier-filter simulate PRESET --seed N` for each preset and seed; '
        'everybody gets the same points and is counted alike. Detectors have their default '
        'parameters, unless the name says otherwise; those with ±5 points have acceleration, and '
        'test each point once; these, and those with one surface, have a significance of 0.001. '
        'Recordings go through the stream in blocks of 0.1 s with 10 ms before and after, as in '
        'the node; single clouds (`pirotti-…`, `sotoodeh-hod`, `kang-…`) are judged as a whole, as '
        'by `clean`. Peers get what stands still as a whole (`leslar-…` and single clouds) and '
        "sweeps in the sensor's frame one by one.",
        f'Seeds: {_list(seeds)}. Intervals of 95 % are drawn from seeds where there are several, '
        'otherwise from 20 stretches of the one. The best F1 of each column is bold. `sor` as '
        'DROR has the setting that was found best for 32 rings in snow elsewhere, as DSOR that of '
        "its authors; both need the sensor's own frame. A dash: the cloud lacks what the detector "
        f'needs (times, the origin), or it is too large for a slow peer (above {MOST:,} points '
        'at once).' + (f' Not installed, so left out: {", ".join(absent)}.' if absent else ''),
        contest_tables.overview(found, everybody),
        'Where a peer has a higher F1 than every detector and chain of ours:',
        contest_tables.beaten(found, others),
        'Everything, sample by sample; seconds are of the processor, for one sample, once:',
        contest_tables.details(found, everybody),
    )


def _list(seeds: Sequence[int]) -> str:
    return ', '.join(map(str, seeds))
