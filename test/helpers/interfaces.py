# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The package point_cloud_interfaces for rclpy, which PyPI lacks: made by the generators of ROS."""

import os
import shutil
import subprocess
import sysconfig
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from helpers.compressed import DEFINITION

PACKAGE = 'point_cloud_interfaces'
TYPE_SUPPORTS = ('rosidl_typesupport_fastrtps_c', 'rosidl_typesupport_introspection_c')
KINDS = ('c', 'fastrtps_c', 'introspection_c')
WITHIN = ('sensor_msgs', 'std_msgs', 'builtin_interfaces')  # messages that the message has


def build(folder: Path) -> None:
    """Generate and compile the package into a folder, unless it is installed; needs gcc."""
    if find_spec(PACKAGE) is not None:
        return
    prefixes = os.environ.get('AMENT_PREFIX_PATH') or sysconfig.get_path('data')
    has = 'share/rosidl_generator_c'
    prefix = next(one for one in map(Path, prefixes.split(os.pathsep)) if (one / has).is_dir())
    message = folder / 'msg/CompressedPointCloud2.msg'
    message.parent.mkdir(parents=True)
    message.write_text(DEFINITION)
    words = ['-o', 'generated', '-I', prefix / 'share', PACKAGE, message.relative_to(folder)]
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv('AMENT_PREFIX_PATH', prefixes)
        _run(folder, 'rosidl', 'generate', *words)
    generated, package = folder / 'generated', folder / PACKAGE
    (generated / 'py').rename(package)
    (package / '__init__.py').touch()
    headers = [*(prefix / 'include').iterdir(), prefix / 'include', sysconfig.get_path('include')]
    for kind in KINDS:
        (folder / 'include' / kind).mkdir(parents=True)
        (folder / 'include' / kind / PACKAGE).symlink_to(generated / kind)
        headers.append(folder / 'include' / kind)
    libraries = ['rcutils', 'rosidl_runtime_c', 'rosidl_typesupport_c', *TYPE_SUPPORTS]
    libraries += ['rosidl_typesupport_fastrtps_cpp', 'fastcdr', 'stdc++']
    parts = ('rosidl_generator_c', 'rosidl_generator_py', *TYPE_SUPPORTS)
    libraries += [f'{one}__{part}' for one in WITHIN for part in parts]
    options = ['-shared', '-fPIC', '-w', *(f'-I{one}' for one in [*headers, np.get_include()])]
    options += ['-Wl,--no-as-needed', f'-Wl,-rpath,$ORIGIN:{prefix}/lib', f'-L{prefix}/lib', '-L.']
    sources = [one for kind in KINDS for one in _sources(generated / kind)]
    # ROS finds them by these names, among what is loaded.
    for name in (f'lib{PACKAGE}__{support}.so' for support in TYPE_SUPPORTS):
        link = ['-o', name, f'-Wl,-soname,{name}', *(f'-l{one}' for one in libraries)]
        _run(package, 'gcc', *options, *sources, *link)
    own = [*package.glob('*rosidl_typesupport_c.c'), *_sources(package / 'msg')]
    name = f'{PACKAGE}_s__rosidl_typesupport_c{sysconfig.get_config_var("EXT_SUFFIX")}'
    libraries += [f'{PACKAGE}__{support}' for support in TYPE_SUPPORTS]
    _run(package, 'gcc', *options, *own, '-o', name, *(f'-l{one}' for one in libraries))


def _sources(folder: Path) -> list[Path]:
    return [one for one in folder.rglob('*') if one.suffix in {'.c', '.cpp'}]


def _run(folder: Path, program: str, *words: object) -> None:
    found = shutil.which(program)
    assert found is not None, f'{program} must be installed'
    subprocess.run([found, *map(str, words)], cwd=folder, check=True, capture_output=True)
