# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""How one drive is judged in each of the forms that drivers send it in."""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from hashlib import sha256

import numpy as np

from lidar_outlier_filter.core.annotations import Bools, Progress
from lidar_outlier_filter.core.engine.stream_cloud import StreamCloud
from lidar_outlier_filter.errors import CloudError
from lidar_outlier_filter.evaluation.confusion import Confusion, confusion
from lidar_outlier_filter.pipeline.library import CloudFilter
from lidar_outlier_lab.results.markdown import NOTHING, folded, number, paragraphs, table
from lidar_outlier_lab.simulation.forms import FORMS, form_clouds
from lidar_outlier_lab.simulation.scenes.mapping_streets import street
from lidar_outlier_lab.simulation.world.drive import Drive
from lidar_outlier_lab.simulation.world.recording import to_message

SEED = 1
CLASSIC = {'chain': ['alpha_beta_gamma', 'quadric', 'lof']}  # config/classic.yaml
COUNTS = ('found', 'lost', 'F1')
MAX_SAID = 6  # sentences of a form that are written
HEAD = ('form', *COUNTS, 'verdicts', *COUNTS, 'lines/s', 'judged by')
RATE = re.compile(r'([\d.]+) (?:turns|swings)/s')


@dataclass(frozen=True)
class JudgedForm:
    """What came of a form.

    Attributes
    ----------
    counts : of its points
    said : the sentences of the log, and those of refused messages; each once, in order
    methods : of the default, and how many blocks each judged
    digest : of what is rejected: equal ones are equal verdicts of the same returns

    """

    counts: Confusion
    said: tuple[str, ...]
    methods: tuple[str, ...]
    digest: str

    @property
    def rate(self) -> str:
        """Turns per second that were found, or a dash."""
        found = [match[1] for match in map(RATE.search, self.said) if match]
        return ', '.join(dict.fromkeys(found)) or NOTHING

    @property
    def method(self) -> str:
        """What judged, and the first refusal."""
        refused = [text for text in self.said if ' must be ' in text]
        return '; '.join((*self.methods, *refused[:1])) or NOTHING


def judge(
    name: str,
    parameters: Mapping[str, object],
    seed: int = SEED,
    draw: Callable[[int], Drive] = street,
) -> JudgedForm:
    """Filter a drive in a form as live messages, and count by its labels.

    Points of messages that are refused are not rejected.
    """
    said: list[str] = []
    rejected: list[Bools] = []
    bad, there = [], []
    filters = CloudFilter(parameters, said.append, said.append)
    filters.refuse = lambda err: said.append(str(err))
    filters.fail = lambda err: said.append(str(err))
    sent: list[object] = []

    def show(cloud: StreamCloud, msg: object) -> None:
        index = next(i for i, one in enumerate(sent) if one is msg)
        rejected[index] = np.asarray(cloud.verdict.rejected)

    filters.show.append(show)
    for cloud in form_clouds(name, seed, draw):
        bad.append(cloud.points['label'].ravel() > 0)
        there.append(np.isfinite(cloud.points['x']).ravel())
        rejected.append(np.zeros(cloud.points.size, np.bool_))
        sent.append(to_message(cloud.stamp, cloud.points, cloud.frame))
        try:
            filters.push(sent[-1])
        except CloudError as err:
            said.append(str(err))
    filters.flush()
    seen = np.concatenate(there)
    result = np.concatenate(rejected)[seen]
    return JudgedForm(
        confusion(np.concatenate(bad)[seen], result),
        tuple(dict.fromkeys(said)),
        tuple(f'{what}: {n} blocks' for what, n in filters.statistics.methods.items()),
        sha256(result.tobytes()).hexdigest(),
    )


def section(
    progress: Progress,
    names: Sequence[str] = tuple(FORMS),
    seed: int = SEED,
    draw: Callable[[int], Drive] = street,
) -> str:
    """Write the table of all forms, and what each made the filter say."""
    rows, sentences = [], []
    for done, name in enumerate(names):
        progress(done, len(names), f'form {name}')
        default, classic = (judge(name, how, seed, draw) for how in ({}, CLASSIC))
        counts = [str(n) for one in (default, classic) for n in _counts(one)]
        rows.append([f'`{name}`: {FORMS[name].sentence}', *counts, default.rate, default.method])
        rows[-1].insert(4, f'`{default.digest[:6]}`')
        sentences.append(f'* `{name}`: {" / ".join(default.said[:MAX_SAID])}')
    sensor = draw(seed).sensor
    return paragraphs(
        '## Forms of one drive',
        f'A drive of a scanner of {sensor.lines_per_second:.2f} turns of {sensor.shots_per_line} '
        f'shots a second, seed {seed}, as drivers send it: outliers found, good points lost, and '
        'F1, of the default and of `config/classic.yaml`. The same returns, but for other heads, '
        'mirrors and echoes. Forms with the same sum of `verdicts` are judged alike, point by '
        'point.',
        table(HEAD, rows),
        folded('What the default said of each', '\n'.join(sentences)),
    )


def _counts(one: JudgedForm) -> tuple[int, int, str]:
    return one.counts.found, one.counts.lost, number(one.counts.f1)
