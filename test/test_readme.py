# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The README says what is true."""

import re
from pathlib import Path

from lidar_outlier_filter.core.detectors import registry
from lidar_outlier_filter.parameters import yaml_files as parameter_files

ROOT = Path(__file__).parents[1]
README = (ROOT / 'README.md').read_text(encoding='utf-8')


def test_parameters_are_those_of_the_code() -> None:
    """The table is made by parameter_files.table()."""
    found = re.search(
        r'<!-- parameters:.*?-->\n\n(.*?)\n<!-- end of parameters -->', README, re.DOTALL
    )
    assert found is not None
    assert found.group(1) == parameter_files.table()


def test_detectors_are_those_of_the_code() -> None:
    """The table is made by registry.table()."""
    found = re.search(
        r'<!-- detectors:.*?-->\n\n(.*?)\n<!-- end of detectors -->', README, re.DOTALL
    )
    assert found is not None
    assert found.group(1) == registry.table()


def test_files_are_there() -> None:
    """Every file that the README links or names is in the project."""
    linked = re.findall(r'\]\((?!http)([^)#]+)\)', README)
    named = re.findall(r'`((?:config|scripts|doc)/[\w./]*)`', README)
    assert linked
    assert [name for name in linked + named if not (ROOT / name).exists()] == []
