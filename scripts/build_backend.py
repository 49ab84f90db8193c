# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""setuptools as pip calls it (PEP 517), and a C++ compiler from PyPI where the machine has none."""
# ruff: noqa: INP001, F403  no package; a backend has the functions of the one that it stands for

import os
import shutil
from collections.abc import Mapping
from typing import Any

from setuptools import build_meta
from setuptools.build_meta import *

Settings = Mapping[str, Any] | None


def _compiler() -> list[str]:
    names = (*os.environ.get('CXX', 'c++').split()[:1], 'g++', 'clang++')
    return [] if any(map(shutil.which, names)) else ['ziglang']


def get_requires_for_build_wheel(config_settings: Settings = None) -> list[str]:
    """List what a build needs beside pyproject.toml."""
    return [*build_meta.get_requires_for_build_wheel(config_settings), *_compiler()]


def get_requires_for_build_editable(config_settings: Settings = None) -> list[str]:
    """List the same."""
    return [*build_meta.get_requires_for_build_editable(config_settings), *_compiler()]
