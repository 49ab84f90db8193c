// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0

// Keys that move the view, and the table that lists all keys.

import { node } from 'panel';
import { setView } from 'stage';

const TURN = 0.08; // rad
const FLY = 0.06; // of the distance to what is looked at
const MOVES = [
  ['arrows', 'turn'], ['W A S D', 'fly ahead, left, back, right'], ['Q E', 'fly down, up'], ['+ −', 'zoom'],
  ['1 2 3', 'orbit, top, side'],
];
const POINTER = [['drag', 'turn; right button: move'], ['?', 'these keys'], ['Esc', 'close these, put a tool away']];

// `more` are the page's own actions by key, `names` how the table lists them; `escaped` is called at Escape.
export function listenToKeys(view, more, names, escaped = () => {}) {
  const at = (id) => document.getElementById(id);
  const actions = {
    ArrowLeft: () => view()?.turn(-TURN, 0), ArrowRight: () => view()?.turn(TURN, 0),
    ArrowUp: () => view()?.turn(0, TURN), ArrowDown: () => view()?.turn(0, -TURN),
    w: () => view()?.fly(FLY, 0, 0), s: () => view()?.fly(-FLY, 0, 0), a: () => view()?.fly(0, -FLY, 0),
    d: () => view()?.fly(0, FLY, 0), e: () => view()?.fly(0, 0, FLY), q: () => view()?.fly(0, 0, -FLY),
    '+': () => view()?.zoom(1.15), '=': () => view()?.zoom(1.15), '-': () => view()?.zoom(1 / 1.15),
    1: () => setView(view(), 'orbit'), 2: () => setView(view(), 'top'), 3: () => setView(view(), 'side'),
    ...more,
  };
  const open = (on) => {
    at('keys').hidden = !on;
    at('keys-button').setAttribute('aria-expanded', on);
  };
  const toggle = () => open(at('keys').hidden);
  const rows = [...MOVES, ...names, ...POINTER];
  at('keys').append(node('table', {}, ...rows.map(([key, text]) => node('tr', {}, node('td', {}, key), node('td', {}, text)))));
  at('keys-button').addEventListener('click', toggle);
  document.addEventListener('keydown', (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const { key } = event;
    if (key === '?') toggle();
    if (key === 'Escape') {
      open(false);
      escaped();
    }
    if (document.activeElement !== at('canvas')) return;
    const action = actions[key.length === 1 ? key.toLowerCase() : key];
    if (action) {
      event.preventDefault();
      action();
    }
  });
}
