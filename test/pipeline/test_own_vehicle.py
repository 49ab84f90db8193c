# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The own vehicle on its way: out of the cleaned clouds, and out of the detectors' sight."""

from collections import Counter
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pytest
from helpers.clouds import cloud, point_bytes
from helpers.own_vehicle import ROW, stamp, turn
from pyproj import CRS

from lidar_outlier_filter import CloudError, CloudFilter, ParameterError, detect_outliers
from lidar_outlier_filter.core.annotations import Rows
from lidar_outlier_filter.core.detectors.registry import reasons
from lidar_outlier_filter.core.points.mask import MaskLearner, as_text
from lidar_outlier_filter.files.clean import clean_file
from lidar_outlier_filter.files.judged_file import CleanOptions
from lidar_outlier_filter.messages.cloud import structured
from lidar_outlier_filter.messages.decoder import Decoder
from lidar_outlier_filter.parameters.declaration import MASKED, MASKED_REASON, SHADOW_REASON
from lidar_outlier_filter.parameters.filter import FilterParameters

CHAINS = [['boosted_trees'], ['sor'], ['sor', 'lof'], ['alpha_beta_gamma']]


@pytest.fixture(scope='module')
def mask(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Learn a mask of twelve turns."""
    learner, decoder = MaskLearner(10.0), Decoder(FilterParameters())
    for number in range(12):
        learner.add(decoder.decode(cloud(turn(number), stamp(number))))
    path = tmp_path_factory.mktemp('mask') / 'car.csv'
    path.write_text(as_text(learner.learn()))
    return str(path)


def results(
    turns: list[Rows], parameters: dict[str, Any], parts: int = 1
) -> tuple[list[Any], CloudFilter]:
    """Filter turns, each cut into so many messages."""
    made = CloudFilter(parameters)
    found = []
    for number, rows in enumerate(turns):
        for some in np.array_split(rows, parts):
            found += made.push(cloud(some, stamp(number)))
    return found + made.flush(), made


def rows_of(clouds: list[Any]) -> Counter[bytes]:
    """Count the points of some clouds, by their bytes."""
    return Counter(one for some in clouds for one in point_bytes(some))


@pytest.mark.parametrize('chain', CHAINS, ids=lambda chain: chain[0])
def test_the_rest_is_judged_as_if_it_were_not_there(chain: list[str], mask: str) -> None:
    """All of the vehicle is an outlier; all other verdicts are those of clouds without it."""
    turns = [turn(number, rain=5) for number in range(20, 23)]
    given = {'chain': chain, 'scores': True}
    with_mask, made = results(turns, given | {'mask': mask})
    without, other = results([rows[rows['own'] == 0] for rows in turns], given)
    found = [structured(result.outliers).reshape(-1) for result in with_mask]
    own = [rows['own'] == 1 for rows in found]
    for rows, is_own, result, alone in zip(found, own, with_mask, without, strict=True):
        assert (rows['outlier_detectors'] == MASKED).tolist() == is_own.tolist()
        assert np.isinf(rows['outlier_score'][is_own]).all()
        assert set(rows['outlier_reason'][is_own].tolist()) == {MASKED_REASON}
        assert set(rows['outlier_detector_number'][is_own].tolist()) == {15}
        assert rows[~is_own].tobytes() == structured(alone.outliers).tobytes()
        assert bytes(result.cleaned.data) == bytes(alone.cleaned.data)
    masked = sum(int(one.sum()) for one in own)
    assert masked == sum(int((rows['own'] == 1).sum()) for rows in turns) > 1000
    counts, alone = made.statistics, other.statistics
    assert counts.rejected['mask'] == masked
    assert (counts.outliers - masked, counts.untested) == (alone.outliers, alone.untested)
    assert (counts.invalid, counts.points) == (0, alone.points + masked)


@pytest.mark.parametrize('parts', [2, 7])
def test_partition_and_chunks(parts: int, mask: str) -> None:
    """However turns are cut: every point is once in one of the two, and always the same."""
    turns = [turn(number, rain=5) for number in range(20, 23)]
    given = {'chain': ['boosted_trees'], 'mask': mask, 'scores': True}
    whole, _ = results(turns, given)
    cut, _ = results(turns, given, parts)
    for side in ('cleaned', 'outliers'):
        one, other = ([getattr(a, side) for a in some] for some in (whole, cut))
        assert rows_of(one) == rows_of(other)
    plain, _ = results(turns, {'chain': ['boosted_trees'], 'mask': mask}, parts)
    both = rows_of([a.cleaned for a in plain]) + rows_of([a.outliers for a in plain])
    assert both == rows_of([cloud(rows) for rows in turns])


def test_missing_returns_beside_the_own_vehicle(mask: str) -> None:
    """Those that are left out are counted without the vehicle, which is an outlier."""
    rows = turn(30)
    rows['x'][rows['ring'] == 14] = np.nan
    given = {'chain': ['sor'], 'mask': mask, 'missing': 'drop'}
    found, made = results([rows], given)
    assert made.statistics.dropped == np.count_nonzero(rows['ring'] == 14) > 0
    both = rows_of([found[0].cleaned, found[0].outliers])
    assert both == rows_of([cloud(rows[rows['ring'] != 14])])


def test_tolerance(mask: str) -> None:
    """What is nearer or farther by more than the tolerance is not masked."""
    rows = turn(30)
    own = rows['own'] == 1
    for axis in 'xyz':
        rows[axis][own] *= (1.5 + 0.3) / 1.5
    given = {'chain': ['sor'], 'mask': mask}
    assert not detect_outliers(rows, parameters=given).masked.any()
    wider = given | {'mask_tolerance': 0.4}
    assert detect_outliers(rows, parameters=wider).masked[own].all()


def test_shadow(mask: str) -> None:
    """Points behind the vehicle are outliers for that reason; those in front and beside stay."""
    rows = turn(30)
    own = np.flatnonzero(rows['own'])
    behind, before = own[::7], own[3::7]
    beside = np.flatnonzero((np.roll(rows['own'], 32) == 1) & (rows['own'] == 0))
    for some, metres in ((behind, 6.0), (before, 0.7), (beside, 6.0)):
        scale = metres / np.sqrt(sum(rows[axis][some] ** 2 for axis in 'xyz'))
        for axis in 'xyz':
            rows[axis][some] *= scale
    given = {'chain': ['sor'], 'mask': mask, 'scores': True}
    assert not detect_outliers(rows, parameters=given).masked[behind].any()
    given['mask_shadow'] = True
    masked = detect_outliers(rows, parameters=given).masked
    assert masked[own[1::7]].all()
    assert not masked[[*before, *beside]].any()
    for parts in (1, 3):
        found, _ = results([rows], given, parts)
        outliers = np.concatenate([structured(one.outliers).reshape(-1) for one in found])
        shadow = outliers[outliers['outlier_reason'] == SHADOW_REASON]
        assert sorted(shadow[[*(ROW.names or ())]].tolist()) == sorted(rows[behind].tolist())
        assert (shadow['outlier_detectors'] == MASKED).all()
    assert reasons()[SHADOW_REASON].text == 'in the shadow of the own vehicle'
    with pytest.raises(ParameterError, match='mask_shadow must be false without a mask, got true'):
        FilterParameters().changed({'mask_shadow': True})


def test_shadow_needs_the_place_of_the_sensor(mask: str, tmp_path: Path) -> None:
    """A file in a coordinate system of the land does not have it, and is refused."""
    path = tmp_path / 'map.las'
    file = laspy.LasData(laspy.LasHeader(point_format=6, version='1.4'))
    file.header.add_crs(CRS.from_epsg(25832))
    file.x, file.y, file.z = np.ones((3, 1))
    file.add_extra_dim(laspy.ExtraBytesParams('ring', np.uint8))
    file.write(path)
    parameters = FilterParameters().changed({'mask': mask, 'mask_shadow': True, 'chain': ['sor']})
    with pytest.raises(ParameterError, match='which does not say where its sensor was'):
        clean_file(path, tmp_path / 'out.las', parameters)


def test_arrays_need_the_ring(mask: str) -> None:
    """Of plain arrays the line is the ring; without it a mask cannot be applied."""
    rows = turn(30)
    xyz = np.stack([rows[axis] for axis in 'xyz'], axis=1)
    given = {'chain': ['sor'], 'mask': mask}
    verdict = detect_outliers(xyz, line=rows['ring'], parameters=given)
    assert verdict.masked.tolist() == (rows['own'] == 1).tolist()
    said = 'line must be the ring of each point if mask is set, got none'
    with pytest.raises(CloudError, match=said):
        detect_outliers(xyz, parameters=given)
    with pytest.raises(CloudError, match='the rings of the sensor, by a field or by rows'):
        detect_outliers(rows[['x', 'y', 'z']], parameters=given)


def test_organised_clouds_keep_their_shape(mask: str) -> None:
    """Rows are rings where there is no such field; masked points become holes."""
    rows = turn(20).reshape(-1, 16).T.copy()
    bare = rows[['x', 'y', 'z']]
    made = CloudFilter({'chain': ['sor'], 'mask': mask, 'keep_organized': True})
    (result,) = made.push(cloud(bare, stamp(0))) + made.flush()
    holes = np.isnan(structured(result.cleaned)['x'])
    assert holes[rows['own'] == 1].all()


def test_files_are_cleaned_of_it(mask: str, tmp_path: Path) -> None:
    """A file with rings is masked, too, with scan lines or without, in tiles or in one piece."""
    rows = turn(20)
    path = tmp_path / 'turn.csv'
    columns = ('x', 'y', 'z', 'ring', 'own')
    np.savetxt(
        path,
        np.stack([rows[name] for name in columns], axis=1),
        fmt='%.6f,%.6f,%.6f,%d,%d',
        header=','.join(columns),
        comments='',
    )
    parameters = FilterParameters().changed({'chain': ['sor'], 'mask': mask})
    for tile in (0.0, 30.0):
        report = clean_file(path, tmp_path / f'out{tile}.csv', parameters, CleanOptions(tile=tile))
        assert report.rejected_by['mask'] == np.count_nonzero(rows['own'])
        assert report.rejected == sum(report.rejected_by.values())
        assert (report.invalid, report.untested) == (0, 0)
    short = tmp_path / 'short.csv'
    short.write_text('x,y,z\n1,2,3\n')
    with pytest.raises(CloudError, match='the line column must be of a usual name, such as ring'):
        clean_file(short, tmp_path / 'no.csv', parameters)


def test_what_is_refused(mask: str, tmp_path: Path) -> None:
    """A mask that is not there, an empty name, and one mask for several sensors."""
    with pytest.raises(ParameterError, match=r'the mask .* must be a readable file'):
        CloudFilter({'mask': str(tmp_path / 'none.csv'), 'chain': ['sor']})
    with pytest.raises(ParameterError, match="mask must be a file, or 'off', got ''"):
        FilterParameters().changed({'mask': ''})
    with pytest.raises(ParameterError, match="mask must be 'off' with several inputs"):
        FilterParameters().changed({'mask': mask, 'inputs': ['left', 'right']})
    assert FilterParameters().changed({'mask': False}).mask == 'off'  # YAML reads the word so
    made = CloudFilter({'mask': mask, 'chain': ['sor'], 'line_source': 'message'})
    with pytest.raises(CloudError, match='the scan lines must be the rings of the sensor'):
        made.push(cloud(turn(0), stamp(0)))
    assert made.statistics.refused == 1
