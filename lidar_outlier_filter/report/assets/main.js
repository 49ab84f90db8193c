// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0

import { PageSource, ServedSource, describe, isRejected, load, measure, neighbours, samePointLine, stepBit } from 'data';
import { drawFlat } from 'flat';
import { Charts, count, percent } from 'charts';
import { list, node, showFound, showGroups, showPoint, showRemoved } from 'panel';
import { INTENSITY, MODES, REASON, TRUTH, legend as drawLegend, reasonColours } from 'colours';
import { connect, findGroups } from 'groups';
import { listenToKeys } from 'keys';
import { listenToStage, openView, placeRing, setView } from 'stage';

const at = (id) => document.getElementById(id);
const NEAR_STEPS = 2; // "near the threshold": rejected by one of so many stricter steps
const KEYS = [['[ ]', 'frame before, after'], ['space', 'play'], ['G', 'next group'], ['< >', 'stricter, looser']];

const state = {
  slider: 0, step: 0, bit: 1, mode: INTENSITY, show: 0, single: false, frame: 0, group: -1, point: null, box: null,
  firstFrame: 0, lastFrame: 0,
};
const times = { start: performance.now() };
let data;
let view = null;
let charts;
let playing = 0;
let flatPending = false;
let finding = 0;

function legend() {
  drawLegend(at('legend'), data, state, view, `kept, rejected ${NEAR_STEPS} steps stricter`);
}

function redraw() {
  if (view) {
    view.draw();
  } else if (!flatPending) {
    flatPending = true;
    requestAnimationFrame(() => {
      flatPending = false;
      drawFlat(at('canvas'), data, state.box, state);
    });
  }
}

// --- Sliders ---------------------------------------------------------------------------------

function makeSliders() {
  data.header.sliders.forEach((slider, number) => {
    const id = `slider-${number}`;
    const input = node('input', {
      type: 'range', id, min: 0, max: slider.texts.length - 1, step: 1, value: slider.given, 'data-slider': number,
    });
    const shown = node('output', { for: id });
    const label = node('label', { for: id }, slider.name, shown);
    const ends = node('p', { class: 'ends' }, node('span', {}, 'rejects more'), node('span', {}, 'rejects less'));
    const box = node('div', { class: 'slider' }, label, input, ends);
    input.addEventListener('input', () => setStep(number, Number(input.value)));
    at('slider-list').append(box);
  });
  at('slider-list').append(node('p', { id: 'count', 'aria-live': 'polite' }));
  if (data.header.sliders.length > 1) {
    at('slider-list').append(node('p', { class: 'quiet' }, 'Moving one sets the others back: combinations were not judged.'));
  }
}

function setStep(number, step) {
  const { sliders, all, points, chain, hasTruth } = data.header;
  const slider = sliders[number];
  state.slider = number;
  state.step = Math.min(Math.max(step, 0), slider.texts.length - 1);
  state.bit = stepBit(slider, state.step);
  sliders.forEach((one, i) => {
    const now = i === number ? state.step : one.given;
    const input = at(`slider-${i}`);
    input.value = now;
    const text = `${one.texts[now]}${now === one.given ? ' (given)' : ''}`;
    input.setAttribute('aria-valuetext', text);
    input.previousElementSibling.querySelector('output').textContent = text;
  });
  let nearBits = 0;
  for (let k = 1; k <= NEAR_STEPS && state.step - k >= 0; k += 1) nearBits |= stepBit(slider, state.step - k);
  if (view) {
    view.shared.bit.value = state.bit;
    view.shared.nearBits.value = nearBits >>> 0;
  }
  const counts = slider.counts[state.step];
  at('count').replaceChildren(count(counts.points), node('small', {}, `of ${count(all.points)} points rejected, ${percent(counts.points, all.points)}`));
  at('lead').replaceChildren(node('strong', {}, `${count(counts.points)} of ${count(points)} points`), ` rejected by ${chain.join(', ')}${state.step === slider.given ? '' : ` at ${slider.name} ${slider.texts[state.step]}`}.`);
  if (hasTruth && all.bad) showTruth(counts, all);
  at('yaml').textContent = slider.yaml[state.step];
  at('lines').textContent = slider.lines[state.step].join('\n') || '# nothing to set: these are the defaults';
  charts.update(state);
  listGroups();
  if (state.point) choose(state.point.frame, state.point.index);
  redraw();
}

function showTruth(counts, all) {
  const found = counts.bad;
  const rejected = counts.bad + counts.good;
  const rows = [
    ['precision', rejected ? percent(found, rejected) : '–'],
    ['recall', percent(found, all.bad)],
    ['F1', percent(2 * found, rejected + all.bad)],
  ];
  at('truth').hidden = false;
  at('truth').replaceChildren(...rows.map(([name, value]) => node('div', {}, node('dt', {}, name), node('dd', { id: name }, value))));
}

// --- Time ------------------------------------------------------------------------------------

function setFrames(single, frame = state.frame) {
  const last = data.frames.length - 1;
  state.single = single;
  state.frame = Math.min(Math.max(frame, 0), last);
  [state.firstFrame, state.lastFrame] = single ? [state.frame, state.frame] : [0, last];
  at('whole').setAttribute('aria-pressed', !single);
  at('single').setAttribute('aria-pressed', single);
  at('frame').value = state.frame;
  const now = data.frames[state.frame];
  const name = data.header.hasFrames ? `${now.start.toFixed(2)} s` : `part ${state.frame + 1}`;
  at('frame-text').textContent = single ? `${name} · ${state.frame + 1} of ${last + 1}` : `${last + 1} ${data.header.hasFrames ? 'frames' : 'parts'}`;
  at('frame').setAttribute('aria-valuetext', at('frame-text').textContent);
  if (view) view.setFrames(state.firstFrame, state.lastFrame);
  if (view) view.moved();
  if (charts && charts.time) charts.drawTime(data.header.sliders[state.slider], state);
  redraw();
}

function play() {
  const on = playing === 0;
  at('play').textContent = on ? '❚❚' : '▶';
  at('play').setAttribute('aria-label', on ? 'Pause' : 'Play');
  if (!on) {
    clearInterval(playing);
    playing = 0;
    return;
  }
  playing = setInterval(() => setFrames(true, (state.frame + 1) % data.frames.length), 200);
}

// --- Points and groups -----------------------------------------------------------------------

function choose(number, index) {
  const frame = data.frames[number];
  const point = describe(data, number, index);
  const near = neighbours(frame, index, 8);
  const line = samePointLine(frame, index);
  state.point = { frame: number, index };
  showPoint(at('point-text'), data, point, {
    rejected: isRejected(frame, index, state.bit), near: near.map(([, d]) => d), inLine: line.length,
  });
  if (view) {
    view.setMarks(0, frame, near.map(([i]) => i));
    const each = Math.ceil(line.length / 3000);
    view.setMarks(1, frame, line.filter((i, k) => k % each === 0 && !isRejected(frame, i, state.bit)));
  }
  ringPoint();
}

function ringPoint() {
  placeRing(view, state.point ? describe(data, state.point.frame, state.point.index).position : null);
}

// Finding groups takes longer than a slider may.
function listGroups() {
  clearTimeout(finding);
  finding = setTimeout(() => {
    if (state.found.bit === state.bit) return;
    state.group = -1;
    state.found = { bit: state.bit, ...findGroups(data, state.bit) };
    groupsAgain();
  }, 100);
}

function groupsAgain() {
  const slider = data.header.sliders[state.slider];
  const settings = state.step === slider.given ? 'at the given settings' : `at ${slider.name} ${slider.texts[state.step]}`;
  showGroups(at('groups'), at('groups-about'), data, state.found, settings, (number) => {
    chooseGroup(number);
    // In one column the list is far below the points that it flies to.
    if (matchMedia('(max-width: 1000px)').matches) at('stage').scrollIntoView();
  });
}

function chooseGroup(number) {
  const { groups } = state.found;
  if (!groups.length) return;
  state.group = (number + groups.length) % groups.length;
  const group = groups[state.group];
  at('groups').querySelectorAll('button').forEach((button, i) => {
    if (i === state.group) {
      button.setAttribute('aria-current', 'true');
      at('groups').scrollTop = button.offsetTop - at('groups').offsetTop - 60;
    } else button.removeAttribute('aria-current');
  });
  if (state.single) setFrames(true, group.frame);
  const middle = group.low.map((low, a) => (low + group.high[a]) / 2);
  if (view) view.flyTo(middle, Math.max(...group.high.map((high, a) => high - group.low[a]), 2));
  choose(group.frame, group.worst);
}

// --- Start -----------------------------------------------------------------------------------

function listen() {
  const { header } = data;
  for (const [i, name] of MODES.entries()) {
    if (i === REASON && !state.reasons.length) continue;
    if (i === TRUTH && !header.hasTruth) continue;
    at('mode').append(node('option', { value: i }, name));
  }
  listenToStage(data, state, {
    legend, choose, view: () => view,
    redraw: () => { charts.update(state); redraw(); },
  });
  at('whole').addEventListener('click', () => setFrames(false));
  at('single').addEventListener('click', () => setFrames(true));
  at('play').addEventListener('click', play);
  at('frame').max = data.frames.length - 1;
  at('frame').addEventListener('input', () => setFrames(true, Number(at('frame').value)));
  at('time').hidden = data.frames.length < 2;
  listenToKeys(() => view, {
    '[': () => setFrames(true, state.frame - 1), ']': () => setFrames(true, state.frame + 1), ' ': play,
    g: () => chooseGroup(state.group + 1),
    '<': () => setStep(state.slider, state.step - 1), '>': () => setStep(state.slider, state.step + 1),
  }, KEYS);
  for (const button of document.querySelectorAll('[data-copy]')) {
    button.addEventListener('click', () => copy(at(button.dataset.copy), button));
  }
}

async function copy(from, button) {
  const text = from.textContent;
  try {
    await navigator.clipboard.writeText(text);
  } catch {
    // From a file, or without permission: what is selected can be copied by hand.
    getSelection().selectAllChildren(from);
    document.execCommand('copy');
  }
  button.textContent = 'Copied';
  setTimeout(() => { button.textContent = 'Copy'; }, 1500);
}

function showDrawn(drawn) {
  if (!times.first) {
    view.finish();
    times.first = performance.now();
  }
  const rest = view.full ? '' : ', the rest follows';
  at('shown').textContent = `${count(drawn)} of ${count(data.header.all.points)} points drawn${rest}`;
  ringPoint();
}

async function start() {
  const served = document.documentElement.dataset.base;
  data = await load(served ? new ServedSource(served, location.search) : new PageSource());
  times.decoded = performance.now();
  if (!data.frames.length) {
    at('lead').textContent = 'There is no valid point.';
    document.querySelector('main').hidden = true;
    showFound(document.querySelector('#found dl'), data.header);
    at('settings').hidden = true;
    document.documentElement.dataset.ready = 'yes';
    return;
  }
  state.reasons = reasonColours(data, state);
  view = openView(data, state);
  view?.listeners.push(showDrawn);
  times.opened = performance.now();
  const { middle, whole } = view ?? measure(data);
  state.box = { centre: middle, extent: whole };
  charts = new Charts(at('charts'), data);
  makeSliders();
  listen();
  showRemoved(at('removed-text'), data.header);
  showFound(document.querySelector('#found dl'), data.header);
  at('footer').textContent = `lidar-outlier-filter ${data.header.version}. Everything is in this file.`;
  setView(view, 'orbit');
  state.slider = 0;
  state.step = data.header.sliders[0].given;
  state.bit = stepBit(data.header.sliders[0], state.step);
  state.found = { bit: state.bit, ...findGroups(data, state.bit) };
  groupsAgain();
  const most = state.found.groups[0]?.frame ?? 0;
  // Frames that lie on each other are shown one by one, those of a drive together.
  setFrames(!data.header.together, most);
  legend();
  setStep(0, data.header.sliders[0].given);
  if (!view) redraw();
  times.built = performance.now();
  document.documentElement.dataset.ready = 'yes';
}

start();
window.report = { state, times, choose, connect, setStep, setFrames, view: () => view, data: () => data };
