# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""setuptools as pip calls it (PEP 517), and a C++ compiler from PyPI where the machine has none."""
# ruff: noqa: INP001, F403  no package; a backend has the functions of the one that it stands for

from collections.abc import Mapping
from typing import Any

from compiler import compiler_packages
from setuptools import build_meta
from setuptools.build_meta import *

Settings = Mapping[str, Any] | None


def get_requires_for_build_wheel(config_settings: Settings = None) -> list[str]:
    """List what a build needs beside pyproject.toml."""
    return [*build_meta.get_requires_for_build_wheel(config_settings), *compiler_packages()]


def get_requires_for_build_editable(config_settings: Settings = None) -> list[str]:
    """List the same."""
    return [*build_meta.get_requires_for_build_editable(config_settings), *compiler_packages()]
