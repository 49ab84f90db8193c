# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The command line: exit statuses, sentences, completion, and what is compiled."""

import os
import pty
import shlex
import shutil
import subprocess
import sys
from argparse import ArgumentParser
from contextlib import suppress
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from helpers import names
from pyarrow import parquet

from lidar_outlier_filter import __version__
from lidar_outlier_filter.cli.arguments import add_parameter_options
from lidar_outlier_filter.cli.main import commands_for, main
from lidar_outlier_filter.cli.terminal import read_parameters
from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_filter.parameters.yaml_files import config_folder, read_yaml
from lidar_outlier_filter.recordings.bags import NewBag, Recording

Capture = pytest.CaptureFixture[str]

BAR = '━━'.encode()
RUN = [sys.executable, '-m', 'lidar_outlier_filter.cli.main']


@pytest.fixture
def drive(recordings: Path, tmp_path: Path) -> Path:
    """Copy a real recording to where its output may be put beside it."""
    return Path(shutil.copytree(recordings / 'bags' / 'vlp16_mrpt_mcap', tmp_path / 'drive'))


def rows(table: str) -> dict[str, list[str]]:
    """Read the rows of a printed table."""
    cells = [[cell.strip() for cell in line.split('│')] for line in table.splitlines()]
    return {row[1]: row[2:-1] for row in cells if len(row) > 1}


def count(text: str) -> int:
    """Read a printed number."""
    return int(text.replace(',', ''))


def test_every_command_ends_its_help_with_two_examples(capsys: Capture) -> None:
    """Each can be parsed: no option, preset or parameter in them is misspelt."""
    parser = ArgumentParser()
    commands = parser.add_subparsers()
    for add in commands_for(()):
        add(commands)
    for name, command in commands.choices.items():
        with pytest.raises(SystemExit, match='0'):
            main([name, '--help'])
        head, first, second = capsys.readouterr().out.splitlines()[-3:]
        assert head == 'examples:'
        for line in (first, second):
            program, verb, *words = shlex.split(line)
            assert (program, verb) == ('lidar-outlier-filter', name)
            options = command.parse_args(words)
            if hasattr(options, 'settings'):
                chain = getattr(options, 'chain', None)
                FilterParameters().changed(read_parameters((), options.settings, chain))


@pytest.mark.parametrize('arguments', [[], ['dance'], ['replay']])
def test_wrong_usage(arguments: list[str], capsys: Capture) -> None:
    """Without a command, or with one that does not exist, argparse says how it is used."""
    with pytest.raises(SystemExit, match='2'):
        main(arguments)
    assert capsys.readouterr().err.startswith('usage: lidar-outlier-filter')


def test_version(capsys: Capture) -> None:
    """The version is that of the package."""
    with pytest.raises(SystemExit, match='0'):
        main(['--version'])
    assert capsys.readouterr().out == f'{__version__}\n'


def test_replay_prints_a_table(drive: Path, tmp_path: Path, capsys: Capture) -> None:
    """A replay writes beside its recording, says so, and prints what it found."""
    assert main(['replay', str(drive)]) == 0
    assert names(tmp_path) == ['drive', 'drive_cleaned']
    printed = capsys.readouterr()
    table = rows(printed.out)
    assert table['messages'] == ['4']
    assert table['refused'] == ['0']
    assert 0 < count(table['rejected'][0]) < 0.1 * count(table['points'][0])
    assert count(table['points per second'][0]) > 0
    assert float(table['× real time'][0]) > 0
    assert printed.out.endswith(f'written to {tmp_path / "drive_cleaned"}\n')
    # Without a cache a further line says that kernels are compiled.
    said = [line for line in printed.err.splitlines() if line.startswith('/velodyne_points: ')]
    times, trees = (line.removeprefix('/velodyne_points: ') for line in said)
    assert times.startswith('times from field ')
    assert trees == 'judged by trees on the scan pattern'


def test_replay_tells_what_each_detector_did(drive: Path, tmp_path: Path, capsys: Capture) -> None:
    """A row for what each rejects, and one for what it cannot judge."""
    arguments = ['replay', str(drive), '--output', str(tmp_path / 'out')]
    assert main([*arguments, '--set', 'chain=[lof, sor]']) == 0
    table = rows(capsys.readouterr().out)
    rejected = [count(table[f'rejected by {name}'][0]) for name in ('lof', 'sor')]
    assert sum(rejected) == count(table['rejected'][0]) > 0
    assert all(count(table[f'undecided by {name}'][0]) >= 0 for name in ('lof', 'sor'))
    assert 'rejected by alpha_beta_gamma' not in table


def test_output_of_a_lone_file(drive: Path) -> None:
    """The output of a lone file has its name without what follows the dot."""
    file = drive / 'hdl32_mrpt.mcap'
    next(drive.glob('*.mcap')).rename(file)
    assert main(['replay', str(file), '--drop-input']) == 0
    with Recording(drive / 'hdl32_mrpt_cleaned') as recording:
        found = [topic.name for topic in recording.topics]
    assert found == ['/velodyne_points/cleaned', '/velodyne_points/outliers']


def test_several_parameter_files(tmp_path: Path) -> None:
    """All of them count, and of one parameter the last file; single parameters win over both."""
    text = '/**:\n  ros__parameters:\n    lof: {{{}}}\n'
    files = [tmp_path / 'site.yaml', tmp_path / 'sensor.yaml']
    files[0].write_text(text.format('min_pts: 9, threshold: 1.5'))
    files[1].write_text(text.format('threshold: 3.0, statistic: lof2'))
    parser = ArgumentParser()
    add_parameter_options(parser)
    arguments = [word for file in files for word in ('--params', str(file))]
    options = parser.parse_args(arguments)
    values = read_parameters(options.params, options.settings)
    assert values == {'lof.min_pts': 9, 'lof.threshold': 3.0, 'lof.statistic': 'lof2'}
    options = parser.parse_args([*arguments, '--set', 'lof.threshold=2.5'])
    assert read_parameters(options.params, options.settings)['lof.threshold'] == 2.5
    options = parser.parse_args([])
    assert read_parameters(options.params, options.settings) == {}


def test_too_much_rejected_gives_status_4(drive: Path, tmp_path: Path, capsys: Capture) -> None:
    """The output is written, of one recording or of a folder, and the exit status says not."""
    many, one = tmp_path / 'many', tmp_path / 'one'
    most = ['--set', 'boosted_trees.threshold=0.1']
    assert main(['replay', str(drive), '--output', str(one), *most]) == 4
    error = capsys.readouterr().err
    assert f'\nwhat is rejected of /velodyne_points of {drive.name} must be at most 15.0%' in error
    assert 'unless --accept-share says so' in error
    assert 'by trees on the ' in error.splitlines()[-1]
    again = ['replay', str(tmp_path / '[d]rive'), '--output', str(many)]
    assert main([*again, *most]) == 4
    assert main([*again, *most]) == 4
    assert '1 done before' in capsys.readouterr().out
    assert main([*again, *most, '--accept-share', '1']) == 0
    assert main([*again, *most, '--accept-share', '-1']) == 1
    assert 'from 0 to 1' in capsys.readouterr().err
    with Recording(one) as recording:
        assert '/velodyne_points/cleaned' in {topic.name for topic in recording.topics}


def test_refused_clouds_give_status_3(drive: Path, tmp_path: Path, capsys: Capture) -> None:
    """Where an output is missing, the output is written, and the exit status says not."""
    source = tmp_path / 'damaged'
    with Recording(drive) as recording, NewBag(source) as bag:
        (topic,) = recording.topics
        bag.add(topic)
        for number, (_, time, data) in enumerate(recording.messages()):
            bag.write(topic, time, data[: 100 if number == 1 else None])
    assert main(['replay', str(source)]) == 3
    printed = capsys.readouterr()
    clouds = '1 of 4 clouds of /velodyne_points'
    refused = f'{clouds} were refused and have no output, for: the CDR bytes must be a whole cloud'
    assert f'\n{refused}, got ' in printed.err
    assert printed.err.endswith(' (1)\n')
    assert rows(printed.out)['refused'] == ['1']
    assert 'damaged_cleaned' in names(tmp_path)


def test_progress_on_a_terminal_only(drive: Path, tmp_path: Path) -> None:
    """A terminal sees a bar, a file does not."""
    command = [*RUN, 'replay', str(drive), '--output']
    plain = subprocess.run([*command, str(tmp_path / 'a')], capture_output=True, check=True)
    screen = on_a_terminal([*command, str(tmp_path / 'b')])
    assert BAR in screen
    assert BAR not in plain.stderr


def on_a_terminal(command: list[str]) -> bytes:
    """Run a command that must succeed; return what its terminal shows."""
    leader, terminal = pty.openpty()
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=terminal) as process:
        os.close(terminal)
        screen = b''
        with os.fdopen(leader, 'rb', buffering=0) as file, suppress(OSError):
            while part := file.read(4096):
                screen += part
        process.communicate()
    assert process.returncode == 0
    return screen


@pytest.mark.parametrize('verb', ['clean', 'report', 'info'])
def test_names_that_are_not_utf8(verb: str, tmp_path: Path, capsys: Capture) -> None:
    """A file may have any bytes as its name; no traceback is printed."""
    path = tmp_path / os.fsdecode(b'a\xff.csv')
    path.write_text('x,y,z\n' + ''.join(f'{i},{i * i % 7},{i % 3}\n' for i in range(50)))
    assert main([verb, str(path)]) in {0, 1}
    assert 'Traceback' not in capsys.readouterr().err


HOSTILE = '[/red] :smile: \x1b[2J\n[FATAL]'  # markup, an emoji, and what a terminal obeys
SHOWN = '[/red] :smile: \\x1b[2J\\n[FATAL]'


@pytest.mark.parametrize('verb', ['info', 'clean'])
def test_names_that_are_markup(verb: str, tmp_path: Path, capsys: Capture) -> None:
    """Names of columns and files are printed as they are, and a terminal obeys nothing in them."""
    path = tmp_path / f'{HOSTILE}.parquet'
    path.parent.mkdir()
    columns = {name: np.arange(60.0) % 7 for name in 'xyz'}
    parquet.write_table(pa.table({**columns, HOSTILE: np.arange(60)}), path)
    chain = [] if verb == 'info' else ['--chain', 'sor']
    assert main([verb, str(path), *chain]) == 0
    said = ''.join(capsys.readouterr())
    assert '\x1b' not in said
    assert ':smile:' in said
    assert 'Traceback' not in said
    if verb == 'info':
        assert SHOWN in said


def test_real_markup(real_data: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    """So are those of a CSV file and of a recording."""
    monkeypatch.setenv('COLUMNS', '200')
    for name in ('markup.csv', 'markup_bag'):
        assert main(['info', str(real_data / 'hostile' / name)]) == 0
    said = ''.join(capsys.readouterr())
    assert '│ [/red] ' in said
    assert '\x1b' not in said


def test_bar_of_a_file_that_is_markup(tmp_path: Path) -> None:
    """So are those that a bar names."""
    path = tmp_path / '[red]a[b].csv'
    path.write_text('x,y,z\n' + '1,2,3\n4,5,6\n' * 30)
    screen = on_a_terminal([*RUN, 'clean', str(path), '--chain', 'sor'])
    assert b'[red]a[b].csv' in screen


@pytest.mark.parametrize(
    ('line', 'expected'),
    [
        ('rep', {'replay', 'report'}),
        ('tr', {'train'}),
        ('clean --keep', {'--keep-classes'}),
        ('replay a --set sor.mult', {'sor.multiplier='}),
        ('clean a --chain sor,lo', {'sor,lof'}),
        ('clean a --mark ', {'class', 'noise', 'withheld', 'column'}),
        ('info dr', {'drive_a/', 'drive_b.mcap'}),
    ],
)
def test_completion(line: str, expected: set[str], tmp_path: Path) -> None:
    """Verbs, options, choices, parameters, detectors and files are completed."""
    (tmp_path / 'drive_a').mkdir()
    (tmp_path / 'drive_b.mcap').touch()
    words = f'lidar-outlier-filter {line}'
    asked = {
        '_ARGCOMPLETE': '1',
        '_ARGCOMPLETE_STDOUT_FILENAME': str(tmp_path / 'completions'),
        'COMP_LINE': words,
        'COMP_POINT': str(len(words)),
        'COMP_TYPE': '9',
    }
    subprocess.run(RUN, env={**os.environ, **asked}, check=True, cwd=tmp_path)
    found = (tmp_path / 'completions').read_text('utf-8').split('\v')
    assert {one.strip() for one in found} == expected


def test_parameter_files_of_the_package(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    """A file of config/ is found where the pages' commands run outside of the sources."""
    monkeypatch.chdir(tmp_path)
    found = read_parameters([Path('config/classic.yaml')], [])
    installed = config_folder() / 'classic.yaml'
    assert found == read_yaml(installed)
    assert capsys.readouterr().err == f'config/classic.yaml is that of the package, {installed}\n'
    (tmp_path / 'config').mkdir()
    (tmp_path / 'config' / 'classic.yaml').write_text('/**:\n  ros__parameters:\n    block: 0.5\n')
    assert read_parameters([Path('config/classic.yaml')], []) == {'block': 0.5}
