# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Clouds and files of any kind, drawn at random: processed in full, or refused in one sentence.

The numbers are small here.
"""

from pathlib import Path
from typing import Any

import pytest
from helpers import hostile
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from lidar_outlier_filter.files import cloud_file

FEW = settings(
    max_examples=60, deadline=None, database=None, suppress_health_check=list(HealthCheck)
)


@FEW
@given(hostile.legal_clouds())
def test_legal_clouds(cloud: Any) -> None:
    """Every point of a legal cloud comes out once, unless what its bytes say is impossible."""
    hostile.judge(cloud)


@FEW
@given(hostile.broken_clouds())
def test_broken_clouds(cloud: Any) -> None:
    """An inconsistent cloud is refused, or the points that it has are filtered."""
    hostile.judge(cloud)


def test_every_format_is_among_them() -> None:
    """Each module that reads files has one here that is broken, and one for a full disk."""
    modules = {reader for reader, *_ in cloud_file.FORMATS.values()}
    here = {cloud_file.FORMATS[f'.{kind.split(maxsplit=1)[0]}'][0] for kind in hostile.FORMATS}
    assert here == modules


@pytest.mark.parametrize('kind', hostile.FORMATS)
def test_whole_files(tmp_path: Path, kind: str) -> None:
    """The files that are broken below are right."""
    path = tmp_path / f'cloud.{kind.split(maxsplit=1)[0]}'
    hostile.whole_file(kind, path)
    assert hostile.read_and_copy(path, tmp_path / f'copy{path.suffix}')


@pytest.mark.parametrize('kind', hostile.FORMATS)
def test_broken_files(tmp_path: Path, kind: str) -> None:
    """A broken file is refused in one sentence, or read and copied, soon."""
    path = tmp_path / f'cloud.{kind.split(maxsplit=1)[0]}'
    hostile.whole_file(kind, path)
    data = path.read_bytes()

    @settings(FEW, max_examples=25)
    @given(st.integers(0, 2**32 - 1))
    @example(0)
    def check(seed: int) -> None:
        path.write_bytes(hostile.broken(data, seed))
        hostile.read_and_copy(path, tmp_path / f'copy{path.suffix}')

    check()
