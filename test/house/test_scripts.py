# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""scripts/environment and .ci/run, with a Python that only writes down what is asked of it."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from helpers import ROOT
from helpers.programs import ended

# Says yes to every question, makes an environment by copying itself, and installs nothing.
PYTHON = """#!/bin/bash
case "$1 $2" in
-c*) [[ "$2" != *rclpy* || -n "$HAS_RCLPY" ]] && echo "$0" ;;
'-m venv')
    [[ -z "$HAS_NO_VENV" ]] || exit 1
    echo "$*" >>"$LOG"
    mkdir -p "${@: -1}/bin" && cp "$0" "${@: -1}/bin/python"
    ;;
'-m pip')
    echo "$*" >>"$LOG"
    [[ -z "$HAS_NO_NETWORK" ]]
    ;;
'setup.py --quiet') ;;  # nothing has changed
*/scripts/compiler.py*) ;;  # the machine has one
*) exit 1 ;;
esac
"""

CHECKS = """#!/bin/bash
name=$1; shift
case "$name" in
python) [[ "$1" == -m ]] || exec "$REAL_PYTHON" "$@" ;;
*) [[ "$name $1" != "$WRONG"* ]] ;;
esac
"""

TESTS = """#!/bin/bash
for word in "$@"; do [[ "$word" != --junitxml=* ]] || report=${word#*=}; done
[[ -z "$REPORT" ]] || echo "$REPORT" >"$report"
exit "$STATUS"
"""


class Project:
    """A copy of the project's scripts, in a folder with a space in its name."""

    def __init__(self, root: Path) -> None:
        """Copy what the scripts need."""
        self.root = root / 'a project'
        self.log = root / 'log'
        self.log.touch()
        shutil.copytree(ROOT / 'scripts', self.root / 'scripts')
        shutil.copytree(ROOT / '.ci', self.root / '.ci')
        shutil.copy(ROOT / 'setup.py', self.root)
        python = root / 'python'
        self.write(python, PYTHON)
        self.environment = {
            'HOME': str(root),
            'LOG': str(self.log),
            'PATH': os.environ['PATH'],
            'PYTHON': str(python),
        }

    def write(self, path: Path, text: str) -> None:
        """Write an executable file."""
        path.write_text(text)
        path.chmod(0o755)

    def run(self, *command: str, **variables: str) -> subprocess.CompletedProcess[str]:
        """Run one of the project's files from another folder."""
        return subprocess.run(
            [str(self.root / command[0]), *command[1:]],
            cwd='/',
            env={**self.environment, **variables},
            capture_output=True,
            text=True,
            check=False,
            timeout=60,
        )

    def make(self, *command: str, **variables: str) -> str:
        """Run a command in the environment, and return what it says."""
        result = self.run('scripts/environment', *command, **variables)
        assert result.returncode == 0, result.stderr
        return result.stdout

    def asked(self) -> list[str]:
        """List what was asked of Python and pip since the last call."""
        lines = self.log.read_text().splitlines()
        self.log.write_text('')
        return lines


@pytest.fixture
def project(tmp_path: Path) -> Project:
    """Make a project without an environment."""
    return Project(tmp_path)


def test_environment_is_made_once(project: Project) -> None:
    """The first run makes it, with ROS from PyPI; the second asks nothing of pip."""
    project.make()
    assert all('constraints.txt' in line for line in project.asked()[1:])
    # Plugins of pytest that others brought are not loaded.
    assert 'PYTEST_DISABLE_PLUGIN_AUTOLOAD=1\n' in project.make('env')
    assert project.asked() == []


def test_the_demo_waits_for_no_test(project: Project) -> None:
    """What tests need comes when a command without --demo is run, and nothing is made twice."""
    project.make('--demo', 'true')
    assert project.asked()[-1].endswith('[ros,lab]')
    project.make('true')
    assert [line.rpartition(' ')[2] for line in project.asked()] == [
        'lidar_outlier_filter[docs,test,lint]'
    ]
    project.make('--demo', 'true')
    assert project.asked() == []


@pytest.mark.parametrize('name', ['setup.py', 'scripts/constraints.txt', 'scripts/environment'])
def test_environment_follows_its_recipe(project: Project, name: str) -> None:
    """A change of its recipe makes the environment again, without its former content."""
    project.make()
    leftover = project.root / '.venv' / 'leftover'
    leftover.touch()
    project.asked()
    with (project.root / name).open('a') as file:
        file.write('# changed\n')
    project.make()
    assert project.asked()
    assert not leftover.exists()


def test_environment_of_someone_else_is_left_alone(project: Project) -> None:
    """A .venv that the script did not make is refused, and stays as it is."""
    theirs = project.root / '.venv' / 'theirs'
    theirs.parent.mkdir()
    theirs.touch()
    result = project.run('scripts/environment')
    assert result.returncode == 1
    assert 'must be made by this script' in result.stderr
    assert theirs.exists()


def test_unfit_python_is_refused(project: Project) -> None:
    """Without a Python 3.11 or 3.12 one sentence says so."""
    result = project.run('scripts/environment', PYTHON='/bin/false')
    assert result.returncode == 1
    assert 'Python must be 3.11 or 3.12' in result.stderr


def test_sourced_jazzy_is_used(project: Project) -> None:
    """With a Jazzy sourced, its rclpy serves, and no wheel is installed."""
    seen = project.make('env', ROS_DISTRO='jazzy', HAS_RCLPY='1', PYTHONPATH='/opt/ros')
    assert not any('[ros' in line or 'constraints.txt' in line for line in project.asked())
    assert 'PYTHONPATH=/opt/ros\n' in seen


@pytest.mark.parametrize('distribution', ['humble', 'jazzy'])
def test_unfit_ros_is_left_alone(project: Project, distribution: str) -> None:
    """A ROS that is no Jazzy, or does not import, has no influence; a sentence says so."""
    result = project.run(
        'scripts/environment', 'env', ROS_DISTRO=distribution, PYTHONPATH='/opt/ros'
    )
    assert f'({distribution}) is left alone' in result.stderr
    assert [line.rpartition('[')[2] for line in project.asked()[-2:]] == [
        'ros,lab]',
        'docs,test,lint]',
    ]
    assert not {'ROS_DISTRO', 'PYTHONPATH'} & {
        line.partition('=')[0] for line in result.stdout.splitlines()
    }


def report(**counts: int) -> str:
    """Write the head of a report as pytest does."""
    given = {'tests': 4, 'failures': 0, 'errors': 0, 'skipped': 0, **counts}
    numbers = ' '.join(f'{name}="{count}"' for name, count in given.items())
    return f'<testsuites><testsuite {numbers}/></testsuites>'


@pytest.mark.parametrize(
    ('status', 'written', 'wrong', 'closing'),
    [
        ('0', report(), 'nothing', '11 passed, 0 failed'),
        ('0', report(skipped=1), 'nothing', '10 passed, 0 failed, 1 skipped'),
        ('1', report(failures=1, errors=1), 'nothing', '9 passed, 2 failed'),
        ('0', report(), 'mypy', '10 passed, 1 failed'),
        ('2', report(), 'nothing', '11 passed, 1 failed'),
        ('5', report(tests=0), 'nothing', '7 passed, 1 failed'),
        ('3', '', 'nothing', '7 passed, 1 failed'),
    ],
    ids=['all', 'skipped', 'tests', 'check', 'interrupted', 'no tests', 'crash'],
)
def test_ci_counts(project: Project, status: str, written: str, wrong: str, closing: str) -> None:
    """Whatever fails, .ci/run fails, and its last line counts it."""
    project.write(project.root / 'scripts' / 'environment', CHECKS)
    project.write(project.root / 'scripts' / 'test', TESTS)
    result = project.run(
        '.ci/run', STATUS=status, REPORT=written, WRONG=wrong, REAL_PYTHON=sys.executable
    )
    assert result.stdout.splitlines()[-1] == closing
    assert (result.returncode == 0) == (' 0 failed' in closing)


def test_tests_of_real_data_are_left_out_together(tmp_path: Path) -> None:
    """Without real recordings one line says so, and none fails."""
    project = tmp_path / 'project' / 'test'
    project.mkdir(parents=True)
    for name in ('conftest.py', 'helpers'):
        (project / name).symlink_to(ROOT / 'test' / name)
    text = 'def test_any(): pass\n\n\ndef test_real(real_data): assert real_data.is_dir()\n'
    (project / 'test_both.py').write_text(text)
    options = ('-p', 'no:cacheprovider', '-p', 'xdist', '-n', '1')
    done = ended(sys.executable, '-m', 'pytest', *options, project, folder=project, env={'CI': ''})
    assert done.returncode == 0, done.stdout
    assert 'tests on real data are left out' in done.stdout
    assert '1 passed' in done.stdout


def test_plugins_of_others_do_not_run(tmp_path: Path) -> None:
    """Of pytest: dash's cannot be loaded without a browser's driver; scripts load ours alone."""
    for name in ('dash', 'another'):
        info = tmp_path / f'{name}-1.0.dist-info'
        info.mkdir()
        (info / 'METADATA').write_text(f'Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n')
        (info / 'entry_points.txt').write_text(f'[pytest11]\n{name} = no_such_module\n')
        words = ('-m', 'pytest', '-n', '0', '--collect-only', '-q', 'test/core/points/test_mask.py')
        env = {'PYTHONPATH': os.pathsep.join([str(tmp_path), *filter(None, sys.path)])}
        alone = {'PYTEST_DISABLE_PLUGIN_AUTOLOAD': '1'} if name == 'another' else {}
        done = ended(sys.executable, *words, folder=ROOT, env=env | alone)
        assert done.returncode == 0, done.stderr
