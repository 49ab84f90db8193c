// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0

// The view in the address: whoever opens it again, or is sent it, sees the same.

const PAUSE = 250; // milliseconds without a change before it is written
let waiting = 0;

// What the address says, by short names; {} where it says nothing.
export function readAddress() {
  return Object.fromEntries(new URLSearchParams(location.hash.slice(1)));
}

// Write what `said` returns, when nothing has changed for a moment; '' and null are left out.
export function keepAddress(said) {
  clearTimeout(waiting);
  waiting = setTimeout(() => {
    const known = Object.entries(said()).filter(([, value]) => value !== '' && value !== null);
    const text = new URLSearchParams(known).toString().replaceAll('%2C', ',');
    try {
      history.replaceState(null, '', `#${text}`);
    } catch {
      // A browser that forbids it for files, or asks for patience: the view is not kept.
    }
  }, PAUSE);
}
