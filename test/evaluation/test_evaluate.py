# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The command evaluate: what it prints, writes and refuses, of recordings and of files."""

import json
import subprocess
import sys
from pathlib import Path

import laspy
import numpy as np
import pytest
from helpers.labelled import REJECTED, SCORED, TRUTH, results, rows, write
from helpers.programs import TIMEOUT
from sklearn import metrics

from lidar_outlier_filter import __version__
from lidar_outlier_filter.cli.evaluate import label_files, read_recording
from lidar_outlier_filter.cli.main import main

Capture = pytest.CaptureFixture[str]

FILES = {'evaluation.json', 'roc.png', 'roc.svg', 'precision_recall.png', 'precision_recall.svg'}


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    """Record outputs with scores: four clouds of eight points."""
    clouds = [rows(SCORED)] * 4
    return write(tmp_path / 'bag', {'/lidar': clouds, **results(clouds, [REJECTED] * 4)})


def printed(capsys: Capture) -> list[str]:
    """Return the lines that were printed, each with single spaces."""
    return [' '.join(line.split()) for line in capsys.readouterr().out.splitlines()]


def test_recording(bag: Path, tmp_path: Path, capsys: Capture) -> None:
    """Figures are printed; numbers and pictures are written where asked for, twice the same."""
    for name in ('a', 'b'):
        assert main(['evaluate', str(bag), '--output', str(tmp_path / name)]) == 0
        lines = printed(capsys)
        assert 'points 32' in lines
        assert 'outliers identified, recall 8 66.67 % outliers 39.06 % – 86.19 %' in lines
        assert 'exhaust 8 4 50.00 % 21.52 % – 78.48 %' in lines
        assert lines[-1] == f'written to {tmp_path / name}'
        assert {path.name for path in (tmp_path / name).iterdir()} == FILES
    for name in FILES:
        assert (tmp_path / 'a' / name).read_bytes() == (tmp_path / 'b' / name).read_bytes()
    found = json.loads((tmp_path / 'a' / 'evaluation.json').read_text(encoding='utf-8'))
    assert (found['found'], found['missed'], found['lost'], found['kept']) == (8, 4, 4, 16)
    points = read_recording(bag)
    assert points.score is not None
    score = np.nan_to_num(points.score, nan=-1.0)
    assert found['auc'] == pytest.approx(metrics.roc_auc_score(points.bad, score))


def test_label_files(bag: Path, tmp_path: Path, capsys: Capture) -> None:
    """A folder of label files, one for each cloud; 1 is the outlier, 0 does not count."""
    folder = tmp_path / 'labels'
    folder.mkdir()
    code = np.where(TRUTH[:, 0] == 0, 40, 1)
    code[0] = 0
    for i in range(4):
        code.astype('<u4').tofile(folder / f'{i:06}.label')
    assert main(['evaluate', str(bag), '--labels', str(folder)]) == 0
    lines = printed(capsys)
    assert 'points 28' in lines
    assert 'outlier 12 8 66.67 % 39.06 % – 86.19 %' in lines
    named = [part for path in sorted(folder.iterdir()) for part in ('--labels', str(path))]
    assert main(['evaluate', *named, str(bag)]) == 0
    assert printed(capsys) == lines


def test_folders_of_labels(tmp_path: Path) -> None:
    """Files of a folder are taken by their numbers; folders and what is hidden are not."""
    (tmp_path / 'c').mkdir()
    (tmp_path / '.directory').touch()
    for names in (
        ['alone.label'],
        ['drive3_9.label', 'drive3_10.label', 'drive3_011.label'],
        ['1700000000.999999999.npy', '1700000001.000000001.npy', '1700000002_000000000.npy'],
    ):
        for name in reversed(names):
            (tmp_path / name).touch()
        assert [path.name for path in label_files([tmp_path])] == names
        for name in names:
            (tmp_path / name).unlink()
    assert label_files([tmp_path / 'x', tmp_path]) == [tmp_path / 'x', tmp_path]


def test_withheld_points_are_named(tmp_path: Path, capsys: Capture) -> None:
    """After ``clean --mark withheld`` classes hold no verdict: figures of them would be wrong."""
    truth, output = tmp_path / 'truth.las', tmp_path / 'marked.las'
    for path, marked in ((truth, False), (output, True)):
        cloud = laspy.LasData(laspy.LasHeader(point_format=6, version='1.4'))
        cloud.x = cloud.y = cloud.z = np.arange(9.0)
        cloud.classification = np.where(np.arange(9) == 4, 1 if marked else 7, 2).astype(np.uint8)
        cloud.withheld = ((np.arange(9) == 4) & marked).astype(np.uint8)
        cloud.write(path)
    command = ['evaluate', str(output), '--labels', str(truth)]
    assert main(command) == 1
    assert 'by --verdict withheld or --verdict classification, got 1' in capsys.readouterr().err
    for name, recall in (('withheld', '1 100.00 %'), ('classification', '0 0.00 %')):
        assert main([*command, '--verdict', name]) == 0
        assert any(f'recall {recall}' in line for line in printed(capsys))


def test_how_it_was_made(tmp_path: Path) -> None:
    """Versions, seeds and parameters of all steps are in the metadata, and in the evaluation."""
    drive, cleaned, found = (tmp_path / name for name in ('drive', 'cleaned', 'found'))
    steps = [
        ['simulate', 'sotoodeh-hod', '--seed', '3', '--output', str(drive)],
        ['replay', str(drive), '--set', 'chain=[lof]', '--output', str(cleaned)],
        ['evaluate', str(cleaned), '--codes', '1-9', '--output', str(found)],
    ]
    assert [main(step) for step in steps] == [0, 0, 0]
    made = json.loads((found / 'evaluation.json').read_text())['made']
    history = made['history']
    assert {made['version'], *(entry['version'] for entry in history.values())} == {__version__}
    assert made['codes'] == '1-9'
    assert (history['simulate']['preset'], history['simulate']['seed']) == ('sotoodeh-hod', 3)
    assert history['replay']['parameters'] == {'chain': ['lof']}


def test_how_a_file_was_made(tmp_path: Path) -> None:
    """By the log of clean, where it lies beside the file; a log of others says nothing."""
    rows = ''.join(f'{i % 9},{i % 7},{i / 10},{i % 2}\n' for i in range(50))
    (cloud := tmp_path / 'a.csv').write_text(f'x,y,z,label\n{rows}')
    assert main(['clean', str(cloud), '--chain', 'lof', '--set', 'lof.min_pts=7']) == 0
    output = tmp_path / 'a_cleaned.csv'
    log = output.with_name('a_cleaned.csv.json')
    for name, text in (('ours', log.read_text()), ('others', '[1]'), ('deep', '[' * 99_999)):
        log.write_text(text)
        assert main(['evaluate', str(output), '--output', str(tmp_path / name)]) == 0
        made = json.loads((tmp_path / name / 'evaluation.json').read_text())['made']
        if name == 'ours':
            assert made['history']['clean']['parameters']['lof.min_pts'] == 7
        else:
            assert made['history'] == {}


def test_a_reader_that_stops(bag: Path, tmp_path: Path) -> None:
    """As ``| head`` does: what --output asks for is written before anything is printed."""
    command = [sys.executable, '-m', 'lidar_outlier_filter.cli.main', 'evaluate', str(bag)]
    command += ['--output', str(tmp_path / 'a')]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        process.stdout.close()
        process.wait(TIMEOUT)
    assert {path.name for path in (tmp_path / 'a').iterdir()} == FILES
