# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The rejected points of a file as a list: CSV, or a GeoPackage, which GIS programs open as a map.

A GeoPackage is an SQLite database with tables of the standard (OGC 12-128r18): no library is
needed, and GDAL's would take as long to write it.
"""

import csv
import sqlite3
import struct
from collections.abc import Iterator
from contextlib import closing
from functools import cache
from pathlib import Path

import numpy as np

from lidar_outlier_filter.core.annotations import Floats, Ints
from lidar_outlier_filter.core.detectors.registry import DETECTORS, bits, reasons
from lidar_outlier_filter.errors import FilterError, refusing
from lidar_outlier_filter.files import cloud_file
from lidar_outlier_filter.files.judged_file import JudgedFile

LISTS = ('.csv', '.gpkg')  # suffixes
_ABOUT = ('point', 'score', 'detectors', 'reason')  # columns beside the coordinates

_UNDEFINED, _OF_FILE = -1, 100_000  # numbers of coordinate systems
_HAS_Z = 1001  # well-known binary: a point with z
# Of version 1.3. Nobody reads the file before it is whole, so no journal is needed.
_TABLES = """
PRAGMA journal_mode = OFF; PRAGMA synchronous = OFF;
PRAGMA application_id = 0x47504B47; PRAGMA user_version = 10300;
CREATE TABLE gpkg_spatial_ref_sys (srs_name TEXT NOT NULL, srs_id INTEGER PRIMARY KEY,
    organization TEXT NOT NULL, organization_coordsys_id INTEGER NOT NULL,
    definition TEXT NOT NULL, description TEXT);
CREATE TABLE gpkg_contents (table_name TEXT NOT NULL PRIMARY KEY, data_type TEXT NOT NULL,
    identifier TEXT UNIQUE, description TEXT DEFAULT '', last_change DATETIME NOT NULL
    DEFAULT (strftime('%Y-%m-%dT%H:%M:%fZ', 'now')), min_x DOUBLE, min_y DOUBLE, max_x DOUBLE,
    max_y DOUBLE, srs_id INTEGER REFERENCES gpkg_spatial_ref_sys(srs_id));
CREATE TABLE gpkg_geometry_columns (table_name TEXT NOT NULL UNIQUE
    REFERENCES gpkg_contents(table_name), column_name TEXT NOT NULL,
    geometry_type_name TEXT NOT NULL, srs_id INTEGER NOT NULL
    REFERENCES gpkg_spatial_ref_sys(srs_id), z TINYINT NOT NULL, m TINYINT NOT NULL,
    PRIMARY KEY (table_name, column_name));
CREATE TABLE rejected (fid INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, geom POINT,
    point INTEGER, score REAL, detectors TEXT, reason TEXT);
INSERT INTO gpkg_spatial_ref_sys VALUES
    ('Undefined cartesian', -1, 'NONE', -1, 'undefined', NULL),
    ('Undefined geographic', 0, 'NONE', 0, 'undefined', NULL),
    ('WGS 84', 4326, 'EPSG', 4326, 'GEOGCS["WGS 84",DATUM["WGS_1984",SPHEROID["WGS 84",6378137,'
    || '298.257223563]],PRIMEM["Greenwich",0],UNIT["degree",0.0174532925199433]]', NULL);
"""


def write_rejected(judged: JudgedFile, path: Path, built: Path) -> None:
    """Write every rejected point of a file to a CSV or GeoPackage, which is built elsewhere.

    Each has its index in the file, from 0 on, its coordinates in the unit and the coordinate system
    of the file, the largest score, the detectors that reject it, and the reason in words; see
    ``CleanOptions.reasons``.

    Raises
    ------
    FilterError
        If it cannot be written.

    """
    write = _write_csv if path.suffix.lower() == LISTS[0] else _write_geopackage
    with refusing(FilterError, f'the output {path}', 'written in full', sqlite3.Error):
        write(judged, built)


def _chunks(judged: JudgedFile) -> Iterator[tuple[Floats, list[tuple[object, ...]]]]:
    """Yield coordinates (n, 3) of rejected points, in units of the file, and ``_ABOUT`` of each."""
    verdict, begin = judged.verdict, 0
    for values in cloud_file.read(judged.file, judged.coordinates):
        where: Ints = begin + np.flatnonzero(verdict.rejected[begin : begin + len(values[0])])
        xyz = np.zeros((len(where), 3))
        for axis, column in enumerate(values):
            xyz[:, axis] = column[where - begin]
        words = map(_words, verdict.detectors[where].tolist(), verdict.reason[where].tolist())
        rows = zip(where.tolist(), verdict.score[where].tolist(), words, strict=True)
        yield xyz, [(index, score, *said) for index, score, said in rows]
        begin += len(values[0])


@cache
def _words(detectors: int, reason: int) -> tuple[str, str]:
    """Name the detectors that reject a point, and say why."""
    names = [name for name, bit in bits().items() if detectors & bit]
    if reason in reasons():
        return ' '.join(names), reasons()[reason].text
    texts = (DETECTORS[name].rejects.partition(':')[0].replace('`', '') for name in names)
    return ' '.join(names), '; '.join(texts)


def _write_csv(judged: JudgedFile, path: Path) -> None:
    with path.open('w', encoding='utf-8', newline='') as stream:
        writer = csv.writer(stream, lineterminator='\n')
        writer.writerow(('x', 'y', 'z', *_ABOUT))
        for xyz, about in _chunks(judged):
            writer.writerows((*place, *one) for place, one in zip(xyz.tolist(), about, strict=True))


def _write_geopackage(judged: JudgedFile, path: Path) -> None:
    name, system = judged.file.crs, judged.file.wkt
    number = _OF_FILE if system else _UNDEFINED
    # Magic, version 0, little-endian without envelope, coordinate system; then the shape.
    head = struct.pack('<2sBBiBI', b'GP', 0, 1, number, 1, _HAS_Z)
    layout = np.dtype([('head', f'V{len(head)}'), ('xyz', '<f8', 3)])
    insert = f'INSERT INTO rejected (geom, {", ".join(_ABOUT)}) VALUES (?, ?, ?, ?, ?)'  # noqa: S608  names of our own
    low = high = np.full(2, np.nan)  # which SQLite takes as null
    with closing(sqlite3.connect(path)) as database, database:
        database.executescript(_TABLES)
        if system:
            row = (name, number, 'NONE', number, system, None)
            database.execute('INSERT INTO gpkg_spatial_ref_sys VALUES (?, ?, ?, ?, ?, ?)', row)
        columns = ('rejected', 'geom', 'POINT', number, 1, 0)
        database.execute('INSERT INTO gpkg_geometry_columns VALUES (?, ?, ?, ?, ?, ?)', columns)
        for xyz, about in _chunks(judged):
            shapes = np.empty(len(xyz), layout)
            shapes['head'], shapes['xyz'] = np.void(head), xyz
            blobs = shapes.view(f'V{layout.itemsize}').tolist()
            rows = ((blob, *one) for blob, one in zip(blobs, about, strict=True))
            database.executemany(insert, rows)
            corners = np.vstack([low, high, xyz[:, :2]])
            low, high = np.fmin.reduce(corners), np.fmax.reduce(corners)
        contents = ('rejected', 'features', judged.file.path.name, number, *low, *high)
        names = 'table_name, data_type, identifier, srs_id, min_x, min_y, max_x, max_y'
        values = f'gpkg_contents ({names}) VALUES (?, ?, ?, ?, ?, ?, ?, ?)'
        database.execute(f'INSERT INTO {values}', contents)
