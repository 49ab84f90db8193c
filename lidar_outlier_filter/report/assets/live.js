// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0

// The page of a node that runs. It asks for new frames and for what the diagnostics say, and sets
// parameters. Groups, reasons by feature, figures and exact counts are for recordings only.

import { describe, isRejected, measure, neighbours, readFrames, samePointLine } from 'data';
import { drawFlat } from 'flat';
import { count, percent } from 'charts';
import { list, node, showPoint } from 'panel';
import { DETECTOR, HEIGHT, INTENSITY, MODES, REASON, SCORE, colours, legend as drawLegend, reasonColours } from 'colours';
import { listenToKeys } from 'keys';
import { listenToStage, openView, placeRing, setView } from 'stage';

const at = (id) => document.getElementById(id);
const PERIOD = 500; // milliseconds from one question to the next
const LEVELS = ['OK', 'Warning', 'Error', 'Stale'];
const KEYS = [['space', 'hold, go on']];

const state = { bit: 1, mode: INTENSITY, show: 0, size: 2, newest: true, hold: false, last: -1, topic: '', point: null, reasons: [], firstFrame: 0, lastFrame: 0 };
const data = { header: { intensity: [0, 0], explained: 0, features: [], ways: [] }, frames: [] };
let view = null;
let flat = false; // pictures instead: there is no WebGL
let sliders = '';
let sending = Promise.resolve();

async function ask(path, asked = {}, options = {}) {
  const token = new URLSearchParams(location.search).get('token');
  const answer = await fetch(`/${path}?${new URLSearchParams({ ...asked, token })}`, options);
  if (!answer.ok) throw new Error(`${path} must be served, got status ${answer.status}`);
  return answer;
}

// --- Clouds ----------------------------------------------------------------------------------

function open() {
  view = openView(data, state);
  flat = !view;
  if (flat) return;
  view.shared.nearBits.value = 2;
  view.listeners.push((drawn) => {
    const frames = data.frames.slice(state.firstFrame, state.lastFrame + 1);
    const all = frames.reduce((sum, frame) => sum + frame.points, 0);
    at('shown').textContent = `${count(drawn)} of ${count(all)} points drawn`;
    ringPoint();
  });
  setView(view, 'orbit');
}

function take(header) {
  data.header.intensity = header.intensity;
  const { frames } = header;
  if (!frames.length) return;
  state.last = frames[frames.length - 1].number;
  const first = !view && !flat;
  if (first) {
    data.frames.push(...frames);
    open();
    legend();
  } else {
    for (const frame of frames) if (view) view.push(frame); else data.frames.push(frame);
    while (data.frames[0].number < header.oldest) if (view) view.shift(); else data.frames.shift();
  }
  colourReasons();
  clearPoint();
  showFrames();
}

// A reason that has a colour keeps it.
function colourReasons() {
  const known = state.reasons.map(([reason]) => reason);
  const found = reasonColours(data, state, known);
  if (found.length === known.length && found.every(([reason], i) => reason === known[i])) return;
  state.reasons = found;
  view?.setColours(colours(data, state));
  legend();
}

function showFrames() {
  const last = data.frames.length - 1;
  [state.firstFrame, state.lastFrame] = state.newest ? [last, last] : [0, last];
  if (view) view.setFrames(state.firstFrame, state.lastFrame);
  if (flat && last >= 0) {
    const { middle, whole } = measure(data);
    drawFlat(at('canvas'), data, { centre: middle, extent: whole }, state);
  }
  const sum = (name) => data.frames.reduce((total, frame) => total + frame[name], 0);
  const [rejected, points] = [sum('rejected'), sum('points')];
  const seconds = last < 0 ? 0 : data.frames[last].end - data.frames[0].start;
  at('lead').replaceChildren(node('strong', {}, `${count(rejected)} of ${count(points)} points`), ` rejected in the last ${seconds.toFixed(1)} s, ${percent(rejected, points)}.`);
  at('frame-text').textContent = state.newest ? 'the newest 0.1 s or sweep' : `the last ${seconds.toFixed(1)} s`;
}

function forget() {
  while (data.frames.length) if (view) view.shift(); else data.frames.shift();
  state.last = -1;
  clearPoint();
}

const legend = () => drawLegend(at('legend'), data, state, view, 'kept, score above 0.8');

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
  at('slider-list').replaceChildren(...found.map((slider, number) => {
    const id = `slider-${number}`;
    const input = node('input', { type: 'range', id, min: 0, max: slider.texts.length - 1, step: 1, 'aria-valuetext': slider.texts[slider.now] });
    input.value = slider.now;
    const shown = node('output', { for: id }, slider.texts[slider.now]);
    input.addEventListener('input', () => { shown.textContent = slider.texts[input.value]; });
    input.addEventListener('change', () => set(slider.name, slider.texts[input.value]));
    const exact = node('input', { type: 'text', id: `exact-${number}`, size: 8, 'aria-label': `${slider.name}, exact value`, value: slider.texts[slider.now] });
    const form = node('form', { class: 'exact' }, exact, node('button', {}, 'Set'));
    form.addEventListener('submit', (event) => {
      event.preventDefault();
      exact.blur();
      set(slider.name, exact.value);
    });
    const ends = node('p', { class: 'ends' }, node('span', {}, 'rejects more'), node('span', {}, 'rejects less'));
    return node('div', { class: 'slider' }, node('label', { for: id }, slider.name, shown), input, ends, form);
  }));
  if (focus) at(focus)?.focus();
}

// --- Diagnostics -----------------------------------------------------------------------------

async function showAbout() {
  const about = await (await ask('about')).json();
  Object.assign(data.header, about);
  at('footer').textContent = `lidar-outlier-filter ${about.version}. Kept: the last ${about.seconds} s, of each 0.1 s or sweep at most ${count(about.mostInFrame)} points, the rejected first. Clouds that pass unfiltered are not drawn.`;
}

async function showStatus() {
  const status = await (await ask('status')).json();
  Object.assign(data.header, status);
  makeSliders(status.sliders);
  showTopics(status.topics);
  const boxes = status.statuses.map((one) => {
    const facts = node('dl', {});
    list(facts, Object.entries(one.values));
    const level = node('strong', { class: `level level-${one.level}` }, LEVELS[one.level] ?? `${one.level}`);
    return node('div', {}, node('h3', {}, one.name), node('p', {}, level, ` ${one.message}`), facts);
  });
  if (boxes.length) at('statuses').replaceChildren(...boxes);
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

// --- A point ---------------------------------------------------------------------------------

function choose(number, index) {
  const frame = data.frames[number];
  const near = neighbours(frame, index, 8);
  const line = samePointLine(frame, index);
  const point = describe(data, number, index);
  state.point = point;
  showPoint(at('point-text'), data, point, { rejected: isRejected(frame, index, 1), near: near.map(([, d]) => d), inLine: line.length });
  view.setMarks(0, frame, near.map(([i]) => i));
  view.setMarks(1, frame, line.length > 3000 ? line.filter((_, i) => i % Math.ceil(line.length / 3000) === 0) : line);
  ringPoint();
}

function clearPoint() {
  if (!state.point) return;
  state.point = null;
  at('point-text').replaceChildren(node('p', { class: 'quiet' }, 'Hold the picture, then click a point.'));
  for (const which of [0, 1]) view?.setMarks(which, null, []);
  ringPoint();
}

const ringPoint = () => placeRing(view, state.point?.position);

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

function listen() {
  for (const i of [INTENSITY, HEIGHT, SCORE, DETECTOR, REASON]) at('mode').append(node('option', { value: i }, MODES[i]));
  listenToStage(data, state, { legend, choose, view: () => view, redraw: showFrames });
  at('newest').addEventListener('click', () => setNewest(true));
  at('all').addEventListener('click', () => setNewest(false));
  at('hold').addEventListener('click', hold);
  at('topic').addEventListener('change', () => {
    state.topic = at('topic').value;
    forget();
    showFrames();
  });
  listenToKeys(() => view, { ' ': hold }, KEYS);
}

async function poll() {
  try {
    if (!data.header.version) await showAbout();
    await showStatus();
    const { topic } = state;
    if (!state.hold && topic) {
      const header = readFrames(await (await ask('frames', { topic, after: state.last })).arrayBuffer());
      if (topic === state.topic) take(header);
    }
    document.documentElement.dataset.frames = data.frames.length;
  } catch (error) {
    at('lead').textContent = `The node does not answer: ${error.message}`;
  }
  setTimeout(poll, PERIOD);
}

listen();
poll();
window.live = { state, data, view: () => view };
