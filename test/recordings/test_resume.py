# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Replays that go on from what a killed run left: the same bytes, and nothing is judged twice."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from typing import TYPE_CHECKING, Any

import pytest
from helpers import HELPERS, TESTS
from helpers.damaged import write_large

from lidar_outlier_filter.cli.main import main
from lidar_outlier_filter.core.engine.chain import Chain
from lidar_outlier_filter.errors import RecordingError
from lidar_outlier_filter.pipeline.topics import CLOUD
from lidar_outlier_filter.recordings.bags import NewBag, Recording, Topic
from lidar_outlier_filter.recordings.journal import NOTES
from lidar_outlier_filter.recordings.replay import replay

if TYPE_CHECKING:
    from pathlib import Path

KILLING = HELPERS / 'killing.py'
LEAVE = """
import sys
from pathlib import Path
sys.path.insert(0, sys.argv[1])
from helpers.killing import leave
for name, values in {}.items():
    folder = Path(sys.argv[3]) / name
    folder.mkdir()
    leave(Path(sys.argv[2]), folder, values, 26)
"""
ALONG: dict[str, object] = {'chain': ('alpha_beta_gamma',), 'threads': 1}
VALUES: dict[str, dict[str, object]] = {
    'time': ALONG | {'blocks': 'time', 'block': 0.05, 'halo': 0.02},
    'message': ALONG | {'blocks': 'message', 'halo': 0.12},
    'auto': ALONG | {'blocks': 'auto'},
}


@pytest.fixture(scope='module')
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write a drive with two lidars, of which one loses every third cloud, and a text."""
    folder = tmp_path_factory.mktemp('drive')
    with Recording(write_large(folder / 'one')) as source, NewBag(folder / 'drive') as bag:
        texts, clouds = sorted(source.topics, key=lambda topic: topic.msgtype == CLOUD)
        more = (clouds.definition, clouds.digest)
        left, right = (Topic(name, CLOUD, *more) for name in ('/l', '/r'))
        for topic in (texts, left, right):
            bag.add(topic)
        for number, (topic, time, data) in enumerate(source.messages()):
            if topic is texts:
                bag.write(texts, time, data)
                continue
            bag.write(left, time, data)
            if number % 3:
                bag.write(right, time, data)
    return folder / 'drive'


@pytest.fixture(scope='module')
def left(drive: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Find what runs with each of the settings left that were killed."""
    folder = tmp_path_factory.mktemp('left')
    program = LEAVE.replace('{}', repr(VALUES))
    command = [sys.executable, '-c', program, str(TESTS), str(drive), str(folder)]
    subprocess.run(command, check=True)
    return folder


@pytest.fixture
def out(left: Path, tmp_path: Path) -> Path:
    """Copy what the killed run with blocks of time left; name the output."""
    shutil.copytree(left / 'time', tmp_path / 'new')
    return tmp_path / 'new' / 'out'


def files(folder: Path) -> dict[str, bytes]:
    """Read all files of a folder."""
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def count_judged(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Count the points of all blocks that are judged from now on."""
    counts: list[int] = []
    judge = Chain.judge

    def counted(chain: Chain, points: Any) -> Any:
        counts.append(len(points))
        return judge(chain, points)

    monkeypatch.setattr(Chain, 'judge', counted)
    return counts


@pytest.mark.parametrize('blocks', list(VALUES))
def test_same_bytes(
    drive: Path, left: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, blocks: str
) -> None:
    """The output and the report are those of an unbroken run; what is there is not judged again."""
    shutil.copytree(left / blocks, tmp_path / 'new')
    said: list[str] = []
    counts = count_judged(monkeypatch)
    (tmp_path / 'whole').mkdir()
    whole = replay(drive, tmp_path / 'whole' / 'out', parameters=VALUES[blocks])
    all_judged = sum(counts)
    counts.clear()
    output = tmp_path / 'new' / 'out'
    assert [path.name for path in output.parent.iterdir()] != ['out']
    report = replay(drive, output, parameters=VALUES[blocks], resume=True, inform=said.append)
    number, _, rest = said[0].partition(' ')
    assert rest == 'answers of a killed run are taken as they are'
    assert int(number) >= 8
    assert sum(counts) < 0.75 * all_judged
    assert files(output) == files(tmp_path / 'whole' / 'out')
    assert report.topics == whole.topics
    assert [path.name for path in output.parent.iterdir()] == ['out']


def test_what_is_damaged_is_not_taken(drive: Path, out: Path, tmp_path: Path) -> None:
    """Answers that were changed on the disk, and notes that were not written in full, are left."""
    whole = tmp_path / 'whole' / 'out'
    whole.parent.mkdir()
    replay(drive, whole, parameters=VALUES['time'])
    (folder,) = out.parent.iterdir()
    bag = folder / 'out' / 'out.mcap'
    data, notes = bag.read_bytes(), (folder / NOTES).read_bytes()
    counts = []
    for where, cut in ((0.95, 1.0), (0.6, 1.0), (0.95, 0.5)):
        (folder / 'out').mkdir(parents=True, exist_ok=True)
        offset = int(where * len(data))
        bag.write_bytes(data[:offset] + bytes(100) + data[offset + 100 :])
        (folder / NOTES).write_bytes(notes[: int(cut * len(notes))] + b'{"answers": 7')
        (folder / '.lock-of-the-run').touch()
        said: list[str] = []
        replay(drive, out, parameters=VALUES['time'], resume=True, inform=said.append)
        assert files(out) == files(whole)
        counts.append(int(said[0].partition(' ')[0]) if said[0][0].isdigit() else 0)
        shutil.rmtree(out)
    assert counts[0] > counts[1] > counts[2] > 0


def test_the_run_that_came_farthest(drive: Path, out: Path) -> None:
    """Of what several runs left, the most answers are taken; all of it is removed."""
    (folder,) = out.parent.iterdir()
    notes = (folder / NOTES).read_text().splitlines(keepends=True)
    kind = folder.name.rpartition('-')[0]
    for name in ('-', '~'):  # one before it, one behind it, in the order of their names
        other = shutil.copytree(folder, folder.with_name(f'{kind}-{name}'))
        (other / NOTES).write_text(''.join(notes[: len(notes) // 2]))
    said: list[str] = []
    replay(drive, out, parameters=VALUES['time'], resume=True, inform=said.append)
    taken, half = int(said[0].partition(' ')[0]), json.loads(notes[len(notes) // 2 - 1])['answers']
    assert taken > half > 0
    assert [path.name for path in out.parent.iterdir()] == ['out']


def test_another_run_is_refused(drive: Path, out: Path, tmp_path: Path) -> None:
    """What a run with other parameters, of another recording, left is neither taken nor removed."""
    before = sorted(out.parent.rglob('*'))
    refused = 'the {} of the killed run that left .* must be the same, got another'
    with pytest.raises(RecordingError, match=refused.format('set of parameters')):
        replay(drive, out, parameters=VALUES['message'], resume=True)
    with pytest.raises(RecordingError, match=refused.format('choice to drop the input')):
        replay(drive, out, parameters=VALUES['time'], resume=True, drop_input=True)
    other = shutil.copytree(drive, tmp_path / 'drive')
    os.utime(other / 'drive.mcap', (0, 0))
    with pytest.raises(RecordingError, match=refused.format('recording')):
        replay(other, out, parameters=VALUES['time'], resume=True)
    (bag,) = other.glob('*.mcap')
    data = bag.read_bytes()
    bag.write_bytes(data[:100_000] + bytes(8) + data[100_008:])
    for file in drive.iterdir():
        os.utime(other / file.name, ns=(0, file.stat().st_mtime_ns))
    with pytest.raises(RecordingError, match=refused.format('recording')):
        replay(other, out, parameters=VALUES['time'], resume=True)
    assert sorted(out.parent.rglob('*')) == before
    replay(drive, out, parameters=VALUES['time'])  # without going on, it is removed
    assert [path.name for path in out.parent.iterdir()] == ['out']


def test_a_mask_that_was_learnt_anew(drive: Path, out: Path) -> None:
    """A run does not go on with another mask under the same name."""
    (folder,) = out.parent.iterdir()
    text = (folder / NOTES).read_text()
    assert text.count('"content of the mask": "off"') == 1
    (folder / NOTES).write_text(text.replace('the mask": "off"', 'the mask": "another"'))
    with pytest.raises(RecordingError, match='content of the mask of the killed run'):
        replay(drive, out, parameters=VALUES['time'], resume=True)


def test_an_interrupt_keeps_what_was_left(drive: Path, out: Path) -> None:
    """Ctrl-C while a run goes on removes its own folder only."""
    before = sorted(out.parent.rglob('*'))

    def interrupt(done: int, _total: int) -> None:
        if done > 20:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        replay(drive, out, parameters=VALUES['time'], resume=True, progress=interrupt)
    assert sorted(out.parent.rglob('*')) == before


def test_nothing_was_left(drive: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Without a killed run, --resume says that it begins anew; a finished output is refused."""
    output = tmp_path / 'out'
    command = ['replay', str(drive), '--output', str(output), '--resume']
    command += ['--set', 'chain=[alpha_beta_gamma]']
    assert main(command) == 0
    sentence = f'no killed run has left answers for {output}: it begins anew\n'
    assert capsys.readouterr().err.startswith(sentence)
    assert main(command) == 1
    assert 'must be a new folder, got' in capsys.readouterr().err
    assert main(['replay', str(drive), '--output', str(tmp_path / 'no' / 'out'), '--resume']) == 1
    assert 'got "No such file or directory"' in capsys.readouterr().err


@pytest.mark.slow
def test_killed_runs_go_on(tmp_path: Path) -> None:
    """Runs that were killed after any number of messages, once or twice, are gone on from."""
    drive = write_large(tmp_path / 'drive')
    (tmp_path / 'new').mkdir()
    command = [sys.executable, str(KILLING), 'resume', str(drive), str(tmp_path / 'new'), '2']
    lines = subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()
    reports = {line for line in lines if line.startswith('(TopicReport')}
    assert len(reports) == 1
    taken = [line for line in lines if 'answers of a killed run are taken' in line]
    assert len(taken) == 2
    assert [line for line in lines if line.startswith(('good', 'bad'))] == ['good'] * 2
