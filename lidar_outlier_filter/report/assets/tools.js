// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0

// Tools on the picture: the distance of two points, and the points in a box.

import { BAD, describe, isRejected } from 'data';
import { count, percent } from 'charts';
import { list, node } from 'panel';

const at = (id) => document.getElementById(id);

export class Tools {
  // `draw` draws the overlay anew.
  constructor(data, state, view, draw) {
    Object.assign(this, { data, state, view, draw });
    Object.assign(state, { tool: '', ends: [], rectangle: null, selected: [] });
    at('tools').hidden = !view;
    for (const button of document.querySelectorAll('[data-tool]')) {
      button.addEventListener('click', () => this.take(button.dataset.tool === state.tool ? '' : button.dataset.tool));
    }
    if (view) this.listen();
  }

  // Take a tool, or none; what the other one showed goes.
  take(name) {
    Object.assign(this.state, { tool: name, ends: [], rectangle: null, selected: [] });
    for (const button of document.querySelectorAll('[data-tool]')) button.setAttribute('aria-pressed', button.dataset.tool === name);
    if (this.view) this.view.controls.enabled = name !== 'box';
    const help = { measure: 'Click two points.', box: 'Drag a box around points.' }[name];
    this.tell(...(help ? [node('p', {}, help)] : []));
    this.draw();
  }

  tell(...children) {
    at('tool').hidden = !children.length;
    at('tool').replaceChildren(...children);
  }

  // A point was clicked; say whether it was for a tool.
  takes(number, index) {
    if (this.state.tool !== 'measure') return this.state.tool === 'box';
    const end = describe(this.data, number, index).position;
    this.state.ends = this.state.ends.length === 1 ? [this.state.ends[0], end] : [end];
    this.draw();
    if (this.state.ends.length === 2) this.tell(distance(...this.state.ends));
    else this.tell(node('p', {}, 'Click the other point.'));
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
      this.draw();
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
    const frames = this.data.frames;
    const rejected = selected.filter(([frame, i]) => isRejected(frames[frame], i, bit)).length;
    const rows = [['in the box', `${count(selected.length)} points that are shown`], ['rejected', `${count(rejected)}, ${percent(rejected, selected.length)}`]];
    if (this.data.header.hasTruth) {
      const bad = selected.filter(([frame, i]) => (frames[frame].words[4 * i + 2] >>> 28) === BAD).length;
      rows.push(['outliers in truth', count(bad)]);
    }
    const facts = node('dl', {});
    list(facts, rows);
    const save = node('button', { type: 'button', id: 'save-csv' }, 'Save as CSV');
    save.addEventListener('click', () => this.save());
    this.tell(facts, ...(selected.length ? [save] : []));
  }

  save() {
    const name = `${this.data.header.name}_selection.csv`;
    const address = URL.createObjectURL(new Blob(table(this.data, this.state), { type: 'text/csv' }));
    const link = node('a', { href: address, download: name });
    link.click();
    setTimeout(() => URL.revokeObjectURL(address), 10000);
  }
}

function distance(one, other) {
  const apart = one.map((value, a) => other[a] - value);
  const facts = node('dl', {});
  list(facts, [
    ['distance', `${Math.hypot(...apart).toFixed(3)} m`], ['level', `${Math.hypot(apart[0], apart[1]).toFixed(3)} m`],
    ['Δx, Δy, Δz', `${apart.map((value) => value.toFixed(3)).join(', ')} m`],
  ]);
  return facts;
}

// Selected points as lines of a table. What a point has not is left empty.
export function table(data, { selected, bit, stepNumber }) {
  const names = new Map(data.header.detectors.map((one) => [one.number, one.name]));
  const number = (value, digits) => (Number.isNaN(value) ? '' : value.toFixed(digits));
  const lines = ['x,y,z,score,rejected,detector,reason,truth,intensity,frame\n'];
  for (const [frame, index] of selected) {
    const point = describe(data, frame, index);
    const rejected = isRejected(data.frames[frame], index, bit);
    lines.push(`${[
      ...point.position.map((value) => value.toFixed(4)), number(point.score, 4), Number(rejected),
      rejected ? names.get(point.detector || stepNumber) ?? '' : '', rejected ? point.reason : '',
      ['', 'good', 'outlier'][point.truth], number(point.intensity, 3), frame,
    ].join()}\n`);
  }
  return lines;
}
