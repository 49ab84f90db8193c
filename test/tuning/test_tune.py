# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The command tune: files that the node loads, lines that it takes, and what is refused."""

import os
import pty
import re
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest
import yaml
from helpers.labelled import drive, write
from helpers.nodes import Ros

from lidar_outlier_filter.cli.evaluate import read_recording
from lidar_outlier_filter.cli.main import main
from lidar_outlier_filter.core.detectors.builtin import AlphaBetaGamma
from lidar_outlier_filter.evaluation.confusion import confusion
from lidar_outlier_filter.parameters.filter import FilterParameters, describe
from lidar_outlier_filter.parameters.yaml_files import read_yaml, ros_lines
from lidar_outlier_filter.recordings.replay import replay
from lidar_outlier_lab.results.papers.methods import SMOOTHER as PAPER
from lidar_outlier_lab.simulation.world.recording import to_message

Capture = pytest.CaptureFixture[str]

SMOOTHER = ['--set', 'chain=[alpha_beta_gamma]']
SETTINGS = [
    *('--set', 'alpha_beta_gamma.before=40', '--set', 'alpha_beta_gamma.after=40'),
    *('--set', 'alpha_beta_gamma.significance=1e-15'),
]
SEARCH = [
    *SMOOTHER,
    *('--search', 'alpha_beta_gamma.before=4,6', '--search', 'alpha_beta_gamma.after=4,6'),
    *('--keep', 'alpha_beta_gamma.order', '--keep', 'alpha_beta_gamma.sides'),
]
# A process that was started in the background of a shell would ignore SIGINT.
COMMAND = """
import signal, sys
from lidar_outlier_filter.cli.main import main
signal.signal(signal.SIGINT, signal.default_int_handler)
sys.exit(main(sys.argv[1:]))
"""
RUN = [sys.executable, '-c', COMMAND]
LINE = re.compile(r'ros2 param set /outlier_filter_node (\S+) (.+)')


@pytest.fixture(scope='module')
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Record a short drive whose outliers are labelled."""
    return write(tmp_path_factory.mktemp('tune') / 'drive', {'/lidar': drive(30, 300)})


@pytest.fixture(scope='module')
def tuned(bag: Path) -> tuple[Path, str]:
    """Tune once from bad values: the parameter file, and what was printed."""
    output = bag.parent / 'tuned.yaml'
    command = [*RUN, 'tune', str(bag)]
    options = [*SETTINGS, *SEARCH, '--output', str(output)]
    done = subprocess.run([*command, *options], capture_output=True, text=True, check=True)
    assert done.stderr == ''
    return output, done.stdout


def test_what_is_printed(tuned: tuple[Path, str]) -> None:
    """Before, after and what to expect; what was changed, and how to use it."""
    output, printed = tuned
    row = re.search(r'^F1 +\S+ % +(\S+) % +(\S+) % +(\S+) % +(\S+) % – ', printed, re.MULTILINE)
    assert row is not None
    start, after, expected, low = (float(text) for text in row.groups())
    assert start + 5 < after
    assert after > 90
    assert low < expected < after + 1
    assert re.search(r'^alpha_beta_gamma\.before +40 +[46]', printed, re.MULTILINE)
    assert 'alpha_beta_gamma.order' not in printed
    assert printed.endswith(f'written to {output}\n')


def test_figures_come_true(tuned: tuple[Path, str], bag: Path, tmp_path: Path) -> None:
    """The user's own replay with the file gives, here and on another drive, what is printed."""
    output, printed = tuned
    row = re.search(r'^F1 +\S+ % +\S+ % +([\d.]+) % +([\d.]+) %', printed, re.MULTILINE)
    assert row is not None
    after, expected = (float(text) for text in row.groups())
    other = write(tmp_path / 'other', {'/lidar': drive(30, 300, seed=77)})
    figures = []
    for source, name in ((bag, 'a'), (other, 'b')):
        replay(source, tmp_path / name, parameters=read_yaml(output))
        points = read_recording(tmp_path / name)
        figures.append(100 * confusion(points.bad, points.rejected).f1)
    assert figures[0] == pytest.approx(after, abs=0.005)
    assert figures[1] == pytest.approx(expected, abs=3)


def test_the_node_loads_the_file(tuned: tuple[Path, str], ros: Ros) -> None:
    """A real node takes the file and has its values."""
    output, _ = tuned
    node = ros.filter('--params-file', str(output))
    values = read_yaml(output)
    assert len(values) == len(describe())
    for name, value in values.items():
        there = node.get_parameter(name).value
        assert (list(there) if isinstance(value, list) else there) == value
    assert values['alpha_beta_gamma.before'] in {4, 6}
    assert node.filter_parameters == FilterParameters().changed(values)


def test_a_limit_that_cannot_be_kept(bag: Path, tmp_path: Path, capsys: Capture) -> None:
    """Where all values tried lose more good points than --most-lost, no file is written."""
    output = tmp_path / 'tuned.yaml'
    words = ['tune', str(bag), '--set', 'chain=[sor]', '--search', 'sor.multiplier=0.01,0.02']
    words += ['--keep', 'sor.k', '--most-lost', '0.001', '--output', str(output)]
    assert main(words) == 1
    said = capsys.readouterr()
    assert 'good points lost' in said.out
    assert re.search(
        r'^the share of good points lost must be at most 0\.001 \(--most-lost\) .* got 0\.',
        said.err,
    )
    assert not output.exists()


def test_injected_outliers_and_default_output(tmp_path: Path, capsys: Capture) -> None:
    """A clean recording needs no labels; the file is beside it, and says what it comes from."""
    clean = [cloud[cloud['label'] == 0] for cloud in drive(30, 300)]
    bag = write(tmp_path / 'clean', {'/lidar': clean}, without='label')
    arguments = ['--inject', '0.02', '--inject-distance', '0.1', '3', '--seed', '4']
    assert main(['tune', str(bag), *arguments, *SEARCH, *SETTINGS]) == 0
    output = tmp_path / 'clean_tuned.yaml'
    text = output.read_text(encoding='utf-8')
    assert re.match(r'# Tuned on clean: F1 0\.\d{3} \(95 %: 0\.\d{3} to [01]\.\d{3}\), ', text)
    printed = capsys.readouterr()
    assert printed.out.endswith(f'written to {output}\n')
    # Injection is not weather, and weather can be put onto the same recording.
    assert 'does not hold for snow' in printed.out
    assert f'simulate --onto {bag} --weather' in printed.out
    assert re.search(r'^ +default +start +tuned +to expect', printed.out, re.MULTILINE)


def test_several_recordings(bag: Path, tmp_path: Path, capsys: Capture) -> None:
    """Whole ones are left out; the file is called after the first, and names all of them."""
    paths = [str(write(tmp_path / f'd{i}', {'/lidar': drive(10, 300, seed=i)})) for i in range(3)]
    assert main(['tune', *paths, *SEARCH]) == 0
    text = (tmp_path / 'd0_tuned.yaml').read_text(encoding='utf-8')
    assert text.startswith('# Tuned on d0, d1, d2: F1 ')
    assert ', in 3 folds.' in text
    assert main(['tune', *paths, '--labels', str(bag), '--output', str(tmp_path / 'x')]) == 1
    assert '--labels must be given for one recording' in capsys.readouterr().err


def test_refused_clouds_are_told(bag: Path, tmp_path: Path, capsys: Capture) -> None:
    """Clouds that the filter does not take are counted; else nothing is said."""
    clouds = drive(8, 300)
    order = [0, 1, 2, 3, 5, 4, 6, 7]
    late = [to_message(number * 100_000_000, clouds[number]) for number in order]
    sentence = '1 of its clouds were refused by the filter, and not learnt from\n'
    for source in (bag, write(tmp_path / 'late', {'/lidar': late})):
        output = str(tmp_path / f'{source.name}.yaml')
        assert main(['tune', str(source), *SEARCH, '--output', output]) == 0
        assert (sentence in capsys.readouterr().err) == (source != bag)


# Lines for a running node -----------------------------------------------------------------------


@pytest.mark.parametrize('paper_first', [False, True])
def test_lines_lead_there_step_by_step(*, paper_first: bool) -> None:
    """Each line alone is one that the node accepts, in numbers that ROS reads back."""
    paper, default = FilterParameters().changed(PAPER), FilterParameters()
    start, goal = (paper, default) if paper_first else (default, paper)
    for line in ros_lines(start, {name: goal.flat()[name] for name in PAPER}):
        found = LINE.fullmatch(line)
        assert found is not None
        start = start.changed({found[1]: yaml.safe_load(found[2])})
    assert start == goal


def test_lines_name_only_what_changes() -> None:
    """Unchanged parameters need no line; where no single step is enough, all lines are printed."""
    start = FilterParameters().changed({'chain': ['lof', 'sor'], 'vote': 2})
    same = {'alpha_beta_gamma.before': start.of(AlphaBetaGamma).before}
    (line,) = ros_lines(start, {**same, 'alpha_beta_gamma.significance': 1e-15})
    assert line.endswith(' 1.0e-15')
    lines = ros_lines(start, {'chain': ('lof',), 'vote': 1})
    assert [line.split()[4] for line in lines] == ['vote', 'chain']


# A terminal -------------------------------------------------------------------------------------


@pytest.mark.slow
def test_progress_and_interrupt(bag: Path, tmp_path: Path) -> None:
    """A terminal sees a bar; Ctrl-C ends the search without a trace and without a file."""
    output = tmp_path / 'tuned.yaml'
    command = [*RUN, 'tune', str(bag)]
    leader, terminal = pty.openpty()
    arguments = [*command, *SMOOTHER, '--output', str(output)]
    with subprocess.Popen(arguments, stdout=subprocess.PIPE, stderr=terminal) as process:
        os.close(terminal)
        screen, asked = b'', False
        with os.fdopen(leader, 'rb', buffering=0) as file, suppress(OSError):
            while part := file.read(4096):
                screen += part
                # Once: a second one would find the interpreter at its end.
                if b'scores' in screen and not asked:
                    process.send_signal(signal.SIGINT)
                    asked = True
        process.communicate()
    assert process.returncode == 130
    assert '━━'.encode() in screen
    assert b'Traceback' not in screen
    assert list(tmp_path.iterdir()) == []
