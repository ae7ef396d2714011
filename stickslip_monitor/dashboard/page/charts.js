// SPDX-License-Identifier: Apache-2.0
// Ten minutes of speed, load, margins and probability, drawn once a second.

import { make, ticks } from '/map.js';

const SPAN = 600000, STEP = 1000, HEIGHT = 118, LEFT = 44, RIGHT = 8, TOP = 8, BOTTOM = 20;
const COLUMNS = ['time', 'speed', 'load', 'fold_margin', 'hopf_margin', 'probability_can', 'probability_will', 'probability_runs'];
const column = (name) => COLUMNS.indexOf(name);

/** The rows of the last ten minutes; the same rules as on the server, which has those of before. */
export class History {
  constructor() { this.rows = []; }

  add(status) {
    const lost = ['speed', 'load'].filter((name) => status.inputs[name]?.lost);
    const hidden = (name) => lost.includes(name) || (lost.length && (name.endsWith('margin') || name.startsWith('probability')));
    const row = COLUMNS.map((name) => (hidden(name) ? null : status[name]));
    const second = (each) => Math.floor(each[0] / STEP), { rows } = this;
    const fresh = !rows.length || second(rows.at(-1)) !== second(row);
    while (rows.length && second(rows.at(-1)) >= second(row)) rows.pop();
    while (rows.length && rows[0][0] < row[0] - SPAN) rows.shift();
    rows.push(row);
    return fresh;
  }

  /** Put before what has come since the page was opened what the server knows of before. */
  precede(rows) {
    const first = this.rows.length ? Math.floor(this.rows[0][0] / STEP) : Infinity;
    this.rows = [...rows.filter((row) => Math.floor(row[0] / STEP) < first), ...this.rows];
  }

  /** Operating points, oldest first. */
  get trail() { return this.rows.filter((row) => row[1] !== null && row[2] !== null).map((row) => [row[1], row[2]]); }
}

/** What each chart has: its lines, how a value becomes a number on it, and the ends of its scale. */
function kinds(bearing) {
  const kilo = bearing.loads[1] >= 5000 ? 1000 : 1;
  const size = (factor) => (value) => Math.abs(value) * factor;
  const percent = (value) => Math.min(Math.max(100 * value, -100), 100);
  return [
    { name: 'Shaft speed', unit: 'rpm', lines: [['speed', '']], of: size(bearing.rpm) },
    { name: 'Bearing load', unit: kilo > 1 ? 'kN' : 'N', lines: [['load', '']], of: size(1 / kilo) },
    { name: 'Margins', unit: '%', lines: [['fold_margin', 'fold'], ['hopf_margin', 'Hopf']], of: percent, ends: [-100, 100] },
    { name: 'Probability', unit: '%', lines: [['probability_can', 'can happen'], ['probability_will', 'starts by itself'], ['probability_runs', 'runs']], of: percent, ends: [0, 100], optional: true },
  ];
}

export class Charts {
  constructor(root, bearing) {
    this.root = root;
    this.charts = kinds(bearing).map((kind) => ({ kind, ...this.build(kind) }));
  }

  build({ name, unit, lines, optional }) {
    const figure = document.createElement('figure');
    const svg = make('svg', { role: 'img', 'aria-label': `${name}: nothing is known yet` });
    const caption = document.createElement('figcaption');
    caption.append(`${name} [${unit}]`);
    lines.forEach(([, words], k) => {
      if (!words) return;
      const item = document.createElement('span'), key = document.createElement('i');
      item.className = 'item';
      key.className = `line dash${lines.length - k}`;
      item.append(key, words);
      caption.append(item);
    });
    figure.append(caption, svg);
    figure.hidden = Boolean(optional);
    this.root.append(figure);
    return { figure, svg };
  }

  show(rows) {
    for (const chart of this.charts) {
      const known = chart.kind.lines.flatMap(([key]) => rows.map((row) => row[column(key)])).filter((value) => value !== null);
      if (chart.kind.optional) chart.figure.hidden = !known.length;
      if (!chart.figure.hidden) this.draw(chart, rows, known.map(chart.kind.of));
    }
  }

  draw({ kind, svg }, rows, known) {
    const width = svg.parentElement.clientWidth;
    if (!width) return;
    const [low, high] = kind.ends ?? [0, 1.05 * known.reduce((a, b) => Math.max(a, b), 1e-9)];
    const end = rows.at(-1)?.[0] ?? 0;
    const x = (time) => LEFT + (1 - (end - time) / SPAN) * (width - LEFT - RIGHT);
    const y = (value) => TOP + (1 - (value - low) / (high - low)) * (HEIGHT - TOP - BOTTOM);
    const parts = [make('rect', { class: 'field', x: LEFT, y: TOP, width: width - LEFT - RIGHT, height: HEIGHT - TOP - BOTTOM })];
    const levels = low < 0 ? [-100, 0, 100] : ticks(high, 3);
    for (const level of levels) {
      parts.push(make('path', { class: 'grid', d: `M${LEFT} ${y(level)}H${width - RIGHT}` }));
      parts.push(make('text', { x: LEFT - 5, y: y(level) + 4, 'text-anchor': 'end' }, String(+level.toPrecision(4))));
    }
    for (const [minutes, anchor] of [[10, 'start'], [5, 'middle'], [0, 'end']]) {
      parts.push(make('text', { x: x(end - minutes * 60000), y: HEIGHT - 5, 'text-anchor': anchor }, minutes ? `−${minutes} min` : 'now'));
    }
    kind.lines.forEach(([key], k) => parts.push(make('path', { class: `course dash${kind.lines.length - k}`, d: course(rows, column(key), x, y, kind.of) })));
    svg.setAttribute('viewBox', `0 0 ${width} ${HEIGHT}`);
    svg.replaceChildren(...parts);
    const text = (value) => value.toFixed(Math.abs(value) < 100 ? 1 : 0);
    const span = known.length ? `from ${text(known.reduce((a, b) => Math.min(a, b)))} to ${text(known.reduce((a, b) => Math.max(a, b)))} ${kind.unit}` : 'not known';
    svg.setAttribute('aria-label', `${kind.name} in the last ten minutes: ${span}`);
  }
}

/** A line with a gap wherever nothing is known, or nothing was heard for some seconds. */
function course(rows, k, x, y, of) {
  let path = '', before = -Infinity;
  for (const row of rows) {
    if (row[k] === null) { before = -Infinity; continue; }
    path += `${row[0] - before > 10 * STEP ? 'M' : 'L'}${x(row[0]).toFixed(1)} ${y(of(row[k])).toFixed(1)}`;
    before = row[0];
  }
  return path;
}
