# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The cloud like Sotoodeh's, its errors beside the paper's, and its picture."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from PIL import Image

from lidar_outlier_filter.core.detectors import hierarchical
from lidar_outlier_filter.core.detectors.builtin import Hierarchical
from lidar_outlier_lab.results import pictures as picture
from lidar_outlier_lab.results.papers import sotoodeh_picture as hod_picture
from lidar_outlier_lab.simulation.papers.sotoodeh_clusters import FAR, NEAR, simulate

if TYPE_CHECKING:
    from pathlib import Path

SEEDS = range(20)


@pytest.mark.parametrize('seed', range(3))
def test_scene(seed: int) -> None:
    """656 points, 84 of them outliers, single ones where they should be; a seed is a scene."""
    xyz, outlier = simulate(seed)
    assert xyz.shape == (656, 3)
    assert np.count_nonzero(outlier) == 84
    gap = np.linalg.norm(xyz[outlier][:, None] - xyz[~outlier], axis=2).min(axis=1)
    assert gap[:36].min() > FAR[0]
    assert NEAR[0] < gap[36:40].min()
    assert gap[36:40].max() < NEAR[1]
    np.testing.assert_array_equal(xyz, simulate(seed).xyz)
    assert not np.array_equal(xyz, simulate(seed + 1).xyz)


def test_course() -> None:
    """Each step is made of the one before, and the last one is the answer."""
    scene, parameters = simulate(0), Hierarchical()
    steps = hod_picture.course(scene.xyz, parameters)
    count = len(scene.xyz)
    assert len(steps.tree) == count - 1
    tree, pruned_tree, graph, pruned_graph = (
        {(min(p, q), max(p, q)) for p, q in ends.tolist()} for ends in steps[:4]
    )
    assert pruned_tree < tree
    assert pruned_graph < graph
    rough = np.flatnonzero(steps.phase != 1)
    # A minimum spanning tree is part of the Gabriel graph.
    assert {edge for edge in pruned_tree if edge[0] in rough} < graph
    assert {p for edge in graph for p in edge} == set(rough.tolist())
    clean = hierarchical.detect(scene.xyz, parameters)
    np.testing.assert_array_equal(steps.phase, clean.phase)


@pytest.mark.parametrize('least', [100, 400, 1000])
def test_picture(tmp_path: Path, least: int) -> None:
    """Six panels, with lost points in their own colour; also where no cluster is large enough."""
    parameters = replace(Hierarchical(), min_cluster=least)
    hod_picture.draw(simulate(0), parameters, tmp_path / 'picture.png')
    with Image.open(tmp_path / 'picture.png') as image:
        colours = {colour for _, colour in image.convert('RGB').getcolors(1000) or []}
    lost = tuple(bytes.fromhex(picture.LOST[1:]))
    assert (lost in colours) == (least == 400)
