# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Build and install the package: with colcon on a machine with ROS, with pip on any other.

The metadata live here and not in a [project] table, because colcon reads them here.
"""

import importlib.util
import os
import platform
import subprocess
import sys
import sysconfig
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from setuptools import Extension, find_packages, setup
from setuptools.command.build_ext import build_ext

# Beside this very file: `colcon build --symlink-install` runs a link to it.
sys.path.insert(0, str(Path(__file__).resolve().parent / 'scripts'))
from compiler import find_compiler

NAME = 'lidar_outlier_filter'
LAB = 'lidar_outlier_lab'  # makes the default, and proves it
ROOT = Path(__file__).parent
# Floating point in the order written, and no product fused with a sum: the same bits everywhere.
FLAGS = ['-std=c++17', '-g0', '-fPIC', '-fvisibility=hidden', '-Wall', '-Wextra']
FLAGS += ['-ffp-contract=off', '-fno-math-errno', '-fno-trapping-math', '-fno-lto', '-DNDEBUG']
WIDE = [f'-mavx512{part}' for part in ('f', 'vl', 'dq', 'bw')]
LEVELS: dict[str, list[str]] = {'base': []}  # of instructions: the options of each
if platform.machine() == 'x86_64':
    LEVELS |= {'avx2': ['-mavx2'], 'avx512': [*WIDE, '-mprefer-vector-width=512']}


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


def kernel_sources(package: str) -> list[str]:
    """List the C++ of a package; results/ of the laboratory has a peer's, which is not ours."""
    found = (path.relative_to(ROOT) for path in (ROOT / package).rglob('*.cpp'))
    return sorted(str(path) for path in found if 'results' not in path.parts)


def compiler_command() -> list[str]:
    """Return the command of a C++ compiler: this machine's, or ziglang of PyPI."""
    if command := find_compiler():
        return command
    if importlib.util.find_spec('ziglang'):
        # Otherwise it compiles for the processor of this machine alone.
        return [sys.executable, '-m', 'ziglang', 'c++', '-mcpu=baseline']
    raise SystemExit('a C++ compiler must be installed, got none: apt install g++')


def find_headers() -> list[str]:
    """Return the options that let a compiler find Python's, and pybind11's, which Debian has."""
    folders = [sysconfig.get_path('include')]
    try:
        folders.append(importlib.import_module('pybind11').get_include())
    except ImportError:
        if not Path('/usr/include/pybind11').is_dir():
            must = 'pybind11 must be installed, got none: apt install pybind11-dev'
            raise SystemExit(must) from None
    return [f'-I{folder}' for folder in folders]


class BuildKernels(build_ext):  # type: ignore[misc]
    """Compiles C++: files side by side, and only those that changed, or whose headers did."""

    def finalize_options(self) -> None:
        """Keep objects beside the sources where these are worked on: pip would not."""
        super().finalize_options()
        if self.inplace:
            self.build_temp = str(Path('build', f'temp.{sys.implementation.cache_tag}'))

    def build_extension(self, ext: Extension) -> None:
        """Compile an extension module, files of fast loops once for each level, and link it."""
        compiler = compiler_command()
        given = [
            one for name in ('CPPFLAGS', 'CXXFLAGS') for one in os.environ.get(name, '').split()
        ]
        command = [*compiler, '-O3', *given, *FLAGS, *find_headers()]  # -O of CXXFLAGS counts
        jobs = []
        # Files of lower levels come first, for the linker: see core/kernels/levels.hpp.
        for level, options in LEVELS.items():
            for source in ext.sources:
                if level == 'base' or source.endswith('.dispatch.cpp'):
                    made = Path(self.build_temp, level, source).with_suffix('.o')
                    bindings = ['-O1'] if source.endswith('module.cpp') else []  # halves the time
                    whole = [
                        *command,
                        *options,
                        *bindings,
                        f'-DLEVEL={level}',
                        '-MMD',
                        '-c',
                        source,
                    ]
                    jobs.append((made, [*whole, '-o', str(made)]))
        # Those that take longest to compile are the largest; they begin first.
        with ThreadPoolExecutor(len(os.sched_getaffinity(0))) as pool:
            order = sorted(jobs, key=lambda job: -Path(job[1][-3]).stat().st_size)
            changed = list(pool.map(lambda job: self._compile(*job), order))
        target = Path(self.get_ext_fullpath(ext.name))
        if any(changed) or not target.exists():
            target.parent.mkdir(parents=True, exist_ok=True)
            linked = [*compiler, '-shared', *(str(made) for made, _ in jobs), '-o', str(target)]
            self._run([*linked, *os.environ.get('LDFLAGS', '').split()])

    def _compile(self, made: Path, command: list[str]) -> bool:
        """Compile a file whose object is older than what it was made from, or made otherwise."""
        listed, said = made.with_suffix('.d'), made.with_suffix('.command')
        if made.exists() and listed.exists() and said.exists():
            _, _, names = listed.read_text().replace('\\\n', ' ').partition(':')
            files = [Path(name) for name in names.split()]
            since = made.stat().st_mtime
            fresh = all(file.exists() and file.stat().st_mtime <= since for file in files)
            if fresh and said.read_text() == ' '.join(command) and not self.force:
                return False
        made.parent.mkdir(parents=True, exist_ok=True)
        self._run(command)
        said.write_text(' '.join(command))
        return True

    def _run(self, command: list[str]) -> None:
        """Run a command; what it says is shown, and its failure ends the build."""
        if subprocess.run(command, check=False).returncode:  # noqa: S603
            raise SystemExit(f'{NAME} is not built, because this failed: {" ".join(command)}')


setup(
    name=NAME,
    version='1.0.0',  # also in package.xml, CITATION.cff and the package; a test compares them
    description='Clean lidar clouds from a moving vehicle, the same live and offline',
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
            'core/*.pyi',
        ],
        LAB: ['py.typed', '*.pyi', 'results/*.cpp'],
    },
    data_files=shared_files(),
    zip_safe=True,
    python_requires='>=3.11',
    # Lower bounds: what Ubuntu 24.04 packages; mcap and rosbags come by pip only. rosbags
    # 0.11.6 is the first that refuses chunks and records that were cut off, 0.12 is not tested.
    install_requires=[
        'mcap>=1.2,<2',
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
            'clang-format==14.0.6',  # others break lines elsewhere
            'mypy>=1.13',
            'ruff>=0.12',
            'types-psutil',
            'types-PyYAML',
        ],
    },
    ext_modules=[
        Extension(f'{NAME}.core._kernels', kernel_sources(NAME)),
        Extension(f'{LAB}._kernels', kernel_sources(LAB)),
    ],
    cmdclass={'build_ext': BuildKernels},
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
