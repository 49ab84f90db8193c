# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Peers in C++, compiled when they are measured: PCL where it is installed, and a ring filter.

PCL's libraries, as Debian packages them, come without AVX; so these are compiled without, too.
"""

from __future__ import annotations

import subprocess
from contextlib import contextmanager
from ctypes import CDLL, c_double, c_int, c_int64
from ctypes.util import find_library
from importlib.resources import files
from pathlib import Path
from shutil import which
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.ctypeslib import ndpointer

from lidar_outlier_filter.errors import FilterError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from lidar_outlier_filter.core.annotations import Bools, Singles

SOURCE = 'native_peers.cpp'
LIBRARIES = tuple(f'pcl_{name}' for name in ('filters', 'search', 'kdtree', 'common'))
ARGUMENTS = {  # of each function, between the coordinates and the result
    'pcl_sor': (c_int64, c_int, c_double),
    'pcl_dror': (c_int64, c_int, c_double, c_double),
    'ring_filter': (*(ndpointer(kind, 1, flags='C') for kind in ('f4', 'f4', 'u2')), c_int64),
}


class NativePeers:
    """The compiled peers. Points are float32 (N, 3), metres; each says which ones it rejects."""

    def __init__(self, library: CDLL) -> None:
        """Declare the functions that the library has."""
        self._library = library
        self.has_pcl = hasattr(library, 'pcl_sor')
        xyz, rejected = ndpointer('f4', 2, flags='C'), ndpointer('u1', 1, flags='C')
        for name, arguments in ARGUMENTS.items():
            if hasattr(library, name):
                function = getattr(library, name)
                function.argtypes, function.restype = (xyz, *arguments, rejected), None

    def _run(self, name: str, xyz: Singles, *arguments: object) -> Bools:
        rejected = np.zeros(len(xyz), np.uint8)
        getattr(self._library, name)(xyz, *arguments, rejected)
        return rejected.view(np.bool_)

    def sor(self, xyz: Singles, count: int, deviations: float) -> Bools:
        """Run PCL's SOR; ``count`` neighbours, the point itself among them, as in Open3D."""
        return self._run('pcl_sor', xyz, len(xyz), count - 1, deviations)

    def dror(self, xyz: Singles, others: int, radius: float, factor: float) -> Bools:
        """Run DROR on PCL's kd-tree: ``others`` within a radius, or within a part of the range."""
        return self._run('pcl_dror', xyz, len(xyz), others, radius, factor)

    def rings(
        self, xyz: Singles, azimuth: Singles, distance: Singles, ring: NDArray[np.uint16]
    ) -> Bools:
        """Run Autoware's ring filter on points in the order of time; radians, metres."""
        return self._run('ring_filter', xyz, azimuth, distance, ring, len(xyz))


@contextmanager
def native_peers() -> Iterator[NativePeers | None]:
    """Compile the peers as long as they are needed; None without a compiler."""
    compiler = which('c++')
    if compiler is None:
        yield None
        return
    with TemporaryDirectory() as folder:
        path = Path(folder) / 'peers.so'
        code = files(__package__).joinpath(SOURCE).read_bytes()
        command = [compiler, '-x', 'c++', '-std=c++17', '-O3', '-shared', '-fPIC', *_pcl()]
        done = subprocess.run(  # noqa: S603  the compiler of this machine
            [*command, '-o', str(path)], input=code, capture_output=True, check=False
        )
        if done.returncode:
            raise FilterError(SOURCE, 'compiled', done.stderr.decode(errors='replace'))
        yield NativePeers(CDLL(str(path)))


def _pcl() -> list[Any]:
    """Name PCL's headers and libraries to the compiler, where all libraries are installed."""
    names = [find_library(name) for name in LIBRARIES]
    if None in names:
        return ['-']
    headers = [*sorted(Path('/usr/include').glob('pcl-*')), '/usr/include/eigen3']
    options = [f'-I{folder}' for folder in headers]
    return ['-DWITH_PCL', *options, '-', '-x', 'none', *(f'-l:{name}' for name in names)]
