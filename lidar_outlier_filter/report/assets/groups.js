// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0

// Groups of rejected points that lie together, at any step of a slider.

import { isRejected, position, scoreOf } from 'data';

export const CELL = 0.25; // metres: points in cells that touch, also at a corner, are one group
const MAX_LISTED = 200;
// Half of the cells around one: the other half finds it.
const BESIDE = [];
for (let n = 0; n < 13; n += 1) BESIDE.push([Math.floor(n / 9) - 1, (Math.floor(n / 3) % 3) - 1, (n % 3) - 1]);

// The largest groups, and how many there are: of frames that lie beside each other together, of
// others frame by frame.
export function findGroups(data, bit) {
  const parts = data.header.together ? [[...data.frames.keys()]] : [...data.frames.keys()].map((number) => [number]);
  let groups = [];
  let total = 0;
  for (const part of parts) {
    const found = ofPart(data, part, bit);
    total += found.length;
    groups = [...groups, ...found].sort((a, b) => b.count - a.count).slice(0, MAX_LISTED);
  }
  return { groups, total };
}

// The rejected points of some frames: the frame and the index of each, and where they are.
function rejectedOf(data, numbers, bit) {
  const most = numbers.reduce((sum, number) => sum + data.frames[number].marked, 0);
  const [frames, indices, where] = [new Int32Array(most), new Int32Array(most), new Float64Array(3 * most)];
  const there = [0, 0, 0];
  let count = 0;
  for (const number of numbers) {
    const frame = data.frames[number];
    for (let i = 0; i < frame.marked; i += 1) {
      if (!isRejected(frame, i, bit)) continue;
      where.set(position(frame, i, there), 3 * count);
      frames[count] = number;
      indices[count] = i;
      count += 1;
    }
  }
  return { frames, indices, where: where.subarray(0, 3 * count) };
}

function ofPart(data, numbers, bit) {
  const { frames, indices, where } = rejectedOf(data, numbers, bit);
  const groups = new Map();
  connect(where).forEach((label, m) => {
    let group = groups.get(label);
    if (!group) {
      group = { count: 0, low: [Infinity, Infinity, Infinity], high: [-Infinity, -Infinity, -Infinity], score: -2 };
      groups.set(label, group);
    }
    group.count += 1;
    for (let a = 0; a < 3; a += 1) {
      const value = where[3 * m + a];
      group.low[a] = Math.min(group.low[a], value);
      group.high[a] = Math.max(group.high[a], value);
    }
    const score = scoreOf(data.frames[frames[m]], indices[m]) ?? -1;
    if (score > group.score) Object.assign(group, { score, frame: frames[m], worst: indices[m] });
  });
  return [...groups.values()];
}

// A number for each point, the same for those of one group. `where` has three numbers for each.
export function connect(where) {
  const count = where.length / 3;
  const cells = new Float64Array(where.length);
  for (let k = 0; k < cells.length; k += 1) cells[k] = Math.floor(where[k] / CELL);
  let size = 16;
  while (size < 2 * count) size *= 2;
  const table = new Int32Array(size).fill(-1); // by cell its first point
  const up = Int32Array.from({ length: count }, (_, i) => i); // parent of each point: its root is the group
  const slot = (x, y, z) => {
    let at = (Math.imul(x | 0, 73856093) ^ Math.imul(y | 0, 19349663) ^ Math.imul(z | 0, 83492791)) & (size - 1);
    while (table[at] >= 0) {
      const k = 3 * table[at];
      if (cells[k] === x && cells[k + 1] === y && cells[k + 2] === z) break;
      at = (at + 1) & (size - 1);
    }
    return at;
  };
  const root = (one) => {
    let i = one;
    while (up[i] !== i) i = up[i] = up[up[i]];
    return i;
  };
  for (let i = 0; i < count; i += 1) {
    const at = slot(cells[3 * i], cells[3 * i + 1], cells[3 * i + 2]);
    if (table[at] < 0) table[at] = i; else up[i] = table[at];
  }
  for (const i of table) {
    if (i < 0) continue;
    const [x, y, z] = cells.subarray(3 * i, 3 * i + 3);
    for (const [dx, dy, dz] of BESIDE) {
      const other = table[slot(x + dx, y + dy, z + dz)];
      if (other >= 0) up[root(other)] = root(i);
    }
  }
  return Int32Array.from({ length: count }, (_, i) => root(i));
}
