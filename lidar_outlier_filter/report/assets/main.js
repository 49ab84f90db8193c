// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0

import { PageSource, ServedSource, describe, isRejected, load, measure, neighbours, samePointLine, stepBit } from 'data';
import { drawFlat } from 'flat';
import { Charts, count, percent } from 'charts';
import { list, node, showFound, showGroups, showPoint, showRemoved } from 'panel';
import { INTENSITY, MODES, REASON, TRUTH, legend as drawLegend, reasonColours } from 'colours';
import { connect, findGroups } from 'groups';
import { Tools, table } from 'tools';
import { drawOverlay } from 'overlay';
import { keepAddress, readAddress } from 'address';
import { listenToKeys } from 'keys';
import { listenToStage, openView, placeRing, setSize, setView } from 'stage';

const at = (id) => document.getElementById(id);
const NEAR_STEPS = 2; // "near the threshold": rejected by one of so many stricter steps
const KEYS = [['[ ]', 'frame before, after'], ['space', 'play'], ['G', 'next group'], ['< >', 'stricter, looser'], ['M', 'measure'], ['B', 'select in a box']];

const state = {
  slider: 0, step: 0, bit: 1, hidden: 0, stepNumber: 0, mode: INTENSITY, show: 0, size: 2, single: false, frame: 0, group: -1, point: null, box: null,
  firstFrame: 0, lastFrame: 0,
};
const times = { start: performance.now() };
let data;
let view = null;
let charts;
let tools;
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

function settings() {
  const slider = data.header.sliders[state.slider];
  return state.step === slider.given ? 'at the given settings' : `at ${slider.name} ${slider.texts[state.step]}`;
}

function setStep(number, step) {
  const { sliders, all, chain, hasTruth } = data.header;
  const slider = sliders[number];
  state.slider = number;
  state.step = Math.min(Math.max(step, 0), slider.texts.length - 1);
  state.bit = stepBit(slider, state.step);
  state.stepNumber = data.header.detectors.find((one) => one.name === slider.detector).number;
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
    view.shared.stepNumber.value = state.stepNumber;
  }
  const counts = slider.counts[state.step];
  at('count').replaceChildren(count(counts.points), node('small', {}, `of ${count(all.points)} measured points rejected, ${percent(counts.points, all.points)}`));
  at('lead').replaceChildren(node('strong', {}, `${count(counts.points)} of ${count(all.points)} measured points`), ` rejected by ${chain.join(', ')}${state.step === slider.given ? '' : ` at ${slider.name} ${slider.texts[state.step]}`}.`);
  showRemoved(at('removed-text'), data.header, counts, settings(), { hidden: state.hidden, hide });
  tools.count();
  keepAddress(address);
  if (hasTruth && all.bad) showTruth(counts, all);
  at('nothing').hidden = Boolean(counts.points) || !all.bad;
  at('nothing').textContent = nothingFound(all.bad, state.step > 0);
  at('yaml').textContent = slider.yaml[state.step];
  at('lines').textContent = slider.lines[state.step].join('\n') || '# nothing to set: these are the defaults';
  charts.update(state);
  listGroups();
  if (state.point) showChosen(state.point.frame, state.point.index);
  redraw();
}

// Where nothing is rejected though labels say that there is something.
function nothingFound(bad, stricter) {
  return `The labels call ${count(bad)} ${bad === 1 ? 'point' : 'points'} an outlier, and none is rejected. They may lie as close and as level as good points do, `
    + 'as vegetation, vehicles and parts of things do; the labels may mean another class than outliers (--codes says which); '
    + `or the threshold is too loose${stricter ? ': move the slider to the left' : ''}. A detector of another kind, or one more in the chain, may find them.`;
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
  keepAddress(address);
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
  if (tools.takes(number, index)) return;
  showChosen(number, index);
}

function showChosen(number, index) {
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
  }, 300);
}

function groupsAgain() {
  showGroups(at('groups'), at('groups-about'), data, state.found, settings(), (number) => {
    chooseGroup(number);
    // In one column the list is far below the points that it flies to.
    if (matchMedia('(max-width: 1000px)').matches) at('stage').scrollIntoView();
  });
}

// Scroll a list, and nothing around it, as little as it takes to see one of its rows.
function reveal(row, list_) {
  const [one, all] = [row.getBoundingClientRect(), list_.getBoundingClientRect()];
  list_.scrollTop += Math.min(one.top - all.top, 0) + Math.max(one.bottom - all.bottom, 0);
}

function chooseGroup(number) {
  const { groups } = state.found;
  if (!groups.length) return;
  state.group = (number + groups.length) % groups.length;
  const group = groups[state.group];
  at('groups').querySelectorAll('button').forEach((button, i) => {
    if (i === state.group) {
      button.setAttribute('aria-current', 'true');
      reveal(button, at('groups'));
    } else button.removeAttribute('aria-current');
  });
  if (state.single) setFrames(true, group.frame);
  const middle = group.low.map((low, a) => (low + group.high[a]) / 2);
  if (view) view.flyTo(middle, Math.max(...group.high.map((high, a) => high - group.low[a]), 2));
  showChosen(group.frame, group.worst);
}

// --- Detectors, and the view in the address --------------------------------------------------

// Leave out what a detector rejects, or show it again.
function hide(number, hidden) {
  state.hidden = hidden ? state.hidden | (1 << number) : state.hidden & ~(1 << number);
  view?.set('hidden', state.hidden >>> 0);
  keepAddress(address);
}

// What the address says of the view; '' of what is as at first.
function address() {
  const slider = data.header.sliders[state.slider];
  return {
    slider: state.step === slider.given ? '' : slider.name, value: state.step === slider.given ? '' : slider.texts[state.step],
    frame: state.single ? state.frame : 'all', colour: state.mode || '', show: state.show || '', size: state.size === 2 ? '' : state.size,
    hidden: state.hidden || '', view: document.querySelector('[data-view][aria-pressed=true]').dataset.view,
    eye: view ? view.pose.map((value) => Number(value.toFixed(3))).join() : '',
  };
}

// What it says that makes no sense, of another recording perhaps, is left out.
function readView() {
  const { slider, value, frame, colour, show, size, hidden, view: name, eye } = readAddress();
  const number = data.header.sliders.findIndex((one) => one.name === slider);
  const step = number < 0 ? -1 : data.header.sliders[number].texts.indexOf(value);
  if (step >= 0) setStep(number, step);
  if (frame) setFrames(frame !== 'all', Number(frame) || 0);
  for (const [id, wanted] of [['mode', colour], ['show', show]]) {
    if (![...at(id).options].some((option) => option.value === wanted)) continue;
    at(id).value = wanted;
    at(id).dispatchEvent(new Event('change'));
  }
  if (size >= 1 && size <= 8) setSize(view, state, Number(size));
  for (const one of data.header.detectors) if (hidden >> one.number & 1) hide(one.number, true);
  if (!view) return;
  if (['orbit', 'top', 'side'].includes(name)) setView(view, name);
  const pose = (eye ?? '').split(',').map(Number);
  if (pose.length === 7 && pose.every(Number.isFinite)) view.pose = pose;
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
  for (const id of ['mode', 'show', 'size']) at(id).addEventListener('input', () => keepAddress(address));
  at('whole').addEventListener('click', () => setFrames(false));
  at('single').addEventListener('click', () => setFrames(true));
  at('play').addEventListener('click', play);
  at('frame').max = data.frames.length - 1;
  at('frame').addEventListener('input', () => setFrames(true, Number(at('frame').value)));
  at('time').hidden = data.frames.length < 2;
  listenToKeys(() => view, {
    '[': () => setFrames(true, state.frame - 1), ']': () => setFrames(true, state.frame + 1), ' ': play,
    g: () => chooseGroup(state.group + 1),
    m: () => tools.take(state.tool === 'measure' ? '' : 'measure'), b: () => tools.take(state.tool === 'box' ? '' : 'box'),
    '<': () => setStep(state.slider, state.step - 1), '>': () => setStep(state.slider, state.step + 1),
  }, KEYS, () => tools.take(''));
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
  overlay();
  keepAddress(address);
}

const overlay = () => drawOverlay(view, state, data.header.path);

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
  times.opened = performance.now();
  const { middle, whole } = view ?? measure(data);
  state.box = { centre: middle, extent: whole };
  charts = new Charts(at('charts'), data, state.box);
  tools = new Tools(data, state, view, overlay);
  makeSliders();
  listen();
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
  readView();
  view?.listeners.push(showDrawn);
  if (!view) redraw();
  times.built = performance.now();
  document.documentElement.dataset.ready = 'yes';
}

start();
window.report = { state, times, choose, connect, setStep, setFrames, table, view: () => view, data: () => data };
