# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A table that is shown in the terminal and written into a page alike."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from rich.table import Table

from lidar_outlier_lab.results import markdown

if TYPE_CHECKING:
    from collections.abc import Sequence


class Sheet(NamedTuple):
    """One table: its title, the heads of its columns, and its rows; all but the first are numbers.

    ``head`` and ``rows`` are texts.
    """

    title: str
    head: Sequence[str]
    rows: Sequence[Sequence[str]]

    def shown(self) -> Table:
        """Return it for the terminal."""
        found = Table(*self.head, title=self.title)
        for column in found.columns[1:]:
            column.justify = 'right'
        for row in self.rows:
            found.add_row(*row)
        return found

    def written(self) -> str:
        """Return it for a page."""
        return f'### {self.title}\n\n{markdown.table(self.head, self.rows)}'
