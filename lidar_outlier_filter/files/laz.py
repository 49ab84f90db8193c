# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Points of LAZ files, unpacked by a process of their own.

On damaged bytes the library for LAZ may end the process it runs in, or print its stack. So nothing
of it but the sentence reaches who reads.
"""

from __future__ import annotations

import signal
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import laspy
import lazrs
import numpy as np
from laspy import DecompressionSelection as Parts

from lidar_outlier_filter.errors import CloudError, said_by
from lidar_outlier_filter.files import unpack_laz

if TYPE_CHECKING:
    from collections.abc import Iterator
    from io import BufferedReader

    from numpy.typing import NDArray


def unpacked(path: Path, header: laspy.LasHeader, parts: Parts, rows: int) -> Iterator[Any]:
    """Give the points of a LAZ file, so many at once, as laspy does.

    Raises
    ------
    CloudError
        If they cannot be unpacked.

    """
    count, each = header.point_count, header.point_format.size
    selection = sum(
        getattr(lazrs, f'SELECTIVE_DECOMPRESS_{part.name}') for part in Parts if part in parts
    )
    if not count:
        return
    command = [
        *(sys.executable, '-I', '-S', str(Path(unpack_laz.__file__))),
        str(Path(lazrs.__file__).parents[1]),
        str(path.absolute()),
        header.vlrs.get('LasZipVlr')[0].record_data_bytes().hex(),
        *(str(n) for n in (header.offset_to_point_data, selection, each, count, rows)),
    ]
    with (
        tempfile.TemporaryFile() as said,
        # In a session of its own: Ctrl-C is for who reads.
        subprocess.Popen(  # noqa: S603  no shell; all but the path are numbers
            command, stdout=subprocess.PIPE, stderr=said, start_new_session=True
        ) as process,
    ):
        stream = cast('BufferedReader', process.stdout)
        try:
            for first in range(0, count, rows):
                data = np.empty(min(rows, count - first), header.point_format.dtype())
                if not _fill(stream, data):
                    said.seek(0)
                    raise CloudError(
                        f'the file {path}', 'readable', _what_ended(process, said.read())
                    )
                yield laspy.ScaleAwarePointRecord(
                    data, header.point_format, header.scales, header.offsets
                )
        finally:
            process.kill()


def _fill(stream: BufferedReader, data: NDArray[Any]) -> bool:
    """Read the next points; return whether all came."""
    return stream.readinto(data.view(np.uint8).data) == data.nbytes


def _what_ended(process: subprocess.Popen[bytes], said: bytes) -> str:
    status = process.wait()
    if status < 0:
        return f'"the library for LAZ ended by {signal.Signals(-status).name}"'
    text = said.decode(errors='replace').rpartition(unpack_laz.ERROR)[2]
    return said_by(RuntimeError(text))
