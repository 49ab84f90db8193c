// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0

// The points where there is no WebGL: a picture from above, and one from the side.

import { place, isRejected } from 'data';

const MOST = 300000; // points that are drawn beside the rejected ones

export function drawFlat(canvas, data, box, state) {
  const { width, height } = canvas.parentElement.getBoundingClientRect();
  canvas.width = Math.round(width);
  canvas.height = Math.round(height);
  const context = canvas.getContext('2d');
  const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  const image = context.createImageData(canvas.width, canvas.height);
  const pixels = new Uint32Array(image.data.buffer);
  pixels.fill(word(colour('--ground')));
  const half = Math.floor(canvas.height / 2);
  const colours = { other: word(colour('--high')), rejected: word(colour('--rejected')) };
  for (const [axis, top] of [[1, 0], [2, half]]) {
    panel(pixels, canvas.width, top, half, data, box, state, axis, colours);
  }
  context.putImageData(image, 0, 0);
  context.fillStyle = colour('--soft');
  context.font = '13px system-ui, sans-serif';
  context.fillText('from above', 12, 20);
  context.fillText('from the side', 12, half + 20);
}

// A colour as ImageData has it, the red first.
const word = (text) => (0xff000000 | (parseInt(text.slice(5, 7), 16) << 16)
  | (parseInt(text.slice(3, 5), 16) << 8) | parseInt(text.slice(1, 3), 16)) >>> 0;

function panel(pixels, width, top, height, data, box, state, axis, colours) {
  const scale = Math.min(width / (box.extent[0] * 1.06), height / (box.extent[axis] * 1.1));
  const there = [0, 0, 0];
  const frames = data.frames.slice(state.firstFrame, state.lastFrame + 1);
  const each = Math.max(100, Math.floor(MOST / frames.length));
  for (const above of [false, true]) {
    const colour = above ? colours.rejected : colours.other;
    const size = above ? 3 : 1;
    for (const frame of frames) {
      const last = above ? frame.marked : Math.min(frame.count, frame.marked + each);
      for (let i = 0; i < last; i += 1) {
        if (isRejected(frame, i, state.bit) !== above) continue;
        place(frame, i, there);
        const x = Math.round(width / 2 + (there[0] - box.centre[0]) * scale);
        const y = Math.round(height / 2 - (there[axis] - box.centre[axis]) * scale);
        if (x < 0 || y < 0 || x + size > width || y + size > height) continue;
        for (let v = 0; v < size; v += 1) {
          const begin = (top + y + v) * width + x;
          pixels.fill(colour, begin, begin + size);
        }
      }
    }
  }
}
