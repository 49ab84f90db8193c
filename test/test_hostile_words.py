# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What a user reads of a damaged file speaks of the file, not of the program that read it."""

from __future__ import annotations

import struct
from pathlib import Path

import pytest

from lidar_outlier_filter.errors import CloudError, RecordingError, said_by
from lidar_outlier_filter.files.cloud_file import readable
from lidar_outlier_filter.recordings.bags import _readable

OWN = '"bytes that its format does not allow"'


@pytest.mark.parametrize(
    ('error', 'said'),
    [
        (IndexError('list index out of range'), OWN),
        (KeyError('bogus'), OWN),
        (ZeroDivisionError('integer division or modulo by zero'), OWN),
        (TypeError('ord() expected a character, but string of length 0 found'), OWN),
        (struct.error('unpack requires a buffer of 8 bytes'), OWN),
        (UnicodeDecodeError('utf-8', b'\xff', 0, 1, 'invalid start byte'), OWN),
        (RecursionError('maximum recursion depth exceeded'), OWN),
        (AssertionError(), OWN),
        (ValueError(''), OWN),
        (ValueError('a sentence\non two lines'), '"a sentence on two lines"'),
        (PermissionError(13, 'Permission denied', 'x'), '"Permission denied"'),
    ],
)
def test_said_by(error: Exception, said: str) -> None:
    """Sentences of libraries on a file are quoted, others are replaced."""
    assert said_by(error) == said
    with (
        pytest.raises(CloudError, match=f'^the file x must be readable, got {said}$'),
        readable(Path('x')),
    ):
        raise error
    with (
        pytest.raises(RecordingError, match=f'must be readable, got {said}$'),
        _readable(Path('x')),
    ):
        raise error
