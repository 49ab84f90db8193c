// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0

// Which points are drawn when. A picture begins with the rejected points and an even sample of the
// others, as many as are drawn in a moment; slice by slice it gets the rest. Whatever happens
// meanwhile begins a new picture.

import { isRejected } from 'data';

const REJECTED = 0.6; // of a slice, at most, while others are to be drawn

// Put the rejected points of a frame first, in the order that they have; return how many there are.
// Only those that some step rejects move: `index` has the frame's points.
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
    const first = few ? left[0] : Math.min(left[0], Math.max(REJECTED * this.budget, this.budget - left[1]));
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
