# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters as text that lie in wait: no alias, no depth and no length costs time or memory."""

from __future__ import annotations

from time import process_time
from typing import TYPE_CHECKING

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from lidar_outlier_filter.cli.terminal import read_parameters
from lidar_outlier_filter.errors import ParameterError
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.parameters.yaml_files import LARGEST_FILE, parse, read_yaml

if TYPE_CHECKING:
    from pathlib import Path

SOON = 2.0  # seconds
HEAD = '/**:\n  ros__parameters:\n'
BOMB = 'a: &a [x, x]\n' + ''.join(
    f'{name}: &{name} [*{before}, *{before}]\n'
    for before, name in zip('abcdefghijklmnopqrstuvwxy', 'bcdefghijklmnopqrstuvwxyz', strict=True)
)
HOSTILE = {
    'a list of itself': f'{HEAD}    chain: &a [*a]\n',
    'alias bomb': BOMB + f'{HEAD}    chain: *z\n',
    'deep brackets': f'{HEAD}    chain: ' + '[' * 5000 + ']' * 5000,
    'deep lines': ''.join(' ' * i + 'a:\n' for i in range(1000)),
    'digits': f'{HEAD}    sor:\n      k: ' + '9' * 5000,
    'no text': '\0',
    'tag': '!!python/object/apply:os.getcwd []',
    'a list as key': '[1]: 2',
    'long': '#' * (LARGEST_FILE + 1),
}


@pytest.mark.parametrize('name', HOSTILE)
def test_hostile_files(tmp_path: Path, name: str) -> None:
    """A parameter file of any kind is refused in one sentence, soon."""
    path = tmp_path / 'parameters.yaml'
    path.write_text(HOSTILE[name])
    begin = process_time()
    with pytest.raises(ParameterError) as caught:
        read_yaml(path)
    assert process_time() - begin < SOON
    assert str(caught.value).startswith(f'{path} must be ')
    assert '\n' not in str(caught.value)
    assert len(str(caught.value)) < 1000


def test_unreadable_files(tmp_path: Path) -> None:
    """A file that is missing, a folder, and bytes that are no text are refused in one line."""
    binary = tmp_path / 'binary.yaml'
    binary.write_bytes(b'\xff\xfe\x00')
    for path in (tmp_path / 'none.yaml', tmp_path, binary):
        with pytest.raises(ParameterError, match='must be a readable YAML file, got ') as caught:
            read_yaml(path)
        assert '\n' not in str(caught.value)


@pytest.mark.parametrize('name', sorted(set(HOSTILE) - {'long', 'deep lines'}))
def test_hostile_values(name: str) -> None:
    """So is the same text as a value of --set."""
    with pytest.raises(ParameterError) as caught:
        FilterParameters().changed(read_parameters([], [f'sor.k={HOSTILE[name]}']))
    assert str(caught.value).startswith(('the value of sor.k must be YAML', 'sor.k must be '))


@pytest.mark.parametrize('value', ['[' + 'x, ' * 4000 + ']', 'x' * 900_000])
def test_long_values_are_shown_short(value: str) -> None:
    """The sentence is one to read, however long the value is."""
    for name in ('chain', 'sor.k', 'load.policy'):
        with pytest.raises(ParameterError) as caught:
            FilterParameters().changed({name: parse(value)})
        assert len(str(caught.value)) < 1000


@pytest.mark.parametrize(
    ('text', 'value'),
    [
        ('1:30', '1:30'),
        ('010', '010'),
        ('1_000', '1_000'),
        ('2001-01-01', '2001-01-01'),
        ('10', 10),
        ('+10', 10),
        ('0x1F', 31),
        ('1e-6', 1e-6),
        ('1.', 1.0),
        ('.5', 0.5),
        ('-1.5E+3', -1500.0),
        ('.inf', float('inf')),
        ('true', True),
        ('[1, 1.0, a]', [1, 1.0, 'a']),
    ],
)
def test_numbers_as_people_write_them(text: str, value: object) -> None:
    """What people do not read as a number is a text, which no number may be."""
    found = parse(text)
    assert found == value
    assert type(found) is type(value)


@pytest.mark.parametrize('text', ['a\0b', '\ud800', 'a/\udcff'])
def test_texts_that_ros_cannot_hold(text: str) -> None:
    """A text with NUL ends there for ROS, and half a character cannot be sent at all."""
    for name, value in (('save_to', text), ('time_field', text), ('inputs', (text,))):
        with pytest.raises(ParameterError) as caught:
            FilterParameters().changed({name: value})
        assert str(caught.value).startswith(f'{name} must be ')
        assert 'Unicode' in str(caught.value)
        assert str(caught.value).isprintable()


@given(st.floats(allow_nan=False))
def test_numbers(number: float) -> None:
    """Every number that Python or YAML writes is read as it is."""
    written = str(number).replace('inf', '.inf')
    assert parse(written) == number
    assert parse(yaml.safe_dump(number)) == number


@given(st.text(max_size=60))
def test_any_text(text: str) -> None:
    """Whatever the text is, it is a value or no YAML."""
    try:
        parse(text)
    except yaml.YAMLError:
        return
