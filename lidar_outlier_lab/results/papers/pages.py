# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The pages of the papers by their names: what is generated on each of them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lidar_outlier_lab.results.papers import kang, leslar, pirotti, sotoodeh_hod, sotoodeh_lof

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from lidar_outlier_filter.core.annotations import Progress

    # Presets that may be simulated, a seed, where pictures go; returns what stands on the page.
    Page = Callable[[Sequence[str], int, Path, Progress], str]

PAGES: Mapping[str, Page] = {
    'leslar2010': leslar.section,
    'sotoodeh2006': sotoodeh_lof.section,
    'sotoodeh2007': sotoodeh_hod.section,
    'kang2018': kang.section,
    'pirotti2018': pirotti.section,
}
TITLE = '## Theirs and ours'


def write_up(
    papers: Sequence[str], presets: Sequence[str], seed: int, folder: Path, progress: Progress
) -> dict[str, str]:
    """Make the tables and pictures of some papers; returns what is for each page."""
    texts = {}
    for name in papers:
        text = PAGES[name](presets, seed, folder, progress)
        texts[name] = f'{TITLE}\n\n{text}'
    return texts
