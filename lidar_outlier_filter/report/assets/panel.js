// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0

// What the page says of a point, of the groups, and of the source.

import { BAD, LARGEST_SCORE } from 'data';
import { bars, count, percent } from 'charts';
import { CELL } from 'groups';

export function node(name, attributes = {}, ...children) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  made.append(...children);
  return made;
}

export function list(parent, rows) {
  parent.replaceChildren();
  for (const [name, value] of rows) {
    parent.append(node('dt', {}, name), node('dd', {}, value));
  }
}

const metres = (values) => values.map((value) => value.toFixed(2)).join(', ');

function scoreText({ score, exact }) {
  if (Number.isNaN(score)) return 'untested';
  if (exact) return score.toPrecision(4);
  return score >= LARGEST_SCORE ? `${score.toFixed(2)} or more` : `about ${score.toFixed(2)}`;
}

// A point: its fields, its score, why, its neighbours.
export function showPoint(parent, data, point, about) {
  const { header } = data;
  const detector = header.detectors.find((one) => one.number === point.detector);
  const rows = [
    ['score', scoreText(point)],
    ['verdict', about.rejected ? `rejected${detector ? ` by ${detector.name}` : ''}` : 'kept'],
    ['x, y, z', `${metres(point.position)} m`],
  ];
  if (about.rejected && point.reason) rows.push(['reason', `${header.reasonTexts[header.reasons.indexOf(point.reason)]} (${point.reason})`]);
  if (point.truth) rows.push(['truth', point.truth === BAD ? 'outlier' : 'good']);
  if (!Number.isNaN(point.intensity)) rows.push(['intensity', `${point.exact ? '' : 'about '}${Number(point.intensity.toPrecision(4))}`]);
  if (point.exact) rows.push(['time', `${point.time.toFixed(6)} s`]);
  rows.push(['scan line', `${point.exact ? point.lineName : `number ${point.line + 1} of its frame`}, ${count(about.inLine)} points drawn`]);
  if (about.near.length) {
    rows.push(['neighbours', `${about.near.length} nearest drawn ones ${about.near[0].toFixed(2)} to ${about.near[about.near.length - 1].toFixed(2)} m away`]);
  }
  const facts = node('dl', { id: 'facts' });
  list(facts, rows);
  parent.replaceChildren(facts);
  parent.append(...why(header, point, detector));
}

// What each feature adds, or why that is not said.
function why(header, point, detector) {
  if (point.features.length) {
    const title = point.ofSum ? 'Why: parts of the score, rejected above 1' : 'Why: what adds up to the log-odds';
    return [node('h3', {}, title), bars(point.features)];
  }
  let text = '';
  if (detector && detector.name !== 'boosted_trees') {
    text = `${detector.name} rejects what ${detector.rejects}. It measures one thing: the score is that ÷ its critical value.`;
  } else if (header.explained) {
    text = `No reasons here: ${count(header.explained)} ${header.explained === 1 ? 'point is' : 'points are'} explained, rejected or near the threshold.`;
  }
  return text ? [node('p', { class: 'quiet why' }, text)] : [];
}

// A box to tick: whether what a detector rejects is in the picture.
function eye({ name, number }, hidden, hide) {
  const box = node('input', { type: 'checkbox', 'aria-label': `show what ${name} rejects`, title: 'shown in the picture', 'data-detector': name });
  box.checked = !(hidden >> number & 1);
  box.addEventListener('change', () => hide(number, !box.checked));
  return box;
}

// Which detectors reject how many points at a step of a slider, and for which reasons.
// `hide` is called to leave out what a detector rejects, in the picture.
export function showRemoved(parent, header, counts, settings, { hidden, hide }) {
  const { chain, masked, reasons, reasonTexts } = header;
  const row = (name, text, number) => node('li', {}, node('div', {}, node('b', {}, name), text ? node('small', {}, text) : ''), node('span', {}, count(number)));
  const rows = chain.map((name) => {
    const made = row(name, '', counts.detectors[name] ?? 0);
    if (chain.length > 1) made.firstChild.prepend(eye(header.detectors.find((one) => one.name === name), hidden, hide));
    return made;
  });
  if (masked) rows.push(row('mask', 'on the own vehicle; not among the points counted above', masked));
  parent.replaceChildren(node('p', { class: 'quiet' }, `${settings[0].toUpperCase()}${settings.slice(1)}.`), node('ul', { class: 'removed' }, ...rows));
  if (!counts.reasons.length) return;
  parent.append(node('h3', {}, 'By the strongest reason'));
  const known = counts.reasons.map(([number, n]) => row(reasonTexts[number - 1], reasons[number - 1], n));
  const rest = counts.points - counts.reasons.reduce((sum, [, n]) => sum + n, 0);
  if (rest) known.push(row('others', 'or kept at the given settings, where no reason is noted', rest));
  parent.append(node('ul', { class: 'removed' }, ...known));
}

// The largest groups of rejected points. `settings` says at which settings.
export function showGroups(parent, about, data, { groups, total }, settings, choose) {
  const { header } = data;
  const listed = groups.length < total ? `The largest ${groups.length} of ${count(total)}` : `${count(total)}`;
  const drawn = header.drawn < header.all.points ? ' that are drawn' : '';
  about.textContent = groups.length
    ? `${listed}, ${settings}: rejected points${drawn} in touching cells of ${CELL} m${header.together ? '' : ', frame by frame'}.`
    : `No point is rejected ${settings}.`;
  parent.replaceChildren(...groups.map((group, i) => {
    const wide = Math.max(...group.high.map((value, a) => value - group.low[a]));
    const text = [];
    if (wide >= 0.005) text.push(`${wide.toFixed(2)} m wide`);
    // Where points were moved, their range is not their distance from the origin.
    if (header.hasRange && !header.moved) text.push(`${group.range.toFixed(1)} m away`);
    const button = node('button', { type: 'button' },
      node('b', {}, `${count(group.count)} ${group.count === 1 ? 'point' : 'points'}`),
      node('span', {}, text.join(', ')));
    button.addEventListener('click', () => choose(i));
    return node('li', {}, button);
  }));
}

function notCounted({ invalid, masked }) {
  const parts = [];
  if (invalid) parts.push(`${count(invalid)} missing ${invalid === 1 ? 'return' : 'returns'}, which are nowhere`);
  if (masked) parts.push(`${count(masked)} on the own vehicle`);
  return parts.join('; ') || 'none';
}

export function showFound(parent, header) {
  const rows = [];
  if (header.topic) rows.push(['topic', header.topic]);
  rows.push(['read as', header.convention || 'no cloud had a valid point']);
  rows.push(['judged by', `${header.chain.join(', ')}${header.ways.length ? `: ${header.ways.join('; ')}` : ''}`]);
  if (header.hasFrames) {
    const rate = header.period ? `, one in ${Number((1000 * header.period).toPrecision(3))} ms` : '';
    rows.push(['clouds', `${count(header.clouds)}${rate}${header.seconds ? `, ${header.seconds.toFixed(2)} s` : ''}`]);
  }
  rows.push(['points', `${count(header.all.points)} measured points. Every count and share on this page is of them; ${header.untested ? count(header.untested) : 'none'} of them untested`]);
  rows.push(['not counted', notCounted(header)]);
  rows.push(['drawn', header.drawn === header.all.points ? 'all of them'
    : `${count(header.drawn)} of ${count(header.all.points)} (${percent(header.drawn, header.all.points)}): the rejected first, an even sample of the rest; counts are of all`]);
  rows.push(['explained', `${count(header.explained)} points, rejected or near the threshold`]);
  const refused = Object.entries(header.refusals);
  if (header.hasFrames) {
    rows.push(['refused', refused.length ? refused.map(([what, n]) => `${count(n)} for ${what}`).join(', ') : 'none']);
    const gaps = header.gaps.slice(0, 5).map(([at, long]) => `${long.toFixed(2)} s at ${at.toFixed(1)} s`).join(', ');
    rows.push(['gaps', header.gaps.length ? `${header.gaps.length >= 50 ? 'at least 50' : header.gaps.length}; the longest: ${gaps}` : 'none']);
    rows.push(['frame', header.moved ? 'moved by odometry, stands still' : 'that of the clouds']);
    if (header.unmoved) rows.push(['without poses', `${count(header.unmoved)} clouds`]);
  }
  list(parent, rows);
}
