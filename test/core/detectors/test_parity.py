# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""LOF and SOR give the results of well-known programs on real clouds.

scikit-learn is here to be asked. The counts of PCL (bun0.pcd) and PDAL (autzen-point-format-3.las)
are those that their own tests expect.
"""

from pathlib import Path

import laspy
import numpy as np
import pytest
from helpers.drives import first_cloud
from helpers.shapes import corner, scattered, sheet
from sklearn.neighbors import LocalOutlierFactor

from lidar_outlier_filter.core.annotations import Floats
from lidar_outlier_filter.core.detectors import lof, sor
from lidar_outlier_filter.core.detectors.builtin import Lof, Sor
from lidar_outlier_filter.core.neighbours.neighbourhood import Neighbourhood
from lidar_outlier_filter.core.points.points import is_return
from lidar_outlier_filter.messages.cloud import structured


def first_sweep(path: Path) -> Floats:
    """Read the returns of the first cloud of a recording."""
    rows = structured(first_cloud(path)).reshape(-1)
    xyz = np.stack([rows[axis].astype(np.float64) for axis in 'xyz'], axis=1)
    return xyz[is_return(xyz)]


def bunny(data: Path) -> Floats:
    """Read PCL's bunny, a PCD file in text form; its type is float32."""
    table = (data / 'clouds' / 'bun0.pcd').read_text().partition('DATA ascii\n')[2]
    return np.loadtxt(table.splitlines(), np.float32, usecols=(0, 1, 2)).astype(np.float64)


def autzen(data: Path) -> Floats:
    """Read PDAL's piece of Autzen."""
    xyz: Floats = np.array(laspy.read(data / 'clouds' / 'autzen-point-format-3.las').xyz)
    return xyz


def differences(xyz: Floats, k: int) -> Floats:
    """Compare LOF with that of scikit-learn, relative, for points that no tie concerns.

    Ties concern a point, those that have it among their neighbours, and those that have these: of
    several points as far as the k-th, scikit-learn takes some.
    """
    expected = -LocalOutlierFactor(n_neighbors=k).fit(xyz).negative_outlier_factor_
    neighbourhood = Neighbourhood(xyz, k)
    index, concerned = neighbourhood.nearest(k)
    for _ in range(2):
        concerned = concerned | concerned[index].any(axis=1)
    clear = neighbourhood.order[~concerned]
    factors = lof.detect(neighbourhood, Lof(min_pts=k, threshold=1.0))
    difference: Floats = factors[clear] / expected[clear] - 1
    assert len(difference) > 0.99 * len(xyz)
    return np.abs(difference)


@pytest.mark.parametrize('recording', ['vlp16_mrpt_mcap', 'os1_128_db3', 'hesai_xt32_nebula_mcap'])
def test_lof_of_sweeps(recordings: Path, recording: str) -> None:
    """scikit-learn's factors on whole sweeps; its 1e-10 is within the tolerance."""
    xyz = first_sweep(recordings / 'bags' / recording)
    assert len(xyz) > 15_000
    assert differences(xyz, 20).max() < 1e-6


@pytest.mark.parametrize('k', [1, 5, 20, 60])
def test_lof_of_small_clouds(real_data: Path, k: int) -> None:
    """scikit-learn's factors with other numbers of neighbours, in metres and in feet."""
    clouds = [make(np.random.default_rng(k)) for make in (scattered, sheet, corner)]
    for xyz in (*clouds, bunny(real_data), autzen(real_data)):
        assert differences(xyz, k).max() < 1e-6


def kept(xyz: Floats, parameters: Sor) -> int:
    """Count the points that are not rejected."""
    score = sor.detect(Neighbourhood(xyz, parameters.list_length), parameters)
    return int(np.count_nonzero(score <= 1))


def test_counts_of_pcl(real_data: Path) -> None:
    """StatisticalOutlierRemoval (50, 1.0) and RadiusOutlierRemoval (0.02, 14) on its bunny."""
    xyz = bunny(real_data)
    assert len(xyz) == 397
    assert kept(xyz, Sor(k=50, multiplier=1.0)) == 352
    assert kept(xyz, Sor(statistic='radius', radius=0.02, min_neighbors=14)) == 307


def test_counts_of_pdal(real_data: Path) -> None:
    """Statistical (mean_k, multiplier) and radius (radius, min_k) on a piece of Autzen."""
    xyz = autzen(real_data)
    assert len(xyz) == 106
    assert kept(xyz, Sor(k=2, multiplier=1.5)) == 96
    assert kept(xyz, Sor(k=5, multiplier=0.0)) == 63
    assert kept(xyz, Sor(statistic='radius', radius=200.0, min_neighbors=1)) == 60
    assert kept(xyz, Sor(statistic='radius', radius=100.0, min_neighbors=2)) == 3
