// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0

// Round numbers: for ticks, and for a bar that says how long so many metres are.

const LONGEST = 130; // pixels of a bar

// The least of 1, 2 or 5 times a power of ten that is not below a number.
export function nice(least) {
  const power = 10 ** Math.floor(Math.log10(Math.max(least, 1e-9)));
  return power * [1, 2, 5, 10].find((factor) => factor * power >= least);
}

function lengthText(metres) {
  if (metres >= 1000) return `${metres / 1000} km`;
  if (metres >= 1) return `${metres} m`;
  if (metres >= 0.01) return `${Math.round(metres * 100)} cm`;
  return `${Number((metres * 1000).toPrecision(1))} mm`;
}

// The longest bar of 1, 2 or 5 times a power of ten metres: its pixels, and what it says.
export function scaleBar(metresPerPixel) {
  const most = LONGEST * metresPerPixel;
  const power = 10 ** Math.floor(Math.log10(most));
  const metres = power * [5, 2, 1].find((factor) => factor * power <= most);
  return { pixels: metres / metresPerPixel, text: lengthText(metres) };
}
