// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0

// The part of a page that shows points, be they of a recording or of a node that runs.

import { View } from 'scene';
import { colours } from 'colours';

const CLICK = 4; // CSS pixels that a pointer may move in a click
const at = (id) => document.getElementById(id);

// Null where there is no WebGL: pictures are drawn instead.
export function openView(data, state) {
  try {
    const view = new View(at('canvas'), data);
    view.setColours(colours(data, state));
    return view;
  } catch (error) {
    const plain = at('canvas').cloneNode(); // one that had another context has no 2-D
    at('canvas').replaceWith(plain);
    at('shown').textContent = `Pictures only: ${error.message}`;
    for (const id of ['mode', 'show', 'size']) at(id).disabled = true;
    for (const button of document.querySelectorAll('[data-view], [data-tool]')) button.disabled = true;
    return null;
  }
}

export function setView(view, name) {
  view?.look(name);
  for (const button of document.querySelectorAll('[data-view]')) button.setAttribute('aria-pressed', button.dataset.view === name);
}

// Around a position, metres; no ring where there is none, or where it is not seen.
export function placeRing(view, position) {
  const there = position && view ? view.project(position) : null;
  at('ring').hidden = !there;
  if (there) [at('ring').style.left, at('ring').style.top] = there.map((value) => `${value}px`);
}

// How wide a point is, CSS pixels.
export function setSize(view, state, size) {
  state.size = size;
  at('size').value = size;
  view?.set('size', size * view.ratio);
}

// `on` has what a page does itself: `legend`, `redraw` after other colours, `choose` a point, and
// `view`, which gives the view once there is one.
export function listenToStage(data, state, on) {
  for (const name of ['mode', 'show']) {
    at(name).addEventListener('change', () => {
      state[name] = Number(at(name).value);
      on.view()?.set(name, state[name]);
      on.legend();
    });
  }
  at('size').addEventListener('input', () => setSize(on.view(), state, Number(at('size').value)));
  for (const button of document.querySelectorAll('[data-view]')) {
    button.addEventListener('click', () => setView(on.view(), button.dataset.view));
  }
  let down = null;
  at('canvas').addEventListener('pointerdown', (event) => { down = [event.offsetX, event.offsetY]; });
  at('canvas').addEventListener('pointerup', (event) => {
    if (!on.view() || !down || Math.hypot(event.offsetX - down[0], event.offsetY - down[1]) > CLICK) return;
    const found = on.view().pick(event.offsetX, event.offsetY, state);
    if (found) on.choose(found.frame, found.index);
  });
  matchMedia('(prefers-color-scheme: dark)').addEventListener('change', () => {
    on.view()?.setColours(colours(data, state));
    on.legend();
    on.redraw();
  });
}
