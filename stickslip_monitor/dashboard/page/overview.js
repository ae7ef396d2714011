// SPDX-License-Identifier: Apache-2.0
// Many bearings at a glance, worst first; of few there is no need for it.

import { get, put } from './dom.js';

const FEW = 4, FEW_ON_PHONE = 2;
/** A screen on which a bearing takes several heights. */
const phone = matchMedia('(max-width: 44rem)');
// One without data comes first, with those that nobody watches: its state is unknown.
const WORST = ['not_monitoring', 'stick_slip', 'amplitude_limit', 'input_stale', 'waiting', 'unreliable', 'bistable', 'vibration', 'caution', 'normal'];
const WORDS = { normal: '✓ normal', caution: '! margin low', bistable: '! bistable', stick_slip: '▲ stick-slip', amplitude_limit: '▲ amplitude', vibration: '! vibration', input_stale: '✕ input lost', unreliable: '! unreliable', waiting: '… waiting', not_monitoring: '✕ not monitored' };
const badness = ({ status, missing }) => (missing ? 0 : status ? WORST.indexOf(status.reason) : WORST.indexOf('waiting'));

export class Overview {
  /** reveal is called with the set of names of those that are to be shown in full, show with one to scroll to. */
  constructor(reveal, show) {
    Object.assign(this, { reveal, show });
    this.rows = new Map();
    [this.root, this.body, this.find, this.only, this.counts] = ['overview', 'rows', 'find', 'only', 'counts'].map(get);
    this.find.addEventListener('input', () => this.order());
    this.only.addEventListener('change', () => this.order());
    this.body.addEventListener('click', (event) => {
      const name = event.target.closest('button')?.dataset.name;
      if (name) this.touch(name);
    });
    phone.addEventListener('change', () => { if (this.bearings) this.begin(this.bearings); });
  }

  begin(bearings) {
    this.bearings = bearings;
    this.root.hidden = bearings.length <= (phone.matches ? FEW_ON_PHONE : FEW);
    document.body.classList.toggle('many', !this.root.hidden);
    document.body.classList.toggle('crowd', bearings.length > FEW);
    this.rows = new Map();
    this.body.replaceChildren();
    if (this.root.hidden) { this.reveal(new Set(bearings.map(({ name }) => name))); return; }
    for (const { name, status } of bearings) {
      const row = this.body.insertRow();
      row.innerHTML = `<td><button type="button"></button></td>${'<td></td>'.repeat(4)}`;
      const button = row.querySelector('button');
      button.dataset.name = button.textContent = name;
      this.rows.set(name, { row, status, name, missing: false });
      this.fill(name, status);
    }
    this.order();
    if (!this.rows.has(this.chosen)) this.chosen = phone.matches ? null : this.sorted()[0].name;
    this.choose();
  }

  take(status) {
    const own = this.bearings?.find(({ name }) => name === status.bearing);
    if (own) own.status = status;
    if (!this.rows.size) return;
    const before = this.rows.get(status.bearing)?.status;
    this.fill(status.bearing, status);
    if (before?.reason !== status.reason) this.order();
  }

  fill(name, status) {
    const own = this.rows.get(name);
    if (!own) return;
    own.status = status;
    own.row.dataset.reason = own.missing ? 'missing' : status?.reason ?? 'waiting';
    if (!status) status = { reason: 'waiting', load: null, fold_margin: null, rpm: null };
    const load = status.load === null ? '–' : (status.load / 1000).toFixed(1);
    const margin = status.fold_margin === null ? '–' : (Math.round(100 * status.fold_margin) + 0).toFixed(0);
    const texts = [own.missing ? '✕ no data' : `${WORDS[status.reason] ?? status.reason}${status.held_until ? ' (held)' : ''}`, status.rpm === null ? '–' : `${Math.abs(status.rpm).toFixed(1)}`, load, margin];
    texts.forEach((text, k) => put(own.row.cells[k + 1], text));
  }

  /** The last record of one without data is not its state. */
  mark(missing) {
    const before = [...this.rows.values()].filter((own) => own.missing !== missing.includes(own.name));
    for (const own of before) { own.missing = !own.missing; this.fill(own.name, own.status); }
    if (before.length) this.order();
  }

  sorted() {
    const margin = ({ status }) => status?.fold_margin ?? Infinity;
    return [...this.rows.values()].sort((a, b) => badness(a) - badness(b) || (margin(a) < margin(b) ? -1 : margin(a) > margin(b) ? 1 : 0));
  }

  /** How many are in each state, the worst first. */
  count() {
    const states = new Map();
    for (const { row } of this.sorted()) states.set(row.cells[1].textContent, (states.get(row.cells[1].textContent) ?? 0) + 1);
    this.counts.textContent = `${this.rows.size}: ${[...states].map(([words, number]) => `${number} ${words.slice(2)}`).join(', ')}`;
  }

  order() {
    this.count();
    const wanted = this.find.value.trim().toLowerCase();
    this.sorted().forEach(({ row, name }, k) => {
      row.hidden = !name.toLowerCase().includes(wanted) || (this.only.checked && row.dataset.reason === 'normal');
      if (this.body.rows[k] !== row) this.body.insertBefore(row, this.body.rows[k] ?? null);
    });
  }

  /** Show a bearing in full; on a phone, where it is far below, go there, and touched again hide it. */
  touch(name) {
    this.chosen = phone.matches && name === this.chosen ? null : name;
    this.choose();
    if (phone.matches && this.chosen) this.show(this.chosen);
  }

  choose() {
    for (const { row, name } of this.rows.values()) row.querySelector('button').setAttribute('aria-pressed', name === this.chosen);
    this.reveal(new Set(this.chosen ? [this.chosen] : []));
  }
}
