# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""3D-OutDet, a published network, on sweeps of WADS, by onnxruntime.

Raisuddin, Cortinhal, Holmblad and Aksoy (2024); the file is `src/outdet/saved_models/outdet.onnx`
of the repository roadview-project/TensorRT_OutDet. It was trained on WADS. As in its own code,
it sees nine neighbours, the point itself among them, and 1 is added to their distances, metres.
It is given all points of a form, copies too, as it was in its training.
"""

# ruff: noqa: INP001  a part of a script, no package

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np
from real_snow_forms import Verdict
from scipy.spatial import cKDTree

from lidar_outlier_filter.errors import RecordingError

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from real_snow_forms import Cloud
    from real_snow_sweeps import Mask

NEIGHBOURS = 9
AWAY = 1.0  # metres
# Of x, y, z and intensity in its training, from its own code
MEAN = np.array([0.3420934, -0.01516175, -0.5889243, 9.875928])
DEVIATION = np.array([25.845459, 18.93466, 1.5863657, 14.734034])


def load(path: Path) -> Any:
    """Load the network.

    Raises
    ------
    RecordingError
        If onnxruntime is not installed, or the file is no network.

    """
    if find_spec('onnxruntime') is None:
        raise RecordingError('the package onnxruntime', 'installed for --outdet', 'no such package')
    onnxruntime = import_module('onnxruntime')
    try:
        return onnxruntime.InferenceSession(path.read_bytes(), providers=['CPUExecutionProvider'])
    except Exception as err:  # its errors have no common class
        raise RecordingError(str(path), 'a network in an ONNX file', err) from err


def judge(clouds: Sequence[Cloud], network: Any) -> Verdict:
    """Judge each cloud alone."""
    begin = perf_counter()
    rejected = [_judge(one, network) for one in clouds]
    return Verdict(rejected, perf_counter() - begin, '')


def _judge(cloud: Cloud, network: Any) -> Mask:
    """Return which points it takes for snow."""
    given = np.column_stack([cloud.xyz, cloud.intensity]).astype(np.float64)
    distance, index = cKDTree(given[:, :3]).query(given[:, :3], NEIGHBOURS, workers=-1)
    answer = network.run(
        None,
        {
            'points': ((given - MEAN) / DEVIATION).astype(np.float32),
            'dist': (distance + AWAY).astype(np.float32),
            'indices': index.astype(np.int64),
        },
    )[0]
    found: Mask = answer[:, 1] > answer[:, 0]
    return found
