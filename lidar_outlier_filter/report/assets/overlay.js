// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0

// What lies over the points: axes, a scale bar, the way of the vehicle, a distance, a box.

import { element } from 'charts';
import { scaleBar } from 'scale';

const at = (id) => document.getElementById(id);
const AXIS = 26; // CSS pixels

export function drawOverlay(view, state, path) {
  const svg = at('overlay');
  const box = svg.getBoundingClientRect();
  svg.replaceChildren();
  if (!view) return;
  drawPath(svg, view, path);
  drawAxes(svg, view, box);
  drawScale(svg, view, box);
  if (state.ends?.length) drawDistance(svg, view, state.ends);
  if (state.rectangle) drawRectangle(svg, state.rectangle);
}

function drawPath(svg, view, path) {
  // Broken where it is behind the eye.
  const runs = [[]];
  for (const position of path) {
    const there = view.project(position);
    if (there) runs[runs.length - 1].push(there.map((value) => value.toFixed(1)).join());
    else if (runs[runs.length - 1].length) runs.push([]);
  }
  for (const run of runs) if (run.length) svg.append(element('polyline', { class: 'path', points: run.join(' ') }));
}

// Each axis as the eye sees a metre of it.
function drawAxes(svg, view, box) {
  const [x, y] = [box.width - 46, 46];
  const m = view.camera.matrixWorldInverse.elements;
  ['x', 'y', 'z'].forEach((name, axis) => {
    const [dx, dy] = [AXIS * m[4 * axis], -AXIS * m[4 * axis + 1]];
    svg.append(element('line', { class: `axis-${name}`, x1: x, y1: y, x2: x + dx, y2: y + dy }));
    if (Math.hypot(dx, dy) > 5) svg.append(element('text', { x: x + 1.35 * dx, y: y + 1.35 * dy + 4, 'text-anchor': 'middle' }, name));
  });
}

function drawScale(svg, view, box) {
  const { pixels, text } = scaleBar(view.metresPerPixel);
  const [right, y] = [box.width - 16, box.height - 34];
  svg.append(element('path', { class: 'scale', d: `M${right - pixels},${y - 5}v5h${pixels}v-5` }));
  svg.append(element('text', { id: 'scale-text', x: right - pixels / 2, y: y - 7, 'text-anchor': 'middle' }, text));
}

function drawDistance(svg, view, ends) {
  const places = ends.map((end) => view.project(end));
  for (const place of places) if (place) svg.append(element('circle', { class: 'end', cx: place[0], cy: place[1], r: 5 }));
  if (places.length < 2 || !places[0] || !places[1]) return;
  const [[x1, y1], [x2, y2]] = places;
  svg.append(element('line', { class: 'distance', x1, y1, x2, y2 }));
  const metres = Math.hypot(...ends[0].map((value, a) => ends[1][a] - value));
  svg.append(element('text', { class: 'distance', x: (x1 + x2) / 2, y: (y1 + y2) / 2 - 8, 'text-anchor': 'middle' }, `${metres.toFixed(2)} m`));
}

function drawRectangle(svg, [x1, y1, x2, y2]) {
  svg.append(element('rect', { class: 'box', x: Math.min(x1, x2), y: Math.min(y1, y2), width: Math.abs(x2 - x1), height: Math.abs(y2 - y1) }));
}
