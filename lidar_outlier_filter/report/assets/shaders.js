// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0

// What the GPU does: a point is unpacked from four words, and gets its position and its colour. And
// which points are drawn when: a picture begins with the rejected points and an even sample of the
// others, and gets the rest slice by slice. Any change begins a new picture.

import { isRejected } from 'data';

export const VERTEX = `
precision highp float;
precision highp int;
in uvec4 position;
in vec4 tint;
uniform mat4 modelViewMatrix, projectionMatrix;
uniform vec3 origin, unit;
uniform uint bit, nearBits, hidden, stepNumber;
uniform int mode, show;
uniform float size;
uniform vec2 heights;
uniform vec3 low, high, rejectedColour, nearColour, missedColour, lostColour;
uniform sampler2D palette;
flat out vec3 colour;
flat out float dot_;
const int INTENSITY = 0, HEIGHT = 1, SCORE = 2, DETECTOR = 3, REASON = 4, TRUTH = 5, CLASS = 6;
void main() {
  uvec3 steps = uvec3(position.x & 0x1FFFFFu,
                      (position.x >> 21) | ((position.y & 0x3FFu) << 11),
                      (position.y >> 10) & 0x1FFFFFu);
  vec3 xyz = origin + unit * vec3(steps);
  bool rejected = (position.w & bit) != 0u;
  bool near = !rejected && (position.w & nearBits) != 0u;
  uint word = position.z;
  float score = float(word & 0x3FFu) / 256.0;
  colour = mix(low, high, sqrt(float((word >> 10) & 0x7Fu) / 127.0));
  if (mode == HEIGHT) {
    float h = clamp((xyz.z - heights.x) / (heights.y - heights.x), 0.0, 1.0);
    colour = texelFetch(palette, ivec2(int(h * 255.0), 0), 0).rgb;
  } else if (mode == SCORE) {
    if ((word & 0x3FFu) != 1023u)
      colour = texelFetch(palette, ivec2(int(clamp(score, 0.0, 1.0) * 255.0), 1), 0).rgb;
  } else if (mode >= CLASS) {
    colour = tint.rgb;
  } else if (mode >= DETECTOR) {
    colour = mix(low, high, 0.3);
  }
  vec3 top = rejectedColour;
  // Who rejects it at the given settings; elsewhere the one whose slider has moved.
  uint number = (word >> 24) & 0xFu;
  if (number == 0u) number = stepNumber;
  if (mode == DETECTOR) top = texelFetch(palette, ivec2(int(number), 2), 0).rgb;
  if (mode == REASON) top = texelFetch(palette, ivec2(int((word >> 17) & 0x7Fu), 3), 0).rgb;
  bool above = rejected || (near && show == 1);
  if (mode == TRUTH) {
    bool bad = ((word >> 28) & 3u) == 2u;
    bool good = ((word >> 28) & 3u) == 1u;
    top = rejected && good ? lostColour : nearColour;
    if (bad && !rejected) { top = missedColour; above = true; }
  } else if (near && mode != REASON) {
    top = nearColour;
  }
  if (above) colour = top;
  vec4 clip = projectionMatrix * modelViewMatrix * vec4(xyz, 1.0);
  // In front of all others, and among themselves in their order.
  if (above) clip.z = -clip.w + (clip.z + clip.w) * 0.001;
  bool out_ = rejected && ((hidden >> number) & 1u) != 0u;
  if (out_ || (show == 2 && !above) || (show == 3 && rejected)) clip = vec4(2.0, 2.0, 2.0, 0.5);
  gl_Position = clip;
  dot_ = above ? size * 1.8 + 1.0 : size;
  gl_PointSize = dot_;
}`;
export const FRAGMENT = `
precision highp float;
flat in vec3 colour;
flat in float dot_;
out vec4 result;
void main() {
  if (dot_ > 2.5 && length(gl_PointCoord - 0.5) > 0.5) discard;
  result = vec4(colour, 1.0);
}`;
export const MARK_VERTEX = `
precision highp float;
in vec3 position;
uniform mat4 modelViewMatrix, projectionMatrix;
uniform float size;
void main() {
  vec4 clip = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
  clip.z = -clip.w * 0.9999;
  gl_Position = clip;
  gl_PointSize = size;
}`;
export const MARK_FRAGMENT = `
precision highp float;
uniform vec3 colour;
out vec4 result;
void main() {
  float r = length(gl_PointCoord - 0.5);
  if (r > 0.5 || r < 0.28) discard;
  result = vec4(colour, 1.0);
}`;

const MAX_REJECTED = 0.6; // of a slice, while others are to be drawn

// An order of a frame's points: marked ones first, then the others so that any first part of them is
// an even sample.
export function evenOrder({ count, marked }) {
  const index = Uint32Array.from({ length: count }, (_, i) => i);
  const rest = count - marked;
  let stride = Math.max(1, Math.round(rest * 0.6180339887));
  const divisor = (a, b) => (b ? divisor(b, a % b) : a);
  while (divisor(stride, rest) > 1) stride += 1;
  for (let k = 0, i = 0; k < rest; k += 1, i = (i + stride) % rest) index[marked + k] = marked + i;
  return index;
}

// Put the rejected points of a frame first; return how many there are. Only marked points move.
export function partition(frame, index, bit) {
  let front = 0;
  let back = frame.marked;
  for (let i = 0; i < frame.marked; i += 1) {
    if (isRejected(frame, i, bit)) index[front++] = i; else index[--back] = i;
  }
  return front;
}

export class Slices {
  // `budget` is how many points a slice may have.
  constructor(budget) {
    this.budget = budget;
    this.restart();
  }

  restart() {
    this.shares = [0, 0]; // drawn so far, of the rejected and of the others
    this.begun = false;
  }

  get done() {
    return this.begun && this.shares[0] === 1 && this.shares[1] === 1;
  }

  // The shares from where and up to where the next slice has, of so many points.
  next(rejected, others) {
    const from = this.shares;
    const left = [rejected * (1 - from[0]), others * (1 - from[1])];
    const few = left[0] + left[1] <= this.budget;
    const first = few ? left[0] : Math.min(left[0], Math.max(MAX_REJECTED * this.budget, this.budget - left[1]));
    const second = few ? left[1] : this.budget - first;
    const grown = (share, more, all) => (few || share * all + more >= all ? 1 : share + more / all);
    this.shares = [grown(from[0], first, rejected), grown(from[1], second, others)];
    this.begun = true;
    return [from, this.shares];
  }
}

// The ranges of a frame's index that a slice draws: rejected points, others that some step rejects,
// and the rest, each in an order in which any first part is an even sample.
export function ranges(frame, rejected, [from, to]) {
  const parts = [[0, rejected, 0], [rejected, frame.marked, 1], [frame.marked, frame.count, 1]];
  return parts.map(([begin, end, which]) => {
    const at = (shares) => begin + Math.ceil(shares[which] * (end - begin));
    return [at(from), at(to) - at(from)];
  }).filter(([, count]) => count > 0);
}
