// SPDX-License-Identifier: Apache-2.0
// Takes the stream of events and shows it. Every text from outside is set as text, never as markup.

import { AlarmList, clock, moment, nameOf, shaftName, time, withoutName, wordsOf, worst } from './alarms.js';
import { Overview } from './overview.js';
import { Sound } from './sound.js';
import { AmplitudeGauge, MarginGauge } from './gauges.js';
import { Charts, History } from './charts.js';
import { ReplayBar } from './replay.js';
import { StabilityMap } from './map.js';
import { connect } from './stream.js';
import { about, get, put } from './dom.js';

const SILENCE = 12000, ANSWER = 5000, REDRAW = 250;
// A note and the alarm on the same fault are no further apart [ms].
const SAME = 60000;
const REASONS = { normal: '✓ Normal', caution: '! Margin low', bistable: '! Bistable', stick_slip: '▲ Stick-slip predicted', amplitude_limit: '▲ Amplitude above limit', vibration: '! Vibration not explained', input_stale: '✕ Input lost', unreliable: '! Not reliable', waiting: '… Waiting', not_monitoring: '✕ Not monitoring' };
const WHAT = { raise: 'raised', clear: 'cleared', acknowledge: 'acknowledged', silence: 'silenced', unsilence: 'silence over', shelve: 'shelved', unshelve: 'unshelved', reset: 'reset', suppress: 'suppressed', unsuppress: 'no longer suppressed', remove: 'taken out of service', restore: 'returned to service' };
const MEASURED = { quiet: '✓ quiet', vibrating: '▲ vibrating', unknown: 'unknown' };
const FAULTS = { not_finite: 'not finite', no_value: '"no value"', implausible: 'implausible', below_minimum: 'below minimum', repeated: 'repeated', out_of_order: 'out of order' };

const speedText = (rpm) => (rpm === null ? '–' : `${Math.abs(rpm).toFixed(Math.abs(rpm) < 99.95 ? 1 : 0)} rpm`);
const loadText = (load) => (load === null ? '–' : Math.abs(load) < 9999.5 ? `${load.toFixed(0)} N` : `${(load / 1000).toFixed(1)} kN`);

/** One bearing's part of the page. */
class Bearing {
  constructor(bearing, columns, events) {
    this.history = new History(columns);
    this.root = get('bearing').content.firstElementChild.cloneNode(true);
    this.find = (selector) => this.root.querySelector(selector);
    this.root.setAttribute('aria-label', `Bearing ${bearing.name}`);
    this.root.dataset.bearing = bearing.name;
    put(this.find('h2'), bearing.name);
    this.name = bearing.name;
    this.topics = bearing.topics;
    [this.rpm, this.shelveTime] = [bearing.rpm, bearing.shelve_time];
    this.shown = this.current = true;
    this.shaft = shaftName(bearing.name, bearing.topics.speed);
    this.charts = new Charts(this.find('.charts'), bearing, this.history, events);
    this.map = new StabilityMap(this.find('.map svg'), bearing);
    this.fold = new MarginGauge('Fold margin', bearing, { near: true, look: 'between', words: 'below the fold: stick-slip possible' }, 'above the fold: safe');
    this.hopf = new MarginGauge('Hopf margin', bearing, { near: false, look: 'bad', words: 'below the Hopf speed: stick-slip starts by itself' }, 'above the Hopf speed: steady sliding is stable');
    this.amplitude = new AmplitudeGauge(bearing);
    this.find('.gauges').append(this.fold.root, this.hopf.root, this.amplitude.root);
    if (bearing.status) this.show(bearing.status);
    else { put(this.find('.badge'), REASONS.waiting); this.find('.badge').dataset.reason = 'waiting'; this.map.show(null, [], 'no data yet'); this.gauge({}); }
  }

  take(status) {
    const fresh = this.history.add(status.row);
    this.show(status);
    if (fresh && this.shown) this.charts.show();
  }

  /** What was before the page was opened is asked for when somebody looks at it. */
  async remember() {
    if (this.asked) return;
    this.asked = true;
    try {
      const answer = await fetch(`history?bearing=${encodeURIComponent(this.name)}`);
      if (answer.ok) this.history.precede((await answer.json()).rows); else this.asked = false;
    } catch { this.asked = false; }
    if (this.shown && this.status) { this.show(this.status); this.charts.show(); }
  }

  /** Whether what is shown is heard now: what is not is told with its time, not as fresh. */
  keep(current) {
    if (this.current === current) return;
    this.current = current;
    if (this.status) this.show(this.status);
  }

  /** What is not looked at is not drawn. */
  reveal(shown) {
    this.shown = shown;
    this.root.hidden = !shown;
    if (!shown) return;
    this.map.redraw();
    if (this.status) { this.show(this.status); this.charts.show(); }
    this.remember();
  }

  show(status) {
    this.status = status;
    if (!this.shown) return;
    const badge = this.find('.badge');
    badge.dataset.reason = status.reason;
    badge.classList.toggle('held', status.held_until !== null);
    put(badge, `${REASONS[status.reason] ?? status.reason}${status.held_until === null ? '' : `, held until ${clock(status.held_until)}`}`);
    put(this.find('.verdict'), withoutName({ text: status.text, bearing: this.name }));
    const astern = status.speed < 0 ? 'astern, ' : '';
    put(this.find('.speed'), speedText(status.rpm));
    put(this.find('.surface'), status.speed === null ? '' : `${astern}${Math.abs(status.speed).toFixed(3)} m/s`);
    const rpm = (speed) => (speed === null ? '–' : speedText(speed * this.rpm));
    put(this.find('.boundaries'), status.regime === null ? '' : `fold ${rpm(status.fold_speed)}, Hopf ${rpm(status.hopf_speed)}`);
    const chances = [['probability_can', 'can happen'], ['probability_will', 'starts by itself'], ['probability_runs', 'runs']].filter(([key]) => status[key] !== null).map(([key, words]) => `${words} ${(100 * status[key]).toFixed(0)} %`);
    put(this.find('.chances'), chances.length ? `stick-slip: ${chances.join(', ')}` : '');
    put(this.find('.measured'), status.measured ? `vibration measured: ${MEASURED[status.measured] ?? status.measured}${status.unmeasured ? ` (${status.unmeasured})` : ''}` : '');
    this.find('.measured').dataset.level = status.measured ?? '';
    put(this.find('.load'), loadText(status.load));
    put(this.find('.loads'), status.regime === null ? '' : `regime: ${status.regime}`);
    this.gauge(status);
    const point = status.speed === null || status.load === null ? null : [status.speed, status.load];
    this.map.show(point, this.history.trail, point ? `${speedText(status.rpm)}, ${loadText(status.load)}, ${status.regime}` : 'no operating point');
    this.inputs(status);
  }

  gauge({ regime = null, fold_margin: fold = null, hopf_margin: hopf = null, ...rest }) {
    this.fold.show(fold, regime !== null);
    this.hopf.show(hopf, regime !== null);
    this.amplitude.show({ amplitude: null, amplitude_exact: null, ...rest, regime });
  }

  inputs({ inputs, time: at }) {
    const body = this.find('.inputs tbody');
    for (const [name, input] of Object.entries(inputs)) {
      const row = body.querySelector(`[data-input="${name}"]`) ?? inputRow(body, name, this.topics[name]);
      const [state, count] = row.querySelectorAll('td');
      state.className = input.lost || input.fault ? 'lost' : '';
      put(row.querySelector('.fault'), input.fault);
      if (name !== 'level') put(this.find(`[data-of="${name}"] .name`), `${name === 'load' ? 'Bearing load' : 'Shaft speed'}${input.lost || !this.current ? ', last known' : ''}`);
      const ago = input.age === null ? 'no valid value yet' : `${about(input.age)} ago`;
      if (!this.current) put(state, input.age === null ? '' : `last heard ${clock(at - 1000 * input.age)}`);
      else put(state, `${input.lost ? '✕ lost, ' : input.age === null ? '' : '✓ '}${input.rate === null || input.lost ? '' : `${+input.rate.toPrecision(2)} Hz, `}${ago}`);
      const refused = Object.entries(FAULTS).filter(([key]) => input.counts[key]).map(([key, words]) => `${input.counts[key]} ${words}`);
      put(count, refused.length ? `refused: ${refused.join(', ')}` : '');
    }
  }
}

function inputRow(body, name, topic) {
  const row = body.insertRow();
  row.dataset.input = name;
  row.innerHTML = '<th scope="row"> <code></code><small class="fault"></small></th><td></td><td></td>';
  row.firstChild.prepend(name);
  row.querySelector('code').textContent = topic ?? '';
  return row;
}

/** The page as a whole, and the stream that feeds it. */
class Page {
  constructor() {
    this.bearings = new Map();
    this.overview = new Overview((names) => { for (const [name, bearing] of this.bearings) bearing.reveal(names.has(name)); }, (name) => this.bearings.get(name).root.scrollIntoView({ block: 'start' }));
    this.sound = new Sound(get('sound'), (words) => this.report(words));
    get('menu').addEventListener('click', () => this.open(!document.body.classList.contains('menu')));
    this.replay = new ReplayBar();
    get('answer').addEventListener('click', () => { get('answer').hidden = true; });
    this.alarms = new AlarmList((...request) => this.act(...request), (text) => put(get('say-now'), text), (name) => this.bearings.get(name)?.status?.text, (name) => this.bearings.get(name)?.shaft);
    this.receivedAt = Date.now();
    setInterval(() => this.watch(), 1000);
    document.addEventListener('visibilitychange', () => this.watch());
    const does = {
      state: (state) => this.begin(state),
      status: (status) => this.later(status),
      map: (map) => this.bearings.get(map.bearing)?.map.remake(map),
      replay: (replay) => this.replay.show(replay),
      alarms: (record) => this.take(record),
      monitor: (monitor) => this.showMonitor(monitor),
      beat: (monitor) => this.showMonitor(monitor),
    };
    this.again = connect(({ kind, data }) => {
      if (kind === 'lost') { this.lose(); return; }
      if (kind === 'login') { location.assign('login'); return; }
      this.receivedAt = Date.now();
      does[kind](data);
    });
  }

  /** Say what is wrong with the sound where it is seen without looking for it. */
  report(words) {
    put(get('menu'), words || 'Settings');
    document.body.classList.toggle('mute', Boolean(words));
    if (words) put(get('say-now'), words);
  }

  /** On a small screen the settings are behind a button. */
  open(opened) {
    document.body.classList.toggle('menu', opened);
    get('menu').setAttribute('aria-expanded', opened);
  }

  /** However often a bearing is sent, it is drawn no oftener than an eye can follow. */
  later(status) {
    this.newest ??= new Map();
    this.newest.set(status.bearing, status);
    this.drawing ??= setTimeout(() => this.draw(), Date.now() - (this.drawnAt ?? 0) < REDRAW ? REDRAW : 0);
  }

  draw() {
    [this.drawing, this.drawnAt] = [null, Date.now()];
    for (const status of this.newest.values()) {
      this.bearings.get(status.bearing)?.take(status);
      this.overview.take(status);
      this.time(status.time);
    }
    this.newest.clear();
    this.alarms.refresh();
  }

  watch() {
    if (Date.now() - this.receivedAt > SILENCE) { this.receivedAt = Date.now(); this.lose(); this.again(); }
  }

  begin(state) {
    this.newest?.clear();
    this.source = state.source;
    get('leave').hidden = !state.signed_in;
    const eventsOf = (name) => () => this.log.filter((entry) => entry.bearing === name && entry.time);
    [this.record, this.log] = [state.alarms, state.log];
    this.bearings = new Map(state.bearings.map((bearing) => [bearing.name, new Bearing(bearing, state.columns, eventsOf(bearing.name))]));
    get('bearings').replaceChildren(...[...this.bearings.values()].map((bearing) => bearing.root));
    this.overview.begin(state.bearings);
    this.replay.show(state.replay);
    this.time(Math.max(0, ...state.bearings.map((bearing) => bearing.status?.time ?? 0)));
    this.take(state);
    this.showMonitor(state.monitor);
  }

  take({ alarms, log }) {
    [this.record, this.log] = [alarms, log];
    if (alarms) {
      this.alarms.show(alarms);
      // What its row says needs not be said again below.
      for (const [name, bearing] of this.bearings) bearing.find('.verdict').hidden = this.alarms.told.has(name);
      this.sound.ring(alarms.sounding ? worst(alarms.rows.filter((row) => row.sounding)) : '');
      this.trust(this.trusted);
    }
    get('log').replaceChildren(...joined(log.toReversed(), [...this.bearings.keys()]).map(logRow));
  }

  refresh() {
    time.local = get('local').value === 'local';
    put(get('zone'), time.local ? 'Time (local)' : 'Time (UTC)');
    if (this.log) this.take({ alarms: this.record, log: this.log });
    if (time.now) this.time(time.now);
    this.redraw();
  }

  /** The colours, or the clock, have changed. */
  redraw() { for (const { charts } of this.bearings.values()) charts.redraw(); }

  showMonitor(monitor) {
    const where = this.source ? `${this.source.replay ? 'replay of ' : ''}${this.source.name}` : '';
    if (monitor.finished) this.showLink('over', where, 'The recording is over: this is how it ended.');
    else if (!monitor.there) this.showLink('silent', where, [...monitor.faults, 'Nothing here is current.'].join(' '));
    else this.showLink(monitor.faults.length ? 'doubtful' : 'live', where, monitor.faults.join(' '));
    this.replay.show(null, monitor.finished);
    if (get('notices').textContent !== monitor.notices.join(' ')) { put(get('notices'), monitor.notices.join(' ')); put(get('say'), monitor.notices.join(' ')); }
    get('notices').hidden = !monitor.notices.length;
    for (const [name, bearing] of this.bearings) {
      const missing = monitor.missing.includes(name);
      bearing.root.classList.toggle('missing', missing);
      bearing.keep(monitor.finished || (monitor.there && !missing));
    }
    this.overview.mark(monitor.missing);
    this.trust(monitor.there && !monitor.faults.length);
  }

  /** The title, too, shows a tab that is not looked at that it is out of date. */
  trust(trusted) {
    this.alarms.trust(trusted);
    this.trusted = trusted;
    const rows = this.alarms.waitingRows, waiting = rows ? `(${rows}) ` : '';
    document.title = `${trusted || get('banner').hidden || document.body.dataset.link === 'over' ? '' : '✕ '}${waiting}Stick-slip monitor`;
  }

  lose() {
    for (const bearing of this.bearings.values()) bearing.keep(false);
    this.showLink('lost', 'connection lost', 'The connection to the dashboard is lost: nothing here is current. Trying again …');
    this.trust(false);
  }

  showLink(link, words, banner) {
    if (banner && (document.body.dataset.link !== link || link === 'doubtful') && get('banner').textContent !== banner) put(get('say-now'), banner);
    document.body.dataset.link = link;
    this.sound.die(link === 'lost' || link === 'silent');
    put(get('link'), words);
    put(get('banner'), banner);
    get('banner').hidden = !banner;
  }

  time(ms) {
    if (ms) { time.now = ms; put(get('clock'), `${moment(ms)} ${time.local ? 'local time' : 'UTC'}`); }
  }

  async act(action, alarm, button) {
    const by = await askName();
    if (!by) return;
    const reason = action === 'shelve' ? await askReason(alarm, this.bearings.get(alarm.bearing)?.shelveTime) : '';
    if (reason === null) return;
    button.setAttribute('aria-disabled', 'true');
    const results = [];
    const members = alarm?.members ?? [alarm];
    for (const each of members) {
      results.push(await post(action, by, each, reason));
      if (!results.at(-1).ok) break;
    }
    button.removeAttribute('aria-disabled');
    const last = results.at(-1), left = members.length - results.length + 1;
    if (last.ok) this.answer(results.length > 1 ? `${action}: ${results.length} alarms` : last.text, true);
    else this.answer(`Not done${members.length > 1 ? ` for ${left} of ${members.length}` : ''}: ${last.text}`, false);
  }

  /** What was done goes by itself; what was not stays until it is seen and touched. */
  answer(text, done) {
    const answer = get('answer');
    for (const place of [get(done ? 'say' : 'say-now'), answer]) put(place, text);
    answer.hidden = false;
    answer.classList.toggle('failed', !done);
    clearTimeout(this.answering);
    if (done) this.answering = setTimeout(() => { answer.hidden = true; }, ANSWER);
  }
}

async function post(action, by, alarm, reason) {
  // A row is a bearing with all its alarms; to shelve is for the one that it names.
  const kind = alarm?.aside || action === 'shelve' ? alarm.alarm : null;
  const body = JSON.stringify({ schema: 'stickslip_monitor/action/1', action, by, bearing: alarm?.bearing ?? null, alarm: kind, ...(reason && { reason }) });
  try {
    const answer = await fetch('act', { method: 'POST', headers: { 'Content-Type': 'application/json' }, body });
    if (answer.status === 401) location.assign('login');
    return await answer.json();
  } catch { return { ok: false, text: 'the dashboard cannot be reached: nothing is known to be done' }; }
}

/** Why an alarm is shelved, for the log; null where nobody says. */
async function askReason(alarm, seconds) {
  const minutes = seconds ? ` for ${+(seconds / 60).toPrecision(3)} min` : '';
  const places = alarm.members?.length > 1 ? `${alarm.members.length} bearings` : alarm.bearing;
  put(get('why-title'), `Shelve "${nameOf(alarm)}, ${places}"${minutes}`);
  get('reason').value = '';
  return (await asked(get('why'))) ? get('reason').value.trim() || null : null;
}

/** Whether a question is answered. */
async function asked(dialog) {
  dialog.showModal();
  return await new Promise((resolve) => { dialog.addEventListener('close', () => resolve(dialog.returnValue), { once: true }); }) === 'ok';
}

/** Of an entry, the latest first, the words on what several bearings may have at once: one input that is lost. */
function sharedWords(entry, names) {
  if (entry.alarm.startsWith('input')) return wordsOf(entry);
  const name = names.find((each) => entry.text.startsWith(`${each}: `));
  return entry.alarm || !name ? null : entry.text.slice(name.length + 2);
}

/** One entry for one lost input: of the same node, at the same time, in the same words, for all its bearings. */
function joined(log, names) {
  const entries = new Map(), raised = log.filter((entry) => entry.alarm.startsWith('input') && entry.what === 'raise');
  for (const entry of log) {
    const words = sharedWords(entry, names), bearing = entry.bearing || (words && entry.text.slice(0, -words.length - 2));
    // What an alarm says soon afterwards needs no note.
    if (words && !entry.alarm && raised.some((each) => each.bearing === bearing && each.text.includes(words) && Math.abs(each.time - entry.time) < SAME)) continue;
    const key = words ? JSON.stringify([entry.node, Math.round(entry.time / 1000), entry.alarm, entry.what, entry.by, words]) : entries.size;
    const known = entries.get(key);
    if (known) known.bearings.push(bearing); else entries.set(key, { ...entry, words, bearings: [bearing] });
  }
  return [...entries.values()];
}

/** A change of an alarm, or a note of the node on anything else. */
function logRow(entry) {
  const row = document.createElement('tr');
  const note = `${entry.node}: ${entry.words ? `${entry.bearings.join(', ')}: ${entry.words}` : entry.text}`, change = [`${nameOf(entry)}, ${entry.bearings.join(', ')}`, WHAT[entry.what] ?? entry.what, entry.by];
  for (const text of [clock(entry.time), ...(entry.alarm ? change : [note])]) row.insertCell().textContent = text;
  if (!entry.alarm) row.cells[1].colSpan = 3;
  if (entry.what === 'raise') {
    const words = document.createElement('small');
    words.textContent = withoutName(entry);
    row.cells[1].append(words);
  }
  return row;
}

/** The name that is given, or what is answered when it is asked for; empty where nobody says. */
async function askName() {
  const who = get('who');
  if (who.value.trim()) return who.value.trim();
  if (!(await asked(get('ask')))) return '';
  who.value = get('ask-name').value.trim();
  keep('who', who.value);
  return who.value;
}

function keep(key, value) {
  try { localStorage.setItem(key, value); } catch { /* a browser that keeps nothing is no reason to fail */ }
}

function recall(key) {
  try { return localStorage.getItem(key); } catch { return null; }
}

const dark = matchMedia('(prefers-color-scheme: dark)');
let page = null;
function light(paper = false) {
  const chosen = get('theme').value;
  document.documentElement.dataset.theme = paper ? 'day' : chosen === 'auto' ? (dark.matches ? 'dusk' : 'day') : chosen;
  page?.redraw();
}

for (const [id, apply] of Object.entries({ who: () => {}, theme: () => light(), local: () => page.refresh() })) {
  get(id).value = recall(id) ?? get(id).value;
  get(id).addEventListener('change', () => { keep(id, get(id).value.trim()); apply(); });
}
get('tools').addEventListener('submit', (event) => event.preventDefault());
dark.addEventListener('change', () => light());
addEventListener('beforeprint', () => light(true));
addEventListener('afterprint', () => light());
light();
get('leave').addEventListener('click', async () => { await fetch('logout', { method: 'POST' }).catch(() => null); location.assign('login'); });
page = new Page();
page.refresh();
