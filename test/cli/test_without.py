# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What works without ROS, and without the extra ``lab``."""

import ast
import json
import re
import subprocess
import sys
from importlib.metadata import packages_distributions
from pathlib import Path

import numpy as np
import pytest
from helpers import ROOT, names
from helpers.drives import write_drive
from helpers.programs import ended

from lidar_outlier_filter import __version__

SESSION = ROOT / 'doc' / 'examples' / 'numpy_session.py'
# Some modules cannot be imported in the processes of this file.
BLOCK = """
import sys

class Without:
    def find_spec(self, name, path=None, target=None):
        if name.partition('.')[0] in {blocked!r}:
            raise ModuleNotFoundError(f'No module named {{name!r}}', name=name)

sys.meta_path.insert(0, Without())
"""
LAB = {'matplotlib', 'PIL', 'sklearn'}
SENTENCE = (
    'the module {module} must be installed for this command: '
    "pip install '.[lab]' in the project, got none"
)
NO_PICTURE = SENTENCE.format(module='matplotlib') + '; no picture is drawn\n'
FAST = ['--set', 'chain=[alpha_beta_gamma]', '--set', 'scores=true']
CSV = ['--set', 'chain=[sor]']

NODE = """
from lidar_outlier_filter.cli.node import main
sys.exit(main(sys.argv[1:]))
"""


def of_ros() -> set[str]:
    """List the modules of ROS: those of its wheels, or those of an installed Jazzy."""
    found = {
        module
        for module, names in packages_distributions().items()
        if any(name.lower().replace('_', '-').startswith('ros-jazzy') for name in names)
    }
    used = {'rclpy', 'sensor_msgs', 'std_msgs', 'std_srvs', 'nav_msgs', 'diagnostic_msgs'}
    return found | used | {'rcl_interfaces', 'builtin_interfaces', 'geometry_msgs', 'tf2_msgs'}


def run(
    code: str, *arguments: object, folder: Path | None = None, blocked: set[str] | None = None
) -> subprocess.CompletedProcess[str]:
    """Run a program in a folder, without some modules; if none are named, without those of ROS."""
    code = BLOCK.format(blocked=blocked or of_ros()) + code
    return ended(sys.executable, '-c', code, *arguments, folder=folder, env={'COLUMNS': '200'})


def output(code: str, *arguments: object) -> str:
    """Run a program that must succeed; return what it prints."""
    done = run(code, *arguments)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def text_of_session() -> str:
    """Return the session, without the two lines of the licence."""
    return SESSION.read_text(encoding='utf-8').split('\n', 3)[3]


HELP = """
import argparse
from lidar_outlier_filter.cli.main import commands_for
commands = argparse.ArgumentParser().add_subparsers()
for add in commands_for(()):
    add(commands)
for command in commands.choices.values():
    command.format_help()
"""
LIGHT = {
    'import lidar_outlier_filter': 'numpy scipy matplotlib rosbags rclpy sensor_msgs',
    'import lidar_outlier_filter.recordings.replay': 'scipy.spatial',
    'from lidar_outlier_filter.parameters import filter; filter.FilterParameters()': 'numpy scipy',
    HELP: 'numpy matplotlib rclpy rosbags rich yaml scipy',
}


@pytest.mark.parametrize(('code', 'heavy'), LIGHT.items())
def test_imports_are_light(code: str, heavy: str) -> None:
    """The library, all parameters and the help of all commands wait for nothing."""
    code += f'\nimport sys; print([one for one in {heavy.split()} if one in sys.modules])'
    assert output(code) == '[]\n'


def test_session() -> None:
    """The session of the README has six lines of code, and does what it says."""
    text = text_of_session()
    assert len(ast.parse(text).body) == 6
    checks = """
assert len(cleaned) + len(outliers) == len(xyz) == 5000
assert verdict.outlier[77] and np.nanargmax(verdict.score) == 77
assert outliers.tolist() == [[1, 2, 3]]
print(verdict.score.dtype, verdict.detectors.dtype)
"""
    assert output(text + checks).split() == ['float32', 'uint16']


def test_the_readme_quotes_the_session() -> None:
    """The README shows the session as it is."""
    readme = (ROOT / 'README.md').read_text(encoding='utf-8')
    assert f'```python\n{text_of_session()}```\n' in readme


def test_the_node_says_what_it_does() -> None:
    """Its help names the topics and where the parameters are; no ROS is needed for it."""
    text = output(NODE, '--help')
    assert text.startswith(
        'usage: outlier_filter_node [-h] [--version] [--lifecycle] [--page [PORT]] '
        '[--ros-args ...]\n'
    )
    for word in ('points/cleaned', 'points/outliers', '/diagnostics', '-r points:=', 'chain:='):
        assert word in text
    for path in re.findall(r'share/lidar_outlier_filter/(\S+\.yaml)', text):
        assert (ROOT / path).is_file()
    assert output(NODE, '--version').strip() == __version__


def test_the_node_refuses_arguments_that_it_has_not() -> None:
    """Those of ROS are left to ROS, wherever they stand."""
    refused = run(NODE, '--ros-args', '-r', 'points:=/p', '--', '--parms-file', 'my.yaml')
    assert refused.returncode == 2
    assert refused.stderr.splitlines()[-1] == (
        'outlier_filter_node: error: unrecognized arguments: --parms-file my.yaml'
    )


def test_sources_alone() -> None:
    """Where nothing is compiled, a command says in one sentence where and how to get it."""
    module = 'lidar_outlier_filter.core._kernels'
    code = 'from lidar_outlier_filter.cli.main import main\nsys.exit(main(["info", "x"]))'
    done = run(f'sys.modules[{module!r}] = None\n{code}')
    assert done.returncode == 1
    assert done.stderr == (
        f'the module _kernels must be compiled in {ROOT / "lidar_outlier_filter" / "core"} (by '
        'scripts/environment or python setup.py build_ext --inplace), or Python started '
        'elsewhere, to import what pip installed, got its sources alone\n'
    )


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Make a folder with a recording and a file."""
    write_drive(tmp_path / 'drive', 5)
    rng = np.random.default_rng(1)
    xyz = np.column_stack([rng.uniform(-9, 9, (600, 2)), rng.normal(0, 0.02, 600), np.zeros(600)])
    xyz[::40, 2:] += [4, 1]
    cloud = tmp_path / 'cloud.csv'
    np.savetxt(cloud, xyz, delimiter=',', header='x,y,z,label', comments='', fmt='%.9g')
    return tmp_path


def statuses(commands: list[list[str]], folder: Path, blocked: set[str]) -> tuple[list[int], str]:
    """Run commands in one process; return the status of each, and all that they say."""
    code = f"""
from lidar_outlier_filter.cli.main import main
print([main(words) for words in {commands}])
"""
    done = run(code, folder=folder, blocked=blocked)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1]), done.stderr


@pytest.mark.slow
def test_commands(folder: Path) -> None:
    """Simulate, clean, evaluate and tune, from end to end."""
    lof = ['--set', 'chain=[lof]', '--search', 'lof.min_pts=10,20', '--folds', '2']
    commands = [
        ['clean', 'cloud.csv', '--output', 'cleaned.csv'],
        ['evaluate', 'cleaned.csv'],
        ['tune', 'cloud.csv', *lof, '--output', 'x.yaml'],
        ['simulate', 'sotoodeh-hod', '--output', 'bag'],
        ['tune', 'bag', '--set', 'chain=[hierarchical]', '--folds', '2', '--output', 'y.yaml'],
    ]
    assert statuses(commands, folder, of_ros())[0] == [0] * 5
    for name, detector in (('x.yaml', 'lof'), ('y.yaml', 'hierarchical')):
        assert f'chain: [{detector}]' in (folder / name).read_text()


def test_recordings_need_rosbags(tmp_path: Path) -> None:
    """Where it is not installed, as by rosdep on Ubuntu, its commands say so in one sentence."""
    commands = [
        ['replay', 'drive', '--output', 'out'],
        ['simulate', 'street-16', '--output', 'out'],
        ['evaluate', 'drive'],
        ['tune', 'drive'],
    ]
    sentence = (
        'the module rosbags must be installed for recordings (the page on installation has the '
        'line), got none\n'
    )
    assert statuses(commands, tmp_path, of_ros() | {'rosbags'}) == ([1] * 4, sentence * 4)


def test_without_ros_and_the_lab(folder: Path) -> None:
    """Recordings, files and arrays are cleaned, inspected and judged."""
    commands = [
        ['replay', 'drive', '--output', 'replayed', *FAST],
        ['info', 'drive'],
        ['report', 'drive', '--output', 'page.html', *FAST],
        ['clean', 'cloud.csv', '--output', 'cleaned.csv', *CSV],
        ['evaluate', 'cleaned.csv'],
    ]
    assert statuses(commands, folder, of_ros() | LAB)[0] == [0] * 5


def test_pictures_without_the_lab(folder: Path) -> None:
    """What cannot be drawn is said once, and nothing else is lost."""
    commands = [
        ['clean', 'cloud.csv', '--picture', 'worst.png', *CSV],
        ['report', 'drive', '--output', 'a', '--figures', 'b', *FAST],
        ['evaluate', 'cloud.csv', '--score', 'z', '--output', 'out'],
        ['report', 'drive', '--figures', 'figures'],
        ['results', '--output', 'out.md'],
        ['demo', '--output', 'demo'],
        ['train', '--output', 'out.json'],
    ]
    found, said = statuses(commands, folder, LAB)
    assert found == [3, 3, 3, 1, 1, 1, 1]
    modules = re.findall(r'the module (\w+) must be installed for this command', said)
    assert modules == ['matplotlib'] * 6 + ['sklearn']
    assert said.startswith(NO_PICTURE)
    assert said.count(NO_PICTURE) == 4
    left = ['a', 'cloud.csv', 'cloud_cleaned.csv', 'cloud_cleaned.csv.json', 'drive', 'out']
    assert names(folder) == left
