# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What viewers are said to show is what the node publishes."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml
from nodes import flush, line, process

from lidar_outlier_filter.core.detectors.registry import BITS
from lidar_outlier_filter.parameters.yaml_files import NODE_NAME
from lidar_outlier_filter.ros.health import PLOTTED

if TYPE_CHECKING:
    from nodes import Ros

CONFIG = Path(__file__).parents[1] / 'config'


def published(ros: Ros) -> tuple[dict[str, str], set[str]]:
    """Return the topics of a node with their types, and the fields of its outlier clouds."""
    node = ros.filter(parameters={'scores': True})
    process(node, line(0.0))
    (answer,) = flush(node)
    fields = {str(field.name) for field in answer.outliers.fields}
    node.start()
    listed = node.get_publisher_names_and_types_by_node(NODE_NAME, '/')
    return {name: kinds[0] for name, kinds in listed}, fields


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
    assert outliers['Channel Name'] in fields
    assert outliers['Min Intensity'] == min(BITS.values())
    assert outliers['Max Intensity'] == max(BITS.values())


def test_foxglove(ros: Ros) -> None:
    """Both clouds in the same way, the diagnostics, and the values that the plots name."""
    topics, fields = published(ros)
    layout = json.loads((CONFIG / 'foxglove.json').read_text())
    panels = layout['configById']
    shown = panels['3D!clouds']['topics']
    assert {topics[name] for name in shown} == {'sensor_msgs/msg/PointCloud2'}
    outliers = shown['/points/outliers']
    assert outliers['colorField'] in fields
    assert outliers['minValue'] == min(BITS.values())
    assert outliers['maxValue'] == max(BITS.values())
    result = topics[panels['DiagnosticSummary!health']['topicToRender']]
    assert result == 'diagnostic_msgs/msg/DiagnosticArray'
    for name in ('Plot!delay', 'Plot!points'):
        for path in panels[name]['paths']:
            found = re.fullmatch(r'(.+)\.data\[(\d+)\]', path['value'])
            assert found is not None
            assert topics[found[1]] == 'std_msgs/msg/Float64MultiArray'
            assert PLOTTED[int(found[2])] == path['label']
    assert set(_leaves(layout['layout'])) == set(panels)


def _leaves(tree: Any) -> list[str]:
    """List the panels of a layout."""
    return [tree] if isinstance(tree, str) else _leaves(tree['first']) + _leaves(tree['second'])
