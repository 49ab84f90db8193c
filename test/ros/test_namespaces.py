# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The namespaces of a launch: each process has topics of its own, or the launch is refused."""

import re
from pathlib import Path

import pytest

from lidar_outlier_filter.errors import ParameterError
from lidar_outlier_filter.ros.executable import split_files, split_namespaces, whole_number

RELATIVE = 'input_topic must be without a leading slash for several namespaces, got '
DIFFERENT = 'namespace must be different names, comma-s'


@pytest.mark.parametrize(
    ('text', 'topics', 'found'),
    [
        ('', ['/points'], ['']),
        ('left', ['/points', 'points'], ['left']),
        ('left, right', ['points', 'more/points'], ['left', 'right']),
        ('/car/left,/car/right', ['points'], ['/car/left', '/car/right']),
        # Each process would filter the same clouds.
        ('left,right', ['/points'], f"{RELATIVE}'/points'"),
        ('left,right', ['points', '/more/points'], f"{RELATIVE}'/more/points'"),
        # Two nodes of one name would receive each other's requests.
        *((text, ['points'], DIFFERENT) for text in ('left,left', 'left,/left', 'left,', ',')),
    ],
)
def test_namespaces(text: str, topics: list[str], found: list[str] | str) -> None:
    """One process may have any topic; several have relative ones, and different names."""
    if isinstance(found, list):
        assert split_namespaces(text, topics) == found
    else:
        with pytest.raises(ParameterError, match=f'^{re.escape(found)}'):
            split_namespaces(text, topics)


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


@pytest.mark.parametrize('text', ['abc', '0', '-1', '1.5', '²'])
def test_depths_are_whole_numbers(text: str) -> None:
    """Others are refused by the name of the argument."""
    assert whole_number('input_depth', '10') == 10
    sentence = f'input_depth must be a whole number above 0, got {text!r}'
    with pytest.raises(ParameterError, match=re.escape(sentence)):
        whole_number('input_depth', text)
