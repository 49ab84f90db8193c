# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Colours, style and sorting of the page of an archive."""

from __future__ import annotations

# Of Okabe and Ito: different for the colour-blind too, on light and on dark ground.
COLOURS = ('#0072b2', '#e69f00', '#009e73', '#cc79a7', '#56b4e9', '#d55e00', '#b8a900')

STYLE = """
:root { color-scheme: light dark; --ground: #fff; --text: #1b1b1b; --soft: #5c5c5c;
  --line: #d8d8d8; --stripe: #f5f6f7; --odd: #b34a00; --failed: #8a1c5b; --plain: #6f9ec4; }
@media (prefers-color-scheme: dark) { :root { --ground: #16181b; --text: #e8e8e8; --soft: #a9adb3;
  --line: #3a3e44; --stripe: #1e2125; --odd: #ffa45c; --failed: #f08cc0; --plain: #4f7ea6; } }
* { box-sizing: border-box; }
body { margin: 0 auto; max-width: 90rem; padding: 1rem; background: var(--ground);
  color: var(--text); font: 15px/1.4 system-ui, sans-serif; }
h1 { font-size: 1.4rem; margin: 0 0 .8rem; }
.totals { display: grid; grid-template-columns: repeat(auto-fit, minmax(12rem, 1fr)); gap: .5rem;
  margin: 0; }
.totals div { border: 1px solid var(--line); border-radius: .4rem; padding: .4rem .6rem; }
.totals .warn dd { color: var(--odd); }
dt, small, figcaption, .note, .key { color: var(--soft); font-size: .85rem; }
dd { margin: 0; font-size: 1.15rem; font-variant-numeric: tabular-nums; overflow-wrap: anywhere; }
figure { margin: 1rem 0; }
svg { display: block; width: 100%; height: 5rem; border-bottom: 1px solid var(--line); }
rect.plain, i.plain { fill: var(--plain); background: var(--plain); }
rect.odd, i.odd { fill: var(--odd); background: var(--odd); }
rect.failed, i.failed { fill: var(--failed); background: var(--failed); }
i.plain, i.odd, i.failed, .key i { display: inline-block; width: .8em; height: .8em;
  margin: 0 .3em 0 .6em; border-radius: .15em; vertical-align: -.05em; }
.key span { white-space: nowrap; }
.scroll { overflow-x: auto; border: 1px solid var(--line); border-radius: .4rem; }
table { border-collapse: collapse; width: 100%; }
th, td { padding: .35rem .6rem; text-align: right; vertical-align: top;
  font-variant-numeric: tabular-nums; white-space: nowrap; font-weight: normal; }
th:first-child { text-align: left; position: sticky; left: 0; background: inherit;
  min-width: 20rem; max-width: 34rem; white-space: normal; overflow-wrap: anywhere; }
thead tr { background: var(--ground); }
thead th { border-bottom: 2px solid var(--line); font-weight: 600; }
tbody tr { background: var(--ground); }
tbody tr:nth-child(even) { background: var(--stripe); }
tbody tr:target { outline: 2px solid var(--odd); outline-offset: -2px; }
th b { font-weight: 600; }
th small { display: block; margin-top: .15rem; line-height: 1.25; white-space: nowrap;
  overflow: hidden; text-overflow: ellipsis; }
th small:hover, th small:focus { white-space: normal; overflow: visible; }
a { color: inherit; }
th a { color: var(--soft); font-size: .9em; }
label.note { display: block; margin: .6rem 0; }
th small.odd { color: var(--odd); }
th small.failed { color: var(--failed); }
td.odd { color: var(--odd); font-weight: 600; }
td.failed { color: var(--failed); font-weight: 600; }
thead button { all: unset; cursor: pointer; font-weight: 600; }
thead button:focus-visible { outline: 2px solid var(--odd); outline-offset: 2px; }
thead button::after { content: ' ↕'; color: var(--soft); }
th[aria-sort=ascending] button::after { content: ' ↑'; color: inherit; }
th[aria-sort=descending] button::after { content: ' ↓'; color: inherit; }
.bar { display: block; width: 6rem; height: 1em; margin-top: .2em; background: var(--line); }
.bar span { display: flex; height: 100%; min-width: 1px; }
.bar i { height: 100%; }
@media (min-width: 60rem) { .totals { grid-template-columns: repeat(5, 1fr); } }
@media (min-width: 84rem) { .scroll { overflow-x: visible; }
  thead th { position: sticky; top: 0; background: var(--ground); z-index: 1; } }
@media (max-width: 95rem) { table { font-size: .85rem; } th, td { padding: .3rem .35rem; }
  th:first-child { min-width: 15rem; max-width: 24rem; } .bar { width: 4rem; }
  thead button::after { content: ''; } }
@media (max-width: 40rem) { body { padding: .6rem; } th:first-child { min-width: 9rem;
  max-width: 45vw; }
  .totals { grid-template-columns: repeat(2, 1fr); } }
"""

# Buttons in the heads sort the rows; numbers from the largest, at first.
SCRIPT = """
const body = document.querySelector('tbody');
const heads = [...document.querySelectorAll('thead th')];
heads.forEach((head, column) => {
  const button = document.createElement('button');
  button.append(...head.childNodes);
  head.append(button);
  const number = head.dataset.kind === 'number';
  const value = row => {
    const text = row.cells[column].dataset.sort;
    return !number ? text : text === undefined ? -1 : text === 'inf' ? Infinity : Number(text);
  };
  button.addEventListener('click', () => {
    const before = head.getAttribute('aria-sort');
    const up = before ? before === 'descending' : !number;
    heads.forEach(other => other.removeAttribute('aria-sort'));
    head.setAttribute('aria-sort', up ? 'ascending' : 'descending');
    const compare = (a, b) => a < b ? -1 : a > b ? 1 : 0;
    body.append(...[...body.rows].sort(
      (a, b) => (up ? 1 : -1) * compare(value(a), value(b))));
  });
});
"""
