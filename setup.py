# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Build and install the package: with colcon on a machine with ROS, with pip on any other.

The metadata live here and not in a [project] table, because colcon reads them here.
"""

import os
import subprocess
import sys
from pathlib import Path

from setuptools import find_packages, setup
from setuptools.command.build_py import build_py
from setuptools.command.develop import develop
from setuptools.command.install import install

NAME = 'lidar_outlier_filter'
LAB = 'lidar_outlier_lab'  # makes the default, and proves it
ROOT = Path(__file__).parent
# What to compile at an installation: the detectors of a chain; nothing; without it, all that ships.
COMPILE = 'LIDAR_OUTLIER_FILTER_COMPILE'


def shared_files() -> list[tuple[str, list[str]]]:
    """List what goes to share/: what ROS finds the package by, launch and config files."""
    found: dict[str, list[str]] = {
        'share/ament_index/resource_index/packages': [f'resource/{NAME}'],
        f'share/{NAME}': ['package.xml'],
    }
    for folder in ('launch', 'config'):
        for path in sorted((ROOT / folder).rglob('*')):
            relative = path.relative_to(ROOT)
            if path.is_file() and '__pycache__' not in relative.parts:
                found.setdefault(f'share/{NAME}/{relative.parent}', []).append(str(relative))
    return list(found.items())


def compile_kernels(folder: str, *words: str) -> None:
    """Compile the kernels of the package in ``folder``. A failure costs the first start only."""
    chain = os.environ.get(COMPILE)
    if chain == '':
        return
    paths = os.pathsep.join([folder, *filter(None, [os.environ.get('PYTHONPATH')])])
    env = {**os.environ, 'PYTHONPATH': paths, 'PYTHONDONTWRITEBYTECODE': '1'}
    command = [sys.executable, '-P', '-m', f'{NAME}.cli.main', 'compile', *words]
    if chain is not None:
        command += ['--chain', chain]
    done = subprocess.run(command, env=env, check=False)  # noqa: S603
    if done.returncode:
        sys.stderr.write('The kernels are not compiled: the first start of the node does it.\n')


class Build(build_py):  # type: ignore[misc]
    """Copies the package, and compiles for all processors of a level what a wheel shall bring."""

    def run(self) -> None:
        """Copy, and compile into folders of its own."""
        super().run()
        if 'bdist_wheel' in self.distribution.commands:
            compile_kernels(os.path.abspath(self.build_lib), '--portable')  # noqa: PTH100  of links


class Install(install):  # type: ignore[misc]
    """Installs for ``colcon build``, and compiles for this processor."""

    def run(self) -> None:
        """Install, and compile where nothing else, such as a wheel, was asked for."""
        super().run()
        if 'install' in self.distribution.commands:
            # Below a root lies what becomes a package for other machines, as Debian's.
            compile_kernels(str(self.install_lib), *(['--portable'] if self.root else []))


class Develop(develop):  # type: ignore[misc]
    """Links for ``colcon build --symlink-install``, and compiles."""

    def run(self) -> None:
        """Link, and compile."""
        super().run()
        if 'develop' in self.distribution.commands and not self.uninstall:
            compile_kernels(os.fspath(Path.cwd()))


setup(
    name=NAME,
    version='1.0.0',  # also in package.xml, CITATION.cff and the package; a test compares them
    description='Clean lidar clouds from a moving vehicle, the same live and offline',
    # Beside this very file: `colcon build --symlink-install` runs a link to it.
    long_description=(Path(__file__).resolve().parent / 'README.md').read_text(encoding='utf-8'),
    long_description_content_type='text/markdown',
    author='The lidar_outlier_filter authors',
    maintainer='The lidar_outlier_filter authors',
    maintainer_email='lidar_outlier_filter@example.org',
    license='Apache-2.0',
    packages=find_packages(include=[NAME, f'{NAME}.*', LAB, f'{LAB}.*']),
    package_data={
        NAME: [
            'py.typed',
            'core/detectors/boosted_trees/*.json',
            'report/assets/*',
            'archive/assets/*',
            '**/portable/*.nb[ci]',
        ],
        LAB: ['py.typed', 'results/*.cpp'],
    },
    data_files=shared_files(),
    zip_safe=True,
    python_requires='>=3.11',
    # Lower bounds: what Ubuntu 24.04 packages; filterpy, mcap and rosbags come by pip only. rosbags
    # 0.11.6 is the first that refuses chunks and records that were cut off, 0.12 is not tested.
    install_requires=[
        'filterpy>=1.4.5',  # `engine: filterpy`
        'mcap>=1.2,<2',
        'numba>=0.58',
        'numpy>=1.26',
        'PyYAML>=6.0',
        'rich>=13.7',
        'rosbags>=0.11.6,<0.12',
        'scipy>=1.11',
    ],
    extras_require={
        # The real Jazzy as wheels, where none is installed; rclpy does not import without the rmw.
        'ros': [
            'ros-jazzy-diagnostic-msgs>=5.3,<6',
            'ros-jazzy-nav-msgs>=5.3,<6',
            'ros-jazzy-rcl-interfaces>=2.0,<3',
            'ros-jazzy-rclpy>=7.1,<8',
            'ros-jazzy-rmw-fastrtps-cpp>=8.4,<9',
            'ros-jazzy-sensor-msgs>=5.3,<6',
            'ros-jazzy-std-msgs>=5.3,<6',
            'ros-jazzy-std-srvs>=5.3,<6',
        ],
        # What `lidar_outlier_lab` needs, and the pictures of `evaluate` and `report`.
        'lab': ['matplotlib>=3.6', 'Pillow>=10.2', 'scikit-learn>=1.5'],
        # `lidar-outlier-filter clean`: LAS, LAZ, PCD (10 MB); Parquet (170 MB). Others need none.
        'files': ['laspy[lazrs]>=2.5', 'pyproj>=3.6', 'python-neo-lzf>=0.3.5'],
        'parquet': ['pyarrow>=14.0.1'],
        'e57': ['pye57>=0.4.10'],  # 60 MB; no apt package, so package.xml has none
        # `lidar-outlier-filter replay` with several processes or a cluster, and recordings
        # elsewhere; s3fs for `s3://`.
        'archive': ['dask>=2026.1.1', 'distributed>=2026.1.1', 'fsspec>=2024.3'],
        's3': ['s3fs>=2024.3'],
        'completion': ['argcomplete>=3.1'],  # of the command line, in bash, zsh and fish
        # Peers that `lidar-outlier-filter bench` and `results` compare with.
        'bench': ['open3d>=0.18', 'scikit-learn>=1.5', 'small-gicp>=1.0'],
        'test': [
            'argcomplete>=3.1',
            'catkin-pkg>=1.0',
            # `--packages-select` and `install/setup.bash` of the README are parts of their own.
            'colcon-bash>=0.5',
            'colcon-core>=0.17',
            'colcon-package-selection>=0.2.10',
            'colcon-ros>=0.5',
            'dask>=2026.1.1',
            'distributed>=2026.1.1',
            'flask-cors>=4.0',
            'fsspec>=2024.3',
            'hypothesis>=6.98',
            'laspy[lazrs]>=2.5',
            'matplotlib>=3.6',
            'mcap-ros2-support>=0.5',
            'moto[s3]>=5.0',
            'Pillow>=10.2',
            'playwright>=1.45',
            'psutil>=5.9',
            'pyarrow>=14.0.1',
            'pye57>=0.4.10',
            'pyproj>=3.6',
            'pytest>=7.4',
            'pytest-cov>=5',
            'pytest-timeout>=2.2',
            'pytest-xdist>=3.4',
            'python-neo-lzf>=0.3.5',
            's3fs>=2024.3',
            'scikit-learn>=1.5',
        ],
        # The pages in doc/; as Ubuntu 24.04 packages them
        'docs': ['myst-parser>=2.0', 'sphinx>=7.2', 'sphinx-rtd-theme>=2.0'],
        'lint': [
            'mypy>=1.13',
            'ruff>=0.12',
            'types-psutil',
            'types-PyYAML',
        ],
    },
    cmdclass={'build_py': Build, 'install': Install, 'develop': Develop},
    entry_points={
        'console_scripts': [
            f'lidar-outlier-filter = {NAME}.cli:start',
            f'outlier_filter_node = {NAME}.cli.node:main',
        ],
        # Verbs of the one command that are not of the product.
        f'{NAME}.commands': [
            f'{verb} = {LAB}.cli.{verb}:add_{verb}'
            for verb in ('bench', 'demo', 'results', 'simulate', 'train')
        ],
    },
)
