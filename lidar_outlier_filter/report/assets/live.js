// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0

// The page of a running node. It asks for new frames and for the diagnostics, and sets parameters.

import { DETECTOR, HEIGHT, INTENSITY, REASON, SCORE, at, node, readMessage } from 'data';
import { count, percent } from 'charts';
import { reasonColours } from 'colours';
import { list, slider } from 'panel';
import { Stage } from 'stage';

const PERIOD = 500; // milliseconds from one question to the next
const LEVELS = ['OK', 'Warning', 'Error', 'Stale'];
const state = { newest: true, hold: false, last: -1, topic: '' };
const data = { header: { intensity: [0, 0], features: [] }, frames: [] };
let sliders = '';
let sending = Promise.resolve();

const stage = new Stage(data, state, {
  near: 'kept, score above 0.8', modes: () => [INTENSITY, HEIGHT, SCORE, DETECTOR, REASON],
  keys: { ' ': hold }, keyNames: [['space', 'hold, go on']], changed: () => {},
  drawn(number) {
    const frames = data.frames.slice(state.firstFrame, state.lastFrame + 1);
    at('shown').textContent = `${count(number)} of ${count(frames.reduce((sum, frame) => sum + frame.points, 0))} points drawn`;
  },
});

async function ask(path, asked = {}, options = {}) {
  const token = new URLSearchParams(location.search).get('token');
  const response = await fetch(`/${path}?${new URLSearchParams({ ...asked, token })}`, options);
  if (!response.ok) throw new Error(`${path} must be served, got status ${response.status}`);
  return response;
}

// --- Clouds ----------------------------------------------------------------------------------

function take(header) {
  data.header.intensity = header.intensity;
  const { frames } = header;
  if (!frames.length) return;
  state.last = frames[frames.length - 1].number;
  const first = !stage.view && !stage.flat;
  for (const frame of frames) if (stage.view) stage.view.push(frame); else data.frames.push(frame);
  while (data.frames[0].number < header.oldest) drop();
  if (first) {
    stage.open();
    stage.view?.set('nearBits', 2);
    stage.legend();
  }
  colourReasons();
  stage.clear();
  showFrames();
}

function drop() {
  if (stage.view) stage.view.shift(); else data.frames.shift();
}

function forget() {
  while (data.frames.length) drop();
  state.last = -1;
  stage.clear();
}

// A reason that has a colour keeps it.
function colourReasons() {
  const known = state.reasons.map(([reason]) => reason);
  const found = reasonColours(data, state, known);
  if (found.length === known.length) return;
  state.reasons = found;
  stage.recolour();
}

function showFrames() {
  const last = data.frames.length - 1;
  stage.setFrames(...(state.newest ? [last, last] : [0, last]));
  const sum = (name) => data.frames.reduce((total, frame) => total + frame[name], 0);
  const [rejected, points] = [sum('rejected'), sum('points')];
  const seconds = last < 0 ? 0 : data.frames[last].end - data.frames[0].start;
  at('lead').replaceChildren(node('strong', {}, `${count(rejected)} of ${count(points)} points`), ` rejected in the last ${seconds.toFixed(1)} s, ${percent(rejected, points)}.`);
  at('frame-text').textContent = state.newest ? 'the newest 0.1 s or sweep' : `the last ${seconds.toFixed(1)} s`;
}

// --- Parameters ------------------------------------------------------------------------------

function set(name, value) {
  // One after the other, so that the last one holds.
  sending = sending.then(async () => {
    let refusal = '';
    try {
      refusal = (await (await ask('set', {}, { method: 'POST', body: JSON.stringify({ [name]: value }) })).json()).refusal;
    } catch (error) {
      refusal = error.message;
    }
    at('refusal').textContent = refusal;
    at('refusal').hidden = !refusal;
    sliders = ''; // shown anew as the node has them
    await showStatus();
  });
}

function makeSliders(found) {
  const text = JSON.stringify(found);
  const busy = at('slider-list').contains(document.activeElement) && document.activeElement.type === 'text';
  if (text === sliders || busy) return;
  sliders = text;
  const focus = document.activeElement?.id;
  at('slider-list').replaceChildren(...found.map((one, number) => {
    const exact = node('input', { type: 'text', id: `exact-${number}`, size: 8, 'aria-label': `${one.name}, exact value`, value: one.texts[one.given] });
    const form = node('form', { class: 'exact' }, exact, node('button', {}, 'Set'));
    const [box, input, shown] = slider(number, one, form);
    input.addEventListener('input', () => { shown.textContent = one.texts[input.value]; });
    input.addEventListener('change', () => set(one.name, one.texts[input.value]));
    form.addEventListener('submit', (event) => {
      event.preventDefault();
      exact.blur();
      set(one.name, exact.value);
    });
    return box;
  }));
  if (focus) at(focus)?.focus();
}

// --- Diagnostics -----------------------------------------------------------------------------

async function showStatus() {
  const status = await (await ask('status')).json();
  Object.assign(data.header, status);
  makeSliders(status.sliders);
  showTopics(status.topics);
  if (!status.statuses.length) return;
  at('statuses').replaceChildren(...status.statuses.map((one) => {
    const facts = node('dl', {});
    list(facts, Object.entries(one.values));
    const level = node('strong', { class: `level level-${one.level}` }, LEVELS[one.level] ?? `${one.level}`);
    return node('div', {}, node('h3', {}, one.name), node('p', {}, level, ` ${one.message}`), facts);
  }));
}

function showTopics(topics) {
  const known = [...at('topic').options].map((option) => option.value);
  if (known.join() === topics.join()) return;
  at('topic').replaceChildren(...topics.map((topic) => node('option', { value: topic }, topic)));
  at('topic-label').hidden = topics.length < 2;
  if (!topics.includes(state.topic)) {
    state.topic = topics[0] ?? '';
    forget();
  }
  at('topic').value = state.topic;
}

// --- Controls --------------------------------------------------------------------------------

function setNewest(newest) {
  state.newest = newest;
  at('newest').setAttribute('aria-pressed', newest);
  at('all').setAttribute('aria-pressed', !newest);
  showFrames();
}

function hold() {
  state.hold = !state.hold;
  at('hold').setAttribute('aria-pressed', state.hold);
}

async function poll() {
  try {
    if (!data.header.version) {
      const about = await (await ask('about')).json();
      Object.assign(data.header, about);
      at('footer').textContent = `lidar-outlier-filter ${about.version}. Kept: the last ${about.kept} s, of each 0.1 s or sweep at most ${count(about.mostInFrame)} points, the rejected first. Clouds that pass unfiltered are not drawn.`;
    }
    await showStatus();
    const { topic } = state;
    if (!state.hold && topic) {
      const header = readMessage(await (await ask('frames', { topic, after: state.last })).arrayBuffer());
      if (topic === state.topic) take(header);
    }
    document.documentElement.dataset.frames = data.frames.length;
  } catch (error) {
    at('lead').textContent = `The node does not respond: ${error.message}`;
  }
  setTimeout(poll, PERIOD);
}

for (const [id, action] of [['newest', () => setNewest(true)], ['all', () => setNewest(false)], ['hold', hold]]) at(id).addEventListener('click', action);
at('topic').addEventListener('change', () => {
  state.topic = at('topic').value;
  forget();
  showFrames();
});
poll();
window.live = { state, data, view: () => stage.view };
