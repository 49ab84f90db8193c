// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0

// The data of a page: a header, and frames of points. Recorded and live pages read the same messages.

export const BITS = 21; // of a point's last word, for the steps of the sliders
export const UNTESTED = 1023;
export const SCORE_UNIT = 256;
export const LARGEST_SCORE = (UNTESTED - 1) / SCORE_UNIT; // and larger ones
export const BAD = 2;
export const [ALL, NEAR, ONLY_REJECTED, ONLY_CLEANED] = [0, 1, 2, 3]; // what is shown
export const MODES = ['intensity', 'height', 'score', 'detector', 'strongest reason', 'truth', 'class', 'return number', 'RGB'];
export const [INTENSITY, HEIGHT, SCORE, DETECTOR, REASON, TRUTH, CLASS, RETURN, RGB] = MODES.keys();
// The columns that give points their colour.
export const COLOUR_COLUMNS = { [CLASS]: ['class'], [RETURN]: ['return_number'], [RGB]: ['red', 'green', 'blue'] };
const TYPES = {
  f4: Float32Array, f8: Float64Array, i1: Int8Array, u1: Uint8Array, i2: Int16Array, u2: Uint16Array,
  i4: Int32Array, u4: Uint32Array, i8: BigInt64Array, u8: BigUint64Array,
};
const WORDS_BYTES = 16; // of a point

export const at = (id) => document.getElementById(id);

export function node(name, attributes = {}, ...children) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  made.append(...children);
  return made;
}

function unpack(text) {
  const bytes = Uint8Array.fromBase64?.(text) ?? Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  return new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream('gzip'))).arrayBuffer();
}

// The data that a recorded page holds.
export async function load() {
  const header = JSON.parse(at('header').textContent);
  const frames = [];
  for (const element of document.querySelectorAll('script.points')) {
    const text = element.textContent;
    element.remove(); // the text is larger than the bytes
    frames.push(...readMessage(await unpack(text)).frames);
  }
  return { header, frames };
}

// A message: the length of its header, the header, the words of all points, and columns.
export function readMessage(buffer) {
  const length = new DataView(buffer).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  let begin = 4 + length;
  for (const frame of header.frames) {
    frame.words = new Uint32Array(buffer, begin, 4 * frame.count);
    frame.columns = {};
    begin += WORDS_BYTES * frame.count;
  }
  const total = header.frames.reduce((sum, frame) => sum + frame.count, 0);
  for (const [name, type, width] of header.columns) {
    const bytes = total * width * TYPES[type].BYTES_PER_ELEMENT;
    const values = new TYPES[type](buffer.slice(begin, begin + bytes));
    begin += bytes;
    let first = 0;
    for (const frame of header.frames) {
      frame.columns[name] = values.subarray(width * first, width * (first + frame.count));
      first += frame.count;
    }
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

// Coordinates as the file has them, of a position in metres.
export const inFile = (header, where) => where.map((value, a) => value / (header.units?.[a] ?? 1));
export const unitOf = (header) => header.unit ?? 'm';
export function coordinates(header, where, digits = 2) {
  return `${inFile(header, where).map((value) => value.toFixed(digits)).join(', ')} ${unitOf(header)}`;
}
// A length in the unit of x and y.
export function lengthText(header, metres, digits = 2) {
  return `${(metres / (header.units?.[0] ?? 1)).toFixed(digits)} ${unitOf(header).split(',')[0]}`;
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

// Whether a point is drawn; as in the shader, but for what only lights up.
export function isShown(frame, i, { bit, show, hidden = 0, stepNumber = 0, mode }) {
  const missed = mode === TRUTH && (frame.words[4 * i + 2] >>> 28) === BAD;
  if (!isRejected(frame, i, bit)) return show !== ONLY_REJECTED || missed;
  return show !== ONLY_CLEANED && !(hidden >>> detectorOf(frame, i, stepNumber) & 1);
}

// Visit the marked points of a frame, and an even sample of at most so many others.
export function visitSample(frame, most, visit) {
  const each = Math.max(1, Math.ceil((frame.count - frame.marked) / Math.max(most, 1)));
  const there = [0, 0, 0];
  for (let i = 0; i < frame.count; i += i < frame.marked ? 1 : each) visit(i, position(frame, i, there));
}

// Where the points are, metres, from an even sample: middle and size of 96 % of them, for a view, and
// of nearly all, for a map; the heights that colours span; half the view's diagonal.
export function measure(frames) {
  const sample = [[], [], []];
  const there = [0, 0, 0];
  for (const frame of frames) {
    const step = Math.max(1, Math.floor(frame.count / 200));
    for (let i = 0; i < frame.count; i += step) {
      position(frame, i, there);
      for (let a = 0; a < 3; a += 1) sample[a].push(there[a]);
    }
  }
  for (const axis of sample) axis.sort((a, b) => a - b);
  const part = (axis, share) => axis[Math.round(share * (axis.length - 1))];
  const middle = (share) => sample.map((axis) => (part(axis, share) + part(axis, 1 - share)) / 2);
  const size = (share) => sample.map((axis) => Math.max(part(axis, 1 - share) - part(axis, share), 0.5));
  const [centre, extent] = [middle(0.02), size(0.02)];
  return {
    centre,
    extent,
    map: { centre: middle(0.001), extent: size(0.001) },
    heights: [0.02, 0.98].map((share) => part(sample[2], share) - centre[2]),
    radius: Math.max(Math.hypot(...extent) / 2, 1),
  };
}

// The values of a point, as text.
export function describe(data, number, i) {
  const { header } = data;
  const frame = data.frames[number];
  const word = frame.words[4 * i + 2];
  const { score, why = [], added = [], ...columns } = frame.columns;
  const exact = score !== undefined && !Number.isNaN(score[i]);
  const width = why.length / frame.count;
  const features = [];
  for (let k = width * i; k < width * (i + 1); k += 1) if (why[k]) features.push([header.features[why[k] - 1], added[k]]);
  return {
    frame: number,
    index: i,
    position: position(frame, i, [0, 0, 0]),
    exact,
    score: exact ? score[i] : scoreOf(frame, i) ?? NaN,
    reason: header.reasons[((word >>> 17) & 0x7f) - 1] ?? '',
    detector: (word >>> 24) & 0xf,
    truth: (word >>> 28) & 3,
    line: lineOf(frame, i),
    features,
    values: Object.fromEntries(Object.entries(columns).map(([name, values]) => [name, valueText(values, i)])),
  };
}

// An exact value as text; times are nanoseconds, and are written in seconds.
function valueText(values, i) {
  const value = values[i];
  if (values instanceof BigInt64Array) return `${value / 1000000000n}.${`${value % 1000000000n}`.padStart(9, '0')}`;
  if (Number.isNaN(value)) return '';
  if (!(values instanceof Float32Array)) return `${value}`;
  for (let digits = 6; digits < 9; digits += 1) {
    const short = Number(value.toPrecision(digits));
    if (Math.fround(short) === value) return `${short}`;
  }
  return `${value}`;
}

// The nearest points of the same frame: [index, distance] of each, the nearest first.
export function neighbours(frame, i, most) {
  const here = position(frame, i, [0, 0, 0]);
  const there = [0, 0, 0];
  const found = [];
  let farthest = Infinity;
  for (let k = 0; k < frame.count; k += 1) {
    if (k === i) continue;
    position(frame, k, there);
    const d = Math.hypot(there[0] - here[0], there[1] - here[1], there[2] - here[2]);
    if (d >= farthest && found.length === most) continue;
    let place = found.length;
    while (place > 0 && found[place - 1][1] > d) place -= 1;
    found.splice(place, 0, [k, d]);
    if (found.length > most) found.pop();
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
