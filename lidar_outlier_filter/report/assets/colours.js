// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0

// The colours of points, and the legend that says what they mean.

import { CLASS, COLOUR_COLUMNS, DETECTOR, HEIGHT, NEAR, ONLY_CLEANED, REASON, RETURN, SCORE, TRUTH, inFile, node, unitOf } from 'data';

// Okabe and Ito, without the colour that stands for "rejected".
const REASON_COLOURS = ['#d55e00', '#0072b2', '#e69f00', '#009e73', '#cc79a7', '#56b4e9'];

const rgb = (text) => [1, 3, 5].map((k) => parseInt(text.slice(k, k + 2), 16) / 255);
const style = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

function bytes(text) {
  return Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
}

// Colours by reason: the known ones first, then those that are the strongest most often.
export function reasonColours(data, state, known = []) {
  const often = new Map();
  for (const frame of data.frames) {
    for (let i = 0; i < frame.marked; i += 1) {
      const reason = (frame.words[4 * i + 2] >>> 17) & 0x7f;
      if (reason) often.set(reason, (often.get(reason) ?? 0) + 1);
    }
  }
  for (const reason of known) often.delete(reason);
  const order = [...known, ...[...often].sort((a, b) => b[1] - a[1]).map(([reason]) => reason)];
  state.others = order.length > REASON_COLOURS.length;
  return order.slice(0, REASON_COLOURS.length).map((reason, i) => [reason, REASON_COLOURS[i]]);
}

function palette({ header }, state) {
  const table = new Uint8Array(256 * 4 * 4).fill(255);
  const put = (row, i, colour) => colour.forEach((value, c) => { table[4 * (256 * row + i) + c] = value; });
  ['viridis', 'cividis'].forEach((name, row) => {
    const map = bytes(header.colours[name]);
    for (let i = 0; i < 256; i += 1) put(row, i, [...map.subarray(3 * i, 3 * i + 3)]);
  });
  const eight = (text) => rgb(text).map((value) => Math.round(255 * value));
  for (let i = 0; i < 16; i += 1) put(2, i, eight(style('--rejected')));
  for (const one of header.detectors) put(2, one.number, eight(detectorColour(one)));
  for (let i = 0; i < 128; i += 1) put(3, i, eight(style('--bar')));
  for (const [reason, colour] of state.reasons) put(3, reason, eight(colour));
  return table;
}

// The default's colour is black, which nobody sees on a dark ground.
const detectorColour = (one) => (one.colour === '#000000' ? style('--rejected') : one.colour);

// Values of a column, up to so many, for a legend.
const MAX_VALUES = 12;
const VALUE_COLOURS = [...REASON_COLOURS.slice(1), '#882255']; // without the one that is near "rejected"
const valueColour = (value) => VALUE_COLOURS[Number(value) % VALUE_COLOURS.length];
function valuesOf(data, name) {
  const found = new Set();
  for (const frame of data.frames) for (const value of frame.columns[name]) found.add(Number(value));
  return [...found].sort((a, b) => a - b).slice(0, MAX_VALUES);
}

// What writes the colour of a point by columns: a colour for each value, or red, green and blue.
export function tintOf(data, mode) {
  const names = COLOUR_COLUMNS[mode];
  if (names.length === 1) {
    const table = VALUE_COLOURS.map((text) => rgb(text).map((value) => Math.round(255 * value)));
    return (columns, i, out) => out.set(table[Number(columns[names[0]][i]) % table.length], 4 * i);
  }
  // Files hold 8 or 16 bits.
  const large = data.frames.some((frame) => names.some((name) => frame.columns[name].some((value) => value > 255)));
  return (columns, i, out) => names.forEach((name, c) => { out[4 * i + c] = large ? columns[name][i] >> 8 : columns[name][i]; });
}

export function colours(data, state) {
  const named = { low: '--low', high: '--high', rejectedColour: '--rejected', nearColour: '--near', missedColour: '--missed', lostColour: '--lost' };
  const found = Object.fromEntries(Object.entries(named).map(([name, variable]) => [name, rgb(style(variable))]));
  return { ...found, ground: style('--ground'), palette: palette(data, state), marks: [rgb(style('--mark')), rgb(style('--soft'))] };
}

// `near` says what is lit up near the threshold.
export function legend(parent, data, state, view, near) {
  const dots = [];
  const dot = (colour, text) => dots.push(node('span', {}, node('i', { style: `background:${colour}` }), text));
  const ramp = (name, low, high) => {
    const map = bytes(data.header.colours[name]);
    const stops = [0, 64, 128, 192, 255].map((i) => `rgb(${map.subarray(3 * i, 3 * i + 3).join()})`);
    dots.push(node('span', {}, low, node('i', { class: 'ramp', style: `background:linear-gradient(90deg,${stops})` }), high));
  };
  if (view && state.mode === HEIGHT) {
    const heights = view.heights.map((one) => inFile(data.header, [0, 0, one + view.centre[2]])[2].toFixed(1));
    ramp('viridis', heights[0], `${heights[1]} ${unitOf(data.header).replace(/.*z in /, '')}`);
  }
  if (state.mode === SCORE) ramp('cividis', 'score 0', '1');
  if (state.mode === CLASS || state.mode === RETURN) {
    for (const value of valuesOf(data, COLOUR_COLUMNS[state.mode][0])) dot(valueColour(value), `${state.mode === CLASS ? 'class' : 'return'} ${value}`);
  }
  if (state.mode === DETECTOR) {
    for (const one of data.header.detectors) if (data.header.chain.includes(one.name)) dot(detectorColour(one), one.name);
  } else if (state.mode === REASON) {
    for (const [reason, colour] of state.reasons) dot(colour, data.header.reasons[reason - 1]);
    if (!state.reasons.length) dots.push(node('span', {}, 'no reason is known: the node says them under scores: true'));
    dot(style('--bar'), state.others ? 'others, or kept at the given settings' : 'kept at the given settings');
  } else if (state.mode === TRUTH) {
    dot(style('--near'), 'found');
    dot(style('--missed'), 'missed');
    dot(style('--lost'), 'good, lost');
  } else if (state.show !== ONLY_CLEANED) {
    dot(style('--rejected'), 'rejected');
  }
  if (state.show === NEAR && state.mode !== TRUTH && state.mode !== REASON) dot(style('--near'), near);
  if (data.header.path?.length) dot(style('--near'), 'path of the sensor');
  parent.replaceChildren(...dots);
}
