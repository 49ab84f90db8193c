// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0

// What the page says of a point, of the groups, and of the source.

import { BAD } from 'data';
import { bars, count, percent } from 'charts';

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

// A point: its fields, its score, why, its neighbours.
export function showPoint(parent, data, point, about) {
  const { header } = data;
  const detector = header.detectors.find((one) => one.number === point.detector);
  const rows = [
    ['score', Number.isNaN(point.score) ? 'untested' : `${point.exact ? point.score.toPrecision(4) : `about ${point.score.toFixed(2)}`}`],
    ['verdict', about.rejected ? `rejected${detector ? ` by ${detector.name}` : ''}` : 'kept'],
    ['x, y, z', `${metres(point.place)} m`],
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
  if (point.features.length) {
    parent.append(node('h3', {}, 'Why: what features add to the log-odds'), bars(point.features));
  } else if (header.trees) {
    const text = header.explained === 1 ? '1 point is' : `${count(header.explained)} points are`;
    parent.append(node('p', { class: 'quiet', style: 'margin-top:8px' }, `No reasons here: ${text} explained, rejected or near the threshold.`));
  }
}

export function showGroups(parent, about, data, choose) {
  const { groups, allGroups } = data.header;
  const listed = groups.length < allGroups ? `The largest ${groups.length} of ${count(allGroups)}` : `${count(allGroups)}`;
  about.textContent = groups.length
    ? `${listed}, at the given settings: rejected points in touching cells of ${data.header.cell} m${data.header.together ? '' : ', frame by frame'}.` : 'No point is rejected at the given settings.';
  groups.forEach((group, i) => {
    const size = Math.max(...group.size);
    const button = node('button', { type: 'button' },
      node('b', {}, `${count(group.count)} ${group.count === 1 ? 'point' : 'points'}`),
      node('span', {}, `${size >= 0.005 ? `${size.toFixed(2)} m wide` : ''}${size >= 0.005 && data.header.hasRange ? ', ' : ''}${data.header.hasRange ? `${group.range.toFixed(1)} m away` : ''}`));
    button.addEventListener('click', () => choose(i));
    parent.append(node('li', {}, button));
  });
}

export function showFound(parent, header) {
  const rows = [];
  if (header.topic) rows.push(['topic', header.topic]);
  rows.push(['read as', header.convention || 'no cloud had a valid point']);
  rows.push(['judged by', `${header.chain.join(', ')}${header.trees ? ', trees on the scan pattern' : ''}`]);
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
