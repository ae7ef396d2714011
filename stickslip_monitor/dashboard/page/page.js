// SPDX-License-Identifier: Apache-2.0
// Takes the stream of events and shows it. Every text from outside is set as text, never as markup.

import { AlarmList, clock, nameOf, withoutName } from '/alarms.js';
import { AmplitudeGauge, MarginGauge } from '/gauges.js';
import { StabilityMap } from '/map.js';
import { connect } from '/stream.js';

const TRAIL = 600, SILENCE = 12000, ANSWER = 5000;
const REASONS = { normal: '✓ Normal', caution: '! Margin low', bistable: '! Bistable', stick_slip: '▲ Stick-slip predicted', amplitude_limit: '▲ Amplitude above limit', input_stale: '✕ Input lost', waiting: '… Waiting', not_monitoring: '✕ Not monitoring' };
const WHAT = { raise: 'came', clear: 'went', acknowledge: 'acknowledged', silence: 'silenced', unsilence: 'silence ran out', shelve: 'shelved', unshelve: 'unshelved', reset: 'reset', suppress: 'suppressed', unsuppress: 'no longer suppressed', remove: 'taken out of service', restore: 'returned to service' };
const FAULTS = { not_finite: 'not finite', implausible: 'implausible', repeated: 'repeated', out_of_order: 'out of order', clock_jump: 'clock jumps' };

const get = (id) => document.getElementById(id);
const put = (element, text) => { if (element.textContent !== text) element.textContent = text; };
const speedText = (rpm) => (rpm === null ? '–' : `${Math.abs(rpm).toFixed(Math.abs(rpm) < 99.95 ? 1 : 0)} rpm`);
const loadText = (load) => (load === null ? '–' : Math.abs(load) < 9999.5 ? `${load.toFixed(0)} N` : `${(load / 1000).toFixed(1)} kN`);

/** One bearing's part of the page. */
class Bearing {
  constructor(bearing) {
    this.trail = [...bearing.trail];
    this.root = get('bearing').content.firstElementChild.cloneNode(true);
    this.find = (selector) => this.root.querySelector(selector);
    this.root.setAttribute('aria-label', `Bearing ${bearing.name}`);
    this.root.dataset.bearing = bearing.name;
    put(this.find('h2'), bearing.name);
    this.name = bearing.name;
    this.topics = bearing.topics;
    this.map = new StabilityMap(this.find('.map svg'), bearing);
    this.fold = new MarginGauge('Fold margin', bearing, { near: true, look: 'between', words: 'inside: stick-slip can run' }, 'outside: no stick-slip can last');
    this.hopf = new MarginGauge('Hopf margin', bearing, { near: false, look: 'bad', words: 'inside: stick-slip starts by itself' }, 'outside: steady sliding is stable');
    this.amplitude = new AmplitudeGauge(bearing);
    this.find('.gauges').append(this.fold.root, this.hopf.root, this.amplitude.root);
    if (bearing.status) this.show(bearing.status);
    else { put(this.find('.badge'), REASONS.waiting); this.find('.badge').dataset.reason = 'waiting'; this.map.show(null, [], 'nothing is known yet'); }
  }

  take(status) {
    const last = this.trail.at(-1);
    if (status.speed !== null && (!last || last[0] !== status.speed || last[1] !== status.load)) this.trail.push([status.speed, status.load]);
    if (this.trail.length > TRAIL) this.trail.shift();
    this.show(status);
  }

  show(status) {
    const badge = this.find('.badge');
    badge.dataset.reason = status.reason;
    put(badge, REASONS[status.reason] ?? status.reason);
    put(this.find('.verdict'), withoutName({ text: status.text, bearing: this.name }));
    const astern = status.speed < 0 ? 'astern, ' : '';
    put(this.find('.speed'), speedText(status.rpm));
    put(this.find('.surface'), status.speed === null ? '' : `${astern}${Math.abs(status.speed).toFixed(3)} m/s; fold ${status.fold_speed?.toFixed(3) ?? '–'}, Hopf ${status.hopf_speed?.toFixed(3) ?? '–'}`);
    put(this.find('.load'), loadText(status.load));
    put(this.find('.loads'), status.regime === null ? '' : `regime: ${status.regime}`);
    const known = status.regime !== null;
    this.fold.show(status.fold_margin, known);
    this.hopf.show(status.hopf_margin, known);
    this.amplitude.show(status);
    const point = status.speed === null || status.load === null ? null : [status.speed, status.load];
    this.map.show(point, this.trail, point ? `${speedText(status.rpm)}, ${loadText(status.load)}, ${status.regime}` : 'no operating point');
    this.inputs(status.inputs);
  }

  inputs(inputs) {
    const body = this.find('.inputs tbody');
    for (const [name, input] of Object.entries(inputs)) {
      const row = body.querySelector(`[data-input="${name}"]`) ?? inputRow(body, name, this.topics[name]);
      const [state, count] = row.querySelectorAll('td');
      state.className = input.lost ? 'lost' : '';
      row.title = input.fault;
      put(state, input.lost ? `✕ lost${input.age === null ? ', never heard' : `, ${input.age.toFixed(0)} s old`}` : '✓ heard');
      const faults = Object.entries(FAULTS).filter(([key]) => input.counts[key]).map(([key, words]) => `${input.counts[key]} ${words}`);
      put(count, `${input.counts.accepted ?? 0} used${faults.length ? `; ${faults.join(', ')}` : ''}`);
    }
  }
}

function inputRow(body, name, topic) {
  const row = body.insertRow();
  row.dataset.input = name;
  const head = document.createElement('th');
  head.scope = 'row';
  const code = document.createElement('code');
  code.textContent = topic ?? '';
  head.append(`${name} `, code);
  row.append(head);
  row.insertCell();
  row.insertCell();
  return row;
}

/** The page as a whole, and the stream that feeds it. */
class Page {
  constructor() {
    this.bearings = new Map();
    get('answer').addEventListener('click', () => { get('answer').hidden = true; });
    this.alarms = new AlarmList((...request) => this.act(...request), (text) => put(get('say-now'), text));
    this.heardAt = Date.now();
    setInterval(() => this.watch(), 1000);
    document.addEventListener('visibilitychange', () => this.watch());
    const does = {
      state: (state) => this.begin(state),
      status: (status) => { this.bearings.get(status.bearing)?.take(status); this.time(status.time); },
      alarms: (record) => this.take(record),
      monitor: (monitor) => this.believe(monitor),
      beat: (monitor) => this.believe(monitor),
    };
    this.again = connect(({ kind, data }) => {
      if (kind === 'lost') { this.lose(); return; }
      if (kind === 'login') { location.assign('/login'); return; }
      this.heardAt = Date.now();
      does[kind](JSON.parse(data));
    });
  }

  watch() {
    if (Date.now() - this.heardAt > SILENCE) { this.heardAt = Date.now(); this.lose(); this.again(); }
  }

  begin(state) {
    this.source = state.source;
    this.bearings = new Map(state.bearings.map((bearing) => [bearing.name, new Bearing(bearing)]));
    get('bearings').replaceChildren(...[...this.bearings.values()].map((bearing) => bearing.root));
    for (const { map } of this.bearings.values()) map.redraw();
    this.time(Math.max(0, ...state.bearings.map((bearing) => bearing.status?.time ?? 0)));
    this.take(state);
    this.believe(state.monitor);
  }

  take({ alarms, log }) {
    if (alarms) {
      this.alarms.show(alarms);
      document.title = `${alarms.unacknowledged ? `(${alarms.unacknowledged}) ` : ''}Stick-slip monitor`;
    }
    get('log').replaceChildren(...log.toReversed().map(logRow));
  }

  believe(monitor) {
    const where = this.source ? `${this.source.replay ? 'replay of ' : ''}${this.source.name}` : '';
    if (monitor.finished) this.tell('over', where, 'The recording is over: this is how it ended.');
    else if (!monitor.there) this.tell('silent', where, [...monitor.faults, 'Nothing here is current.'].join(' '));
    else this.tell(monitor.faults.length ? 'doubtful' : 'live', where, monitor.faults.join(' '));
    for (const [name, bearing] of this.bearings) bearing.root.classList.toggle('unheard', monitor.unheard.includes(name));
    this.alarms.trust(monitor.there && !monitor.faults.length);
  }

  lose() {
    this.alarms.trust(false);
    this.tell('lost', 'connection lost', 'The connection to the dashboard is lost: nothing here is current. Trying again …');
  }

  tell(link, words, banner) {
    if (banner && (document.body.dataset.link !== link || link === 'doubtful') && get('banner').textContent !== banner) put(get('say-now'), banner);
    document.body.dataset.link = link;
    put(get('link'), words);
    put(get('banner'), banner);
    get('banner').hidden = !banner;
  }

  time(ms) {
    if (ms) put(get('clock'), `${new Date(ms).toISOString().slice(0, 19).replace('T', ' ')} UTC`);
  }

  async act(action, alarm, button) {
    const by = await askName();
    if (!by) return;
    button.setAttribute('aria-disabled', 'true');
    const body = JSON.stringify({ schema: 'stickslip_monitor/action/1', action, by, bearing: alarm?.bearing ?? null, alarm: alarm?.alarm ?? null });
    let done = false, text = 'The dashboard cannot be reached: nothing is known to be done.';
    try {
      const answer = await fetch('/act', { method: 'POST', headers: { 'Content-Type': 'application/json' }, body });
      if (answer.status === 401) location.assign('/login');
      ({ ok: done, text } = await answer.json());
    } catch { /* said above */ }
    button.removeAttribute('aria-disabled');
    this.answer(done ? text : `Not done: ${text}`, done);
  }

  /** What was done goes by itself; what was not stays until it is seen and touched. */
  answer(text, done) {
    put(get(done ? 'say' : 'say-now'), text);
    put(get('answer'), text);
    get('answer').hidden = false;
    clearTimeout(this.answering);
    get('answer').classList.toggle('failed', !done);
    if (done) this.answering = setTimeout(() => { get('answer').hidden = true; }, ANSWER);
  }
}

function logRow(change) {
  const row = document.createElement('tr');
  for (const text of [clock(change.time), `${nameOf(change)}, ${change.bearing}`, WHAT[change.what] ?? change.what, change.by]) row.insertCell().textContent = text;
  return row;
}

/** The name that is given, or what is answered when it is asked for; empty where nobody says. */
async function askName() {
  const who = get('who');
  if (who.value.trim()) return who.value.trim();
  const dialog = get('ask');
  dialog.showModal();
  const said = await new Promise((resolve) => { dialog.addEventListener('close', () => resolve(dialog.returnValue), { once: true }); });
  if (said === 'ok') { who.value = get('ask-name').value.trim(); keep('who', who.value); }
  return said === 'ok' ? who.value : '';
}

function keep(key, value) {
  try { localStorage.setItem(key, value); } catch { /* a browser that keeps nothing is no reason to fail */ }
}

function recall(key) {
  try { return localStorage.getItem(key); } catch { return null; }
}

const dark = matchMedia('(prefers-color-scheme: dark)');
function light() {
  const chosen = get('theme').value;
  document.documentElement.dataset.theme = chosen === 'auto' ? (dark.matches ? 'dusk' : 'day') : chosen;
}

get('who').value = recall('who') ?? '';
get('who').addEventListener('change', (event) => keep('who', event.target.value.trim()));
get('tools').addEventListener('submit', (event) => event.preventDefault());
get('theme').value = recall('theme') ?? 'auto';
get('theme').addEventListener('change', (event) => { keep('theme', event.target.value); light(); });
dark.addEventListener('change', light);
light();
new Page();
