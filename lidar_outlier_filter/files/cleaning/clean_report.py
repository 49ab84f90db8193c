# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The report on a judged file: counts of its points, and how they were judged."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from lidar_outlier_filter.core.detectors.registry import DETECTORS
from lidar_outlier_filter.files.cleaning.clean_log import CleanReport, settings, versions
from lidar_outlier_filter.files.cleaning.points import say_coarse

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from datetime import datetime
    from pathlib import Path

    from numpy.typing import NDArray

    from lidar_outlier_filter.core.verdict import Verdict
    from lidar_outlier_filter.files.cleaning.judged_file import JudgedFile


def report_of(
    judged: JudgedFile, clouds: Sequence[Path], started: datetime, seconds: Mapping[str, float]
) -> CleanReport:
    """Say what became of a judged file, of which these clouds were written."""
    file, wanted, loaded = judged.file, judged.wanted, judged.loaded
    return CleanReport(
        input=str(file.path),
        outputs=tuple(str(cloud) for cloud in clouds),
        started=started.isoformat(timespec='seconds'),
        settings=settings(file.path, wanted)['settings'],
        rejected_points=wanted.rejected,
        coordinates=judged.coordinates,
        tile=wanted.tile,
        metres=judged.metres,
        lines=loaded.lines,
        lack=loaded.lack,
        rings=loaded.rings,
        coarse=say_coarse(file, judged.coordinates, loaded.points, judged.metres),
        chain=judged.parameters.chain,
        **_counts(judged.verdict, loaded.points.valid, judged.ignored, judged.parameters.chain),
        spared=int(np.count_nonzero(judged.everything.rejected & ~judged.verdict.rejected)),
        by_class=judged.by_class,
        low=int(np.count_nonzero(~judged.high)),
        high=int(np.count_nonzero(judged.high)),
        seconds=seconds,
        versions=versions(),
        parameters=judged.parameters.flat(),
    )


def _counts(
    verdict: Verdict, valid: NDArray[np.bool_], ignored: int, chain: Sequence[str]
) -> dict[str, Any]:
    """Count the points, all and by detector."""

    def by_detector(bits: NDArray[np.uint16]) -> dict[str, int]:
        return {name: int(np.count_nonzero(bits & DETECTORS[name].bit)) for name in chain}

    return {
        'points': len(valid),
        'invalid': int(np.count_nonzero(~valid)) - ignored,
        'ignored': ignored,
        'untested': int(np.count_nonzero(np.isnan(verdict.score[valid]))),
        'rejected': int(np.count_nonzero(verdict.rejected)),
        'rejected_by': by_detector(verdict.detectors),
        'extra': {
            name: int(np.count_nonzero(verdict.detectors & bit))
            for one in DETECTORS.values()
            for bit, name in one.extra.items()
        },
        'undecided_by': by_detector(verdict.undecided),
    }
