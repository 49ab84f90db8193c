# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Who gives a command what another one takes reads what to type, in the sentence of the refusal."""

from __future__ import annotations

import shutil
from typing import TYPE_CHECKING

import pytest

from lidar_outlier_filter.cli.main import main

if TYPE_CHECKING:
    from pathlib import Path

RUN = 'lidar-outlier-filter'


@pytest.fixture
def here(recordings: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Work where there are a recording, a folder of one, a file of points and a folder of one."""
    bag = recordings / 'bags' / 'vlp16_mrpt_mcap'
    for name in ('my_recording', 'drives/a'):
        shutil.copytree(bag, tmp_path / name)
    (tmp_path / 'strips').mkdir()
    for name in ('plane.laz', 'strips/a.laz'):
        shutil.copy(recordings / 'clouds' / 'plane.laz', tmp_path / name)
    (tmp_path / 'cloud.xyz').write_text('1.0 2.0 3.0\n2.0 3.0 4.0\n')
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(
    ('wrong', 'right'),
    [
        ('replay plane.laz', f'{RUN} clean plane.laz filters a file of points'),
        ('replay cloud.xyz', f'{RUN} clean cloud.xyz filters a file of points'),
        ('clean my_recording', f'{RUN} replay my_recording filters a recording'),
        ('clean drives', f'{RUN} replay drives filters a folder of recordings'),
        ('info drives', f'it is a folder of recordings, so name one: {RUN} info drives/a'),
        ('report drives', f'it is a folder of recordings, so name one: {RUN} report drives/a'),
        ('tune drives', f'it is a folder of recordings, so name one: {RUN} tune drives/a'),
        ('replay strips', f'it is a folder of files, so name them: {RUN} clean strips/*.laz'),
        ('info strips', f'it is a folder of files, so name them: {RUN} info strips/a.laz'),
        (
            'clean cloud.xyz',
            f'it has no names on top: {RUN} clean cloud.xyz --columns 1,2,3 counts them',
        ),
    ],
)
@pytest.mark.usefixtures('here')
def test_the_right_verb_is_named(
    wrong: str, right: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """One sentence, which ends with what to type."""
    assert main(wrong.split()) == 1
    said = capsys.readouterr().err
    assert said.endswith(f'; {right}\n')
    assert said.count('\n') == 1


@pytest.mark.parametrize('command', ['replay my_recording --set block=9999', 'info nothing.laz'])
@pytest.mark.usefixtures('here')
def test_the_right_one_is_not_named_again(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    """What is refused for another reason ends with what was got."""
    assert main(command.split()) == 1
    assert RUN not in capsys.readouterr().err


@pytest.mark.parametrize('command', ['replay my_recording', 'clean plane.laz'])
@pytest.mark.usefixtures('here')
def test_a_list_is_shown(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Detectors with commas between, as --chain takes them, are no list in YAML."""
    assert main([*command.split(), '--set', 'chain=lof,sor']) == 1
    assert capsys.readouterr().err == (
        "the value of chain must be a list, as in chain=[lof,sor], got 'lof,sor'\n"
    )
