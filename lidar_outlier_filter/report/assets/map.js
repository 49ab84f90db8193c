// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0

// Points from above or from the side. What each pixel has is found once, for all steps of all sliders.

import { inFile, unitOf, visitSample } from 'data';

const [WIDE, NARROW] = [[840, 430], [420, 320]]; // pixels of a map; the browser scales it to the page
const NARROWEST = 560; // pixels on the page of a wide map: in less its labels are too small to read
const [LEFT, BELOW] = [88, 34]; // pixels of the axes: to the left, and below
const TICK = 125; // pixels from number to number, at least
const LONGEST = 130; // pixels of a scale bar
const MAX_KEPT_POINTS = 60000; // that no step rejects
const DOT = 3; // pixels of a rejected point
const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
// A colour as ImageData has it, the red first.
const word = (text) => (0xff000000 | (parseInt(text.slice(5, 7), 16) << 16)
  | (parseInt(text.slice(3, 5), 16) << 8) | parseInt(text.slice(1, 3), 16)) >>> 0;

// The smallest of 1, 2 or 5 times a power of ten that is not below a number.
export function nice(least) {
  const power = 10 ** Math.floor(Math.log10(Math.max(least, 1e-9)));
  return power * [1, 2, 5, 10].find((factor) => factor * power >= least);
}

// The longest bar of 1, 2 or 5 times a power of ten units: its pixels, and its text.
export function scaleBar(header, metresPerPixel) {
  const size = header.units?.[0] ?? 1;
  const most = (LONGEST * metresPerPixel) / size;
  const power = 10 ** Math.floor(Math.log10(most));
  const long = power * [5, 2, 1].find((factor) => factor * power <= most);
  const unit = unitOf(header).split(',')[0];
  let text = `${Number(long.toPrecision(1))} ${unit}`;
  if (unit === 'm' && long >= 1000) text = `${long / 1000} km`;
  else if (unit === 'm' && long < 1) text = long >= 0.01 ? `${Math.round(long * 100)} cm` : `${Number((long * 1000).toPrecision(1))} mm`;
  return { pixels: (long * size) / metresPerPixel, text };
}

export class Map2D {
  // `box` has the middle and the size of what is shown, metres; `path` the positions of the sensor;
  // `axis` points up: 1 from above, 2 from the side. The canvas must be on the page.
  constructor(canvas, header, frames, box, axis = 1) {
    Object.assign(this, { canvas, header, box, axis, path: header.path ?? [] });
    [canvas.width, canvas.height] = canvas.clientWidth < NARROWEST ? NARROW : WIDE;
    this.wide = canvas.width - LEFT;
    this.tall = canvas.height - BELOW;
    this.scale = Math.min(this.wide / (box.extent[0] * 1.06), this.tall / (box.extent[axis] * 1.1)); // pixels of a metre
    this.ground = new Uint8Array(this.wide * this.tall); // whether a pixel has points
    this.steps = new Uint32Array(this.wide * this.tall); // the steps that reject any of its points
    for (const frame of frames) {
      visitSample(frame, Math.max(60, MAX_KEPT_POINTS / frames.length), (i, there) => {
        const [u, v] = this.place(there);
        if (u < 0 || v < 0 || u >= this.wide || v >= this.tall) return;
        const pixel = Math.floor(v) * this.wide + Math.floor(u);
        this.ground[pixel] = 1;
        this.steps[pixel] |= frame.words[4 * i + 3];
      });
    }
  }

  place(where) {
    return [0, this.axis].map((axis, k) => [this.wide, this.tall][k] / 2 + (k ? -1 : 1) * (where[axis] - this.box.centre[axis]) * this.scale);
  }

  draw(bit) {
    const context = this.canvas.getContext('2d');
    const image = context.createImageData(this.wide, this.tall);
    const pixels = new Uint32Array(image.data.buffer);
    const [card, low, rejected] = ['--card', '--low', '--rejected'].map((name) => word(colour(name)));
    for (let i = 0; i < pixels.length; i += 1) pixels[i] = this.ground[i] || (i % this.wide && this.ground[i - 1]) ? low : card;
    for (let i = 0; i < pixels.length; i += 1) if (this.steps[i] & bit) this.dot(pixels, i, rejected);
    context.clearRect(0, 0, this.canvas.width, this.canvas.height);
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
    const { width, height } = this.canvas;
    context.strokeStyle = colour('--line');
    context.fillStyle = colour('--soft');
    context.font = '15px system-ui, sans-serif';
    context.strokeRect(LEFT + 0.5, 0.5, this.wide - 1, this.tall - 1);
    const [low, high] = [-1, 1].map((side) => this.box.centre.map((value, a) => value + side * [this.wide, this.tall][a ? 1 : 0] / 2 / this.scale));
    const [from, to] = [inFile(this.header, low), inFile(this.header, high)];
    const step = nice(((to[0] - from[0]) * TICK) / this.wide);
    const digits = Math.max(0, -Math.floor(Math.log10(step)));
    const ticks = (axis) => Array.from({ length: 1 + Math.floor(to[axis] / step) - Math.ceil(from[axis] / step) }, (_, k) => (Math.ceil(from[axis] / step) + k) * step);
    context.textAlign = 'center';
    for (const x of ticks(0)) {
      const [u, text] = [LEFT + ((x - from[0]) / (to[0] - from[0])) * this.wide, x.toFixed(digits)];
      if (u + context.measureText(text).width / 2 <= width) context.fillText(text, u, height - BELOW + 17);
    }
    context.textAlign = 'right';
    for (const y of ticks(this.axis)) {
      const v = this.tall * (1 - (y - from[this.axis]) / (to[this.axis] - from[this.axis]));
      if (v > 20) context.fillText(y.toFixed(digits), LEFT - 6, Math.min(v + 5, this.tall));
    }
    context.fillText(`${'xyz'[this.axis]}, ${unitOf(this.header).split(',')[0]}`, LEFT - 6, 12);
    context.fillText(`x, ${unitOf(this.header).split(',')[0]}`, width - 4, height - 3);
    const { pixels, text } = scaleBar(this.header, 1 / this.scale);
    context.textAlign = 'center';
    context.fillText(text, width - 14 - pixels / 2, this.tall - 18);
    context.strokeStyle = colour('--ink');
    context.beginPath();
    context.moveTo(width - 14 - pixels, this.tall - 10);
    context.lineTo(width - 14, this.tall - 10);
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
