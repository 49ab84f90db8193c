# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The clouds that are written of a judged file, and in what each differs from it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from lidar_outlier_filter.errors import CloudError
from lidar_outlier_filter.files import cloud_file
from lidar_outlier_filter.files.cleaning.clean_log import CLASS, MARK, REMOVE, SEPARATE, WITHHELD
from lidar_outlier_filter.files.cloud_file import Change
from lidar_outlier_filter.messages.cloud import DETECTORS, REASON, SCORE

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from numpy.typing import NDArray

    from lidar_outlier_filter.files.cleaning.clean_log import Wanted
    from lidar_outlier_filter.files.cleaning.judged_file import JudgedFile
    from lidar_outlier_filter.files.cloud_file import CloudFile

OUTLIER = 'outlier'


def list_clouds(file: CloudFile, output: Path, outliers: Path | None, wanted: Wanted) -> list[Path]:
    """List the clouds to be written.

    Raises
    ------
    CloudError
        If one cannot be, or what is wanted cannot be done with the file.

    """
    if wanted.rejected != MARK and file.whole:
        must_be = f'{MARK!r} for {file.path}: {file.whole}'
        raise CloudError('what becomes of rejected points', must_be, repr(wanted.rejected))
    if wanted.mark != CLASS and not (file.classes and wanted.rejected == MARK):
        must_be = f'{CLASS!r}, unless points of LAS and LAZ are marked'
        raise CloudError('how rejected points are marked', must_be, repr(wanted.mark))
    if wanted.rejected == SEPARATE and outliers is None:
        raise CloudError('the file for the outliers', 'given, to separate them', 'none')
    if wanted.rejected != SEPARATE and outliers is not None:
        must_be = f'{SEPARATE!r} where they have a file'
        raise CloudError('what becomes of rejected points', must_be, repr(wanted.rejected))
    clouds = [output] if outliers is None else [output, outliers]
    for cloud in clouds:
        if cloud.name.lower().endswith('.copc.laz'):
            must_be = 'LAZ without an octree, of which untwine or PDAL makes COPC'
            raise CloudError('the output', must_be, cloud)
        if not cloud_file.is_same_format(file.path, cloud):
            raise CloudError('the output', f'in the format of {file.path.name}', cloud)
    return clouds


def changes(judged: JudgedFile) -> list[Change]:
    """Say in what each of the clouds to be written differs from the file."""
    verdict, wanted = judged.verdict, judged.wanted
    scores: dict[str, NDArray[Any]] = {SCORE: verdict.score, DETECTORS: verdict.detectors}
    if judged.parameters.scores:
        scores[REASON] = verdict.reason
    added = scores if judged.parameters.scores else {}
    if wanted.rejected == MARK:
        if judged.file.classes:
            return [_marked(judged, added)]
        return [Change(added={OUTLIER: verdict.rejected.astype(np.uint8), **scores})]
    cleaned = Change(keep=~verdict.rejected, added=added)
    if wanted.rejected == REMOVE:
        return [cleaned]
    return [cleaned, Change(keep=verdict.rejected, added=added)]


def _marked(judged: JudgedFile, added: Mapping[str, NDArray[Any]]) -> Change:
    """Say how the rejected points of a LAS file are marked."""
    rejected = judged.verdict.rejected
    if judged.wanted.mark == WITHHELD:
        return Change(withheld=rejected, added=added)
    if judged.wanted.mark == CLASS:
        return Change(noise=rejected, added=added)
    high = np.zeros(len(rejected), np.bool_)
    high[rejected] = judged.high
    return Change(noise=rejected & ~high, high=high, added=added)
