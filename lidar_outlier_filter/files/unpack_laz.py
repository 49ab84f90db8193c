# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A program that unpacks the points of a LAZ file: see :mod:`.laz`, which starts it.

It imports nothing but the library for LAZ, so that it starts in some hundredths of a second.
"""

from __future__ import annotations

import sys

ERROR = 'error: '  # in front of what was wrong, which comes last on stderr


def main() -> int:
    """Write points as they are in a LAS file to stdout."""
    library, path, record = sys.argv[1:4]
    begin, selection, size, count, rows = (int(word) for word in sys.argv[4:])
    sys.path.insert(0, library)
    import lazrs  # noqa: PLC0415  where it lies is known now

    laszip, parts = bytes.fromhex(record), lazrs.DecompressionSelection(selection)
    try:
        with open(path, 'rb') as source:  # noqa: PTH123  pathlib takes longer to import
            source.seek(begin)
            try:
                unpacker = lazrs.ParLasZipDecompressor(source, laszip, parts)
            except lazrs.LazrsError:  # of points that are in no chunks
                source.seek(begin)
                unpacker = lazrs.LasZipDecompressor(source, laszip, parts)
            for first in range(0, count, rows):
                data = bytearray(size * min(rows, count - first))
                unpacker.decompress_many(data)
                sys.stdout.buffer.write(data)
            sys.stdout.buffer.flush()
    except BrokenPipeError:  # nobody reads on
        return 1
    except BaseException as err:  # noqa: BLE001  so the library ends where it comes upon what cannot be
        sys.stderr.write(f'\n{ERROR}{err}')
        return 1
    return 0


if __name__ == '__main__':
    sys.exit(main())
