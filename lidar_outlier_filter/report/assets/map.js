// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0

// The rejected points from above. What each pixel has is found once, for all steps of all sliders.

import { position } from 'data';
import { nice, scaleBar } from 'scale';

const [WIDTH, HEIGHT, LEFT, BELOW] = [840, 430, 62, 34]; // pixels; of the axes: to the left, and below
const MOST = 60000; // points that no step rejects
const DOT = 3; // pixels of a rejected point
const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
// A colour as ImageData has it, the red first.
export const word = (text) => (0xff000000 | (parseInt(text.slice(5, 7), 16) << 16)
  | (parseInt(text.slice(3, 5), 16) << 8) | parseInt(text.slice(1, 3), 16)) >>> 0;

export class Map2D {
  // `box` has the middle and the size of what is shown, metres; `path` the way of the vehicle.
  constructor(canvas, data, box, path) {
    Object.assign(this, { canvas, data, box, path });
    [canvas.width, canvas.height] = [WIDTH, HEIGHT];
    this.wide = WIDTH - LEFT;
    this.tall = HEIGHT - BELOW;
    this.scale = Math.min(this.wide / (box.extent[0] * 1.06), this.tall / (box.extent[1] * 1.1)); // pixels of a metre
    this.ground = new Uint8Array(this.wide * this.tall); // whether a pixel has points
    this.steps = new Uint32Array(this.wide * this.tall); // the steps that reject any of its points
    for (const frame of data.frames) this.look(frame);
  }

  place([x, y]) {
    return [this.wide / 2 + (x - this.box.centre[0]) * this.scale, this.tall / 2 - (y - this.box.centre[1]) * this.scale];
  }

  look(frame) {
    const there = [0, 0, 0];
    const last = Math.min(frame.count, frame.marked + Math.max(60, Math.floor(MOST / this.data.frames.length)));
    for (let i = 0; i < last; i += 1) {
      const [u, v] = this.place(position(frame, i, there));
      if (u < 0 || v < 0 || u >= this.wide || v >= this.tall) continue;
      const pixel = Math.floor(v) * this.wide + Math.floor(u);
      this.ground[pixel] = 1;
      this.steps[pixel] |= frame.words[4 * i + 3];
    }
  }

  draw(bit) {
    const context = this.canvas.getContext('2d');
    const image = context.createImageData(this.wide, this.tall);
    const pixels = new Uint32Array(image.data.buffer);
    const [card, low, rejected] = ['--card', '--low', '--rejected'].map((name) => word(colour(name)));
    for (let i = 0; i < pixels.length; i += 1) pixels[i] = this.ground[i] || (i % this.wide && this.ground[i - 1]) ? low : card;
    for (let i = 0; i < pixels.length; i += 1) if (this.steps[i] & bit) this.dot(pixels, i, rejected);
    context.clearRect(0, 0, WIDTH, HEIGHT);
    context.putImageData(image, LEFT, 0);
    this.drawAxes(context);
    this.drawPath(context);
  }

  dot(pixels, at, shade) {
    const x = at % this.wide;
    for (let v = 0; v < DOT; v += 1) {
      const begin = at - x + v * this.wide;
      pixels.fill(shade, begin + x, begin + Math.min(x + DOT, this.wide));
    }
  }

  // Coordinates at the edges, and a bar as long as so many metres.
  drawAxes(context) {
    context.strokeStyle = colour('--line');
    context.fillStyle = colour('--soft');
    context.font = '15px system-ui, sans-serif';
    context.strokeRect(LEFT + 0.5, 0.5, this.wide - 1, this.tall - 1);
    const [across, up] = [this.wide / this.scale, this.tall / this.scale];
    const step = nice(across / 8);
    const [west, south] = [this.box.centre[0] - across / 2, this.box.centre[1] - up / 2];
    const digits = Math.max(0, -Math.floor(Math.log10(step)));
    context.textAlign = 'center';
    for (let x = Math.ceil(west / step) * step; x < west + across; x += step) {
      context.fillText(x.toFixed(digits), LEFT + (x - west) * this.scale, HEIGHT - BELOW + 17);
    }
    context.textAlign = 'right';
    for (let y = Math.ceil(south / step) * step; y < south + up; y += step) {
      const v = this.tall - (y - south) * this.scale;
      if (v > 12) context.fillText(y.toFixed(digits), LEFT - 6, Math.min(v + 5, this.tall));
    }
    context.fillText('y, m', LEFT - 6, 12);
    context.fillText('x, m', WIDTH - 4, HEIGHT - 3);
    const { pixels, text } = scaleBar(1 / this.scale);
    context.textAlign = 'center';
    context.fillText(text, WIDTH - 14 - pixels / 2, this.tall - 18);
    context.strokeStyle = colour('--ink');
    context.beginPath();
    context.moveTo(WIDTH - 14 - pixels, this.tall - 10);
    context.lineTo(WIDTH - 14, this.tall - 10);
    context.stroke();
  }

  drawPath(context) {
    context.strokeStyle = colour('--near');
    context.lineWidth = 2;
    context.beginPath();
    for (const position of this.path) {
      const [u, v] = this.place(position);
      context.lineTo(LEFT + u, v);
    }
    context.stroke();
    context.lineWidth = 1;
  }
}
