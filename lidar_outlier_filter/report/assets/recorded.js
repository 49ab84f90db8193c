// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0

// The page of a recording or a file.

import { COLOUR_COLUMNS, MODES, REASON, TRUTH, at, isRejected, load, measure, node, stepBit } from 'data';
import { Charts, count, percent } from 'charts';
import { reasonColours } from 'colours';
import { connect, findGroups } from 'groups';
import { list, showFound, showGroups, showRemoved, slider } from 'panel';
import { Stage } from 'stage';
import { Tools, table } from 'tools';

const NEAR_STEPS = 2; // "near the threshold": rejected by one of so many stricter steps
const PAUSE = 250; // milliseconds without a change before the address is written
const KEYS = [['[ ]', 'frame before, after'], ['space', 'play'], ['G', 'next group'], ['< >', 'stricter, looser'], ['M', 'measure'], ['B', 'select in a box']];
const state = { slider: 0, step: 0, single: false, frame: 0, group: -1 };
const times = { start: performance.now() };
let data;
let stage;
let charts;
let tools;
let playing = 0;
let finding = 0;
let writing = 0;

// --- Sliders ---------------------------------------------------------------------------------

function makeSliders() {
  data.header.sliders.forEach((one, number) => {
    const [box, input] = slider(number, one);
    input.addEventListener('input', () => setStep(number, Number(input.value)));
    at('slider-list').append(box);
  });
  at('slider-list').append(node('p', { id: 'count', 'aria-live': 'polite' }));
  if (data.header.sliders.length > 1) at('slider-list').append(node('p', { class: 'quiet' }, 'Moving one sets the others back: combinations were not judged.'));
}

function settings() {
  const { name, texts, given } = data.header.sliders[state.slider];
  return state.step === given ? 'at the given settings' : `at ${name} ${texts[state.step]}`;
}

function setStep(number, step) {
  const { sliders, all, chain, hasTruth, detectors } = data.header;
  const now = sliders[number];
  state.slider = number;
  state.step = Math.min(Math.max(step, 0), now.texts.length - 1);
  state.bit = stepBit(now, state.step);
  state.stepNumber = detectors.find((one) => one.name === now.detector).number;
  sliders.forEach((one, i) => {
    const value = i === number ? state.step : one.given;
    const text = `${one.texts[value]}${value === one.given ? ' (given)' : ''}`;
    at(`slider-${i}`).value = value;
    at(`slider-${i}`).setAttribute('aria-valuetext', text);
    document.querySelector(`output[for=slider-${i}]`).textContent = text;
  });
  let nearBits = 0;
  for (let k = 1; k <= NEAR_STEPS && state.step - k >= 0; k += 1) nearBits |= stepBit(now, state.step - k);
  if (stage.view) {
    stage.view.shared.bit.value = state.bit;
    stage.view.shared.nearBits.value = nearBits >>> 0;
    stage.view.shared.stepNumber.value = state.stepNumber;
  }
  const counts = now.counts[state.step];
  at('count').replaceChildren(count(counts.points), node('small', {}, `of ${count(all.points)} measured points rejected, ${percent(counts.points, all.points)}`));
  at('lead').replaceChildren(node('strong', {}, `${count(counts.points)} of ${count(all.points)} measured points`), ` rejected by ${chain.join(', ')}${state.step === now.given ? '' : ` ${settings()}`}.`);
  showRemoved(at('removed-text'), data.header, counts, settings(), { hidden: state.hidden, hide });
  tools.count();
  changed();
  if (hasTruth) showTruth(counts, all);
  at('nothing').hidden = Boolean(counts.points) || !all.bad;
  at('nothing').textContent = nothingFound(all.bad, state.step > 0);
  at('yaml').textContent = now.yaml[state.step];
  at('lines').textContent = now.lines[state.step].join('\n') || '# nothing to set: these are the defaults';
  charts.update(state);
  listGroups();
  if (state.point) stage.choose(state.point.frame, state.point.index);
  stage.redraw();
}

// Where nothing is rejected though labels name outliers.
function nothingFound(bad, stricter) {
  return `The labels call ${count(bad)} ${bad === 1 ? 'point' : 'points'} an outlier, and none is rejected. They may lie as close and as level as good points do, `
    + 'as vegetation, vehicles and parts of things do; the labels may mean another class than outliers (--codes says which); '
    + `or the threshold is too loose${stricter ? ': move the slider to the left' : ''}. A detector of another kind, or one more in the chain, may find them.`;
}

function showTruth(counts, all) {
  const rejected = counts.bad + counts.good;
  const rows = [
    ['precision', rejected ? percent(counts.bad, rejected) : '–'], ['recall', percent(counts.bad, all.bad)],
    ['F1', percent(2 * counts.bad, rejected + all.bad)],
  ];
  at('truth').hidden = false;
  at('truth').replaceChildren(...rows.map(([name, value]) => node('div', {}, node('dt', {}, name), node('dd', { id: name }, value))));
}

// --- Time ------------------------------------------------------------------------------------

function setFrames(single, frame = state.frame) {
  const last = data.frames.length - 1;
  state.single = single;
  state.frame = Math.min(Math.max(frame, 0), last);
  at('whole').setAttribute('aria-pressed', !single);
  at('single').setAttribute('aria-pressed', single);
  at('frame').value = state.frame;
  const { hasFrames, sliders } = data.header;
  const name = hasFrames ? `${data.frames[state.frame].start.toFixed(2)} s` : `part ${state.frame + 1}`;
  at('frame-text').textContent = single ? `${name} · ${state.frame + 1} of ${last + 1}` : `${last + 1} ${hasFrames ? 'frames' : 'parts'}`;
  at('frame').setAttribute('aria-valuetext', at('frame-text').textContent);
  stage.setFrames(...(single ? [state.frame, state.frame] : [0, last]));
  changed();
  if (charts.time) charts.drawTime(sliders[state.slider], state);
}

function play() {
  const on = playing === 0;
  at('play').textContent = on ? '❚❚' : '▶';
  at('play').setAttribute('aria-label', on ? 'Pause' : 'Play');
  clearInterval(playing);
  playing = on ? setInterval(() => setFrames(true, (state.frame + 1) % data.frames.length), 200) : 0;
}

// --- Groups ----------------------------------------------------------------------------------

// Finding groups takes longer than a slider may.
function listGroups() {
  clearTimeout(finding);
  finding = setTimeout(() => {
    if (state.found.bit === state.bit) return;
    state.group = -1;
    state.found = { bit: state.bit, ...findGroups(data, state.bit) };
    showFoundGroups();
  }, 300);
}

function showFoundGroups() {
  showGroups(at('groups'), at('groups-about'), data.header, state.found, settings(), (number) => {
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
    button.toggleAttribute('aria-current', i === state.group);
    if (i !== state.group) return;
    button.setAttribute('aria-current', 'true');
    // Scroll the list, and nothing around it.
    const [one, all] = [button.getBoundingClientRect(), at('groups').getBoundingClientRect()];
    at('groups').scrollTop += Math.min(one.top - all.top, 0) + Math.max(one.bottom - all.bottom, 0);
  });
  if (state.single) setFrames(true, group.frame);
  stage.flyTo(group.low, group.high, group.frame, group.worst);
  stage.choose(group.frame, group.worst);
}

// --- Detectors, and the view in the address --------------------------------------------------

// Leave out what a detector rejects, or show it again.
function hide(number, hidden) {
  state.hidden = hidden ? state.hidden | (1 << number) : state.hidden & ~(1 << number);
  stage.view?.set('hidden', state.hidden >>> 0);
  changed();
}

// What the address says of the view; '' of what is as at first.
function address() {
  const { name, texts, given } = data.header.sliders[state.slider];
  const moved = state.step !== given;
  return {
    slider: moved ? name : '', value: moved ? texts[state.step] : '', frame: state.single ? state.frame : 'all',
    colour: state.mode || '', show: state.show || '', size: state.size === 2 ? '' : state.size, hidden: state.hidden || '',
    view: document.querySelector('[data-view][aria-pressed=true]')?.dataset.view ?? '',
    eye: stage.view ? stage.view.pose.map((value) => Number(value.toFixed(3))).join() : '',
  };
}

// Write the address when nothing has changed for a moment.
function changed() {
  clearTimeout(writing);
  writing = setTimeout(() => {
    const known = Object.entries(address()).filter(([, value]) => value !== '');
    try {
      history.replaceState(null, '', `#${new URLSearchParams(known).toString().replaceAll('%2C', ',')}`);
    } catch {
      // A browser that forbids it for files: the view is not kept.
    }
  }, PAUSE);
}

// What makes no sense in the address, of another recording perhaps, is left out.
function readAddress() {
  const { slider: name, value, frame, colour, show, size, hidden, view, eye } = Object.fromEntries(new URLSearchParams(location.hash.slice(1)));
  const number = data.header.sliders.findIndex((one) => one.name === name);
  const step = number < 0 ? -1 : data.header.sliders[number].texts.indexOf(value);
  if (step >= 0) setStep(number, step);
  if (frame) setFrames(frame !== 'all', Number(frame) || 0);
  for (const [id, value] of [['mode', colour], ['show', show]]) {
    if (![...at(id).options].some((option) => option.value === value)) continue;
    at(id).value = value;
    at(id).dispatchEvent(new Event('change'));
  }
  if (size >= 1 && size <= 8) stage.setSize(Number(size));
  for (const one of data.header.detectors) if (hidden >> one.number & 1) hide(one.number, true);
  if (['orbit', 'top', 'side'].includes(view)) stage.setView(view);
  const pose = (eye ?? '').split(',').map(Number);
  if (stage.view && pose.length === 7 && pose.every(Number.isFinite)) stage.view.pose = pose;
}

// --- Start -----------------------------------------------------------------------------------

async function copy(from, button) {
  try {
    await navigator.clipboard.writeText(from.textContent);
  } catch {
    // From a file, or without permission.
    getSelection().selectAllChildren(from);
    document.execCommand('copy');
  }
  button.textContent = 'Copied';
  setTimeout(() => { button.textContent = 'Copy'; }, 1500);
}

function drawn(number) {
  if (!times.first) {
    stage.view.finish();
    times.first = performance.now();
  }
  at('shown').textContent = `${count(number)} of ${count(data.header.all.points)} points drawn${stage.view.full ? '' : ', the rest follows'}`;
}

function modes() {
  const known = { [REASON]: reasonColours(data, {}).length > 0, [TRUTH]: data.header.hasTruth };
  for (const [mode, names] of Object.entries(COLOUR_COLUMNS)) known[mode] = names.every((name) => data.frames[0].columns[name]);
  return [...MODES.keys()].filter((mode) => known[mode] ?? true);
}

async function start() {
  data = await load();
  times.decoded = performance.now();
  showFound(document.querySelector('#found dl'), data.header);
  if (!data.frames.length) {
    at('lead').textContent = 'There is no valid point.';
    document.querySelector('main').hidden = true;
    at('settings').hidden = true;
    document.documentElement.dataset.ready = 'yes';
    return;
  }
  stage = new Stage(data, state, {
    near: `kept, rejected ${NEAR_STEPS} steps stricter`, modes, drawn, changed,
    keys: {
      '[': () => setFrames(true, state.frame - 1), ']': () => setFrames(true, state.frame + 1), ' ': play,
      g: () => chooseGroup(state.group + 1), m: () => tools.toggle('measure'), b: () => tools.toggle('box'),
      '<': () => setStep(state.slider, state.step - 1), '>': () => setStep(state.slider, state.step + 1),
    },
    keyNames: KEYS, takes: (...point) => tools.takes(...point), escaped: () => tools.take(''),
  });
  state.reasons = reasonColours(data, state);
  stage.open();
  charts = new Charts(at('charts'), data, measure(data.frames).map);
  tools = new Tools(data, state, stage);
  makeSliders();
  for (const [id, action] of [['whole', () => setFrames(false)], ['single', () => setFrames(true)], ['play', play]]) at(id).addEventListener('click', action);
  at('frame').max = data.frames.length - 1;
  at('frame').addEventListener('input', () => setFrames(true, Number(at('frame').value)));
  // The parts of a file follow each other in no time, and no node reads it.
  at('time').hidden = data.frames.length < 2 || !data.header.hasFrames;
  at('running').hidden = !data.header.hasFrames;
  for (const button of document.querySelectorAll('[data-copy]')) button.addEventListener('click', () => copy(at(button.dataset.copy), button));
  at('footer').textContent = `lidar-outlier-filter ${data.header.version}. Everything is in this file.`;
  const { given } = data.header.sliders[0];
  state.bit = stepBit(data.header.sliders[0], given);
  state.step = given;
  state.found = { bit: state.bit, ...findGroups(data, state.bit) };
  showFoundGroups();
  // Frames that lie on each other are shown one by one, those of a drive together.
  setFrames(!data.header.together, state.found.groups[0]?.frame ?? 0);
  stage.legend();
  setStep(0, given);
  readAddress();
  document.documentElement.dataset.ready = 'yes';
}

start();
window.report = { state, times, choose: (...point) => stage.choose(...point), connect, setStep, setFrames, chooseGroup, table, view: () => stage.view, data: () => data };
