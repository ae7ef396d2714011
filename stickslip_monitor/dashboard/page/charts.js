// SPDX-License-Identifier: Apache-2.0
// Ten minutes of speed, load, margins and probability: drawn by uPlot, with the value under the
// pointer, a stretch to look at closer, and the alarms that came and went.

import { time } from './alarms.js';

const SPAN = 600, GAP = 10, HEIGHT = 165;
// Half of a time at the right end of its axis [px].
const RIGHT = 30;
const MARKS = { raise: '▼', clear: '△' };
const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

/** The rows of the last ten minutes, as the server makes them: time [ms] first. */
export class History {
  constructor(columns) { [this.columns, this.rows] = [columns, []]; }

  /** Take a row; whether it begins another second. Where the clock stepped back, the future goes. */
  add(row) {
    const second = (each) => Math.floor(each[0] / 1000), { rows } = this;
    const fresh = !rows.length || second(rows.at(-1)) !== second(row);
    while (rows.length && second(rows.at(-1)) >= second(row)) rows.pop();
    while (rows.length && rows[0][0] < row[0] - 1000 * SPAN) rows.shift();
    rows.push(row);
    return fresh;
  }

  /** Put before what has come since the page was opened what the server knows of before. */
  precede(rows) {
    const first = this.rows.length ? Math.floor(this.rows[0][0] / 1000) : Infinity;
    this.rows = [...rows.filter((row) => Math.floor(row[0] / 1000) < first), ...this.rows];
  }

  column(name) {
    const k = this.columns.indexOf(name);
    return this.rows.map((row) => row[k]);
  }

  /** Operating points, oldest first. */
  get trail() {
    const [speed, load] = ['speed', 'load'].map((name) => this.columns.indexOf(name));
    return this.rows.filter((row) => row[speed] !== null && row[load] !== null).map((row) => [row[speed], row[load]]);
  }
}

/** What each chart has: its lines, the factor to its unit, and the ends of its scale. */
function kinds(bearing) {
  const kilo = bearing.loads[1] >= 5000 ? 1000 : 1;
  return [
    { name: 'Shaft speed', unit: 'rpm', lines: [['speed', 'speed'], ['fold_speed', 'fold'], ['hopf_speed', 'Hopf']], of: (value) => Math.abs(value) * bearing.rpm },
    { name: 'Bearing load', unit: kilo > 1 ? 'kN' : 'N', lines: [['load', 'load']], of: (value) => value / kilo },
    { name: 'Margins', unit: '%', lines: [['fold_margin', 'fold'], ['hopf_margin', 'Hopf']], of: (value) => 100 * value, ends: [-100, 100] },
    { name: 'Probability', unit: '%', lines: [['probability_can', 'can happen'], ['probability_will', 'starts by itself'], ['probability_runs', 'runs']], of: (value) => 100 * value, ends: [0, 100], optional: true },
  ];
}

const DASHES = [[], [7, 4], [2, 3]], STROKES = ['—', '- -', '···'];
const digits = (value) => (value === null || value === undefined ? '–' : value.toFixed(Math.abs(value) < 100 ? 1 : 0));

export class Charts {
  /** history is what is drawn; events gives the alarms of the bearing that came and went. */
  constructor(root, bearing, history, events) {
    [this.root, this.history, this.events, this.window] = [root, history, events, null];
    this.choice = root.querySelector('select');
    this.choice.addEventListener('change', () => { this.window = null; this.show(); });
    this.charts = kinds(bearing).map((kind) => this.build(kind, bearing.name));
    new ResizeObserver(() => this.resize()).observe(root);
    this.show();
  }

  build(kind, group) {
    const figure = document.createElement('figure');
    figure.innerHTML = '<figcaption></figcaption><p class="nothing">No data.</p><div></div>';
    figure.querySelector('figcaption').textContent = `${kind.name} [${kind.unit}]`;
    this.root.append(figure);
    const axis = { stroke: () => css('--ink'), grid: { stroke: () => css('--line'), width: 1 }, ticks: { show: false }, font: '12px system-ui, DejaVu Sans, sans-serif' };
    const plot = new uPlot({
      width: 300,
      height: HEIGHT,
      padding: [null, RIGHT, null, null],
      legend: { live: true, markers: { show: false } },
      cursor: { sync: { key: group }, drag: { x: true, y: false, setScale: false } },
      tzDate: (seconds) => (time.local ? new Date(1e3 * seconds) : uPlot.tzDate(new Date(1e3 * seconds), 'Etc/UTC')),
      scales: { y: { range: (_, low, high) => kind.ends ?? [0, 1.08 * Math.max(high, 0) || 1] } },
      axes: [{ ...axis, values: '{HH}:{mm}:{ss}', space: 70, size: 26 }, { ...axis, size: 46 }],
      series: [
        { label: 'time', value: '{HH}:{mm}:{ss}' },
        ...kind.lines.map(([, label], k) => ({ label: kind.lines.length > 1 ? `${STROKES[k]} ${label}` : label, dash: DASHES[k], width: k ? 1.5 : 2, stroke: () => css(k ? '--ink' : '--trail'), value: (_, value) => digits(value), points: { show: false } })),
      ],
      hooks: {
        // Without a pointer the newest values are read.
        draw: [(u) => this.mark(u), (u) => { if (!(u.cursor.left >= 0)) u.setLegend({ idx: u.data[0].length - 1 }, false); }],
        setSelect: [(u) => { if (u.select.width > 3) this.zoom(u.posToVal(u.select.left, 'x'), u.posToVal(u.select.left + u.select.width, 'x')); }],
        ready: [(u) => u.over.addEventListener('dblclick', () => { this.window = null; this.show(); })],
      },
    }, [[], ...kind.lines.map(() => [])], figure.querySelector('div'));
    return { kind, figure, plot };
  }

  zoom(from, to) {
    this.window = [from, to];
    for (const { plot } of this.charts) plot.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false);
    this.show();
  }

  /** The stretch that is shown [s]: what somebody has drawn open, or the newest. */
  get stretch() {
    const end = (this.history.rows.at(-1)?.[0] ?? 0) / 1000;
    return this.window ?? [end - Number(this.choice.value), end];
  }

  show() {
    const times = this.history.column('time').map((ms) => ms / 1000);
    // Where no data came for long the line is broken.
    const breaks = times.map((at, k) => k > 0 && at - times[k - 1] > GAP);
    const broken = (column, of) => column.flatMap((value, k) => (breaks[k] ? [of(null, k), of(value, k)] : [of(value, k)]));
    const xs = broken(times, (value, k) => value ?? times[k - 1] + 1);
    const [min, max] = this.stretch;
    for (const { kind, figure, plot } of this.charts) {
      const lines = kind.lines.map(([name]) => broken(this.history.column(name), (value) => (value === null || value === undefined ? null : kind.of(value))));
      const known = lines.flat().filter((value) => value !== null);
      figure.hidden = Boolean(kind.optional) && !known.length;
      figure.classList.toggle('empty', !known.length);
      if (!known.length) continue;
      plot.setData([xs, ...lines], false);
      plot.setScale('x', { min, max });
      const least = known.reduce((a, b) => Math.min(a, b)), most = known.reduce((a, b) => Math.max(a, b));
      figure.setAttribute('aria-label', `${kind.name} in the last ten minutes: from ${digits(least)} to ${digits(most)} ${kind.unit}`);
    }
    this.root.classList.toggle('zoomed', this.window !== null);
  }

  /** A line where an alarm came or went. */
  mark(plot) {
    const { ctx, bbox } = plot, { min, max } = plot.scales.x;
    ctx.save();
    ctx.font = `${12 * devicePixelRatio}px system-ui, DejaVu Sans, sans-serif`;
    ctx.textAlign = 'center';
    ctx.setLineDash([]);
    for (const event of this.events()) {
      const at = event.time / 1000;
      if (!(event.what in MARKS) || at < min || at > max) continue;
      const x = plot.valToPos(at, 'x', true);
      ctx.strokeStyle = ctx.fillStyle = css(event.what === 'raise' ? '--alarm' : '--soft');
      ctx.beginPath();
      ctx.moveTo(x, bbox.top);
      ctx.lineTo(x, bbox.top + bbox.height);
      ctx.stroke();
      ctx.fillText(MARKS[event.what], x, bbox.top + 10 * devicePixelRatio);
    }
    ctx.restore();
  }

  resize() {
    for (const { figure, plot } of this.charts) {
      const width = figure.clientWidth;
      if (width && width !== plot.width) plot.setSize({ width, height: HEIGHT });
    }
  }

  /** The colours have changed. */
  redraw() { for (const { plot } of this.charts) plot.redraw(false, true); }
}
