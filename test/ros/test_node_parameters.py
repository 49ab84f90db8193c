# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The parameters of the node: declared, set through its services, and read from files."""

from pathlib import Path

import pytest
from helpers import ROOT
from helpers.nodes import Ros, values
from rcl_interfaces.msg import ParameterDescriptor, ParameterType
from rclpy.qos import HistoryPolicy, ReliabilityPolicy

from lidar_outlier_filter.errors import ParameterError
from lidar_outlier_filter.parameters.filter import describe

# Windows that are as small as order 1 allows.
LINEAR = {
    'alpha_beta_gamma.order': 1,
    'alpha_beta_gamma.before': 3,
    'alpha_beta_gamma.after': 3,
}
CONFIG = ROOT / 'config'
TYPES = {
    bool: ParameterType.PARAMETER_BOOL,
    int: ParameterType.PARAMETER_INTEGER,
    float: ParameterType.PARAMETER_DOUBLE,
    str: ParameterType.PARAMETER_STRING,
    tuple: ParameterType.PARAMETER_STRING_ARRAY,
}


def test_every_parameter_is_declared_as_described(ros: Ros) -> None:
    """ROS is said text, unit, range, type, default and whether it is read-only, of each of them."""
    node = ros.filter()
    names = [item.name for item in describe()]
    descriptors = ros.wait(ros.parameters().describe_parameters(names)).descriptors
    assert len(descriptors) == len(names)
    for item, descriptor in zip(describe(), descriptors, strict=True):
        assert descriptor.name == item.name
        assert descriptor.type == TYPES[type(item.default)]
        assert item.text in descriptor.description
        assert item.unit in descriptor.description
        assert descriptor.additional_constraints == item.range_text
        assert descriptor.read_only == item.fixed
        assert limits(descriptor) == ([(item.low, item.high)] if item.low is not None else [])
        default = list(item.default) if isinstance(item.default, tuple) else item.default
        assert values(node)[item.name] == default


def limits(descriptor: ParameterDescriptor) -> list[tuple[float, float]]:
    """List the ranges, which sliders are made from."""
    ranges = [*descriptor.floating_point_range, *descriptor.integer_range]
    return [(item.from_value, item.to_value) for item in ranges]


@pytest.mark.parametrize(
    ('name', 'value', 'sentence'),
    [
        ('gap_factor', 0.5, 'gap_factor must be from 1 to 1e+06, got 0.5'),
        ('chain', ['magic'], "chain must be a list, without repetition, of one of 'alpha_beta"),
        ('alpha_beta_gamma.order', 2, 'at least order + 2 = 4, with sides: either, got 3 and 3'),
        ('block', 0.2, 'block must be 0.1 (read-only), got 0.2'),
        ('lof.treshold', 2.0, "them, got 'lof.treshold' (did you mean 'lof.threshold'?)"),
        ('unheard', 1, "one of this node, as ~/save_parameters writes them, got 'unheard"),
    ],
)
def test_what_makes_no_sense_is_refused(ros: Ros, name: str, value: object, sentence: str) -> None:
    """The refusal says in one sentence what, must be and got; nothing changes."""
    node = ros.filter(parameters=LINEAR)
    before = values(node)
    (reason,) = ros.set(**{name: value})
    assert sentence in reason
    assert '\n' not in reason
    assert values(node) == before


def test_all_or_nothing(ros: Ros) -> None:
    """Set atomically, parameters are checked with each other; one wrong one refuses them all."""
    node = ros.filter(parameters=LINEAR)
    before = values(node)
    reason = ros.set_together(alpha_beta_gamma__before=6, gap_factor=0.5)
    assert reason == 'gap_factor must be from 1 to 1e+06, got 0.5'
    reason = ros.set_together(alpha_beta_gamma__before=1, alpha_beta_gamma__after=1)
    assert reason.endswith('must be together at least order + 2 = 3, got 1 and 1')
    assert 'read-only' in ros.set_together(gap_factor=2.0, halo=0.02)
    assert "got 'unheard_of'" in ros.set_together(gap_factor=2.0, unheard_of=1)
    assert values(node) == before
    # Order 2 alone is refused, as for it the windows are too small.
    ros.set_together(alpha_beta_gamma__order=2, alpha_beta_gamma__before=4)
    changed = {'alpha_beta_gamma.before': 4, 'alpha_beta_gamma.order': 2}
    assert values(node) == before | changed


# Parameter files


@pytest.mark.parametrize('path', sorted(CONFIG.glob('*.yaml')), ids=lambda path: path.name)
def test_the_files_of_config_load(ros: Ros, path: Path) -> None:
    """Every file that the package ships is one for --params-file."""
    node = ros.filter('--params-file', str(path))
    assert node.has_parameter('block')


FILE = """
/**:
  ros__parameters:
    use_sim_time: true
    gap_factor: 3
    chain: [alpha_beta_gamma]
    alpha_beta_gamma:
      sigma: 1
      sides: both
    qos_overrides:
      /points:
        subscription: {reliability: reliable, depth: 7}
      /points/cleaned:
        publisher: {reliability: best_effort, depth: 8}
      /points/outliers:
        publisher: {history: keep_all}
"""


def test_a_file_for_everything(ros: Ros, tmp_path: Path) -> None:
    """Sections, whole numbers for floats, and what ROS itself declares, in one file."""
    path = tmp_path / 'parameters.yaml'
    path.write_text(FILE, encoding='utf-8')
    node = ros.filter('--params-file', str(path))
    node.start()
    assert node.get_parameter('use_sim_time').value is True
    changed = {
        'gap_factor': 3.0,
        'chain': ['alpha_beta_gamma'],
        'alpha_beta_gamma.sigma': 1.0,
        'alpha_beta_gamma.sides': 'both',
    }
    assert values(node) == {item.name: _plain(item.default) for item in describe()} | changed
    (points,) = (item for item in node.subscriptions if item.topic_name == '/points')
    assert points.qos_profile.reliability is ReliabilityPolicy.RELIABLE
    assert points.qos_profile.depth == 7
    assert (
        node.channels[0].publisher.cleaned.qos_profile.reliability is ReliabilityPolicy.BEST_EFFORT
    )
    assert node.channels[0].publisher.cleaned.qos_profile.depth == 8
    assert node.channels[0].publisher.outliers.qos_profile.history is HistoryPolicy.KEEP_ALL
    assert node.channels[0].publisher.outliers.qos_profile.reliability is ReliabilityPolicy.RELIABLE


def _plain(value: object) -> object:
    return list(value) if isinstance(value, tuple) else value


@pytest.mark.parametrize(
    ('values', 'sentence'),
    [
        (['gap_factr:=2'], r"a known one, got 'gap_factr' \(did you mean 'gap_factor'\?\)"),
        (['halo:=-1.0'], 'halo must be from 0 to 60 s, got -1.0'),
        (['chain:=[]'], 'chain must be a list of strings, got None'),
        (['max_delay:=0.05'], r'max_delay must be at least block \+ halo \+ lateness'),
        (
            ['alpha_beta_gamma.order:=2', 'alpha_beta_gamma.before:=3'],
            r'at least order \+ 2 = 4, with sides: either, got 3 and 3',
        ),
        (["inputs:=['/points', 'points']"], r"must be different topics, got \['/points', 'points'"),
        (
            ["inputs:=['a b']"],
            'a topic of inputs must be a topic name that ROS 2 allows',
        ),
        (["inputs:=['', 'a']"], r"must be a list, without repetition, of texts, got \['', 'a'\]"),
        (["inputs:=['a', 'a']"], r"must be a list, without repetition, of texts, got \['a', 'a'\]"),
        (["inputs:=['a', 'b']", 'motion.source:=odometry'], "must be 'none' or 'tf' with several"),
    ],
)
def test_refused_at_the_start(ros: Ros, values: list[str], sentence: str) -> None:
    """A node is not made with parameters that make no sense."""
    with pytest.raises(ParameterError, match=sentence):
        ros.filter(*(word for value in values for word in ('-p', value)))


def test_parameters_of_the_caller(ros: Ros) -> None:
    """A caller gives parameters as a mapping; they win over the command line."""
    given = {'gap_factor': 4, 'chain': ('alpha_beta_gamma',)}
    node = ros.filter('-p', 'gap_factor:=3', '-p', 'halo:=0.02', parameters=given)
    assert values(node)['gap_factor'] == 4.0
    assert values(node)['halo'] == 0.02
    with pytest.raises(ParameterError, match=r"one of .*, got 'none'"):
        ros.filter(parameters={'none': 1})
