# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters as a Python program gives them: some by name, the chain by itself."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from lidar_outlier_filter.errors import ParameterError
from lidar_outlier_filter.parameters.filter import FilterParameters

if TYPE_CHECKING:
    from collections.abc import Sequence


def gather(parameters: object, chain: Sequence[str] | None = None) -> FilterParameters:
    """Make a set of parameters; what is not given has its default.

    Parameters
    ----------
    parameters : mapping of flat names to values, or FilterParameters; optional
        Values may be numpy's numbers.
    chain : sequence of str, optional
        The detectors, in their order.

    Raises
    ------
    ParameterError
        If a name is unknown, a value makes no sense, or the chain is given twice.

    """
    if isinstance(parameters, FilterParameters):
        return parameters if chain is None else parameters.changed({'chain': chain})
    if not isinstance(parameters, Mapping | None):
        must_be = "a mapping as in {'max_points': 1000}"
        raise ParameterError('the parameters', must_be, repr(parameters))
    values = dict(parameters or {})
    if chain is not None:
        if 'chain' in values:
            raise ParameterError('chain', 'given once', 'another one among the parameters')
        values['chain'] = chain
    plain = {
        name: value.item() if isinstance(value, np.generic) else value
        for name, value in values.items()
    }
    return FilterParameters().changed(plain)
