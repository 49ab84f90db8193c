# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Recordings of a moving sensor to learn from."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from helpers.moving_bags import write
from helpers.profile_scanner import Drive, seconds
from lidar_outlier_filter.evaluation.labels import ALL_BUT_0
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.tuning.training import Training, from_recording

if TYPE_CHECKING:
    from pathlib import Path

    from nav_msgs.msg import Odometry


LINES = 10 * 720  # points of a cloud


class Recorded:
    """A recorded drive of a profile scanner, labels beside it."""

    def __init__(self, folder: Path, drive: Drive) -> None:
        self.drive = drive
        self.bag = write(folder / 'drive', drive)
        self.labels = folder / 'labels'
        self.labels.mkdir()
        self.files = []
        for begin in range(0, len(drive.wrong), LINES):
            self.files.append(self.labels / f'{begin:06}.npy')
            np.save(self.files[-1], drive.wrong[begin : begin + LINES].astype(np.uint8))

    def training(self, values: dict[str, object], **options: Any) -> Training:
        """Read it."""
        options.setdefault('truth', self.files)
        parameters = FilterParameters().changed(values)
        return from_recording(self.bag, parameters, ALL_BUT_0, **options)


class WithoutFirstPoses(Drive):
    """A drive whose odometry begins 0.3 s late."""

    def odometry(self, rate: int = 100) -> list[Odometry]:
        """Leave the first poses out."""
        return [msg for msg in super().odometry(rate) if seconds(msg) > 0.295]
