// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0

// The points where there is no WebGL: a picture from above, and one from the side.

import { position, isRejected } from 'data';
import { word } from 'map';

const MOST = 300000; // points that are drawn beside the rejected ones
const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

export function drawFlat(canvas, data, box, state) {
  const { width, height } = canvas.parentElement.getBoundingClientRect();
  [canvas.width, canvas.height] = [Math.round(width), Math.round(height)];
  const half = Math.floor(canvas.height / 2);
  const frames = data.frames.slice(state.firstFrame, state.lastFrame + 1);
  const context = paint(canvas, frames, box, state.bit, [[1, 0, half], [2, half, half]], '--high', MOST);
  context.fillStyle = colour('--soft');
  context.font = '13px system-ui, sans-serif';
  context.fillText('from above', 12, 20);
  context.fillText('from the side', 12, half + 20);
}

// Pixels one by one: drawing as many squares takes a GPU that is none several seconds. A panel is an
// axis that points up, its top and its height.
function paint(canvas, frames, box, bit, panels, other, most) {
  const context = canvas.getContext('2d');
  const image = context.createImageData(canvas.width, canvas.height);
  const pixels = new Uint32Array(image.data.buffer);
  pixels.fill(word(colour('--ground')));
  for (const above of [false, true]) {
    const look = above ? [word(colour('--rejected')), 3] : [word(colour(other)), canvas.width > 800 ? 2 : 1];
    const each = above ? 0 : Math.max(60, Math.floor(most / frames.length));
    for (const panel of panels) drawPoints(pixels, canvas.width, panel, box, frames, each, (frame, i) => isRejected(frame, i, bit) === above, look);
  }
  context.putImageData(image, 0, 0);
  return context;
}

// Of each frame what any step rejects, and at most `each` others.
function drawPoints(pixels, width, [axis, top, height], box, frames, each, wanted, [shade, size]) {
  const scale = Math.min(width / (box.extent[0] * 1.06), height / (box.extent[axis] * 1.1));
  const there = [0, 0, 0];
  for (const frame of frames) {
    const last = Math.min(frame.count, frame.marked + each);
    for (let i = 0; i < last; i += 1) {
      if (!wanted(frame, i)) continue;
      position(frame, i, there);
      const x = Math.round(width / 2 + (there[0] - box.centre[0]) * scale);
      const y = Math.round(height / 2 - (there[axis] - box.centre[axis]) * scale);
      if (x < 0 || y < 0 || x + size > width || y + size > height) continue;
      for (let v = 0; v < size; v += 1) {
        const begin = (top + y + v) * width + x;
        pixels.fill(shade, begin, begin + size);
      }
    }
  }
}
