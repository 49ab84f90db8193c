# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A program that unpacks the points of a LAZ file to stdout; :mod:`.las` starts it.

On damaged bytes the library for LAZ may end its process, print its stack, or ask for any amount of
memory. So it runs apart, with a limit. Nothing else is imported: it starts in some hundredths of a
second.
"""

import resource
import struct
import sys
from collections.abc import Sequence
from typing import Any, BinaryIO
from zlib import crc32

MAX_MEMORY_BYTES = 2**31  # bytes
VARIABLE = 2**32 - 1  # the size of chunks that differ
LAYERED = 3  # compressor


def main(arguments: Sequence[str]) -> int:
    """Check the point count by the chunks, then write the points as in a LAS file.

    Arguments: folder of the library, file, LASzip record (hex), offset of the points, selection
    of fields, size of a point, count, points per write (0: only check), and the checksum of the
    table of chunks (-1: any). The last line on stderr is the error.
    """
    library, path, record, *numbers = arguments
    begin, selection, size, count, rows, table = map(int, numbers)
    most = resource.getrlimit(resource.RLIMIT_DATA)[1]
    limit = MAX_MEMORY_BYTES if most == resource.RLIM_INFINITY else min(most, MAX_MEMORY_BYTES)
    resource.setrlimit(resource.RLIMIT_DATA, (limit, most))
    sys.path.insert(0, library)
    import lazrs  # noqa: PLC0415  its folder is known now

    try:
        laszip, parts = bytes.fromhex(record), lazrs.DecompressionSelection(selection)
        with open(path, 'rb') as source:  # noqa: PTH123  pathlib takes longer to import
            found = _count(source, lazrs, laszip, begin, size, count)
            if found != count:
                raise ValueError(f'{found} points instead of {count}')  # noqa: TRY301
            if not rows:
                return 0
            if table >= 0:
                source.seek(begin)
                chunks = lazrs.read_chunk_table(source, lazrs.LazVlr(laszip))
                if checksum(chunks) != table:
                    raise ValueError('other chunks than those of its octree')  # noqa: TRY301
            source.seek(begin)
            try:
                unpacker = lazrs.ParLasZipDecompressor(source, laszip, parts)
            except lazrs.LazrsError:  # points without chunks
                source.seek(begin)
                unpacker = lazrs.LasZipDecompressor(source, laszip, parts)
            for first in range(0, count, rows):
                data = bytearray(size * min(rows, count - first))
                unpacker.decompress_many(data)
                sys.stdout.buffer.write(data)
            sys.stdout.buffer.flush()
    except BrokenPipeError:  # the reader has stopped
        return 1
    except BaseException as err:  # noqa: BLE001  a panic of the library is no Exception
        text = ' '.join(str(err).split())
        sys.stderr.write(f'\n{text}')
        return 1
    return 0


def checksum(chunks: Sequence[tuple[int, int]]) -> int:
    """Return the checksum of the points and bytes of all chunks with points."""
    return crc32(b''.join(struct.pack('<QQ', *one) for one in chunks if one[0]))


def _count(  # noqa: PLR0913  where the points are
    source: BinaryIO, lazrs: Any, laszip: bytes, begin: int, size: int, said: int
) -> int:
    """Count the points in the table of chunks.

    Chunks of point formats 6 to 10 count their points. Of the others the size
    of the last chunk is unknown: then the header is trusted, up to a whole chunk.
    """
    vlr = lazrs.LazVlr(laszip)
    if vlr.item_size() != size:
        raise ValueError(f'points of {vlr.item_size()} bytes instead of {size}')
    compressor, chunk_size = struct.unpack_from('<H10xI', laszip)
    if compressor < 2:  # noqa: PLR2004  LASzip's number for chunks
        return said
    source.seek(begin)
    chunks = lazrs.read_chunk_table(source, vlr)
    if not chunks:
        return 0
    most, last = sum(int(points) for points, _ in chunks), int(chunks[-1][0])
    if compressor == LAYERED and chunks[-1][1]:
        source.seek(begin + 8 + sum(length for _, length in chunks[:-1]) + size)
        return most - last + int.from_bytes(source.read(4), 'little')
    fewest = most if chunk_size == VARIABLE else most - last + 1
    return min(max(said, fewest), most)


if __name__ == '__main__':
    sys.exit(main(sys.argv[1:]))
