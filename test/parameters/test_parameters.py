# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters: one place for all, refused in one sentence, and written to and read from files.

No alias, no depth and no length of their texts costs time or memory.
"""

import re
from collections.abc import Mapping
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np
import pytest
import yaml
from helpers import ROOT
from hypothesis import given
from hypothesis import strategies as st

from lidar_outlier_filter.core.detectors.builtin import AlphaBetaGamma
from lidar_outlier_filter.errors import ParameterError
from lidar_outlier_filter.parameters.declaration import Parameter
from lidar_outlier_filter.parameters.filter import FilterParameters, describe
from lidar_outlier_filter.parameters.yaml_files import (
    MAX_YAML_BYTES,
    NODE_NAME,
    parse,
    read_yaml,
    write_yaml,
)
from lidar_outlier_lab.results.papers.methods import CLASSIC, METHODS, SMOOTHER, VEGETATION

CONFIG = ROOT / 'config'
FILES = sorted(CONFIG.rglob('*.yaml'))
DEFAULT = FilterParameters()
EACH = pytest.mark.parametrize('parameter', describe(), ids=lambda parameter: parameter.name)


# Each by itself ---------------------------------------------------------------------------------


@EACH
def test_every_parameter_is_described(parameter: Parameter) -> None:
    """A parameter has a sentence and a range, and is in the file."""
    assert re.fullmatch(r'[A-Z\x27a-z0-9].*\.', parameter.text)
    # This reads as if something were cut off behind the name of a choice.
    assert not parameter.text.endswith(tuple(f', else {choice}.' for choice in parameter.choices))
    assert parameter.range_text
    assert parameter.check(parameter.default) == parameter.default
    assert type(parameter.default) in {bool, int, float, str, tuple}
    if isinstance(parameter.default, int | float) and not isinstance(parameter.default, bool):
        assert parameter.low is not None
        assert parameter.high is not None
    assert parameter.text in write_yaml()
    assert DEFAULT.flat()[parameter.name] == parameter.default
    assert re.fullmatch(r'([a-z_]+\.)?[a-z_]+', parameter.name)


@EACH
def test_other_types_are_refused(parameter: Parameter) -> None:
    """A value of another type is refused; only a whole number serves for a number."""
    odd: list[Any] = [None, True, 3, 0.5, 'some text', b'bytes', {'a': 1}, [1], ['some text']]
    fit = {float: (int, float), tuple: (list,)}.get(
        type(parameter.default), (type(parameter.default),)
    )
    for value in odd:
        if type(value) not in fit:
            with pytest.raises(ParameterError, match=f'^{re.escape(parameter.name)} must be '):
                DEFAULT.changed({parameter.name: value})


@pytest.mark.parametrize(
    ('name', 'low', 'high', 'kind'),
    [(p.name, p.low, p.high, type(p.default)) for p in describe() if p.low is not None],
)
def test_range(name: str, low: float, high: float, kind: type) -> None:
    """The ends of the range are in it, and what is beyond, infinite or NaN is not."""
    parameter = next(parameter for parameter in describe() if parameter.name == name)
    assert parameter.check(kind(low)) == low
    assert parameter.check(kind(high)) == high
    beyond: list[Any] = [10**400, -(10**400)]
    if kind is int:
        beyond += [int(low) - 1, int(high) + 1]
    else:
        beyond += [np.nextafter(low, -np.inf).item(), np.nextafter(high, np.inf).item()]
        beyond += [float('inf'), float('-inf'), float('nan')]
    for value in beyond:
        with pytest.raises(ParameterError, match=f'^{re.escape(name)} must be ') as refusal:
            DEFAULT.changed({name: value})
        assert str(refusal.value).endswith(f'got {value!r}')


SENTENCES: list[tuple[Mapping[str, object], str]] = [
    ({'block': 0}, 'block must be from 0.001 to 60 s, got 0.0'),
    ({'time_field': 5}, 'time_field must be a string, got 5'),
    ({'time_unit': 'min'}, "time_unit must be one of 'auto', 's', 'ms', 'us', 'ns', got 'min'"),
    ({'chain': 3}, 'chain must be a list of strings, got 3'),
    ({'chain': []}, 'chain must be a list, without repetition, of one of '),
    ({'chain': ['alpha_beta_gamma'] * 2}, "got ['alpha_beta_gamma', 'alpha_beta_gamma']"),
    ({'chain': [['alpha_beta_gamma']]}, "got [['alpha_beta_gamma']]"),
    ({'sensor': 'free'}, "a known one, got 'sensor' (did you mean 'boosted_trees.sensor'?)"),
    (
        {'lof.treshold': 2.0},
        "a parameter must be a known one, got 'lof.treshold' (did you mean 'lof.threshold'?)",
    ),
    (
        {'chain': ['Lof', 'elevation', 'quadrik']},
        "got ['Lof', 'elevation', 'quadrik'] (did you mean 'lof', 'quadric'?)",
    ),
    ({'time_unit': 'nss'}, "got 'nss' (did you mean 'ns'?)"),
    ({'alpha_beta_gamma': 2.0}, ", got 'alpha_beta_gamma'"),
    (
        {'alpha_beta_gamma.before': 2, 'alpha_beta_gamma.after': 0},
        'alpha_beta_gamma.before and after must be together at least order + 2 = 3, got 2 and 0',
    ),
    (
        {'alpha_beta_gamma.order': 2},
        'must be one of them at least order + 2 = 4, with sides: either, got 3 and 3',
    ),
    ({'max_delay': 0.5, 'block': 0.5}, 'max_delay must be at least block + halo + lateness = '),
    ({'time_jump': 0.1, 'lateness': 0.2}, 'time_jump must be at least lateness = 0.2 s, got 0.1 s'),
    ({'points_per_second': 0.5}, 'points_per_second must be 0 or at least 1, got 0.5'),
]


@pytest.mark.parametrize(('values', 'sentence'), SENTENCES, ids=[text for _, text in SENTENCES])
def test_refusals(values: Mapping[str, object], sentence: str) -> None:
    """What makes no sense, alone or with others, is refused in one sentence."""
    with pytest.raises(ParameterError, match=re.escape(sentence)):
        DEFAULT.changed(values)
    assert FilterParameters() == DEFAULT


# Together ---------------------------------------------------------------------------------------


def test_changed() -> None:
    """A changed copy has the new values and all the others; the original has not."""
    values = {
        'block': 2,
        'max_delay': 3.0,
        'alpha_beta_gamma.passes': 3,
        'chain': ['alpha_beta_gamma'],
    }
    changed = DEFAULT.changed(values)
    assert (changed.block, changed.max_delay, changed.of(AlphaBetaGamma).passes) == (2.0, 3.0, 3)
    assert type(changed.block) is float
    assert changed.chain == ('alpha_beta_gamma',)
    names = {name for name, value in changed.flat().items() if value != DEFAULT.flat()[name]}
    assert names == {'block', 'max_delay', 'alpha_beta_gamma.passes', 'chain'}
    assert FilterParameters() == DEFAULT
    assert changed.changed(DEFAULT.flat()) == DEFAULT
    assert DEFAULT.changed({}) == DEFAULT


def test_all_or_nothing() -> None:
    """One wrong value refuses all; values that are right together only are taken together."""
    with pytest.raises(ParameterError, match=r'^gap_factor must be'):
        DEFAULT.changed({'halo': 0.02, 'gap_factor': -1.0})
    with pytest.raises(ParameterError, match=r'^max_delay must be at least'):
        DEFAULT.changed({'block': 5.0})
    with pytest.raises(ParameterError, match=r'^block must be from'):
        FilterParameters(block=-1.0)
    assert DEFAULT.changed({'block': 5.0, 'max_delay': 6.0}).block == 5


# Files ------------------------------------------------------------------------------------------


def read(path: Path, text: str) -> dict[str, object]:
    """Write a file and read it."""
    file = path / 'parameters.yaml'
    file.write_text(text, encoding='utf-8')
    return read_yaml(file)


def test_defaults_file() -> None:
    """The file of the defaults is the one that is written; write_yaml() makes it anew."""
    assert (CONFIG / 'defaults.yaml').read_text(encoding='utf-8') == write_yaml()
    assert DEFAULT.changed(read_yaml(CONFIG / 'defaults.yaml')) == DEFAULT


@pytest.mark.parametrize('file', FILES, ids=lambda file: file.stem)
def test_files(file: Path) -> None:
    """Every file of the folder is accepted, and says of itself and its settings why."""
    values = read_yaml(file)
    assert values
    DEFAULT.changed(values)
    lines = file.read_text(encoding='utf-8').splitlines()
    reasons = [line for line in lines if line.lstrip().startswith('# ')]
    assert len(reasons) >= 2


@pytest.mark.parametrize(
    ('name', 'values'),
    [
        ('leslar2010', SMOOTHER),
        ('classic', CLASSIC),
        ('classic_vegetation', VEGETATION),
        *((f'papers/{name}', values) for name, values in METHODS.items()),
    ],
)
def test_files_of_measured_chains(name: str, values: dict[str, object]) -> None:
    """The files of chains and of the papers have the settings that tables are made with."""
    assert read_yaml(CONFIG / f'{name}.yaml') == values


def test_round_trip(tmp_path: Path) -> None:
    """All values, written and read, are what they were."""
    values = {
        'time_field': "it's: a #field",
        'line_field': 'on',
        'angle_field': '007',
        'gap_factor': 1e6,
        'points_per_second': 1e9,
        'halo': 1e-7,
        'max_points': 2_000_000_000,
        'scores': True,
        'alpha_beta_gamma.significance': 1e-15,
        'alpha_beta_gamma.sigma_floor': 1e-6,
        'alpha_beta_gamma.sides': 'both',
    }
    changed = DEFAULT.changed(values)
    again = DEFAULT.changed(read(tmp_path, write_yaml(changed.flat())))
    assert again == changed
    assert read(tmp_path, write_yaml()) == {
        name: list(value) if isinstance(value, tuple) else value
        for name, value in DEFAULT.flat().items()
    }


def test_sections(tmp_path: Path) -> None:
    """Sections of the wildcards and of this node in any namespace are read; the later one wins."""
    text = f"""
/**:
  ros__parameters: {{gap_factor: 1.0, halo: 0.0, block: 0.5}}
other_node:
  ros__parameters: {{gap_factor: 99.0, unknown: 1}}
{NODE_NAME}_2:
  ros__parameters: {{gap_factor: 98.0}}
{NODE_NAME}:
  ros__parameters:
    gap_factor: 2.0
    alpha_beta_gamma.before: 7
/vehicle/front:
  {NODE_NAME}:
    ros__parameters:
      halo: 0.01
  other_node:
    ros__parameters: {{halo: 97.0}}
/vehicle/{NODE_NAME}:
  ros__parameters:
    alpha_beta_gamma:
      after: 8
    qos_overrides./points.depth: 7
"""
    assert read(tmp_path, text) == {
        'gap_factor': 2.0,
        'halo': 0.01,
        'block': 0.5,
        'alpha_beta_gamma.before': 7,
        'alpha_beta_gamma.after': 8,
        'qos_overrides./points.depth': 7,
    }


@pytest.mark.parametrize('name', ['/**', '*', '/*', '/**/' + NODE_NAME, '/' + NODE_NAME, NODE_NAME])
def test_names_of_sections(tmp_path: Path, name: str) -> None:
    """Each form in which ROS names this node is understood."""
    text = f'"{name}":\n  ros__parameters:\n    block: 0.5\n'
    assert read(tmp_path, text) == {'block': 0.5}


@pytest.mark.parametrize(
    'text',
    [
        '',
        '- a list',
        'ros__parameters:\n  block: 0.5\n',
        'other_node:\n  ros__parameters:\n    block: 0.5\n',
        '/**:\n  ros__parameters: 5\n',
    ],
)
def test_no_section(tmp_path: Path, text: str) -> None:
    """A file without parameters for this node is refused."""
    sentence = f"must be a ROS parameter file with 'ros__parameters' for '{NODE_NAME}' or '/**'"
    with pytest.raises(ParameterError, match=re.escape(sentence)):
        read(tmp_path, text)


# Text that lies in wait ---------------------------------------------------------------------------

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
    'tag': '!!python/object/apply:os.mkdir [made]',
    'a list as key': '[1]: 2',
    'long': '#' * (MAX_YAML_BYTES + 1),
}


@pytest.mark.parametrize('name', HOSTILE)
def test_hostile_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    """A parameter file of any kind is refused in one sentence, soon; nothing of it is run."""
    monkeypatch.chdir(tmp_path)
    path = tmp_path / 'parameters.yaml'
    path.write_text(HOSTILE[name])
    begin = process_time()
    with pytest.raises(ParameterError) as caught:
        read_yaml(path)
    assert process_time() - begin < SOON
    assert str(caught.value).startswith(f'{path} must be ')
    assert '\n' not in str(caught.value)
    assert len(str(caught.value)) < 1000
    assert [*tmp_path.iterdir()] == [path]


def test_unreadable_files(tmp_path: Path) -> None:
    """A file that is missing, a folder, and bytes that are no text are refused in one line."""
    binary = tmp_path / 'binary.yaml'
    binary.write_bytes(b'\xff\xfe\x00')
    for path in (tmp_path / 'none.yaml', tmp_path, binary):
        with pytest.raises(ParameterError, match='must be a readable YAML file, got ') as caught:
            read_yaml(path)
        assert '\n' not in str(caught.value)


@pytest.mark.parametrize('value', ['[' + 'x, ' * 4000 + ']', 'x' * 900_000])
def test_long_values_are_shown_short(value: str) -> None:
    """The sentence is one to read, however long the value is."""
    parsed = parse(value)
    for name in ('chain', 'sor.k', 'load.policy'):
        with pytest.raises(ParameterError) as caught:
            FilterParameters().changed({name: parsed})
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


@given(st.text(max_size=60))
def test_any_text(text: str) -> None:
    """Whatever the text is, it is a value or no YAML."""
    try:
        parse(text)
    except yaml.YAMLError:
        return
