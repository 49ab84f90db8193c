// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0

// What the page says of a point, of the groups, and of the source; and sliders.

import { BAD, LARGEST_SCORE, coordinates, lengthText, node } from 'data';
import { count, percent } from 'charts';
import { CELL } from 'groups';

const ALONE = 3; // times the distance that is usual

export function list(parent, rows) {
  parent.replaceChildren();
  for (const [name, value] of rows) parent.append(node('dt', {}, name), node('dd', {}, value));
}

// A slider for a threshold: `texts` of its values, and which it has.
export function slider(number, { name, texts, given }, ...more) {
  const id = `slider-${number}`;
  const input = node('input', { type: 'range', id, min: 0, max: texts.length - 1, step: 1, value: given, 'aria-valuetext': texts[given] });
  const ends = node('p', { class: 'ends' }, node('span', {}, 'rejects more'), node('span', {}, 'rejects less'));
  const label = node('label', { for: id }, name, node('output', { for: id }, texts[given]));
  return [node('div', { class: 'slider' }, label, input, ends, ...more), input, label.lastChild];
}

function scoreText({ score, exact }) {
  if (Number.isNaN(score)) return 'untested';
  if (exact) return score.toPrecision(4);
  return score >= LARGEST_SCORE ? `${score.toFixed(2)} or more` : `about ${score.toFixed(2)}`;
}

// A point: its fields, its score, why, its neighbours.
export function showPoint(parent, header, point, about) {
  const detector = header.detectors.find((one) => one.number === point.detector);
  const { distances, inLine } = about;
  const rows = [
    ['score', scoreText(point)],
    ['verdict', about.rejected ? `rejected${detector ? ` by ${detector.name}` : ''}` : 'kept'],
    ['x, y, z', coordinates(header, point.position)],
  ];
  if (about.rejected && point.reason) rows.push(['reason', `${header.reasonTexts[header.reasons.indexOf(point.reason)]} (${point.reason})`]);
  if (point.truth) rows.push(['truth', point.truth === BAD ? 'outlier' : 'good']);
  for (const [name, value] of Object.entries(point.values)) if (value) rows.push([name.replace('_', ' '), name === 'time' ? `${value} s` : value]);
  rows.push(['scan line', `number ${point.line + 1} of its frame, ${count(inLine)} points drawn`]);
  if (distances.length) {
    const [first, last] = [distances[0], distances[distances.length - 1]].map((one) => lengthText(header, one));
    rows.push(['neighbours', `${distances.length} nearest drawn ones ${first} to ${last} away`]);
  }
  const facts = node('dl', { id: 'facts' });
  list(facts, rows);
  parent.replaceChildren(facts, ...why(header, point, detector, about));
}

export function clearPoint(parent) {
  parent.replaceChildren(node('p', { class: 'quiet' }, 'Click a point.'));
}

// How a point lies among its neighbours, in words; '' where nothing is special.
function place(header, { distances, rejectedNear, spacing }) {
  if (!distances.length) return 'alone: no other return is drawn';
  const nearest = `nearest return ${lengthText(header, distances[0], 1)}`;
  if (distances[0] > ALONE * spacing) return `alone: ${nearest}, where ${lengthText(header, spacing)} is usual`;
  return rejectedNear ? `among other rejected returns: ${rejectedNear} of its ${distances.length} nearest` : nearest;
}

// Why a point is rejected, or nearly: how it lies, and the features that add most to its score.
function why(header, point, detector, about) {
  const words = [];
  if (about.rejected) words.push(place(header, about));
  const added = (name, value) => node('small', { class: 'quiet' }, `${name}, +${value.toFixed(2)}`);
  words.push(...point.features.map(([[name, text], value]) => [`${text} `, added(name, value)]));
  if (detector && !point.features.length) words.push(`${detector.name} rejects a point that ${detector.rejects.split('. ')[0]}`);
  if (!words.length) return [];
  const title = about.rejected ? 'Why' : 'What speaks for a rejection';
  return [node('h3', {}, title), node('ul', { class: 'why' }, ...words.map((texts) => node('li', {}, ...[texts].flat())))];
}

// A box to tick: whether the points that a detector rejects are in the picture.
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
  const known = counts.reasons.map(([number, n]) => row(reasonTexts[number - 1], reasons[number - 1], n));
  const rest = counts.points - counts.reasons.reduce((sum, [, n]) => sum + n, 0);
  if (rest) known.push(row('others', 'or kept at the given settings, where no reason is noted', rest));
  parent.append(node('h3', {}, 'By the strongest reason'), node('ul', { class: 'removed' }, ...known));
}

// The largest groups of rejected points. `settings` says at which settings.
export function showGroups(parent, about, header, { groups, total }, settings, choose) {
  const listed = groups.length < total ? `The largest ${groups.length} of ${count(total)}` : `${count(total)}`;
  const drawn = header.drawn < header.all.points ? ' that are drawn' : '';
  about.textContent = groups.length
    ? `${listed}, ${settings}: rejected points${drawn} in touching cells of ${lengthText(header, CELL)}${header.together ? '' : ', frame by frame'}.`
    : `No point is rejected ${settings}.`;
  parent.replaceChildren(...groups.map((group, i) => {
    const wide = Math.max(...group.high.map((value, a) => value - group.low[a]));
    const size = wide >= 0.005 ? `, ${lengthText(header, wide)} wide` : '';
    const middle = group.low.map((value, a) => (value + group.high[a]) / 2);
    const button = node('button', { type: 'button' },
      node('b', {}, `${count(group.count)} ${group.count === 1 ? 'point' : 'points'}${size}`),
      node('span', {}, coordinates(header, middle, 1)));
    button.addEventListener('click', () => choose(i));
    return node('li', {}, button);
  }));
}

function notCounted({ invalid, masked }) {
  const parts = [];
  if (invalid) parts.push(`${count(invalid)} missing ${invalid === 1 ? 'return' : 'returns'}`);
  if (masked) parts.push(`${count(masked)} on the own vehicle`);
  return parts.join('; ') || 'none';
}

export function showFound(parent, header) {
  const all = count(header.all.points);
  const rows = [
    ['topic', header.topic],
    ['read as', header.convention || 'no cloud had a valid point'],
    ['coordinates', header.hasFrames ? 'metres' : `as in the file, ${header.unit}`],
    ['judged by', `${header.chain.join(', ')}${header.methods.length ? `: ${header.methods.join('; ')}` : ''}`],
    ['points', `${all} measured points. Every count and share on this page is of them; ${header.untested ? count(header.untested) : 'none'} of them untested`],
    ['not counted', notCounted(header)],
    ['drawn', header.drawn === header.all.points ? 'all of them'
      : `${count(header.drawn)} of ${all} (${percent(header.drawn, header.all.points)}): rejected ones first, an even sample of the rest; counts are of all`],
  ];
  if (header.hasFrames) {
    const rate = header.period ? `, one in ${Number((1000 * header.period).toPrecision(3))} ms` : '';
    const refused = Object.entries(header.refusals).map(([what, n]) => `${count(n)} for ${what}`);
    const gaps = header.gaps.slice(0, 5).map(([begin, long]) => `${long.toFixed(2)} s at ${begin.toFixed(1)} s`).join(', ');
    rows.push(
      ['clouds', `${count(header.clouds)}${rate}${header.seconds ? `, ${header.seconds.toFixed(2)} s` : ''}`],
      ['refused', refused.join(', ') || 'none'],
      ['gaps', gaps ? `${header.gaps.length >= 50 ? 'at least 50' : header.gaps.length}; the longest: ${gaps}` : 'none'],
      ['frame', header.moved ? 'fixed, moved by odometry' : 'that of the clouds'],
      ['without poses', header.without_pose ? `${count(header.without_pose)} clouds` : ''],
    );
  }
  list(parent, rows.filter(([, value]) => value));
}
