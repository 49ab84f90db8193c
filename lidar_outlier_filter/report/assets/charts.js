// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0

// Figures as SVG, drawn anew at each step of a slider from exact counts.

import { node } from 'data';
import { Map2D, nice } from 'map';

const SVG = 'http://www.w3.org/2000/svg';
const WIDTH = 420;
const HEIGHT = 200;
const BOX = { left: 46, right: 10, top: 8, bottom: 36 };

export function element(name, attributes = {}, text = '') {
  const made = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  if (text) made.textContent = text;
  return made;
}

export function count(number) {
  return number.toLocaleString('en').replaceAll(',', ' ');
}

export function percent(part, whole) {
  if (!whole) return '–';
  const value = (100 * part) / whole;
  if (value === 0 || value >= 1) return `${value.toFixed(2)} %`;
  return `${Number(value.toPrecision(2))} %`;
}

function chart(parent, title, about) {
  const svg = element('svg', { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: 'img', 'aria-label': `${title}. ${about}` });
  const caption = node('figcaption', { class: 'quiet' }, about);
  parent.append(node('figure', { class: 'chart' }, node('h2', {}, title), caption, svg));
  return { svg, caption };
}

const across = (part) => BOX.left + part * (WIDTH - BOX.left - BOX.right);
const up = (part) => HEIGHT - BOX.bottom - part * (HEIGHT - BOX.top - BOX.bottom);

function axes(svg, xTicks, yTicks, label) {
  svg.replaceChildren();
  for (const [part, text] of yTicks) {
    svg.append(element('line', { class: 'axis', x1: across(0), x2: across(1), y1: up(part), y2: up(part) }));
    svg.append(element('text', { x: across(0) - 6, y: up(part) + 4, 'text-anchor': 'end' }, text));
  }
  for (const [part, text] of xTicks) {
    svg.append(element('text', { x: across(part), y: HEIGHT - BOX.bottom + 14, 'text-anchor': 'middle' }, text));
  }
  svg.append(element('text', { x: across(0.5), y: HEIGHT - 5, 'text-anchor': 'middle' }, label));
}

const short = (value) => (value >= 1e6 ? `${value / 1e6} M` : value >= 1e3 ? `${value / 1e3} k` : `${value}`);

// Heights on a logarithmic scale from half a point on, so that a single one is seen.
function decades(most) {
  const top = Math.max(1, Math.ceil(Math.log10(Math.max(most, 10))));
  const part = (value) => (value > 0 ? (Math.log10(value) + 0.3) / (top + 0.3) : 0);
  const ticks = [];
  for (let power = 0; power <= top; power += Math.ceil(top / 5)) ticks.push([part(10 ** power), short(10 ** power)]);
  return { part, ticks };
}

const THRESHOLD = 'Dashed: the threshold.';

export class Charts {
  // `box` is what the map shows, see `Map2D`.
  constructor(parent, data, box) {
    this.data = data;
    this.header = data.header;
    const header = this.header;
    this.scores = chart(parent, 'Score', header.hasTruth
      ? `Points by score. Blue: outliers in truth. ${THRESHOLD}` : `Points by score. ${THRESHOLD}`);
    if (header.hasRange) {
      this.ranges = chart(parent, 'Range', 'Points by distance from the origin of the clouds; rejected ones in front.');
    }
    if (header.hasFrames && data.frames.length > 1) {
      this.time = chart(parent, 'Over time', 'Share of the points that is rejected.');
    }
    if (header.curve) {
      this.roc = chart(parent, 'ROC', `Outliers found against good points lost. Area ${header.curve.auc.toFixed(4)}.`);
    }
    this.map = chart(parent, 'Map', header.moved || !header.hasFrames
      ? `Rejected points from above${header.path.length ? '; blue: the path of the sensor' : ''}.` : 'Rejected points from above, in the frame of the clouds.');
    this.map.svg.remove();
    const canvas = node('canvas', { role: 'img', 'aria-label': 'Map of the rejected points, from above' });
    this.map.caption.after(canvas);
    this.plan = new Map2D(canvas, header, data.frames, box);
  }

  update(state) {
    const slider = this.header.sliders[state.slider];
    const counts = slider.counts[state.step];
    this.drawScores(slider, state);
    if (this.ranges) this.drawRanges(counts);
    if (this.time) this.drawTime(slider, state);
    if (this.roc) this.drawRoc(slider, state);
    this.plan.draw(state.bit);
  }

  drawScores(slider, state) {
    const { svg } = this.scores;
    const [good, bad] = this.header.scores;
    const most = Math.max(...good.map((value, i) => value + bad[i]));
    const scale = decades(most);
    const largest = this.header.largestScore;
    axes(svg, [0, 1, 2, 3, 4].map((x) => [x / largest, x === largest ? '≥ 4' : `${x}`]), scale.ticks,
      'score at the given settings');
    const width = (across(1) - across(0)) / good.length;
    good.forEach((value, i) => {
      const height = up(0) - up(scale.part(value + bad[i]));
      const x = across(i / good.length);
      if (height > 0) svg.append(element('rect', { class: 'all', x, y: up(0) - height, width: width - 0.6, height }));
      const part = up(0) - up(scale.part(bad[i]));
      if (part > 0) svg.append(element('rect', { class: 'bad', x, y: up(0) - part, width: width - 0.6, height: part }));
    });
    const limit = slider.limits[state.step];
    // In a chain the other detectors stay where they are.
    const limits = this.header.sliders.length > 1 && limit !== 1 ? [1, limit] : [limit];
    for (const one of limits) {
      if (one === null || one > largest) continue;
      const x = across(one / largest);
      svg.append(element('line', { class: 'limit', x1: x, x2: x, y1: up(0), y2: up(1) }));
      if (limits.length > 1) svg.append(element('text', { x: x + 4, y: up(1) + (one === 1 ? 10 : 22) }, one === 1 ? 'the others' : slider.detector));
    }
  }

  drawRanges(counts) {
    const { svg } = this.ranges;
    const all = this.header.all.ranges;
    const scale = decades(Math.max(...all));
    const bins = all.length;
    axes(svg, this.header.ranges.map((from, i) => [i / bins, `${from}`]), scale.ticks, 'range, m');
    const width = (across(1) - across(0)) / bins;
    all.forEach((value, i) => {
      for (const [name, number] of [['all', value], ['out', counts.ranges[i]]]) {
        const height = up(0) - up(scale.part(number));
        const bar = element('rect', { class: name, x: across(i / bins) + 1, y: up(0) - height, width: width - 2, height });
        bar.append(element('title', {}, `${count(counts.ranges[i])} of ${count(value)} rejected`));
        if (height > 0) svg.append(bar);
      }
    });
  }

  drawTime(slider, state) {
    const { svg } = this.time;
    const frames = this.data.frames;
    const shares = slider.byFrame[state.step].map((value, i) => (100 * value) / Math.max(frames[i].points, 1));
    const top = nice(Math.max(...shares, 1e-4));
    const first = frames[0].start;
    const length = Math.max(frames[frames.length - 1].start - first, 1e-9);
    const each = nice(length / 6);
    const ticks = [];
    for (let at = 0; at <= length; at += each) ticks.push([at / length, `${Number(at.toPrecision(3))}`]);
    axes(svg, ticks, [0, 0.5, 1].map((part) => [part, `${Number((part * top).toPrecision(2))} %`]), 's');
    const line = shares.map((share, i) => `${across((frames[i].start - first) / length).toFixed(1)},${up(share / top).toFixed(1)}`);
    svg.append(element('polyline', { class: 'over', points: line.join(' ') }));
    if (frames.length < 40) {
      for (const one of line) {
        const [cx, cy] = one.split(',');
        svg.append(element('circle', { class: 'dot', cx, cy, r: 2.2 }));
      }
    }
    if (state.single) {
      const x = across((frames[state.frame].start - first) / length);
      svg.append(element('line', { class: 'now', x1: x, x2: x, y1: up(0), y2: up(1) }));
    }
  }

  drawRoc(slider, state) {
    const { svg } = this.roc;
    const { all, curve } = this.header;
    const least = Math.floor(Math.log10(Math.max(0.5 / all.good, 1e-7)));
    const part = (share) => Math.min(1, Math.max(0, (Math.log10(Math.max(share, 10 ** least)) - least) / -least));
    const ticks = [];
    for (let power = least; power <= 0; power += 1) ticks.push([part(10 ** power), power < -2 ? `1e${power}` : `${10 ** power}`]);
    axes(svg, ticks, [0, 0.25, 0.5, 0.75, 1].map((one) => [one, one.toFixed(2)]), 'good points lost, share (logarithmic)');
    const line = curve.recall.map((recall, i) => `${across(part(curve.lost[i])).toFixed(1)},${up(recall).toFixed(1)}`);
    svg.append(element('polyline', { class: 'curve', points: line.join(' ') }));
    slider.counts.forEach((counts, step) => {
      const now = step === state.step;
      svg.append(element('circle', {
        class: now ? 'dot' : 'step', cx: across(part(counts.good / all.good)), cy: up(counts.bad / all.bad), r: now ? 5 : 2.2,
      }));
    });
  }
}
