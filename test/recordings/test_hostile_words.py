# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What a user reads of a damaged file speaks of the file, not of the program that read it."""

from __future__ import annotations

import pickle
import re
import struct
from pathlib import Path

import pytest
from helpers.clouds import cloud, table

from lidar_outlier_filter.cli.terminal import say
from lidar_outlier_filter.errors import CloudError, JudgingError, RecordingError, said_by
from lidar_outlier_filter.files.cloud_file import readable
from lidar_outlier_filter.messages.decoder import Decoder
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.recordings.bags import _readable
from lidar_outlier_filter.recordings.salvage import Losses

OWN = '"bytes that its format does not allow"'


@pytest.mark.parametrize(
    ('error', 'said'),
    [
        (IndexError('list index out of range'), OWN),
        (struct.error('unpack requires a buffer of 8 bytes'), OWN),
        (UnicodeDecodeError('utf-8', b'\xff', 0, 1, 'invalid start byte'), OWN),
        (AssertionError(), OWN),
        (ValueError(''), OWN),
        (ValueError('a sentence\non two lines'), '"a sentence on two lines"'),
        (ValueError('a \x1b[2J or a \x07'), r'"a \\x1b\[2J or a \\x07"'),
        (PermissionError(13, 'Permission denied', 'x'), '"Permission denied"'),
    ],
)
def test_said_by(error: Exception, said: str) -> None:
    """Sentences of libraries on a file are quoted, others are replaced."""
    assert re.fullmatch(said, said_by(error))
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


@pytest.mark.parametrize('name', ['z\n', '\x1b[2J', 'z\r', 'z\x9b', 'z\u2028', '\u202e', '\udcff'])
def test_names_that_a_terminal_obeys(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    """A name from a cloud or a recording stays on its line, and is read as it is."""
    escaped = name.encode('unicode_escape').decode()
    msg = cloud(table(3))
    msg.fields[2].name = name
    with pytest.raises(CloudError) as refused:
        Decoder(FilterParameters()).decode(msg)
    assert escaped in str(refused.value)
    assert str(refused.value).isprintable()
    assert CloudError(name, 'another', 'it').what == escaped
    losses = Losses()
    losses.add(f'the topic /{name} has no schema')
    assert losses.reasons[0].isprintable()
    say(f'no point of /{name} could be tested')
    assert capsys.readouterr().err.removesuffix('\n').isprintable()


def test_an_error_of_another_process() -> None:
    """It comes with its kind, its sentence, and what else is known of it."""
    damage = RecordingError('the bag', 'whole', 'half of it')
    damage.is_damage = True
    for error in (damage, CloudError('a', 'b', '\n'), JudgingError(ValueError('no'))):
        again = pickle.loads(pickle.dumps(error))  # noqa: S301  our own bytes
        assert (type(again), str(again)) == (type(error), str(error))
        assert vars(again) == vars(error)
