# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Names are those of the field; names that were replaced do not come back."""

import io
import tokenize

import pytest
from helpers import ROOT

REPLACED = frozenset(
    """
    AGAIN ANSWERS Answer ByWhom FEWEST HURRY Hands JoinedAnswer Kinds LEAST MOST Made Mounting
    MovingStream Order PATIENCE Places SHED Seen Way amid answer answered answers apart_kernel
    begin_anew can_shed company dials evidence find_places glare hurry hurry_oldest inner_kernel
    lonely look look_around looks measure_again places said_by shed unmoved wanted ways
    """.split()  # noqa: SIM905  a list of 46 lines
)
FOLDERS = ('lidar_outlier_filter', 'lidar_outlier_lab', 'benchmarks', 'test', 'launch', 'doc')


@pytest.mark.parametrize('folder', FOLDERS)
def test_no_replaced_name_is_used(folder: str) -> None:
    """No module, function, class, argument or variable has such a name."""
    found = set()
    for path in (ROOT / folder).rglob('*.py'):
        names = tokenize.generate_tokens(io.StringIO(path.read_text('utf-8')).readline)
        used = {token.string for token in names if token.type == tokenize.NAME} | {path.stem}
        found |= {(path.name, name) for name in used & REPLACED}
    assert found == set()
