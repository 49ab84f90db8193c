# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Recordings that lie: about their messages, their index and their size when they are unpacked."""

from __future__ import annotations

import shutil
from typing import TYPE_CHECKING

import pytest

from lidar_outlier_filter.cli.main import main
from lidar_outlier_filter.errors import RecordingError
from lidar_outlier_filter.recordings.bags import Recording

if TYPE_CHECKING:
    from pathlib import Path


@pytest.fixture
def drive(recordings: Path, tmp_path: Path) -> Path:
    """Copy a real recording to where it may be changed."""
    return shutil.copytree(
        recordings / 'bags' / 'vlp16_mrpt_mcap', tmp_path / 'drive', copy_function=shutil.copyfile
    )


def read_all(path: Path) -> int:
    """Read a recording to its end."""
    with Recording(path) as recording:
        return sum(1 for _ in recording.messages())


@pytest.mark.parametrize(
    ('old', 'new'),
    [
        ('message_count: 4', 'message_count: many'),
        ('message_count: 4', 'message_count: -4'),
        ('message_count: 4', 'message_count: [4]'),
        ('message_count: 4', 'message_count: &a [*a]'),
        ('message_count: 4', 'message_count: 4.5'),
        ('nanoseconds: ', 'nanoseconds: x'),
        ('version: ', 'version: x'),
        ('relative_file_paths:', 'relative_file_paths: 5\n  more:'),
        ('storage_identifier: mcap', 'storage_identifier: []'),
        ('name: ', 'name: []\n        other: '),
        ('type: ', 'type: 5\n        other: '),
        ('rosbag2_bagfile_information:', 'rosbag2_bagfile_information:\n  custom_data: [1]'),
        ('rosbag2_bagfile_information:', 'rosbag2_bagfile_information:\n  custom_data: {a: 1}'),
        ('rosbag2_bagfile_information:', 'other:'),
    ],
)
def test_metadata(
    drive: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], old: str, new: str
) -> None:
    """Metadata that cannot be true are refused in one sentence, and nothing is written."""
    path = drive / 'metadata.yaml'
    text = path.read_text()
    assert old in text
    path.write_text(text.replace('  custom_data: null\n', '').replace(old, new))
    assert main(['replay', str(drive)]) == 1
    said = capsys.readouterr().err
    assert said.count('\n') == 1
    assert ' must be ' in said
    assert 'Traceback' not in said
    assert [item.name for item in tmp_path.iterdir()] == ['drive']
    with pytest.raises(RecordingError):
        read_all(drive)
