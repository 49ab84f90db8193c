# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What makes no sense in a command line is refused in one sentence, and nothing is written."""

import os
import shlex
import shutil
from pathlib import Path

import pytest
from helpers.drives import write_drive
from helpers.hostile import whole_file

from lidar_outlier_filter.cli.main import main

RUN = 'lidar-outlier-filter'
REFUSED = {
    # Files
    'clean cloud.obj': 'the file cloud.obj must be one of .las .laz .pcd .ply',
    'clean none.las': 'the file none.las must be a file, got none\n',
    'clean a.pcd --chain sor --set max_points=10': 'the number of points of',
    'clean a.pcd --tile nan': '--tile must be at least 0 and finite, got nan',
    'clean a.pcd --output a.pcd': 'must be a new file, got a.pcd, which exists; remove it, or name',
    'clean a.pcd --output b.ply': 'the output must be in the format of a.pcd',
    'clean a.pcd --output no/b.pcd': 'the output must be in a folder that exists, got no/b.pcd',
    'clean a.laz --output no/b.laz': 'the output must be in a folder that exists',
    'clean a.laz --output strips/a.laz': 'the output must be a new file, got strips/a.laz',
    'clean a.pcd --rejected remove --outliers b.pcd': 'the treatment of rejected points',
    'clean a.pcd --outliers a_cleaned.pcd': 'the outputs must be different files',
    'clean a.pcd a.laz --output cloud.xyz': '--output of several files must be',
    'clean a.pcd a.laz --outliers b.pcd': '--outliers must be given for one file',
    'clean a.laz --only-classes ground': '--only-classes must be whole numbers, with',
    'clean a.laz --keep-classes 300': 'a class must be from 0 to 255, got 300',
    'clean a.laz --jobs 0': '--jobs must be at least 1, got 0',
    'clean a.laz --rejected remove --mark noise': 'how rejected points are marked must be',
    'clean a.laz --rejected remove --old-class': 'the column of old classes must be left out',
    'clean a.laz --mark noise --mark-class 9': 'the class of rejected points must be 7, unless',
    'clean a.laz --mark-class 256': 'the class of rejected points must be from 0 to ',
    'clean a.laz --output b.copc.laz': 'must be LAZ without an octree, as the file',
    # Recordings
    'replay drive --topic /nowhere': "a topic to filter must be one of /lidar, got '/nowhere'",
    'replay drive --output .': 'the output must be a new folder, got ., which exists',
    'replay drives --output=drives/out': 'the output must be outside of ',
    'replay drives --output=drives': 'the output must be outside of ',
    'replay drives --set=sor.k=none': 'sor.k must be a whole number',
    'replay drives --jobs=0': '--jobs must be at least 1, got 0',
    'replay drives --scheduler=tcp://x --jobs=2': '--jobs must be left out with --scheduler',
    'replay drives/a --scheduler tcp://x': '--scheduler must be for several',
    'info none.MCAP': 'the recording none.MCAP must be readable, got ',
    'info none': 'none',
    'info x.mcap --sample -1': '--sample must be at least 0 and finite, got -1',
    'info x.mcap --sample nan': '--sample must be at least 0 and finite, got nan',
    # Truth
    'evaluate drive --topic /x': "one of those with '/cleaned' and '/outliers' (none), got '/x'",
    'tune drive --labels nowhere.npy': 'the file nowhere.npy must be a file, got none',
    'evaluate a.csv --labels empty': 'the labels must be with files, got empty, empty',
    'evaluate a.csv --output .': 'the output must be a new folder, got ., which exists',
    'evaluate a.csv --output no/where': 'the output must be in a folder that exists, got no/where',
    'tune drive --topic /x': "one of its topics of clouds (/lidar), got '/x'",
    'tune drive --inject 0.1 --codes 7': '--inject must be given without labels, got both',
    'tune drive --search lof.k=1 --search lof.k=2': '--search must be given once for lof.k, got ',
    'tune drive --search order': "--search must be NAME=V,V,..., got 'order'",
    "tune drive --search 'lof.k=: :'": "must be YAML, got ': :'",
    'tune drive --output .': 'the output must be a new file, got ., which exists',
    # Parameters
    'clean a.pcd --set sor.k=0': 'sor.k must be from 1 to 1000, got 0',
    'clean a.pcd --set chain=lof,sor': "as in chain=[lof,sor], got 'lof,sor'",
    'replay drive --set block': "--set must be NAME=VALUE, got 'block'",
    "replay drive --set 'block=: :'": "the value of block must be YAML, got ': :'",
    'replay drive --set block=long': "block must be a number, got 'long'",
    'replay drive --params missing.yaml': 'missing.yaml must be a readable YAML file, got',
    # An empty argument would be the working folder.
    "clean ''": "an argument must be not empty, got ''",
    "info ''": "an argument must be not empty, got ''\n",
    'clean a.pcd --output=': "an argument must be not empty, got '--output='\n",
    # To open a pipe would wait for ever, wherever it is named.
    'info pipe': 'got a pipe or device',
    'replay pipe': 'got a pipe or device',
    'clean a.pcd --set=mask=pipe': 'got a pipe or device',
    'evaluate a.csv --labels=pipe': 'got a pipe or device',
    'evaluate a.csv --verdict=x --labels=labels': '1.label must be a file, got a pipe or device',
    'clean a.pcd --params pipe.yaml': 'the mask pipe must be a readable file',
    # What to type instead
    'replay a.laz': f'; {RUN} clean a.laz filters a file of points\n',
    'clean drive': f'; {RUN} replay drive filters a recording\n',
    'clean drives': f'; {RUN} replay drives filters a folder of recordings\n',
    'info drives': f'; it is a folder of recordings, so name one: {RUN} info drives/a\n',
    'replay strips': f'; {RUN} clean strips filters a folder of files\n',
    'info strips': f'; it is a folder of files, so name one: {RUN} info strips/a.laz\n',
    'clean cloud.xyz': 'read with --columns 1,2,3 (it has no header)',
    'info nothing.laz': ', got none\n',
}


@pytest.fixture(scope='module')
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Make a recording, a folder of one, files of points, a folder of one, and pipes."""
    folder = tmp_path_factory.mktemp('here')
    for name in ('drives', 'strips', 'labels', 'empty'):
        (folder / name).mkdir()
    write_drive(folder / 'drive', 3)
    shutil.copytree(folder / 'drive', folder / 'drives/a')
    for path in ('a.laz', 'strips/a.laz'):
        whole_file('laz', folder / path)
    whole_file('pcd ascii', folder / 'a.pcd')
    (folder / 'a.csv').write_text('x,y,z\n0,0,0\n')
    (folder / 'cloud.xyz').write_text('1.0 2.0 3.0\n2.0 3.0 4.0\n')
    (folder / 'pipe.yaml').write_text('/**:\n  ros__parameters:\n    mask: pipe\n')
    for path in ('pipe', 'labels/1.label'):
        os.mkfifo(folder / path)
    return folder


@pytest.mark.parametrize('line', REFUSED)
def test_refused_in_one_sentence(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], line: str
) -> None:
    """The exit status is 1."""
    monkeypatch.chdir(folder)
    before = sorted(folder.rglob('*'))
    assert main(shlex.split(line)) == 1
    printed = capsys.readouterr()
    assert REFUSED[line] in printed.err.replace(f'{folder}/', '')
    assert (printed.out, printed.err.count('\n')) == ('', 1)
    assert sorted(folder.rglob('*')) == before
