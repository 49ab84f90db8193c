# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""New files appear whole, together, or not at all, whatever ends a run or fills a disk."""

import fcntl
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from itertools import product
from pathlib import Path
from typing import Any

import pytest
from helpers import names
from helpers.damaged import write_recording
from helpers.hostile import FORMATS, whole_file

from lidar_outlier_filter.cli.main import main
from lidar_outlier_filter.disk import new_files as new_files_module
from lidar_outlier_filter.disk.new_files import (
    FILE,
    FOLDER,
    LOCK,
    hidden_folder,
    new_files,
    new_output,
    replaced,
)
from lidar_outlier_filter.errors import CloudError, FilterError
from lidar_outlier_filter.files.clean import _allocator
from lidar_outlier_filter.files.cloud_file import open_cloud


@pytest.mark.parametrize('error', [KeyboardInterrupt, CloudError, SystemExit])
def test_nothing_is_left_behind(tmp_path: Path, error: type[BaseException]) -> None:
    """An error of any kind leaves nothing behind."""

    def fail() -> None:
        with new_files([tmp_path / 'a', tmp_path / 'b']) as built:
            built[0].write_text('half')
            raise error('a', 'b', 'c')

    with pytest.raises(error):
        fail()
    assert names(tmp_path) == []


def test_refused(tmp_path: Path) -> None:
    """Files that exist, that are one, and folders that do not exist are refused."""
    there = tmp_path / 'there'
    there.write_text('mine')
    for paths, sentence in (
        ([there], 'the output must be a new file, got .*there, which exists'),
        ([tmp_path / 'a', tmp_path / 'other' / '..' / 'a'], 'the outputs must be different files'),
        (
            [tmp_path / 'no' / 'a'],
            'the output must be in a folder that exists, got .*a',
        ),
    ):
        with pytest.raises(FilterError, match=sentence), new_files(paths):
            pytest.fail('never comes here')
    assert there.read_text() == 'mine'
    assert names(tmp_path) == ['there']


@pytest.fixture(params=['one step', 'two steps', 'two steps without links'])
def renames(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Publish in each way that file systems have: all of them are used on this one."""

    def no_links(_built: Path, _path: Path) -> None:
        raise PermissionError  # as FAT does

    if request.param != 'one step':  # as on NFS
        monkeypatch.setattr(new_files_module, '_rename_in_one_step', lambda _built, _path: False)
    if request.param.endswith('links'):
        monkeypatch.setattr(os, 'link', no_links)


def test_a_worker_that_still_writes_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A hidden folder goes at the end, although a file is made in it while it is removed."""
    unlink = os.unlink
    with hidden_folder(tmp_path / 'out') as folder:
        (folder / 'attempt').mkdir()
        (folder / 'attempt' / 'early').write_bytes(b'')

        def write(*arguments: Any, **options: Any) -> None:
            with suppress(FileNotFoundError):
                (folder / 'attempt' / 'late').write_bytes(b'')
            unlink(*arguments, **options)

        monkeypatch.setattr(os, 'unlink', write)
    assert names(tmp_path) == []


@pytest.mark.usefixtures('renames')
def test_published(tmp_path: Path) -> None:
    """Until the end nothing is there under its name; then all are, and nothing else."""
    (tmp_path / 'other').mkdir()
    paths = [tmp_path / 'a.las', tmp_path / 'other' / 'b.las']
    with new_files(paths) as built, new_output(tmp_path / 'folder', FOLDER) as folder:
        for path in (*built, folder / 'page'):
            path.write_text(path.name)
        assert not any(path.exists() for path in (*paths, tmp_path / 'folder'))
    assert [path.read_text() for path in paths] == ['a.las', 'b.las']
    assert (tmp_path / 'folder' / 'page').read_text() == 'page'
    assert (names(tmp_path), names(tmp_path / 'other')) == (['a.las', 'folder', 'other'], ['b.las'])


@pytest.mark.usefixtures('renames')
def test_what_was_made_meanwhile_stays(tmp_path: Path) -> None:
    """A name that was taken after the start is refused: a file, an empty folder, a dead link."""

    def take(path: Path, kind: str) -> None:
        if kind == 'file':
            path.write_text('theirs')
        elif kind == 'folder':
            path.mkdir()
        else:
            path.symlink_to('nowhere')

    def write(path: Path, must_be: str, kind: str) -> None:
        with new_output(path, must_be) as built:
            (built / 'page' if must_be == FOLDER else built).write_text('mine')
            take(path, kind)

    for number, (must_be, kind) in enumerate(product((FILE, FOLDER), ('file', 'folder', 'link'))):
        path = tmp_path / f'{number}'
        with pytest.raises(FilterError, match=f'must be {must_be}, got {path}, which exists'):
            write(path, must_be, kind)
        assert names(tmp_path) == [f'{i}' for i in range(number + 1)]
        assert path.is_symlink() == (kind == 'link')
        if kind == 'folder':
            assert not list(path.iterdir())
        elif kind == 'file':
            assert path.read_text() == 'theirs'


@pytest.mark.usefixtures('renames')
@pytest.mark.parametrize('must_be', [FILE, FOLDER])
def test_replaced(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, must_be: str) -> None:
    """The older output stays until the new one is complete; a name taken meanwhile is refused."""
    path = tmp_path / 'output'

    def write(text: str, then: Callable[[Path], object]) -> None:
        with replaced(path) as built:
            if must_be == FOLDER:
                built.mkdir()
            (built / 'page' if must_be == FOLDER else built).write_text(text)
            then(path)

    with pytest.raises(FilterError, match='which exists'):
        write('mine', Path.touch)
    path.unlink()
    page = path / 'page' if must_be == FOLDER else path
    for text in ('first', 'second'):
        write(text, str)
        assert page.read_text() == text
    with pytest.raises(KeyboardInterrupt):
        write('third', interrupt)
    if must_be == FOLDER:
        monkeypatch.setattr(new_files_module, 'publish', interrupt)
        with pytest.raises(KeyboardInterrupt):
            write('third', str)
    assert (page.read_text(), names(tmp_path)) == ('second', ['output'])


def interrupt(*_paths: Path) -> None:
    """Press Ctrl-C."""
    raise KeyboardInterrupt


@pytest.mark.usefixtures('renames')
def test_all_or_none(tmp_path: Path) -> None:
    """Where the second name was taken meanwhile, the first is given back."""
    paths = [tmp_path / 'a', tmp_path / 'b']

    def write() -> None:
        with new_files(paths) as built:
            for path in built:
                path.write_text('mine')
            paths[1].write_text('theirs')

    with pytest.raises(FilterError, match=r'the output must be a new file, got .*b, which exists'):
        write()
    assert names(tmp_path) == ['b']
    assert paths[1].read_text() == 'theirs'


def test_a_name_that_the_system_refuses(tmp_path: Path) -> None:
    """Other errors of a rename give one sentence."""

    def write() -> None:
        with new_output(tmp_path / 'folder' / 'file') as built:
            built.unlink(missing_ok=True)

    (tmp_path / 'folder').mkdir()
    with pytest.raises(FilterError, match='written in full, got "No such file or directory"'):
        write()


def test_what_is_no_cloud(tmp_path: Path) -> None:
    """Unknown suffixes, folders, missing files, and tables of other formats are refused."""
    (tmp_path / 'folder.las').mkdir()
    (tmp_path / 'cloud.ply').touch()
    for name, table, sentence in (
        ('cloud.pts', None, r"must be one of \.las \.laz .*, got '\.pts'"),
        ('cloud', None, "must be one of .*, got ''"),
        ('cloud.las', None, r'cloud\.las must be a file, got none'),
        ('folder.las', None, r'folder\.las must be a file, got a folder'),
        ('cloud.ply', 'points', r"given for a database only, not for \.ply, got 'points'"),
    ):
        with pytest.raises(CloudError, match=sentence):
            open_cloud(tmp_path / name, table)


@pytest.mark.parametrize(
    ('module', 'library', 'extra'),
    [('las', 'laspy', 'files'), ('pcd', 'lzf', 'files'), ('parquet', 'pyarrow', 'parquet')],
)
def test_missing_libraries(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, module: str, library: str, extra: str
) -> None:
    """Where a library is not installed, the sentence says how to install it."""
    path = tmp_path / f'cloud.{module}'
    path.touch()
    monkeypatch.delitem(sys.modules, f'lidar_outlier_filter.files.{module}', raising=False)
    monkeypatch.setitem(sys.modules, library, None)
    must_be = rf"must be installed, as by pip install 'lidar_outlier_filter\[{extra}\]', got none"
    with pytest.raises(CloudError, match=f'the module {library} for {path.suffix} files {must_be}'):
        open_cloud(path)


FULL = """
import resource, sys
from lidar_outlier_filter.cli.main import main
import lidar_outlier_filter.files.clean
resource.setrlimit(resource.RLIMIT_FSIZE, (200, 200))
print([main(['clean', '--chain', 'sor', path]) for path in sys.argv[1:]])
"""


def test_what_is_left_is_removed(tmp_path: Path) -> None:
    """A folder whose lock is free was left by a killed run; one that is held stays.

    So does one without a lock, which no run made, whatever its name.
    """
    output = tmp_path / 'out.las'
    for name in ('free', 'held', 'mine', 'empty', 'free-gone', 'mine-gone'):
        (tmp_path / f'.out.las.partial-{name}').mkdir()
    (tmp_path / '.out.las.partial-link').symlink_to(tmp_path)
    (tmp_path / '.other.las.partial-free').mkdir()
    for name in ('free', 'mine', 'free-gone', 'mine-gone'):
        (tmp_path / f'.out.las.partial-{name}' / 'below').mkdir()
        (tmp_path / f'.out.las.partial-{name}' / 'out.las').touch()
    for name in ('free', 'held', 'free-gone'):
        (tmp_path / f'.out.las.partial-{name}' / LOCK).touch()
    with (tmp_path / '.out.las.partial-held' / LOCK).open() as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        with hidden_folder(output) as folder, hidden_folder(output) as other:
            assert folder != other
            assert folder.is_dir()
    kept = ('held', 'link', 'mine', 'mine-gone')
    assert {path.name for path in tmp_path.iterdir()} == {
        '.other.las.partial-free',
        *(f'.out.las.partial-{name}' for name in kept),
    }
    for name in ('mine', 'mine-gone'):
        found = sorted(path.name for path in (tmp_path / f'.out.las.partial-{name}').iterdir())
        assert found == ['below', 'out.las']


def test_a_removal_that_is_killed_is_finished(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The lock is the last file that goes, so the next run knows whose the rest is."""
    original, removed = os.unlink, list[str]()

    def unlink(path: Any, *arguments: Any, **options: Any) -> None:
        removed.append(Path(path).name)
        original(path, *arguments, **options)

    monkeypatch.setattr(os, 'unlink', unlink)
    with hidden_folder(tmp_path / 'out') as folder:
        for name in ('.a', 'z'):
            (folder / name).touch()
    assert removed[-1] == LOCK


@pytest.mark.parametrize('moment', ['mkdtemp', '_take', 'before _take'])
def test_a_folder_removed_before_its_lock(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, moment: str
) -> None:
    """Where another run takes a folder without a lock for one that was left, a second is made."""
    output, calls = tmp_path / 'out.las', list[int]()
    name = moment.removeprefix('before ')
    original = getattr(new_files_module, name)

    def with_another_run(*given: object, **more: object) -> object:
        result = None if name != moment else original(*given, **more)
        if not calls:
            calls.append(1)
            with hidden_folder(output):
                pass
        return result if name == moment else original(*given, **more)

    monkeypatch.setattr(new_files_module, name, with_another_run)
    with hidden_folder(output) as folder:
        assert (folder / LOCK).is_file()
        assert list(tmp_path.iterdir()) == [folder]
    assert list(tmp_path.iterdir()) == []


KILLED = """
import os, signal, sys
from pathlib import Path
from lidar_outlier_filter.disk import new_files
from lidar_outlier_filter.disk.new_files import new_files as make
publish, left = new_files.publish, [int(sys.argv[1])]
def killed(built, path):
    if not left[0]:
        os.kill(os.getpid(), signal.SIGKILL)
    left[0] -= 1
    publish(built, path)
new_files.publish = killed
with make([Path(name) for name in sys.argv[2:]]) as built:
    for path in built:
        path.write_text(path.name)
"""


@pytest.mark.parametrize('named', [0, 1, 2])
def test_a_run_that_is_killed_between_two_names(tmp_path: Path, named: int) -> None:
    """The next run for the same outputs gives the rest their names, and refuses to do more."""
    (tmp_path / 'other').mkdir()
    paths = [tmp_path / 'a', tmp_path / 'other' / 'b', tmp_path / 'c']
    command = [sys.executable, '-c', KILLED, str(named), *map(str, paths)]
    assert subprocess.run(command, check=False).returncode == -signal.SIGKILL
    assert sum(path.exists() for path in paths) == named
    with pytest.raises(FilterError, match='which exists'), new_files(paths):
        pytest.fail('never comes here')
    assert [path.read_text() for path in paths] == ['a', 'b', 'c']
    for path in paths:
        path.unlink()
    with new_files(paths) as built:
        for path in built:
            path.write_text('new')
    assert [path.read_text() for path in paths] == ['new'] * 3
    assert (names(tmp_path), names(tmp_path / 'other')) == (['a', 'c', 'other'], ['b'])


def test_an_output_that_was_removed_since(tmp_path: Path) -> None:
    """Where somebody removed an output of a killed run, the rest of that run is removed, too."""
    paths = [tmp_path / 'a', tmp_path / 'b']
    command = [sys.executable, '-c', KILLED, '1', *map(str, paths)]
    assert subprocess.run(command, check=False).returncode == -signal.SIGKILL
    paths[0].unlink()
    with new_files(paths) as built:
        for path in built:
            path.write_text('new')
    assert [path.read_text() for path in paths] == ['new', 'new']
    assert names(tmp_path) == ['a', 'b']


def run_where_full(script: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run a script that limits its files; coverage would write its own within that limit."""
    env = {name: value for name, value in os.environ.items() if not name.startswith('COVERAGE')}
    command = [sys.executable, '-c', script, *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=True, env=env)


@pytest.mark.slow
def test_full_disk(tmp_path: Path) -> None:
    """Where no more can be written, one sentence names the output, and nothing is left."""
    paths = []
    for kind in FORMATS:
        suffix, _, form = kind.partition(' ')
        paths.append(tmp_path / f'cloud_{form}.{suffix}')
        whole_file(kind, paths[-1])
    done = run_where_full(FULL, *map(str, paths))
    assert done.stdout == f'{[1] * len(paths)}\n'
    sentences = done.stderr.splitlines()
    assert len(sentences) == len(paths)
    for sentence in sentences:
        assert sentence.startswith('the output ')
        assert 'must be written in full, got "' in sentence
    assert set(tmp_path.iterdir()) == set(paths)


def test_full_disk_of_arrays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Room for the arrays is taken before it is used: writing beyond it would kill the process."""

    def full(*_: int) -> None:
        raise OSError(28, 'No space left on device')

    monkeypatch.setattr(os, 'posix_fallocate', full)
    sentence = 'must be able to hold 2400 bytes beside the output, for --tile, got "No space left'
    with pytest.raises(CloudError, match=sentence):
        _allocator(tmp_path / 'out.las', 1.0)((100, 3))
    assert list(tmp_path.iterdir()) == []


# Replays ------------------------------------------------------------------------------------------

FULL_REPLAY = """
import resource, sys
from lidar_outlier_filter.cli.main import main
import lidar_outlier_filter.recordings.replay
limit = int(sys.argv[1])
resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
print(main(['replay', '--set', 'chain=[sor]', *sys.argv[2:]]))
"""


@pytest.mark.parametrize(('limit', 'more'), [(1000, []), (6000, ['--salvage'])])
def test_full_disk_of_a_replay(tmp_path: Path, limit: int, more: list[str]) -> None:
    """A disk that is full while the bag or a copy is written gives one sentence."""
    source, output = write_recording('folder', tmp_path), tmp_path / 'out'
    arguments = [str(limit), str(source), '--output', str(output), *more]
    done = run_where_full(FULL_REPLAY, *arguments)
    assert done.stdout == '1\n'
    sentence = done.stderr.splitlines()[-1]
    assert sentence.startswith(f'the output {tmp_path}/')
    assert sentence.endswith(' must be written in full, got "File too large"')
    assert list(tmp_path.iterdir()) == [source]


@pytest.mark.parametrize('more', [[], ['--salvage']])
@pytest.mark.parametrize('folder', ['/proc', '/no/such/folder'])
def test_target_that_cannot_be_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], folder: str, more: list[str]
) -> None:
    """A folder that is read-only or missing is refused in one sentence."""
    source = write_recording('mcap', tmp_path)
    command = ['replay', str(source), '--output', f'{folder}/out', '--set', 'chain=[sor]', *more]
    assert main(command) == 1
    sentence = capsys.readouterr().err.splitlines()[-1]
    must_be = 'the output must be in a folder that exists, got /no/such/folder/out'
    if folder == '/proc':
        must_be = f'the output {folder}/out must be written in full, got "'
    assert sentence.startswith(must_be)
