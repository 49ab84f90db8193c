# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The door of the library: its names, and what their docstrings say and show."""

import inspect
import re
import tomllib
from collections.abc import Callable

import pytest
from helpers import ROOT
from helpers.detectors import BITS

import lidar_outlier_filter
from lidar_outlier_filter import CloudFilter, detect_outliers
from lidar_outlier_filter.core.detectors import (
    crop_box,
    dual_return,
    elevation,
    hierarchical,
    lof,
    ring_outlier,
    scan_shadows,
    sor,
)
from lidar_outlier_filter.core.detectors.alpha_beta_gamma import detector as alpha_beta_gamma
from lidar_outlier_filter.core.detectors.boosted_trees import methods as boosted_trees
from lidar_outlier_filter.core.detectors.quadric import detector as quadric

DETECTORS = (
    *(alpha_beta_gamma, quadric, lof, sor, hierarchical, elevation, boosted_trees),
    *(scan_shadows, ring_outlier, dual_return, crop_box),
)
FUNCTIONS = (detect_outliers, CloudFilter, *(detector.detect for detector in DETECTORS))


def test_names_of_the_door() -> None:
    """Every name is there, documented, and listed; another is refused as by any module."""
    listed = dir(lidar_outlier_filter)
    for name in lidar_outlier_filter.__all__:
        assert name in listed
        assert getattr(lidar_outlier_filter, name).__doc__
    with pytest.raises(AttributeError, match="'lidar_outlier_filter' has no attribute 'detect'"):
        getattr(lidar_outlier_filter, 'detect')  # noqa: B009  a type checker knows better


def test_bits_are_described() -> None:
    """The documentation says the bit of every detector, in the order of the bits."""
    document = ' '.join((inspect.getdoc(detect_outliers) or '').split())
    assert ', '.join(f'{bit} {name}' for name, bit in BITS.items()) in document


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
