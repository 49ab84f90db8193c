# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The namespaces of a launch: each process has topics of its own, or the launch is refused."""

import re
from pathlib import Path

import pytest

from lidar_outlier_filter.errors import ParameterError
from lidar_outlier_filter.ros.executable import split_files, split_namespaces


@pytest.mark.parametrize(
    ('text', 'topics', 'names'),
    [
        ('', ['/points'], ['']),
        ('left', ['/points', 'points'], ['left']),
        ('left, right', ['points', 'more/points'], ['left', 'right']),
        ('/car/left,/car/right', ['points'], ['/car/left', '/car/right']),
    ],
)
def test_accepted(text: str, topics: list[str], names: list[str]) -> None:
    """One process may have any topic; several have relative ones."""
    assert split_namespaces(text, topics) == names


@pytest.mark.parametrize('topics', [['/points'], ['points', '/more/points']])
def test_a_topic_that_all_would_share(topics: list[str]) -> None:
    """Each process would filter the same clouds."""
    sentence = 'input_topic must be without a leading slash for several namespaces, got ' + repr(
        topics[-1]
    )
    with pytest.raises(ParameterError, match=f'^{re.escape(sentence)}$'):
        split_namespaces('left,right', topics)


@pytest.mark.parametrize('text', ['left,left', 'left,/left', 'left,', ','])
def test_namespaces_that_are_not_different(text: str) -> None:
    """Two nodes of one name would receive each other's requests."""
    with pytest.raises(ParameterError, match=r'^namespace must be different names, comma-s'):
        split_namespaces(text, ['points'])


def test_a_file_for_each_namespace(tmp_path: Path) -> None:
    """One for all, or one for each; a file that does not exist is refused."""
    left, right = (tmp_path / name for name in ('left.yaml', 'right.yaml'))
    for path in (left, right):
        path.touch()
    assert split_files('params_file', '', 2) == ['', '']
    assert split_files('params_file', str(left), 2) == [str(left)] * 2
    assert split_files('params_file', f'{left}, {right}', 2) == [str(left), str(right)]
    with pytest.raises(ParameterError, match=r'^params_file must be one file, or one for each of'):
        split_files('params_file', f'{left},{right}', 3)
    with pytest.raises(ParameterError, match=r'^params_file must be a file that exists'):
        split_files('params_file', f'{left},{tmp_path}/none.yaml', 2)
