/* SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors */
/* SPDX-License-Identifier: Apache-2.0 */
// Buttons in the headings sort the rows; numbers the largest first.
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
