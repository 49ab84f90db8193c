# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""How a recording was made: versions, seeds and parameters, in ``custom_data`` of its metadata."""

import json
from collections.abc import Mapping
from typing import Any

from lidar_outlier_filter import __version__
from lidar_outlier_filter.parameters.filter import WITHOUT_EFFECT, FilterParameters

PREFIX = 'lidar_outlier_filter.'  # of the keys; the name of the command follows


def made_by(
    command: str, parameters: FilterParameters | None = None, **said: Any
) -> dict[str, str]:
    """Write the entry of a command: this version, what it was given, and changed parameters."""
    entry: dict[str, Any] = {'version': __version__, **said}
    if parameters is not None:
        default = FilterParameters().flat()
        given = parameters.flat().items()
        entry['parameters'] = {
            name: value
            for name, value in given
            if value != default[name] and name not in WITHOUT_EFFECT
        }
    return {PREFIX + command: json.dumps(entry)}


def history(custom_data: Mapping[str, str]) -> dict[str, Any]:
    """Return the entries that commands of this package have left, by command."""
    found: dict[str, Any] = {}
    for key, text in custom_data.items():
        if key.startswith(PREFIX):
            try:
                found[key.removeprefix(PREFIX)] = json.loads(text)
            except (ValueError, RecursionError):  # written by somebody else
                found[key.removeprefix(PREFIX)] = text
    return found
