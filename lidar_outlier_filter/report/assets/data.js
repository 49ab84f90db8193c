// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0

// Where the page takes its data from. A source gives a header, an object, and buffers by name. The
// static page has all of it in itself; one that is served fetches it. The page of a node that runs
// gets frames as they come.

export const BITS = 21; // of a point's last word, for the steps of the sliders
export const UNTESTED = 1023;
export const SCORE_UNIT = 256;
export const LARGEST_SCORE = (UNTESTED - 1) / SCORE_UNIT; // and what is larger
export const BAD = 2;
export const ONLY_REJECTED = 2; // what is shown
export const ONLY_CLEANED = 3;
export const TRUTH = 5; // of the colours
export const ROW = 20; // numbers of a point with reasons

export class PageSource {
  header() {
    return Promise.resolve(JSON.parse(document.getElementById('header').textContent));
  }

  buffer(name) {
    const element = document.getElementById(`data-${name}`);
    const text = element.textContent;
    element.remove(); // the text is not needed again, and is larger than the bytes
    return Promise.resolve(decode(text));
  }
}

export class ServedSource {
  // `suffix` goes behind every address: a token
  constructor(base, suffix = '') {
    this.base = base;
    this.suffix = suffix;
  }

  async header() {
    return (await this.get('header.json')).json();
  }

  async buffer(name) {
    return (await this.get(`${name}.bin`)).arrayBuffer();
  }

  async get(name) {
    const answer = await fetch(`${this.base}${name}${this.suffix}`);
    if (!answer.ok) throw new Error(`${name} must be served, got status ${answer.status}`);
    return answer;
  }
}

function decode(text) {
  if (Uint8Array.fromBase64) return Uint8Array.fromBase64(text).buffer;
  const plain = atob(text);
  const bytes = new Uint8Array(plain.length);
  for (let i = 0; i < plain.length; i += 1) bytes[i] = plain.charCodeAt(i);
  return bytes.buffer;
}

export async function load(source) {
  const header = await source.header();
  const sections = [];
  for (let i = 0; i < header.sections; i += 1) {
    sections.push(new Uint32Array(await source.buffer(`points-${i}`)));
  }
  const reasons = new Float32Array(await source.buffer('reasons'));
  let row = 0;
  for (const frame of header.frames) {
    const section = sections[frame.section];
    frame.words = section.subarray(4 * frame.begin, 4 * (frame.begin + frame.count));
    frame.row = row; // of the first of its points with reasons
    row += frame.explained;
  }
  return { header, reasons, frames: header.frames };
}

// What a node has sent: the length of a header, the header, and the points of its frames.
export function readFrames(buffer) {
  const length = new DataView(buffer).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  let begin = 4 + length;
  for (const frame of header.frames) {
    frame.words = new Uint32Array(buffer, begin, 4 * frame.count);
    begin += 16 * frame.count;
  }
  return header;
}

// Position of a point of a frame, metres, written to a vector of three numbers.
export function position(frame, i, out) {
  const a = frame.words[4 * i];
  const b = frame.words[4 * i + 1];
  out[0] = frame.origin[0] + frame.step[0] * (a & 0x1fffff);
  out[1] = frame.origin[1] + frame.step[1] * ((a >>> 21) | ((b & 0x3ff) << 11));
  out[2] = frame.origin[2] + frame.step[2] * (b >>> 10 & 0x1fffff);
  return out;
}

export const stepBit = (slider, step) => (1 << (slider.first + step)) >>> 0;
export const lineOf = (frame, i) => frame.words[4 * i + 3] >>> BITS;
export function scoreOf(frame, i) {
  const score = frame.words[4 * i + 2] & 0x3ff;
  return score === UNTESTED ? null : score / SCORE_UNIT;
}

export const isRejected = (frame, i, bit) => (frame.words[4 * i + 3] & bit) !== 0;

// The number of the detector that rejects a point: at the given settings, or the one whose slider moved.
export const detectorOf = (frame, i, stepNumber) => (frame.words[4 * i + 2] >>> 24 & 0xf) || stepNumber;

// Whether a point is drawn; as the shader has it, but for what only lights up.
export function isShown(frame, i, { bit, show, hidden = 0, stepNumber = 0, mode }) {
  const missed = mode === TRUTH && (frame.words[4 * i + 2] >>> 28) === BAD;
  if (!isRejected(frame, i, bit)) return show !== ONLY_REJECTED || missed;
  return show !== ONLY_CLEANED && !(hidden >>> detectorOf(frame, i, stepNumber) & 1);
}

// Where the points are, metres, from an even sample: middle and size of 96 % of them, for a view, and
// of nearly all, for a map; the heights that colours span; half the view's diagonal.
export function measure(data) {
  const sample = [[], [], []];
  const there = [0, 0, 0];
  for (const frame of data.frames) {
    const step = Math.max(1, Math.floor(frame.count / 200));
    for (let i = 0; i < frame.count; i += step) {
      position(frame, i, there);
      for (let a = 0; a < 3; a += 1) sample[a].push(there[a]);
    }
  }
  for (const axis of sample) axis.sort((a, b) => a - b);
  const at = (axis, part) => axis[Math.round(part * (axis.length - 1))];
  const middle = (part) => sample.map((axis) => (at(axis, part) + at(axis, 1 - part)) / 2);
  const size = (part) => sample.map((axis) => Math.max(at(axis, 1 - part) - at(axis, part), 0.5));
  const [centre, extent] = [middle(0.02), size(0.02)];
  return {
    centre,
    extent,
    middle: middle(0.001),
    whole: size(0.001),
    heights: [0.02, 0.98].map((part) => at(sample[2], part) - centre[2]),
    radius: Math.max(Math.hypot(...extent) / 2, 1),
  };
}

// What is known of a point, for people.
export function describe(data, number, i) {
  const frame = data.frames[number];
  const word = frame.words[4 * i + 2];
  const point = {
    frame: number,
    index: i,
    position: position(frame, i, [0, 0, 0]),
    score: scoreOf(frame, i) ?? NaN,
    exact: false,
    intensity: intensityOf(data.header, (word >>> 10) & 0x7f),
    reason: data.header.reasons[((word >>> 17) & 0x7f) - 1] ?? '',
    detector: (word >>> 24) & 0xf,
    truth: (word >>> 28) & 3,
    line: lineOf(frame, i),
    features: [],
    ofSum: false, // what features add is part of the score
  };
  if (i < frame.explained) {
    const row = data.reasons.subarray(ROW * (frame.row + i), ROW * (frame.row + i + 1));
    Object.assign(point, { exact: true, score: row[0], time: frame.start + row[1], lineName: row[2] });
    if (!Number.isNaN(row[3])) point.intensity = row[3];
    for (let f = 0; f < 8; f += 1) {
      if (row[12 + f] !== 0) point.features.push([data.header.features[row[4 + f]], row[12 + f]]);
    }
    point.ofSum = row[4] >= data.header.ofSum;
  }
  return point;
}

function intensityOf(header, step) {
  const [low, high] = header.intensity;
  return high > low ? low + ((high - low) * step) / 127 : NaN;
}

// The nearest points of the same frame: [index, distance] of each, the nearest first.
export function neighbours(frame, i, count) {
  const here = position(frame, i, [0, 0, 0]);
  const there = [0, 0, 0];
  const found = [];
  let farthest = Infinity;
  for (let k = 0; k < frame.count; k += 1) {
    if (k === i) continue;
    position(frame, k, there);
    const d = Math.hypot(there[0] - here[0], there[1] - here[1], there[2] - here[2]);
    if (d >= farthest && found.length === count) continue;
    let at = found.length;
    while (at > 0 && found[at - 1][1] > d) at -= 1;
    found.splice(at, 0, [k, d]);
    if (found.length > count) found.pop();
    farthest = found[found.length - 1][1];
  }
  return found;
}

export function samePointLine(frame, i) {
  const line = lineOf(frame, i);
  const found = [];
  for (let k = 0; k < frame.count; k += 1) if (lineOf(frame, k) === line) found.push(k);
  return found;
}
