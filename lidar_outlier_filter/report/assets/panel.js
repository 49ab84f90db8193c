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
  if (about.rejected && point.reason) rows.push(['reason', point.reason]);
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
  if (detector && detector.name !== 'evidence') {
    text = `${detector.name} rejects what ${detector.rejects}. It measures one thing: the score is that ÷ its critical value.`;
  } else if (header.explained) {
    text = `No reasons here: ${count(header.explained)} ${header.explained === 1 ? 'point is' : 'points are'} explained, rejected or near the threshold.`;
  }
  return text ? [node('p', { class: 'quiet why' }, text)] : [];
}

// Which detectors reject how many points at the given settings, and for which reasons.
export function showRemoved(parent, { removed, chain }) {
  const row = (name, text, number) => node('li', {}, node('div', {}, node('b', {}, name), text ? node('small', {}, text) : ''), node('span', {}, count(number)));
  const found = new Map(removed.detectors);
  parent.append(node('p', { class: 'quiet' }, 'At the given settings.'));
  parent.append(node('ul', { class: 'removed' }, ...chain.map((name) => row(name, '', found.get(name) ?? 0))));
  if (!removed.reasons.length) return;
  parent.append(node('h3', {}, 'By the strongest reason'));
  const reasons = removed.reasons.map(([name, text, number]) => row(name, text, number));
  if (removed.others) reasons.push(row('others', '', removed.others));
  parent.append(node('ul', { class: 'removed' }, ...reasons));
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

export function showFound(parent, header) {
  const rows = [];
  if (header.topic) rows.push(['topic', header.topic]);
  rows.push(['read as', header.convention || 'no cloud had a valid point']);
  rows.push(['judged by', `${header.chain.join(', ')}${header.ways.length ? `: ${header.ways.join('; ')}` : ''}`]);
  if (header.hasFrames) {
    const rate = header.period ? `, one in ${Number((1000 * header.period).toPrecision(3))} ms` : '';
    rows.push(['clouds', `${count(header.clouds)}${rate}${header.seconds ? `, ${header.seconds.toFixed(2)} s` : ''}`]);
  }
  rows.push(['points', `${count(header.points)}, of them ${count(header.invalid)} missing returns and ${count(header.untested)} untested`]);
  rows.push(['drawn', header.drawn === header.all.points ? 'all valid points'
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
