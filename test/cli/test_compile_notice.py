# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A command says that it compiles kernels, which, once, and about how long that takes."""

from __future__ import annotations

import os
import subprocess
import sys
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

import pytest
from helpers.watching import fresh_copy
from numba import njit

from lidar_outlier_filter.cli.compile_notice import notice
from lidar_outlier_filter.core.detectors.registry import DETECTORS
from lidar_outlier_filter.core.kernels.compile_listeners import listeners
from lidar_outlier_filter.core.kernels.compiling import NotCompiled, only_compiled
from lidar_outlier_filter.pipeline.compiling import SHARED_SECONDS

if TYPE_CHECKING:
    from pathlib import Path

PACKAGE = 'lidar_outlier_filter'


def seconds(name: str) -> int:
    """Return what a detector declares."""
    return DETECTORS[name].kernels.seconds


SAID = f'the kernels of sor are compiled, this once: about {seconds("sor")} s\n'


@pytest.mark.slow
def test_the_first_run_says_what_is_compiled(tmp_path: Path) -> None:
    """The second run compiles nothing, and says nothing of it."""
    env = os.environ | fresh_copy(tmp_path, 'detector._average-*.nb?')
    file = tmp_path / 'cloud.csv'
    rows = (f'{n % 20},{n // 20},{n % 3 / 10}\n' for n in range(400))
    file.write_text('x,y,z\n' + ''.join(rows))
    command = [sys.executable, '-P', '-m', f'{PACKAGE}.cli.main', 'clean', str(file), '--dry-run']
    first, second = (
        subprocess.run(
            [*command, '--chain', 'sor'], env=env, capture_output=True, text=True, check=True
        ).stderr
        for _ in range(2)
    )
    assert first.count(SAID) == 1
    assert 'compiled' not in second


def test_each_part_is_said_once(capsys: pytest.CaptureFixture[str]) -> None:
    """A detector's own kernels by its name, those of the core as shared; strangers' not at all."""
    say_once = notice()
    pattern = dict(DETECTORS['boosted_trees'].kernels.parts)['pattern']
    boosted_trees = 'detectors.boosted_trees'
    inside = ('pattern.judge', 'pattern.window', 'pattern.profile_groups', 'survey.near')
    modules = [f'{boosted_trees}.{name}' for name in inside]
    for module in ('detectors.lof', 'kernels', *modules):
        say_once(f'{PACKAGE}.core.{module}')
        say_once(f'{PACKAGE}.core.{module}')
    say_once('lidar_outlier_lab.simulation.world.caster')
    say_once('somebody.else')
    assert capsys.readouterr().err.splitlines() == [
        f'the kernels of lof are compiled, this once: about {seconds("lof")} s',
        f'the kernels that all share are compiled, this once: about {SHARED_SECONDS} s',
        f'the kernels of boosted_trees, pattern, are compiled, this once: about {pattern} s',
        'the kernels of boosted_trees, profile groups, are compiled, this once: about 6 s',
        'the kernels of boosted_trees are compiled, this once',
        'the kernels of lidar_outlier_lab are compiled, this once',
    ]


def test_parts_are_there() -> None:
    """Each part that a detector declares is a package or a module of it."""
    for one in DETECTORS.values():
        for name, took in one.kernels.parts:
            assert find_spec(f'{one.home}.{name}') is not None
            assert 0 < took < one.kernels.seconds


def test_asking_is_not_compiling() -> None:
    """Listeners learn which module is compiled, and nothing where kernels are only asked for."""
    # Without a cache: what was kept of another run would be used.
    add: Any = njit(lambda x: x + 1)
    compiled: list[str] = []
    listeners.append(compiled.append)
    try:
        with only_compiled(), pytest.raises(NotCompiled):
            add(1)
        assert compiled == []
        assert add(1) == 2
    finally:
        listeners.remove(compiled.append)
    assert compiled == [__name__]
