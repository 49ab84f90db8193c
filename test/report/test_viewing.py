# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What viewers are said to show is what the node publishes."""

import json
import re
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import yaml
from helpers import ROOT
from helpers.nodes import PLOTTED, Ros, flush, line, process

from lidar_outlier_filter.messages.cloud import NUMBER, first_numbers
from lidar_outlier_filter.parameters.declaration import MASKED
from lidar_outlier_filter.parameters.yaml_files import NODE_NAME

CONFIG = ROOT / 'config'


def published(ros: Ros) -> tuple[dict[str, str], set[str]]:
    """Return the topics of a node with their types, and the fields of its outlier clouds."""
    node = ros.filter(parameters={'scores': True})
    process(node, line(0.0))
    (output,) = flush(node)
    fields = {str(field.name) for field in output.outliers.fields}
    node.start()
    listed = node.get_publisher_names_and_types_by_node(NODE_NAME, '/')
    return {name: kinds[0] for name, kinds in listed}, fields


def range_of_numbers() -> tuple[int, int]:
    """Return the range of all numbers, with that of the own vehicle, over which colours spread."""
    first, last = first_numbers(np.array([1, MASKED], np.uint16)).tolist()
    return first, last


def test_rviz(ros: Ros) -> None:
    """Both clouds, received however they are sent; outliers in a colour for each detector."""
    topics, fields = published(ros)
    tree = yaml.safe_load((CONFIG / 'filter.rviz').read_text())
    displays = tree['Visualization Manager']['Displays']
    shown = {item['Topic']['Value']: item for item in displays if 'Topic' in item}
    assert set(shown) == {'/points/cleaned', '/points/outliers'}
    for topic, display in shown.items():
        assert display['Class'] == 'rviz_default_plugins/PointCloud2'
        assert topics[topic] == 'sensor_msgs/msg/PointCloud2'
        assert display['Topic']['Reliability Policy'] == 'Best Effort'
    assert shown['/points/cleaned']['Color Transformer'] == 'FlatColor'
    outliers = shown['/points/outliers']
    assert outliers['Color Transformer'] == 'Intensity'
    assert outliers['Channel Name'] == NUMBER
    assert NUMBER in fields
    assert outliers['Use rainbow']
    assert not outliers['Invert Rainbow'] | outliers['Autocompute Intensity Bounds']
    assert (outliers['Min Intensity'], outliers['Max Intensity']) == range_of_numbers()


def test_foxglove(ros: Ros) -> None:
    """Both clouds in the same way, the diagnostics, and the values that the plots name."""
    topics, fields = published(ros)
    layout = json.loads((CONFIG / 'foxglove.json').read_text())
    panels = layout['configById']
    shown = panels['3D!clouds']['topics']
    assert {topics[name] for name in shown} == {'sensor_msgs/msg/PointCloud2'}
    outliers = shown['/points/outliers']
    assert outliers['colorField'] == NUMBER
    assert NUMBER in fields
    assert (outliers['colorMode'], outliers['colorMap']) == ('colormap', 'rainbow')
    assert (outliers['minValue'], outliers['maxValue']) == range_of_numbers()
    result = topics[panels['DiagnosticSummary!health']['topicToRender']]
    assert result == 'diagnostic_msgs/msg/DiagnosticArray'
    for name in ('Plot!delay', 'Plot!points'):
        for path in panels[name]['paths']:
            found = re.fullmatch(r'(.+)\.data\[(\d+)\]', path['value'])
            assert found is not None
            assert topics[found[1]] == 'std_msgs/msg/Float64MultiArray'
            assert PLOTTED[int(found[2])] == path['label']
    assert set(_leaves(layout['layout'])) == set(panels)


def test_plotjuggler(ros: Ros) -> None:
    """The curves are of topics that the node publishes; the title of a plot names them."""
    topics, _ = published(ros)
    root = ET.fromstring((CONFIG / 'plotjuggler.xml').read_text())  # noqa: S314
    (chosen,) = (one.attrib['value'] for one in root.iter('selected_topics'))
    assert set(chosen.split(';')) <= set(topics)
    status = f'/diagnostics//points/{ros.diagnosis(lambda one: "outliers" in one.values).name}/'
    series = {f'/{NODE_NAME}/statistics/data[{i}]': name for i, name in enumerate(PLOTTED)}
    series |= {status + name: name for name in ('outliers', 'rejected by boosted_trees')}
    areas = list(root.iter('DockArea'))
    assert len(areas) == 4
    for area in areas:
        curves = [series[curve.attrib['name']] for curve in area.iter('curve')]
        assert area.attrib['name'] == ', '.join(curves)


def _leaves(tree: Any) -> list[str]:
    """List the panels of a layout."""
    return [tree] if isinstance(tree, str) else _leaves(tree['first']) + _leaves(tree['second'])
