# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The door of the library: its names, and what their docstrings say and show."""

import inspect
import re
import tomllib
from collections.abc import Callable
from importlib import import_module

import pytest
from helpers import ROOT

import lidar_outlier_filter
from lidar_outlier_filter import CloudFilter, detect_outliers
from lidar_outlier_filter.core.detectors.boosted_trees import mixed_pixels
from lidar_outlier_filter.core.detectors.plugins import BUILTIN

MODULES = [str(one.score).partition(':')[0] for one in BUILTIN.values()]
MODULES.remove(mixed_pixels.__name__)  # an example would need a sweep
FUNCTIONS = (detect_outliers, CloudFilter, *(import_module(name).detect for name in MODULES))


def test_names_of_the_door() -> None:
    """Every name is there, documented, and listed; another is refused as by any module."""
    listed = dir(lidar_outlier_filter)
    for name in lidar_outlier_filter.__all__:
        assert name in listed
        assert getattr(lidar_outlier_filter, name).__doc__
    with pytest.raises(AttributeError, match="'lidar_outlier_filter' has no attribute 'detect'"):
        getattr(lidar_outlier_filter, 'detect')  # noqa: B009  a type checker knows better


def test_examples_are_run() -> None:
    """Every file with an example in a docstring is collected by pytest."""
    settings = tomllib.loads((ROOT / 'pyproject.toml').read_text(encoding='utf-8'))
    options = settings['tool']['pytest']['ini_options']
    assert '--doctest-modules' in options['addopts']
    folders = tuple(path for path in options['testpaths'] if path != 'test')
    paths = sorted((ROOT / 'lidar_outlier_filter').rglob('*.py'))
    with_examples = [str(p.relative_to(ROOT)) for p in paths if '>>> ' in p.read_text('utf-8')]
    assert len(with_examples) >= 9
    assert [path for path in with_examples if not path.startswith(folders)] == []
    assert all((ROOT / path).exists() for path in folders)


@pytest.mark.parametrize('function', FUNCTIONS, ids=lambda function: function.__module__)
def test_docstrings(function: Callable[..., object]) -> None:
    """What users call says what it takes and gives, and shows it."""
    document = inspect.getdoc(function) or ''
    found = re.findall(r'^([A-Z][a-z ]+)\n-+$', document, re.MULTILINE)
    assert {'Parameters', 'Examples'} <= set(found)
    numpydoc = ('Parameters', 'Attributes', 'Returns', 'Raises', 'See Also', 'References')
    assert found == [name for name in (*numpydoc, 'Examples') if name in found]
    inside = function.__init__ if isinstance(function, type) else function  # type: ignore[misc]
    names = set(inspect.signature(inside).parameters) - {'self'}
    assert names == {
        name for name in names if re.search(rf'^(\w+, )*{name}\b.* : ', document, re.MULTILINE)
    }
    if function.__module__.startswith('lidar_outlier_filter.core.detectors'):
        assert 'Returns' in found
