# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Commands on a store that speaks S3: as on this machine, and one sentence for what goes wrong."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import fsspec
import pytest
from stores import Store, running_store

from lidar_outlier_filter.archive.places import path_at
from lidar_outlier_filter.cli.main import main
from lidar_outlier_filter.recordings.bags import Recording
from lidar_outlier_filter.recordings.replay import replay

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from lidar_outlier_filter.recordings.remote_path import RecordingPath

    Capture = pytest.CaptureFixture[str]

MCAP, BAG = 'vlp16_mrpt_mcap', 'vlp16_mrpt.bag'
FAST = ['--set', 'chain=[alpha_beta_gamma]', '--jobs', '1']


@pytest.fixture(scope='module')
def store(recordings: Path) -> Iterator[Store]:
    """Run a store with a bucket of two recordings, and an empty one."""
    with running_store() as store:
        drives = store.new_bucket('drives')
        store.new_bucket('cleaned')
        for file in (recordings / 'bags' / MCAP).iterdir():
            store.put(f'{drives}/one/{file.name}', file.read_bytes())
        store.put(f'{drives}/two.bag', (recordings / 'bags' / BAG).read_bytes())
        yield store


def content(path: RecordingPath) -> list[tuple[str, int, bytes]]:
    """Read all of a recording."""
    with Recording(path) as recording:
        return [(topic.name, time, data) for topic, time, data in recording.messages()]


def test_from_store_to_store(
    store: Store, recordings: Path, tmp_path: Path, capsys: Capture
) -> None:
    """Outputs have the bytes of a replay of this machine; a second run replays nothing."""
    assert main(['replay', 's3://drives', '--output', 's3://cleaned/all', *FAST]) == 0
    fast = {'chain': ['alpha_beta_gamma']}
    for source, name in ((MCAP, 'one'), (BAG, 'two')):
        replay(recordings / 'bags' / source, tmp_path / name, parameters=fast)
        assert content(path_at(f's3://cleaned/all/{name}')) == content(tmp_path / name)
    keys = store.keys('cleaned')
    assert {'all/manifest.jsonl', 'all/archive.html'} < set(keys)
    assert store.uploads('cleaned') == []
    lines = path_at('s3://cleaned/all/manifest.jsonl').read_text('utf-8').splitlines()
    assert [json.loads(line)['source'] for line in lines] == [
        's3://drives/one',
        's3://drives/two.bag',
    ]
    capsys.readouterr()
    reads = store.requests.count('GET /drives/')
    assert main(['replay', 's3://drives', '--output', 's3://cleaned/all', *FAST]) == 0
    assert '0 replayed, 2 done before, 0 failed' in ' '.join(capsys.readouterr())
    assert store.requests.count('GET /drives/') == reads
    assert store.keys('cleaned') == keys


def test_one_recording(store: Store, recordings: Path, tmp_path: Path, capsys: Capture) -> None:
    """A recording of a store is replayed to this machine, and described."""
    assert store.keys('drives')
    assert main(['replay', 's3://drives/one', '--output', str(tmp_path / 'far'), *FAST]) == 0
    replay(
        recordings / 'bags' / MCAP, tmp_path / 'near', parameters={'chain': ['alpha_beta_gamma']}
    )
    assert content(tmp_path / 'far') == content(tmp_path / 'near')
    capsys.readouterr()
    for address in ('s3://drives/one', 's3://drives/two.bag'):
        assert main(['info', address]) == 0
        assert '16 rings' in capsys.readouterr().out


@pytest.mark.usefixtures('store')
@pytest.mark.parametrize(
    ('arguments', 'sentence'),
    [
        (['replay', 's3://nowhere/x.mcap'], 's3://nowhere/x.mcap must be reached, got "The spec'),
        (['replay', 's3://nowhere'], 's3://nowhere must be reached, got "The specified bucket'),
        (['replay', 's3://drives', '--output', 's3://nowhere/out'], 'must be written in full, got'),
        (['replay', 's3://drives', '--output', 's3://drives/out'], 'must be outside of s3://driv'),
        (['info', 's3://nowhere/x.mcap'], 's3://nowhere/x.mcap must be reached, got "The specif'),
    ],
)
def test_what_is_not_there(
    arguments: list[str], sentence: str, tmp_path: Path, capsys: Capture
) -> None:
    """A bucket that is not there costs one sentence, and status 1."""
    if arguments[0] == 'replay':
        given = [] if '--output' in arguments else ['--output', str(tmp_path / 'out')]
        arguments = [*arguments, *given, *FAST]
    assert main(arguments) == 1
    said = capsys.readouterr().err.splitlines()
    assert sentence in said[-1]
    assert not (tmp_path / 'out').exists()


@pytest.mark.parametrize(
    ('missing', 'sentence'),
    [('network', 'got "Could not connect'), ('credentials', 'got "Unable to locate credentials"')],
)
def test_no_network_and_no_credentials(
    store: Store, missing: str, sentence: str, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    """Without either there is one sentence; what the other bucket holds stays as it is."""
    keys = store.keys('cleaned')
    system = fsspec.get_filesystem_class('s3')
    monkeypatch.setenv('AWS_MAX_ATTEMPTS', '1')
    if missing == 'network':
        monkeypatch.setenv('AWS_ENDPOINT_URL_S3', 'http://127.0.0.1:1')
    else:
        for name in ('AWS_ACCESS_KEY_ID', 'AWS_SECRET_ACCESS_KEY'):
            monkeypatch.delenv(name)
    system.clear_instance_cache()
    assert main(['replay', 's3://drives', '--output', 's3://cleaned/new', *FAST]) == 1
    system.clear_instance_cache()
    said = capsys.readouterr().err.splitlines()
    assert len(said) == 1
    assert sentence in said[0]
    assert store.keys('cleaned') == keys
