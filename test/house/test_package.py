# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The package as a whole: what it says of itself, and what colcon makes of it."""

import ast
import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from catkin_pkg.package import parse_package
from helpers import ROOT
from helpers.programs import ended

import lidar_outlier_filter

NAME = 'lidar_outlier_filter'
LAB = 'lidar_outlier_lab'


def words(text: str) -> set[str]:
    """Split a text into its words."""
    return {*text.split()}


# Modules whose rosdep key is their own name behind ``python3-``.
FROM_APT = words(
    'PIL argcomplete catkin_pkg hypothesis matplotlib numpy psutil pyproj pytest rich scipy '
    'sklearn yaml'
)
# Where the name of a module differs from its name on PyPI.
PYPI_NAMES = {
    'PIL': 'Pillow',
    'boto3': 'moto',
    'catkin_pkg': 'catkin-pkg',
    'lazrs': 'laspy',  # in its brackets
    'lzf': 'python-neo-lzf',
    'mcap_ros2': 'mcap-ros2-support',
    'sklearn': 'scikit-learn',
    'yaml': 'PyYAML',
    'zstandard': 'mcap',  # needs it
}
# Imported only where a user asks for them, and installed by an extra
EXTRAS = {
    'argcomplete': 'completion',
    'dask': 'archive',
    'distributed': 'archive',
    'fsspec': 'archive',
    'laspy': 'files',
    'lazrs': 'files',
    'lzf': 'files',
    'PIL': 'lab',
    'matplotlib': 'lab',
    'open3d': 'bench',
    'pyarrow': 'parquet',
    'pye57': 'e57',
    'pyproj': 'files',
    'small_gicp': 'bench',
}
# Of ROS, and needed by rclpy itself, or by nav_msgs
WITH_RCLPY = {'geometry_msgs', 'lifecycle_msgs', 'rosgraph_msgs'}
# Only pip has them: rosdep would call it for the system, which Ubuntu 24.04 refuses.
PIP_ONLY = words(
    'boto3 dask distributed fsspec laspy lazrs lz4 lzf mcap mcap_ros2 moto playwright '
    'pyarrow pye57 rosbags zstandard'
)
SINCE_NUMPY_2 = {
    'np': """
        acos acosh asin asinh astype atan atan2 atanh bitwise_count bitwise_invert
        bitwise_left_shift bitwise_right_shift bool concat cumulative_prod cumulative_sum isdtype
        long matrix_transpose matvec permute_dims pow strings trapezoid ulong unique_all
        unique_counts unique_inverse unique_values unstack vecdot vecmat
    """,
    'np.linalg': """
        cross diagonal matmul matrix_norm matrix_transpose outer svdvals tensordot trace vecdot
        vector_norm
    """,
}
ARRAYS_SINCE_NUMPY_2 = {'device', 'mT', 'to_device'}  # whatever they are attributes of
MADE = shutil.ignore_patterns('.*', '__pycache__', '*.egg-info', 'demo_output', 'build', '*.so')
BUILD = 'import sys; from colcon_core.command import main; sys.exit(main())'


def python_files() -> list[Path]:
    """All the project's own Python files."""
    folders = (NAME, LAB, 'doc', 'launch', 'test')
    return [ROOT / 'setup.py', *(path for one in folders for path in (ROOT / one).rglob('*.py'))]


def imports(path: Path) -> Iterator[str]:
    """Full names of the modules that a file imports, wherever in it."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module


def foreign(*folders: str) -> set[str]:
    """Top-level modules of others that the files in these folders import."""
    files = [path for folder in folders for path in (ROOT / folder).rglob('*.py')]
    found = {name.partition('.')[0] for path in files for name in imports(path)}
    return found - set(sys.stdlib_module_names) - {NAME, LAB}


def rosdep_keys(modules: set[str]) -> set[str]:
    """Name modules as rosdep does."""
    key = {name: f'python3-{name.lower().replace("_", "-")}' for name in FROM_APT}
    return {key.get(name, name) for name in modules}


def setup_argument(name: str) -> Any:
    """Value of an argument of setup() in setup.py."""
    for node in ast.walk(ast.parse((ROOT / 'setup.py').read_text())):
        if isinstance(node, ast.keyword) and node.arg == name:
            return ast.literal_eval(node.value)
    raise LookupError(name)


def requirement_names(requirements: list[str]) -> set[str]:
    """Names on PyPI, without the versions."""
    return {re.split(r'[<>=!~;\[ ]', text)[0] for text in requirements}


def pypi_names(modules: set[str]) -> set[str]:
    """Name modules as PyPI does."""
    return {PYPI_NAMES.get(name, name) for name in modules}


def test_package_xml_is_valid() -> None:
    """The parser of colcon and rosdep accepts it without a warning; all name one version."""
    warnings: list[str] = []
    package = parse_package(str(ROOT), warnings=warnings)
    assert warnings == []
    assert package.name == NAME
    assert package.package_format == 3
    assert package.get_build_type() == 'ament_python'
    assert package.version == setup_argument('version') == lidar_outlier_filter.__version__
    cited = (ROOT / 'CITATION.cff').read_text()
    assert f'\nversion: {package.version}\n' in cited
    (released,) = re.findall(r'\ndate-released: (.*)\n', cited)
    assert f'{package.version} ({released})\n' in (ROOT / 'CHANGELOG.rst').read_text()


def test_package_xml_lists_what_is_imported() -> None:
    """Every module of others that is imported is an exec_depend, and nothing else is."""
    imported = foreign(NAME, 'launch') - set(EXTRAS) - PIP_ONLY
    stated = {depend.name for depend in parse_package(str(ROOT)).exec_depends}
    assert stated == rosdep_keys(imported) | {'tf2_msgs'}


def test_rosdep_calls_no_pip() -> None:
    """Every key comes from apt: a package with a pip key cannot be released."""
    keys = set(re.findall(r'<\w*depend>(.*?)<', (ROOT / 'package.xml').read_text()))
    assert keys >= {'rclpy', 'python3-pytest', 'python3-sphinx'}
    assert not [key for key in keys if key.endswith('-pip') or key == 'mcap-ros2-support']


def from_pip() -> dict[str, tuple[str, list[str]]]:
    """Read the list of what apt lacks: version and hashes, by the name on PyPI."""
    text = (ROOT / 'config/from_pip.txt').read_text()
    found = re.findall(
        r'^(\S+)==(\S+)((?: \\\n +--hash=sha256:[0-9a-f]{64})+)$', text, re.MULTILINE
    )
    assert len(found) == len(re.findall('^[^# ]', text, re.MULTILINE))
    return {name: (version, given.split()) for name, version, given in found}


def test_what_apt_lacks_is_one_list() -> None:
    """All that the product imports, of the versions that tests run with; the image takes it."""
    constraints = (ROOT / 'scripts/constraints.txt').read_text()
    pinned = dict(re.findall(r'^(\S+)==(\S+)', constraints, re.MULTILINE))
    listed = from_pip()
    assert {name: version for name, (version, _) in listed.items()}.items() <= pinned.items()
    assert pypi_names(foreign(NAME) & PIP_ONLY - set(EXTRAS)) <= set(listed)
    dockerfile = (ROOT / 'Dockerfile').read_text()
    assert dockerfile.count('pip install') == dockerfile.count('-r src/') == 1
    assert '-r src/lidar_outlier_filter/config/from_pip.txt' in dockerfile
    assert '\nUSER ubuntu\n' in dockerfile


IMPORT_ALL = """
import importlib, json, pkgutil, sys
import lidar_outlier_filter as package
for name in json.loads(sys.argv[1]):
    sys.modules[name] = None
found = {}
for module in pkgutil.walk_packages(package.__path__, package.__name__ + '.'):
    try:
        importlib.import_module(module.name)
    except ImportError as err:
        found[module.name] = err.name
print(json.dumps(found))
"""


@pytest.mark.slow
def test_all_modules_import_with_what_package_xml_and_the_list_name() -> None:
    """But for those of extras, which commands name in one sentence."""
    listed = {'ruamel' if name.startswith('ruamel') else name for name in from_pip()}
    others = (PIP_ONLY | set(EXTRAS) | words('matplotlib open3d pandas sklearn pytest')) - listed
    run = ended(sys.executable, '-c', IMPORT_ALL, json.dumps(sorted(others)), folder=ROOT)
    assert run.returncode == 0, run.stderr
    lacks = {name.partition('.')[0] for name in json.loads(run.stdout).values()}
    assert lacks <= set(EXTRAS)
    assert not lacks & (PIP_ONLY - set(EXTRAS))


def test_numpy_is_that_of_ubuntu() -> None:
    """No function or attribute of NumPy is used that 1.26 lacks: Ubuntu packages that one."""
    used = [
        node
        for folder in (NAME, LAB)
        for path in (ROOT / folder).rglob('*.py')
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Attribute)
    ]
    assert 'flatnonzero' in {node.attr for node in used if ast.unparse(node.value) == 'np'}
    newer = {
        ast.unparse(node)
        for node in used
        if node.attr in SINCE_NUMPY_2.get(ast.unparse(node.value), '').split()
        or node.attr in ARRAYS_SINCE_NUMPY_2
    }
    assert newer == set()


def test_setup_lists_what_is_imported() -> None:
    """The same for pip: ROS in the extra `ros`, what few users need in extras of its own."""
    extras = setup_argument('extras_require')
    imported = foreign(NAME)
    ros = imported - FROM_APT - set(EXTRAS) - PIP_ONLY
    always = imported - ros - set(EXTRAS)
    wheels = {f'ros-jazzy-{name.replace("_", "-")}' for name in ros}
    assert requirement_names(setup_argument('install_requires')) == pypi_names(always)
    # The middleware is loaded by rclpy, and imported by nobody.
    assert requirement_names(extras['ros']) == wheels | {'ros-jazzy-rmw-fastrtps-cpp'}
    for module in imported & set(EXTRAS):
        assert pypi_names({module}) <= requirement_names(extras[EXTRAS[module]])


def test_the_debian_package_is_of_package_xml() -> None:
    """It has that version, and Ubuntu's packages of those dependencies, as bloom names them."""
    package = parse_package(str(ROOT))
    control = (ROOT / 'debian/control').read_text()
    own = words(
        '${misc:Depends} ${python3:Depends} ${shlibs:Depends} debhelper-compat dh-python python3 '
        'python3-all-dev python3-setuptools ros-jazzy-ros-workspace'
    )
    needed = {'Depends': package.exec_depends, 'Build-Depends': package.build_depends}
    for field, depends in needed.items():
        (stated,) = re.findall(rf'^{field}: (.*)', control, re.MULTILINE)
        names = {one.name.replace('_', '-') for one in depends}
        apt = {
            name if name.startswith(('python3-', 'pybind11-')) else f'ros-jazzy-{name}'
            for name in names
        }
        assert {text.split(' ')[0] for text in stated.split(', ')} - own == apt
    assert f'({package.version}-' in (ROOT / 'debian/changelog').read_text().partition('\n')[0]


@pytest.mark.slow
def test_pixi_takes_what_is_needed() -> None:
    """What the node imports, and the bounds of setup.py, from RoboStack, conda-forge or PyPI."""
    manifest = tomllib.loads((ROOT / 'pixi.toml').read_text('utf-8'))
    stated = {**manifest['dependencies'], **manifest['pypi-dependencies']}
    assert requirement_names(setup_argument('extras_require')['ros']) <= set(stated)
    for requirement in setup_argument('install_requires'):
        ((name, bounds),) = re.findall(r'^([\w-]+)(.+)', requirement.lower())
        assert stated[name] == (bounds if name != 'numpy' else '>=2,<3')


def test_what_tests_import_is_listed() -> None:
    """Every module of others that a test imports is a test_depend, and in the extra `test`."""
    package = parse_package(str(ROOT))
    ours = {path.stem for path in (ROOT / 'test').rglob('*')}  # folders, too
    imported = foreign('test') - foreign(NAME, 'launch') - ours | foreign('test') & set(EXTRAS)
    assert rosdep_keys(imported - PIP_ONLY) <= {depend.name for depend in package.test_depends}
    extras = setup_argument('extras_require')
    assert pypi_names(imported - WITH_RCLPY) <= requirement_names(extras['test'])


def test_what_the_pages_need_is_listed() -> None:
    """What builds the pages is a doc_depend, and in the extra `docs`, which the tests install."""
    names = {'myst-parser', 'sphinx', 'sphinx-rtd-theme'}
    loaded = set(re.findall(r"^    '(\w+)", (ROOT / 'doc' / 'conf.py').read_text(), re.MULTILINE))
    assert {name.replace('_', '-') for name in loaded} >= names
    extras = setup_argument('extras_require')
    assert requirement_names(extras['docs']) == names
    keys = {depend.name for depend in parse_package(str(ROOT)).doc_depends}
    # myst-parser has a pip key only; rosdoc2 brings it along.
    assert keys == {'python3-sphinx', 'python3-sphinx-rtd-theme'}
    assert 'docs' in (ROOT / 'scripts' / 'environment').read_text()


def test_every_extra_is_described() -> None:
    """A reader of the page on installation learns what each extra is for."""
    extras = setup_argument('extras_require')
    rows = re.findall(r'^\| (`.+?`) \|', (ROOT / 'doc/install.md').read_text(), re.MULTILINE)
    described = {name for row in rows for name in re.findall('`([a-z0-9]+)`', row)}
    assert set(extras) <= described


def test_every_file_names_its_licence() -> None:
    """Every Python file begins with the two SPDX lines."""
    header = (
        '# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors\n'
        '# SPDX-License-Identifier: Apache-2.0\n'
    )
    assert [path.name for path in python_files() if not path.read_text().startswith(header)] == []


# Prints where the compiled module lies, and what a detector of it finds.
JUDGE = """
import numpy as np
from lidar_outlier_filter import detect_outliers
from lidar_outlier_filter.core import _kernels

print(_kernels.__file__)
points = np.random.default_rng(1).normal(size=(500, 3))
print(np.flatnonzero(detect_outliers(points, chain=['sor', 'lof']).rejected))
"""
WAYS = {
    'wheel': '-m pip wheel --no-deps --no-build-isolation -w .. .',
    'root': 'setup.py install --root ../installed --install-lib /',  # as for a Debian package
}


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize('way', WAYS)
def test_packages_bring_the_compiled_module(way: str, tmp_path: Path) -> None:
    """It is theirs that is imported, and it finds what that of the sources finds."""
    sources, installed = tmp_path / 'sources', tmp_path / 'installed'
    shutil.copytree(ROOT, sources, ignore=MADE)
    done = ended(sys.executable, *WAYS[way].split(), folder=sources)
    assert done.returncode == 0, done.stderr
    for wheel in tmp_path.glob('*.whl'):
        shutil.unpack_archive(wheel, installed, 'zip')
    said = []
    for package in (installed, ROOT):
        paths = [str(package), *filter(None, [os.environ.get('PYTHONPATH')])]
        env = {'PYTHONPATH': os.pathsep.join(paths)}
        done = ended(sys.executable, '-P', '-c', JUDGE, env=env)
        assert (done.returncode, done.stderr) == (0, '')
        file, found = done.stdout.split('\n', 1)
        assert Path(file).is_relative_to(package)
        said.append(found)
    assert said[0] == said[1]


class Workspace:
    """A colcon workspace with nothing but this package in it."""

    def __init__(self, root: Path, *options: str) -> None:
        """Copy the package, and build it with the options given."""
        self.root = root
        self.prefix = root / 'install' / NAME
        self.share = self.prefix / 'share' / NAME
        shutil.copytree(ROOT, root / 'src' / NAME, ignore=MADE)
        self.environment = {'COLCON_HOME': str(root / 'colcon')}
        (line,) = re.findall(
            r'^colcon (build [^#\n]*)', (ROOT / 'README.md').read_text(), re.MULTILINE
        )
        self.run(sys.executable, '-c', BUILD, *line.split(), *options, check=True)

    def run(self, *command: str, check: bool = False) -> subprocess.CompletedProcess[str]:
        """Run a command in the workspace, and leave what it says."""
        result = ended(*command, folder=self.root, env=self.environment)
        assert not check or result.returncode == 0, result.stdout + result.stderr
        return result

    def run_sourced(self, *command: str) -> subprocess.CompletedProcess[str]:
        """Run a command where the workspace is sourced, as a user does."""
        sourced = 'source install/setup.bash && exec "$@"'
        return self.run('bash', '-c', sourced, 'bash', *command)


@pytest.fixture(scope='module', params=['copied', 'linked'])
def workspace(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Workspace:
    """Build the package with colcon, both ways."""
    options = {'copied': [], 'linked': ['--symlink-install']}[request.param]
    return Workspace(tmp_path_factory.mktemp('workspace'), *options)


@pytest.mark.slow
@pytest.mark.long
def test_colcon_installs(workspace: Workspace) -> None:
    """ROS finds the package by its marker, package.xml, and every launch and config file."""
    index = workspace.prefix / 'share' / 'ament_index' / 'resource_index' / 'packages'
    assert (index / NAME).is_file()
    assert (workspace.share / 'package.xml').read_text() == (ROOT / 'package.xml').read_text()
    for folder in ('launch', 'config'):
        ours, there = (
            {path.relative_to(top) for path in (top / folder).rglob('*.*') if path.is_file()}
            for top in (ROOT, workspace.share)
        )
        assert ours
        assert {path for path in ours if '__pycache__' not in path.parts} == there


@pytest.mark.slow
@pytest.mark.long
def test_the_built_node_starts(workspace: Workspace) -> None:
    """`ros2 run` finds the node; it starts, reads its parameters, and refuses one that is wrong."""
    node = workspace.prefix / 'lib' / NAME / 'outlier_filter_node'
    assert os.access(node, os.X_OK)
    # Python is named for folders with a space, which the first line of a script cannot have.
    result = workspace.run_sourced(sys.executable, str(node), '--ros-args', '-p', 'halo:=-1.0')
    assert result.returncode == 1, result.stderr
    assert 'halo must be' in result.stderr


@pytest.mark.slow
@pytest.mark.long
def test_the_built_command_is_this_package(workspace: Workspace) -> None:
    """What runs is the package in the workspace, not the one that is tested."""
    command = workspace.prefix / 'lib' / NAME / 'lidar-outlier-filter'
    version = workspace.run_sourced(sys.executable, str(command), '--version')
    assert version.stdout.strip() == lidar_outlier_filter.__version__
    shown = 'print(y.__file__, y.config_folder(), sep=chr(10))'
    code = f'import {NAME}.parameters.yaml_files as y; {shown}'
    source, config = workspace.run_sourced(sys.executable, '-c', code).stdout.splitlines()
    assert source.startswith(str(workspace.root))
    assert config.startswith(str(workspace.root))
    assert Path(config, 'fastdds_large_clouds.xml').is_file()
    code = f'import {NAME}.core._kernels as y; print(y.__file__)'
    assert workspace.run_sourced(sys.executable, '-c', code).stdout.startswith(str(workspace.root))
