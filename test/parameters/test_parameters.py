# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters: one place for all, refused in one sentence, and written to and read from files."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from helpers import ROOT

from lidar_outlier_filter.core.detectors.builtin import AlphaBetaGamma
from lidar_outlier_filter.errors import ParameterError
from lidar_outlier_filter.parameters.filter import FilterParameters, describe
from lidar_outlier_filter.parameters.yaml_files import NODE_NAME, read_yaml, table, write_yaml
from lidar_outlier_lab.results.papers.methods import CLASSIC, METHODS, SMOOTHER

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from lidar_outlier_filter.parameters.declaration import Parameter

CONFIG = ROOT / 'config'
FILES = sorted(CONFIG.rglob('*.yaml'))
DEFAULT = FilterParameters()
EACH = pytest.mark.parametrize('parameter', describe(), ids=lambda parameter: parameter.name)


# Each by itself ---------------------------------------------------------------------------------


@EACH
def test_every_parameter_is_described(parameter: Parameter) -> None:
    """A parameter has a sentence and a range, and is in the table and in the file."""
    assert re.fullmatch(r'[A-Z\x27a-z0-9].*\.', parameter.text)
    # This reads as if something were cut off behind the name of a choice.
    assert not parameter.text.endswith(tuple(f', else {choice}.' for choice in parameter.choices))
    assert parameter.range_text
    assert parameter.check(parameter.default) == parameter.default
    assert type(parameter.default) in {bool, int, float, str, tuple}
    if isinstance(parameter.default, int | float) and not isinstance(parameter.default, bool):
        assert parameter.low is not None
        assert parameter.high is not None
    row = next(row for row in table().splitlines() if row.startswith(f'| `{parameter.name}`'))
    assert parameter.range_text in row
    assert parameter.text in row
    assert parameter.text in write_yaml()
    assert DEFAULT.flat()[parameter.name] == parameter.default


def test_names() -> None:
    """Names are flat or detector.name, each once, and the table and flat() have no others."""
    names = [parameter.name for parameter in describe()]
    assert len(set(names)) == len(names)
    assert all(re.fullmatch(r'([a-z_]+\.)?[a-z_]+', name) for name in names)
    assert list(DEFAULT.flat()) == names
    assert [row.split('`')[1] for row in table().splitlines()[2:]] == names
    for name in ('time_field', 'gap_factor', 'block', 'halo', 'max_delay', 'scores', 'chain'):
        assert name in names
    assert 'alpha_beta_gamma.before' in names


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
    ({'time_field': 5}, 'time_field must be a text, got 5'),
    ({'time_unit': 'ms'}, "time_unit must be one of 'auto', 's', 'us', 'ns', got 'ms'"),
    ({'chain': 3}, 'chain must be a list of texts, got 3'),
    ({'chain': []}, 'chain must be a list, without repetition, of one of '),
    ({'chain': ['alpha_beta_gamma'] * 2}, "got ['alpha_beta_gamma', 'alpha_beta_gamma']"),
    ({'chain': [['alpha_beta_gamma']]}, "got [['alpha_beta_gamma']]"),
    ({'gap': 2.0}, 'a parameter must be one of alpha_beta_gamma.after, '),
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


def test_files_of_families() -> None:
    """There is a file for each sensor family, and none that only repeats defaults."""
    families = ('velodyne', 'ouster', 'hesai', 'robosense', 'livox', 'autoware', 'profile_scanner')
    for family in families:
        values = read_yaml(CONFIG / f'{family}.yaml')
        assert DEFAULT.changed(values) != DEFAULT
        assert len(values) < 8


@pytest.mark.parametrize(('name', 'values'), [('leslar2010', SMOOTHER), ('classic', CLASSIC)])
def test_file_of_a_measured_chain(name: str, values: dict[str, object]) -> None:
    """The files beside those of the sensors have the settings that tables are made with."""
    assert read_yaml(CONFIG / f'{name}.yaml') == values


@pytest.mark.parametrize('name', METHODS)
def test_files_of_the_papers(name: str) -> None:
    """The file of each paper's method has the settings that its tables are made with."""
    values = read_yaml(CONFIG / 'papers' / f'{name}.yaml')
    assert values == METHODS[name]
    assert DEFAULT.changed(values).chain == tuple(METHODS[name]['chain'])  # type: ignore[arg-type]


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
