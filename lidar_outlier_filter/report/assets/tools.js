// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0

// Tools on the picture: the distance of two points, and the points in a box.

import { BAD, at, describe, inFile, isRejected, lengthText, node, unitOf } from 'data';
import { count, percent } from 'charts';
import { list } from 'panel';

export class Tools {
  constructor(data, state, stage) {
    Object.assign(this, { data, state, stage, view: stage.view });
    Object.assign(state, { tool: '', ends: [], rectangle: null, selected: [] });
    at('tools').hidden = !this.view;
    for (const button of document.querySelectorAll('[data-tool]')) button.addEventListener('click', () => this.toggle(button.dataset.tool));
    if (this.view) this.listen();
  }

  toggle(name) {
    this.take(name === this.state.tool ? '' : name);
  }

  // Take a tool, or none; what the other one showed goes.
  take(name) {
    Object.assign(this.state, { tool: name, ends: [], rectangle: null, selected: [] });
    for (const button of document.querySelectorAll('[data-tool]')) button.setAttribute('aria-pressed', button.dataset.tool === name);
    if (this.view) this.view.controls.enabled = name !== 'box';
    const help = { measure: 'Click two points.', box: 'Drag a box around points.' }[name];
    this.tell(...(help ? [node('p', {}, help)] : []));
    this.stage.drawOverlay();
  }

  tell(...children) {
    at('tool').hidden = !children.length;
    at('tool').replaceChildren(...children);
  }

  // A point was clicked; return whether it was for a tool.
  takes(number, index) {
    const { state, data } = this;
    if (state.tool !== 'measure') return state.tool === 'box';
    const end = describe(data, number, index).position;
    state.ends = state.ends.length === 1 ? [state.ends[0], end] : [end];
    if (state.ends.length === 2) {
      const apart = end.map((value, a) => value - state.ends[0][a]);
      state.distance = lengthText(data.header, Math.hypot(...apart));
      const facts = node('dl', {});
      list(facts, [
        ['distance', lengthText(data.header, Math.hypot(...apart), 3)],
        ['horizontal', lengthText(data.header, Math.hypot(apart[0], apart[1]), 3)],
        ['Δx, Δy, Δz', `${inFile(data.header, apart).map((value) => value.toFixed(3)).join(', ')} ${unitOf(data.header)}`],
      ]);
      this.tell(facts);
    } else this.tell(node('p', {}, 'Click the other point.'));
    this.stage.drawOverlay();
    return true;
  }

  listen() {
    const { state } = this;
    const canvas = at('canvas');
    let begin = null;
    canvas.addEventListener('pointerdown', (event) => {
      if (state.tool !== 'box') return;
      begin = [event.offsetX, event.offsetY];
      canvas.setPointerCapture(event.pointerId);
    });
    canvas.addEventListener('pointermove', (event) => {
      if (!begin) return;
      state.rectangle = [...begin, event.offsetX, event.offsetY];
      this.stage.drawOverlay();
    });
    canvas.addEventListener('pointerup', () => {
      if (begin && state.rectangle) this.select();
      begin = null;
    });
  }

  // Choose the points in the box that are shown, however deep.
  select() {
    const [x1, y1, x2, y2] = this.state.rectangle;
    const [left, right, top, bottom] = [Math.min(x1, x2), Math.max(x1, x2), Math.min(y1, y2), Math.max(y1, y2)];
    const selected = [];
    this.view.seen(this.state, (frame, index, [u, v]) => {
      if (u >= left && u <= right && v >= top && v <= bottom) selected.push([frame, index]);
    });
    this.state.selected = selected;
    this.count();
  }

  // What is in the box, at the step of the slider.
  count() {
    const { selected, bit } = this.state;
    if (!selected.length && !this.state.rectangle) return;
    const { frames, header } = this.data;
    const rejected = selected.filter(([frame, i]) => isRejected(frames[frame], i, bit)).length;
    const rows = [['in the box', `${count(selected.length)} points that are shown`], ['rejected', `${count(rejected)}, ${percent(rejected, selected.length)}`]];
    if (header.hasTruth) rows.push(['outliers in truth', count(selected.filter(([frame, i]) => (frames[frame].words[4 * i + 2] >>> 28) === BAD).length)]);
    const facts = node('dl', {});
    list(facts, rows);
    const save = node('button', { type: 'button', id: 'save-csv' }, 'Save as CSV');
    save.addEventListener('click', () => this.save());
    this.tell(facts, ...(selected.length ? [save] : []));
  }

  save() {
    const href = URL.createObjectURL(new Blob(table(this.data, this.state), { type: 'text/csv' }));
    node('a', { href, download: `${this.data.header.name}_selection.csv` }).click();
    setTimeout(() => URL.revokeObjectURL(href), 10000);
  }
}

// Selected points as lines of a table: coordinates as in the file, and the exact values of its fields
// as far as they are there. What a point does not have is left empty.
export function table(data, { selected, bit, stepNumber }) {
  const names = new Map(data.header.detectors.map((one) => [one.number, one.name]));
  const columns = Object.keys(data.frames[0]?.columns ?? {}).filter((name) => !['score', 'why', 'added'].includes(name));
  const lines = [`${['x', 'y', 'z', ...columns, 'score', 'rejected', 'detector', 'reason', 'truth', 'frame'].join()}\n`];
  for (const [frame, index] of selected) {
    const point = describe(data, frame, index);
    const rejected = isRejected(data.frames[frame], index, bit);
    lines.push(`${[
      ...inFile(data.header, point.position).map((value) => value.toFixed(4)),
      ...columns.map((name) => point.values[name]),
      Number.isNaN(point.score) ? '' : point.score.toFixed(4), Number(rejected),
      rejected ? names.get(point.detector || stepNumber) ?? '' : '', rejected ? point.reason : '',
      ['', 'good', 'outlier'][point.truth], frame,
    ].join()}\n`);
  }
  return lines;
}
