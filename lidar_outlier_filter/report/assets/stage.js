// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0

// The picture and its controls, of recorded and live points: view, colours, keys, the chosen point.

import { ALL, COLOUR_COLUMNS, INTENSITY, MODES, at, describe, isRejected, measure, neighbours, node, position, samePointLine, visitSample } from 'data';
import { colours, legend, tintOf } from 'colours';
import { Map2D, scaleBar } from 'map';
import { element } from 'charts';
import { clearPoint, showPoint } from 'panel';
import { View } from 'scene';

const CLICK = 4; // CSS pixels that a pointer may move in a click
const MAX_MARKS = 3000; // of a scan line
const AXIS = 26; // CSS pixels
const TURN = 0.08; // rad
const FLY = 0.06; // of the distance to the target
const VIEWS = ['orbit', 'top', 'side'];
const MOVES = [
  ['arrows', 'turn'], ['W A S D', 'fly ahead, left, back, right'], ['Q E', 'fly down, up'], ['+ −', 'zoom'],
  ['1 2 3', 'orbit, top, side'],
];
const POINTER = [['drag', 'turn; right button: move'], ['?', 'these keys'], ['Esc', 'close these, put a tool away']];

export class Stage {
  // `state` is that of the page. `page` has what the page does itself: `near` says which points light
  // up near the threshold; `modes` of colour; `keys`, actions by key, and `keyNames`; `drawn` and
  // `changed` are called after a picture and a change of the view; `takes` a click before others;
  // `escaped` is called at Escape.
  constructor(data, state, page) {
    Object.assign(this, { data, state, page, view: null, flat: false });
    Object.assign(state, { mode: INTENSITY, show: ALL, size: 2, bit: 1, hidden: 0, stepNumber: 0, point: null, reasons: [], firstFrame: 0, lastFrame: 0 });
    for (const mode of page.modes()) at('mode').append(node('option', { value: mode }, MODES[mode]));
    this.listen();
    this.listenToKeys();
  }

  // There are points now.
  open() {
    const { data, state } = this;
    try {
      this.view = new View(at('canvas'), data);
      this.view.setColours(colours(data, state));
      this.view.listeners.push((drawn) => {
        this.placeRing();
        this.drawOverlay();
        this.page.drawn(drawn);
        this.page.changed();
      });
      this.setView('orbit');
    } catch (error) {
      this.flat = true;
      at('canvas').replaceWith(...['from above', 'from the side'].map((name) => node('canvas', { class: 'flat', role: 'img', 'aria-label': `Points ${name}` })));
      at('shown').textContent = `Pictures only: ${error.message}`;
      for (const id of ['mode', 'show', 'size']) at(id).disabled = true;
      for (const button of document.querySelectorAll('[data-view], [data-tool]')) button.disabled = true;
    }
  }

  redraw() {
    this.view?.draw();
    if (!this.flat) return;
    const { data, state } = this;
    const frames = data.frames.slice(state.firstFrame, state.lastFrame + 1);
    const { map } = measure(data.frames);
    document.querySelectorAll('.flat').forEach((canvas, i) => new Map2D(canvas, data.header, frames, map, i + 1).draw(state.bit));
  }

  setFrames(first, last) {
    [this.state.firstFrame, this.state.lastFrame] = [first, last];
    this.view?.setFrames(first, last);
    this.redraw();
  }

  setView(name) {
    this.view?.setView(name);
    for (const button of document.querySelectorAll('[data-view]')) button.setAttribute('aria-pressed', button.dataset.view === name);
  }

  // How wide a point is, CSS pixels.
  setSize(size) {
    this.state.size = size;
    at('size').value = size;
    this.view?.set('size', size * this.view.ratio);
  }

  legend() {
    legend(at('legend'), this.data, this.state, this.view, this.page.near);
  }

  recolour() {
    this.view?.setColours(colours(this.data, this.state));
    this.legend();
  }

  // --- The chosen point ---

  choose(number, index) {
    if (this.page.takes?.(number, index)) return;
    const { data, state, view } = this;
    const frame = data.frames[number];
    const near = neighbours(frame, index, 8);
    const line = samePointLine(frame, index);
    const point = describe(data, number, index);
    state.point = point;
    const rejected = (i) => isRejected(frame, i, state.bit);
    showPoint(at('point-text'), data.header, point, {
      rejected: rejected(index),
      distances: near.map(([, d]) => d),
      rejectedNear: near.filter(([i]) => rejected(i)).length,
      spacing: this.spacing(frame, point.position),
      inLine: line.length,
    });
    view?.setMarks(0, frame, near.map(([i]) => i));
    const each = Math.ceil(line.length / MAX_MARKS);
    view?.setMarks(1, frame, line.filter((i, k) => k % each === 0 && !rejected(i)));
    this.placeRing();
  }

  // The usual distance from a kept point to the nearest one: of those that are about as far from the
  // sensor as a position, where there is one at the origin.
  spacing(frame, where) {
    const range = this.data.header.hasRange === false ? 0 : Math.hypot(...where);
    const found = [];
    visitSample(frame, 400, (i, there) => {
      const similar = !range || Math.abs(Math.hypot(...there) - range) < range / 4;
      if (found.length < 24 && similar && !isRejected(frame, i, this.state.bit)) found.push(neighbours(frame, i, 1)[0]?.[1] ?? Infinity);
    });
    return found.sort((a, b) => a - b)[found.length >> 1] ?? Infinity;
  }

  clear() {
    if (!this.state.point) return;
    this.state.point = null;
    clearPoint(at('point-text'));
    for (const which of [0, 1]) this.view?.setMarks(which, null, []);
    this.placeRing();
  }

  placeRing() {
    const { point } = this.state;
    const there = point && this.view ? this.view.project(point.position) : null;
    at('ring').hidden = !there;
    if (there) [at('ring').style.left, at('ring').style.top] = there.map((value) => `${value}px`);
  }

  // Fly to a box in metres, so that what is around a point of it is in view, too.
  flyTo(low, high, number, index) {
    const frame = this.data.frames[number];
    const around = neighbours(frame, index, 8).map(([i]) => position(frame, i, [0, 0, 0]));
    const from = low.map((value, a) => Math.min(value, ...around.map((there) => there[a])));
    const size = high.map((value, a) => Math.max(value, ...around.map((there) => there[a])) - from[a]);
    this.view?.flyTo(from.map((value, a) => value + size[a] / 2), Math.max(...size, 2));
  }

  // --- What lies over the points: path, axes, scale bar, and what a tool draws ---

  drawOverlay() {
    const svg = at('overlay');
    svg.replaceChildren();
    const { view, state } = this;
    if (!view) return;
    const box = svg.getBoundingClientRect();
    const add = (...given) => svg.append(element(...given));
    // Broken where it is behind the eye.
    const corners = (this.data.header.path ?? []).map((one) => view.project(one)?.map((value) => value.toFixed(1)).join() ?? '|');
    for (const run of corners.join(' ').split('|')) if (run.trim()) add('polyline', { class: 'path', points: run.trim() });
    // Each axis as the eye sees it.
    const [x, y] = [box.width - 46, 46];
    const m = view.camera.matrixWorldInverse.elements;
    ['x', 'y', 'z'].forEach((name, axis) => {
      const [dx, dy] = [AXIS * m[4 * axis], -AXIS * m[4 * axis + 1]];
      add('line', { class: `axis-${name}`, x1: x, y1: y, x2: x + dx, y2: y + dy });
      if (Math.hypot(dx, dy) > 5) add('text', { x: x + 1.35 * dx, y: y + 1.35 * dy + 4, 'text-anchor': 'middle' }, name);
    });
    const { pixels, text } = scaleBar(this.data.header, view.metresPerPixel);
    const [right, bottom] = [box.width - 16, box.height - 34];
    add('path', { class: 'scale', d: `M${right - pixels},${bottom - 5}v5h${pixels}v-5` });
    add('text', { id: 'scale-text', x: right - pixels / 2, y: bottom - 7, 'text-anchor': 'middle' }, text);
    const ends = (state.ends ?? []).map((end) => view.project(end));
    for (const end of ends) if (end) add('circle', { class: 'end', cx: end[0], cy: end[1], r: 5 });
    if (ends.length === 2 && ends[0] && ends[1]) {
      const [[x1, y1], [x2, y2]] = ends;
      add('line', { class: 'distance', x1, y1, x2, y2 });
      add('text', { class: 'distance', x: (x1 + x2) / 2, y: (y1 + y2) / 2 - 8, 'text-anchor': 'middle' }, state.distance);
    }
    if (state.rectangle) {
      const [x1, y1, x2, y2] = state.rectangle;
      add('rect', { class: 'box', x: Math.min(x1, x2), y: Math.min(y1, y2), width: Math.abs(x2 - x1), height: Math.abs(y2 - y1) });
    }
  }

  // --- Controls ---

  listen() {
    const { state, page } = this;
    for (const name of ['mode', 'show']) {
      at(name).addEventListener('change', () => {
        state[name] = Number(at(name).value);
        if (COLOUR_COLUMNS[state.mode]) this.view?.setTints(tintOf(this.data, state.mode));
        this.view?.set(name, state[name]);
        this.legend();
      });
    }
    at('size').addEventListener('input', () => this.setSize(Number(at('size').value)));
    for (const id of ['mode', 'show', 'size']) at(id).addEventListener('input', () => page.changed());
    for (const button of document.querySelectorAll('[data-view]')) button.addEventListener('click', () => this.setView(button.dataset.view));
    let down = null;
    at('canvas').addEventListener('pointerdown', (event) => { down = [event.offsetX, event.offsetY]; });
    at('canvas').addEventListener('pointerup', (event) => {
      if (!this.view || !down || Math.hypot(event.offsetX - down[0], event.offsetY - down[1]) > CLICK) return;
      const found = this.view.pick(event.offsetX, event.offsetY, state);
      if (found) this.choose(found.frame, found.index);
    });
    matchMedia('(prefers-color-scheme: dark)').addEventListener('change', () => {
      this.recolour();
      this.redraw();
    });
  }

  listenToKeys() {
    const { page } = this;
    const [turn, fly, zoom] = ['turn', 'fly', 'zoom'].map((name) => (...given) => () => this.view?.[name](...given));
    const actions = {
      ArrowLeft: turn(-TURN, 0), ArrowRight: turn(TURN, 0), ArrowUp: turn(0, TURN), ArrowDown: turn(0, -TURN),
      w: fly(FLY, 0, 0), s: fly(-FLY, 0, 0), a: fly(0, -FLY, 0), d: fly(0, FLY, 0), e: fly(0, 0, FLY), q: fly(0, 0, -FLY),
      '+': zoom(1.15), '=': zoom(1.15), '-': zoom(1 / 1.15),
      ...Object.fromEntries(VIEWS.map((name, i) => [i + 1, () => this.setView(name)])),
      ...page.keys,
    };
    const open = (on) => {
      at('keys').hidden = !on;
      at('keys-button').setAttribute('aria-expanded', on);
    };
    const toggle = () => open(at('keys').hidden);
    at('keys').append(node('table', {}, ...[...MOVES, ...page.keyNames, ...POINTER].map(([key, text]) => node('tr', {}, node('td', {}, key), node('td', {}, text)))));
    at('keys-button').addEventListener('click', toggle);
    document.addEventListener('keydown', (event) => {
      if (event.ctrlKey || event.metaKey || event.altKey) return;
      const { key } = event;
      if (key === '?') toggle();
      if (key === 'Escape') {
        open(false);
        page.escaped?.();
      }
      if (document.activeElement !== at('canvas')) return;
      const action = actions[key.length === 1 ? key.toLowerCase() : key];
      if (!action) return;
      event.preventDefault();
      action();
    });
  }
}
