# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Simulated clouds in memory: what is in them, and how they are to be judged."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from helpers.labelled import BAD, rows

from lidar_outlier_filter.parameters.filter import FilterParameters
from lidar_outlier_lab.results.samples import Sample, simulated
from lidar_outlier_lab.simulation import presets
from lidar_outlier_lab.simulation.world.recording import FRAME, START, Cloud

if TYPE_CHECKING:
    from collections.abc import Iterator

    import pytest


def made(monkeypatch: pytest.MonkeyPatch, clouds: list[Cloud]) -> list[Sample]:
    """Let a preset be these clouds."""

    def make(name: str, seed: int, progress: object) -> Iterator[Cloud]:
        assert (name, seed) == ('street-16', 7)
        assert callable(progress)
        return iter(clouds)

    monkeypatch.setattr(presets, 'make', make)
    return simulated('street-16', 7)


def test_a_recording_is_streamed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Several clouds of one topic are one sample, sweep by sweep where the sensor is the origin."""
    clouds = [Cloud(START + i * 10**8, START, rows(), frame='lidar') for i in range(2)]
    (sample,) = made(monkeypatch, clouds)
    assert (sample.name, sample.seed, len(sample.data)) == ('street-16', 7, 2 * len(BAD))
    assert sample.data.streamed
    assert sample.timed
    assert sample.in_own_frame
    np.testing.assert_array_equal(sample.data.bad, np.tile(BAD, 2))
    np.testing.assert_array_equal(sample.data.good, ~sample.data.bad)
    assert [len(xyz) for xyz in sample.clouds] == [len(BAD)] * 2
    assert (np.diff(sample.data.stretch) >= 0).all()


def test_what_stands_still_is_seen_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """In the frame of the map, filters without a stream get all clouds together."""
    clouds = [Cloud(START + i * 10**8, START, rows(), frame=FRAME) for i in range(2)]
    (sample,) = made(monkeypatch, clouds)
    assert not sample.in_own_frame
    assert [len(xyz) for xyz in sample.clouds] == [2 * len(BAD)]


def test_without_times_there_are_no_lines(monkeypatch: pytest.MonkeyPatch) -> None:
    """A cloud of one instant is judged as a whole, and not by the smoother."""
    cloud = rows()
    cloud['t'] = 0
    (sample,) = made(monkeypatch, [Cloud(START, START, cloud)])
    assert not sample.timed
    assert not sample.data.streamed
    assert not sample.suits(('lof', 'alpha_beta_gamma'))
    assert sample.suits(('lof',))
    verdict = sample.data.judge(FilterParameters().changed({'chain': ['sor']}))
    assert len(verdict) == len(BAD)
