# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Labels from foreign files, scores beside them, and what codes mean."""

from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pyarrow as pa
import pytest
from pyarrow import csv, parquet

from lidar_outlier_filter.errors import FilterError, RecordingError
from lidar_outlier_filter.evaluation import labels
from lidar_outlier_filter.evaluation.judged import read_files

CODE = np.array([0, 7, 1, 18, 7, 65])
SCORE = np.array([0.5, 3.0, 1.0, np.nan, 1.0000001, 0.25])


def las(path: Path, classes: Any, **columns: Any) -> Path:
    """Write a LAS file with these classes and further dimensions."""
    header = laspy.LasHeader(point_format=6, version='1.4')
    header.scales = np.full(3, 0.001)
    for name, values in columns.items():
        header.add_extra_dim(laspy.ExtraBytesParams(name, np.asarray(values).dtype))
    data = laspy.LasData(header)
    data.x = data.y = data.z = np.arange(len(classes)) + 1.0
    data.classification = classes
    for name, values in columns.items():
        data[name] = values
    data.write(path)
    return path


def table(path: Path, **columns: Any) -> Path:
    """Write a table as CSV or Parquet."""
    made = pa.table(columns)
    (csv.write_csv if path.suffix == '.csv' else parquet.write_table)(made, path)
    return path


def test_formats(tmp_path: Path) -> None:
    """Labels and scores of every format; an empty cell of a table is an untested point."""
    kitti = tmp_path / '000000.label'  # the instance is in the upper 16 bits
    np.array([0, 1, 40, 1 | (77 << 16), 40 | (65535 << 16)], '<u4').tofile(kitti)
    np.testing.assert_array_equal(labels.read_codes(kitti), [0, 1, 40, 1, 40])
    np.save(tmp_path / 'a.npy', CODE.astype(np.float32))
    np.testing.assert_array_equal(labels.read_codes(tmp_path / 'a.npy'), CODE)
    path = las(tmp_path / 'a.laz', CODE, truth=np.arange(6).astype(np.uint8))
    np.testing.assert_array_equal(labels.read_codes(path), CODE)
    np.testing.assert_array_equal(labels.read_codes(path, 'truth'), np.arange(6))
    scores = pa.array([None if np.isnan(score) else score for score in SCORE])
    for suffix in ('csv', 'parquet'):
        path = table(tmp_path / f'a.{suffix}', x=np.zeros(6), label=CODE, score=scores)
        np.testing.assert_array_equal(labels.read_codes(path), CODE)
        np.testing.assert_array_equal(labels.read_column(path, 'score'), SCORE)


@pytest.mark.parametrize(
    ('codes', 'bad', 'counted'),
    [
        (labels.ALL_BUT_0, [0, 1, 1, 1, 1, 1], [1, 1, 1, 1, 1, 1]),
        (labels.USUAL_CODES['.laz'], [0, 1, 0, 1, 1, 0], [1, 1, 1, 1, 1, 1]),
        (labels.USUAL_CODES['.label'], [0, 0, 1, 0, 0, 0], [0, 1, 1, 1, 1, 1]),
    ],
)
def test_usual_codes(codes: labels.Codes, bad: list[int], counted: list[int]) -> None:
    """All but 0; low and high noise of LAS; class 1 of SemanticKITTI, where 0 does not count."""
    np.testing.assert_array_equal(codes.bad(CODE), bad)
    np.testing.assert_array_equal(codes.counted(CODE), counted)


def test_parsed_codes() -> None:
    """Single codes and ranges, both ends included; anything else is refused with an example."""
    assert labels.parse_codes('7,18') == {7, 18}
    assert labels.parse_codes('1-3, 110,0-0') == {0, 1, 2, 3, 110}
    for text in ('', 'x', '3-1', '1-', '-1', '70000', '1.5', '1,,2', '²'):
        with pytest.raises(FilterError, match=r"numbers up to 65535 as in '7,18' or '1-5', got"):
            labels.parse_codes(text)


def test_recordings_are_told_from_files(tmp_path: Path) -> None:
    """A folder and what bags are called; anything else has a value for each point."""
    assert labels.is_recording(tmp_path)
    assert all(labels.is_recording(tmp_path / name) for name in ('a', 'a.mcap', 'a.db3', 'A.BAG'))
    names = ('a.npy', 'a.laz', 'a.csv', 'a.label', 'a.db')
    assert not any(labels.is_recording(tmp_path / name) for name in names)


def test_refused_files(tmp_path: Path) -> None:
    """Each in one sentence that names the file."""
    (tmp_path / 'odd.label').write_bytes(b'12345')
    np.save(tmp_path / 'flat.npy', np.zeros((2, 3)))
    np.save(tmp_path / 'text.npy', np.array(['a']))
    np.save(tmp_path / 'half.npy', np.array([1.0, 0.5]))
    np.save(tmp_path / 'nan.npy', np.array([np.nan]))
    np.save(tmp_path / 'large.npy', np.array([1, -70000]))
    np.save(tmp_path / 'pickle.npy', np.array([{}], object))
    (tmp_path / 'broken.las').write_bytes(b'LASF')
    table(tmp_path / 'a.csv', x=[1.0])
    for name, match in (
        ('odd.label', r'the size of .*odd\.label must be a multiple of 4 bytes, got 5'),
        ('flat.npy', r'must be one number for each point, got float64 \(2, 3\)'),
        ('text.npy', r'must be one number for each point, got <U1 \(1,\)'),
        ('half.npy', r'must be whole numbers up to 65535, got 0\.5'),
        ('nan.npy', r'must be whole numbers up to 65535, got nan'),
        ('large.npy', r'must be whole numbers up to 65535, got -70000'),
        ('pickle.npy', r'pickle\.npy must be readable, got .*allow_pickle=False'),
        ('broken.las', r'the header of .*broken\.las must be of at least 227 bytes, got 4'),
        ('none.npy', r'none\.npy must be a file, got none'),
        ('a.csv', r"must be one of x, got 'code'"),
        ('a.odt', r'the file .*a\.odt must be one of \.las'),
    ):
        with pytest.raises(FilterError, match=match) as caught:
            labels.read_codes(tmp_path / name, 'code')
        assert '\n' not in str(caught.value)


# Files with verdicts -----------------------------------------------------------------------------


def test_scores_and_labels(tmp_path: Path) -> None:
    """A point is rejected above the threshold, not at it; an untested one is kept."""
    np.save(tmp_path / 'score.npy', SCORE)
    np.save(tmp_path / 'code.npy', CODE)
    pair = (tmp_path / 'score.npy', tmp_path / 'code.npy')
    points = read_files(*pair, labels.Codes(frozenset({7, 18})))
    np.testing.assert_array_equal(points.rejected, [0, 1, 0, 0, 1, 0])
    np.testing.assert_array_equal(points.bad, [0, 1, 0, 1, 1, 0])
    np.testing.assert_array_equal(points.index, np.arange(6))
    points = read_files(*pair, threshold=0.25)
    np.testing.assert_array_equal(points.rejected, [1, 1, 1, 0, 1, 0])


def test_what_clean_wrote_in_las(tmp_path: Path) -> None:
    """Rejected are the classes 7 and 18, the truth are those of the file before it was cleaned."""
    before = las(tmp_path / 'before.laz', [1, 65, 65, 2, 1, 1])
    after = las(tmp_path / 'after.laz', [1, 7, 65, 7, 18, 1])
    points = read_files(after, before, labels.Codes(frozenset({65})))
    np.testing.assert_array_equal(points.rejected, [0, 1, 0, 1, 1, 0])
    np.testing.assert_array_equal(points.bad, [0, 1, 1, 0, 0, 0])
    assert points.score is None


def test_what_clean_wrote_in_tables(tmp_path: Path) -> None:
    """The column outlier says what was rejected, whatever the scores are, as under a vote."""
    columns = {
        'label': [0, 1, 1, 0, 0, 0],
        'outlier': [0, 1, 0, 0, 1, 0],
        'outlier_score': [0.5, 3.0, 2.0, 0.1, 1.5, 0.25],
        'outlier_detectors': [0, 5, 4, 0, 5, 0],
    }
    path = table(tmp_path / 'a.parquet', **columns)
    points = read_files(path, path)
    np.testing.assert_array_equal(points.rejected, columns['outlier'])
    np.testing.assert_array_equal(points.detectors, columns['outlier_detectors'])
    np.testing.assert_array_equal(points.score, columns['outlier_score'])
    # Asked for, the score decides.
    for points in (
        read_files(path, path, score='outlier_score'),
        read_files(path, path, threshold=1.0),
    ):
        np.testing.assert_array_equal(points.rejected, [0, 1, 1, 0, 1, 0])
    points = read_files(path, path, verdict='outlier_detectors')
    np.testing.assert_array_equal(points.rejected, [0, 1, 1, 0, 1, 0])


def test_refused_pairs(tmp_path: Path) -> None:
    """One column cannot be both; numbers must fit; columns must be there."""
    np.save(tmp_path / 'six.npy', SCORE)
    np.save(tmp_path / 'five.npy', CODE[:5])
    cloud, plain = las(tmp_path / 'a.las', CODE), table(tmp_path / 'a.csv', x=[1.0] * 6)
    for verdicts, truth, threshold, match in (
        (tmp_path / 'six.npy', tmp_path / 'five.npy', None, 'must be equal, got 5 and 6'),
        (cloud, cloud, None, "another than that of the verdicts, got 'classification'"),
        (plain, cloud, None, 'must be with outlier or classification, got x'),
        (cloud, plain, None, 'must be with classification or label, got x'),
        (plain, cloud, 2.0, 'must be with outlier_score, got x'),
    ):
        with pytest.raises(FilterError, match=match):
            read_files(verdicts, truth, threshold=threshold)


@pytest.mark.parametrize(
    ('names', 'got'),
    [
        (['a.label', 'b.label'], 'a.label and b.label'),
        (['1_1.label', '1_2.label', '2_2.label'], '1_2.label and 2_2.label'),
        (['1.label', '01.label'], '1.label'),
        (['1.label', '1_2.label'], '1.label and 1_2.label'),
    ],
)
def test_names_without_one_number(tmp_path: Path, names: list[str], got: str) -> None:
    """Names of label files that differ in more than one number, or less, are refused."""
    for name in names:
        (tmp_path / name).touch()
    with pytest.raises(RecordingError, match='must be alike but for one number') as caught:
        labels.by_number(tmp_path)
    assert got in str(caught.value)
