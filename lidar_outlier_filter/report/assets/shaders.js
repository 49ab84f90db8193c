// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0

// What the GPU does: a point is unpacked from four words, and gets its position and its colour.

export const VERTEX = `
precision highp float;
precision highp int;
in uvec4 position;
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
const int INTENSITY = 0, HEIGHT = 1, SCORE = 2, DETECTOR = 3, REASON = 4, TRUTH = 5;
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
  } else if (mode == DETECTOR || mode == REASON) {
    colour = mix(low, high, 0.3);
  } else if (mode == TRUTH) {
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
