# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Table 1 and figure 2 of Sotoodeh (2007) from simulated clouds like the paper's.

python benchmarks/hod_scene.py [PICTURE.png]
"""

# ruff: noqa: INP001  a script, no package

from __future__ import annotations

import sys
from pathlib import Path

from rich.console import Console

from lidar_outlier_filter.core.detectors.hierarchical.parameters import Hierarchical
from lidar_outlier_lab.results import sotoodeh_picture as hod_picture
from lidar_outlier_lab.simulation.papers import sotoodeh_clusters as hod_scene

SEEDS = range(20)

if __name__ == '__main__':
    Console().print(hod_scene.table(SEEDS, Hierarchical()))
    if len(sys.argv) > 1:
        hod_picture.draw(hod_scene.simulate(SEEDS[0]), Hierarchical(), Path(sys.argv[1]))
