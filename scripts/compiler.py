# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The C++ compiler of this machine; as a program, it names what brings one where there is none."""
# ruff: noqa: INP001, T201  no package; a program prints

import os
import shutil
import sysconfig


def find_compiler() -> list[str]:
    """Return the command of a C++ compiler: CXX, Python's own, or a usual one; or nothing."""
    given = os.environ.get('CXX') or sysconfig.get_config_var('CXX') or ''
    commands = (given.split(), ['c++'], ['g++'], ['clang++'])
    return next((one for one in commands if one and shutil.which(one[0])), [])


def compiler_packages() -> list[str]:
    """List the packages of PyPI that a build needs for a compiler."""
    return [] if find_compiler() else ['ziglang']


if __name__ == '__main__':
    print(*compiler_packages())
