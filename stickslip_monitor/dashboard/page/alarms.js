// SPDX-License-Identifier: Apache-2.0
// The list of alarms: worst first, what waits for somebody before what does not.

import { get, make, put } from './dom.js';

export const NAMES = {
  amplitude_limit: 'Amplitude above limit',
  stick_slip: 'Stick-slip predicted',
  bistable: 'Bistable',
  margin_low: 'Margin low',
  input_lost: 'Input lost',
  input_implausible: 'Input implausible',
  vibration: 'Vibration not explained',
};
const STATES = {
  unacknowledged: 'not acknowledged',
  returned_unacknowledged: 'cleared, not acknowledged',
  acknowledged: 'acknowledged',
  latched: 'cleared, latched: waits for its reset',
  shelved: 'shelved',
  suppressed: 'suppressed',
  out_of_service: 'out of service',
};
const BUTTONS = { acknowledge: 'Acknowledge', silence: 'Silence', reset: 'Reset', shelve: 'Shelve', unshelve: 'Unshelve' };
const ORDER = Object.keys(STATES);
const PRIORITIES = ['alarm', 'warning', 'caution'];
// So many bearings of one shaft have a row each, and so many of a group are named.
const FEW = 4, NAMED = 5;
const ASIDE = ['shelved', 'suppressed', 'out_of_service'];
const WAITING = ['unacknowledged', 'returned_unacknowledged'];
// Triangle, circle and square, as on a bridge: the priority can be seen without its colour.
const SHAPES = {
  alarm: ['path', { d: 'M17 3L32 30H2Z' }, 27],
  warning: ['circle', { cx: 17, cy: 17, r: 14 }, 22],
  caution: ['rect', { x: 4, y: 4, width: 26, height: 26 }, 22],
};

/** How times are written: UTC, or by the clock of the device; the date where it is not today's. */
export const time = { local: false, now: null };
export function moment(ms) {
  const shift = time.local ? new Date(ms).getTimezoneOffset() * 60000 : 0;
  return new Date(ms - shift).toISOString().slice(0, 19).replace('T', ' ');
}
export function clock(ms) {
  if (ms === null || ms === undefined) return '–';
  const text = moment(ms);
  return time.now !== null && moment(time.now).slice(0, 10) === text.slice(0, 10) ? text.slice(11) : text;
}
/** The worst priority among some rows; empty for none. */
export const worst = (rows) => PRIORITIES.find((priority) => rows.some((row) => row.priority === priority)) ?? '';
/** The name of the shaft: the namespace of its monitor, else the topic of its speed. */
export const shaftName = (bearing, topic) => (bearing.includes('/') ? `/${bearing.slice(0, bearing.lastIndexOf('/'))}` : topic);
export const nameOf = (alarm) => NAMES[alarm.alarm] ?? alarm.alarm;
export const withoutName = ({ text, bearing }) => (text.startsWith(`${bearing}: `) ? text.slice(bearing.length + 2) : text);
/** The words on a matter without its bearing and its times: those of one cause are the same. */
export const wordsOf = (row) => withoutName(row).replace(/ *\d+(\.\d+)? (s|min|h|days|years)\b/g, '');
const keyOf = (row) => (row.shaft ? `${row.shaft}/${row.alarm}/${row.state}` : row.members?.length > 1 ? `${row.members.length} bearings/${row.alarm}/${row.state}/${withoutName(row)}` : row.aside ? `${row.bearing}/${row.alarm}` : row.bearing);

/**
 * The order in which alarms are to be dealt with: what stands and nobody has acknowledged above all
 * else, then the other alarms and warnings that stand, what has gone and waits, and the rest; in each
 * the worse priority first.
 */
export function rank(alarm) {
  const stands = alarm.state === 'acknowledged' && alarm.priority !== 'caution';
  const part = alarm.state === 'unacknowledged' ? 0 : stands ? 1 : WAITING.includes(alarm.state) ? 2 : ASIDE.includes(alarm.state) ? 4 : 3;
  return 100 * part + 10 * PRIORITIES.indexOf(alarm.priority) + ORDER.indexOf(alarm.state);
}

/**
 * One row where many bearings have the same alarm from one cause: one lost speed, or one shaft that
 * turns too slowly. shaftOf gives the shaft of a bearing.
 */
export function grouped(rows, shaftOf) {
  const groups = new Map(), shafts = new Map();
  const shaftKey = (row) => [row.alarm, row.state, row.sounding, shaftOf(row.bearing)].join('\n');
  for (const row of rows) shafts.set(shaftKey(row), (shafts.get(shaftKey(row)) ?? 0) + 1);
  for (const row of rows) {
    if (!row.aside && !row.alarm.startsWith('input') && shafts.get(shaftKey(row)) > FEW) {
      groups.set(shaftKey(row), [...(groups.get(shaftKey(row)) ?? []), { ...row, shaft: shaftOf(row.bearing) }]);
      continue;
    }
    const key = row.alarm.startsWith('input') && !row.aside ? [row.alarm, row.state, row.sounding, wordsOf(row)].join('\n') : keyOf(row);
    groups.set(key, [...(groups.get(key) ?? []), row]);
  }
  return [...groups.values()].map((members) => ({ ...members[0], members }));
}

function stateOf(alarm) {
  let text = STATES[alarm.state] ?? alarm.state;
  if (alarm.state === 'shelved') text += ` until ${clock(alarm.shelved_until)}`;
  if (alarm.suppressed_by?.length) text += ` (${alarm.suppressed_by.join(', ').replaceAll('_', ' ')})`;
  if (alarm.silenced && alarm.state === 'unacknowledged') text += ', silenced';
  if (['acknowledged', 'shelved', 'out_of_service'].includes(alarm.state) && alarm.by !== 'monitor' && alarm.by) text += ` by ${alarm.by}`;
  return text;
}

/** Since when a matter stands, how often it came back, and what else it has. */
function courseOf(row) {
  if (row.back_since !== null && row.back_since !== undefined) return `back since ${clock(row.back_since)}, clears ${clock(row.clears_at)}`;
  const came = `came ${clock(row.since)}${row.came_back ? `, came back ${row.came_back === 1 ? 'once' : `${row.came_back} times`} since ${clock(row.came_back_since)}` : ''}`;
  const others = (row.kinds ?? []).filter((kind) => kind !== row.alarm).map((kind) => (NAMES[kind] ?? kind).toLowerCase());
  return others.length ? `${came}; with it: ${others.join(', ')}` : came;
}

export class AlarmList {
  /** act is called with an action, an alarm and the button; say with words that cannot wait; now gives
      the text of a bearing now, shaftOf its shaft. */
  constructor(act, say, now, shaftOf) {
    [this.act, this.say, this.now, this.shaftOf] = [act, say, now, shaftOf];
    this.waitingRows = 0;
    this.items = new Map();
    this.known = null;
    this.standing = [];
    this.none = this.trusted = false;
    [this.list, this.aside, this.asideList, this.quiet, this.unsure, this.shelved, this.tally, this.silence, this.section, this.seen] = ['alarm-list', 'aside', 'aside-list', 'quiet', 'unsure', 'hidden-alarms', 'tally', 'silence', 'alarms', 'seen'].map(get);
    // Those that are listed now, not those that come while they are being acknowledged.
    this.seen.addEventListener('click', () => act('acknowledge', { members: this.waiting }, this.seen));
    this.silence.addEventListener('click', () => act('silence', null, this.silence));
  }

  show(record) {
    const aside = record.alarms.filter((alarm) => ASIDE.includes(alarm.state)).map((alarm) => ({ ...alarm, aside: true }));
    const rows = grouped([...record.rows, ...aside], this.shaftOf);
    rows.sort((a, b) => rank(a) - rank(b) || (b.since ?? 0) - (a.since ?? 0));
    const focused = document.activeElement;
    const within = this.section.contains(focused);
    this.place(this.list, rows.filter((row) => !row.aside));
    this.place(this.asideList, rows.filter((row) => row.aside));
    const kept = new Set(rows.map(keyOf));
    for (const [key, item] of this.items) {
      if (!kept.has(key)) { item.root.remove(); this.items.delete(key); }
    }
    if (within && !this.section.contains(document.activeElement)) this.refocus(focused);
    this.standing = aside.filter((alarm) => alarm.active);
    this.none = !record.rows.length && !this.standing.length;
    this.trust(this.trusted);
    this.aside.hidden = aside.length === 0;
    this.aside.querySelector('summary').textContent = `${aside.length} aside: ${ASIDE.map((s) => [aside.filter((a) => a.state === s).length, STATES[s]]).filter(([n]) => n).map((pair) => pair.join(' ')).join(', ')}`;
    this.silence.hidden = !record.sounding;
    this.waiting = record.rows.filter((row) => row.actions.includes('acknowledge'));
    this.seen.hidden = this.waiting.length < 2;
    this.waitingRows = rows.filter((row) => !row.aside && WAITING.includes(row.state)).length;
    this.told = new Set(rows.filter((row) => !row.aside && row.members.length === 1).map((row) => row.bearing));
    this.count(record);
    this.announce(record.rows);
  }

  /** Only what is known to be all clear is called so. */
  trust(trusted) {
    this.trusted = trusted;
    this.quiet.hidden = !(this.none && trusted);
    this.unsure.hidden = trusted;
    this.shelved.hidden = !this.standing.length;
    this.shelved.textContent = `${this.standing.length} shelved, suppressed or out of service but still active: ${this.standing.slice(0, 5).map((a) => `${nameOf(a)}, ${a.bearing}`).join('; ')}${this.standing.length > 5 ? ' …' : ''}`;
  }

  count(record) {
    const parts = [`${this.waitingRows} not acknowledged`];
    if (record.flood.flooding) parts.push(`flood: ${record.flood.alarms_10min} in ten minutes`);
    this.tally.textContent = this.waitingRows || record.flood.flooding ? parts.join(', ') : '';
  }

  /** Say aloud what was not given before. */
  announce(rows) {
    const given = new Map(rows.filter((row) => row.state === 'unacknowledged').map((row) => [`${row.bearing}/${row.alarm}/${row.since}`, row]));
    const fresh = [...given].filter(([key]) => !this.known?.has(key)).map(([, row]) => row);
    this.known = new Set(given.keys());
    if (fresh.length) this.say(fresh.map((row) => `${row.priority}: ${nameOf(row)}. ${row.text}`).join(' '));
  }

  place(list, alarms) {
    alarms.forEach((alarm, k) => {
      const item = this.items.get(keyOf(alarm)) ?? this.create(alarm);
      this.fill(item, alarm);
      if (list.children[k] !== item.root) list.insertBefore(item.root, list.children[k] ?? null);
    });
  }

  /** Moving an element takes the focus from it: give it back, or to the list if it has gone. */
  refocus(focused) {
    (focused.isConnected && focused.checkVisibility() ? focused : this.section).focus({ preventScroll: true });
  }

  /** The text of a bearing changes oftener than its alarms. */
  refresh() { for (const item of this.items.values()) this.describe(item); }

  describe({ root, alarm }) {
    if (alarm.shaft) { put(root.querySelector('.text'), this.ofShaft(alarm)); return; }
    const now = alarm.aside || alarm.members.length > 1 ? null : this.now(alarm.bearing);
    put(root.querySelector('.text'), withoutName(now ? { text: now, bearing: alarm.bearing } : alarm));
  }

  /** What many bearings of one shaft ask for: the highest of their speeds. */
  ofShaft({ members, shaft }) {
    const texts = members.map((each) => this.now(each.bearing) ?? each.text);
    const speeds = texts.map((text) => Number(/above ([\d.]+) rpm/.exec(text)?.[1]));
    const known = speeds.every((speed) => speed > 0);
    return `${members.length} bearings of ${shaft}: ${known ? `raise speed above ${Math.max(...speeds)} rpm` : texts[0]}`;
  }

  create(alarm) {
    const root = document.createElement('li');
    root.innerHTML = '<div class="what"><h3></h3><div class="state"></div></div><div class="words"><p class="text"></p><small class="course"></small><small class="places"></small></div><div class="buttons"></div>';
    root.prepend(make('svg', { class: 'shape', viewBox: '0 0 34 34', 'aria-hidden': 'true' }));
    const item = { root, buttons: {} };
    for (const [action, label] of Object.entries(BUTTONS)) {
      const button = document.createElement('button');
      button.type = 'button';
      button.textContent = label;
      button.dataset.action = action;
      button.addEventListener('click', () => this.act(action, item.alarm, button));
      item.buttons[action] = button;
      root.querySelector('.buttons').append(button);
    }
    this.items.set(keyOf(alarm), item);
    return item;
  }

  fill(item, alarm) {
    item.alarm = alarm;
    const { root } = item, back = alarm.back_since > 0;
    root.className = `alarm priority-${alarm.priority}${WAITING.includes(alarm.state) ? ' waiting' : ''}${['returned_unacknowledged', 'latched'].includes(alarm.state) || back ? ' gone' : ''}${alarm.sounding ? ' sounding' : ''}`;
    Object.assign(root.dataset, { state: alarm.state, alarm: alarm.members.length > 1 ? keyOf(alarm) : `${alarm.bearing}/${alarm.alarm}` });
    if (item.priority !== alarm.priority) {
      const [kind, attributes, y] = SHAPES[alarm.priority] ?? SHAPES.caution;
      root.querySelector('.shape').replaceChildren(make(kind, { class: 'fill', ...attributes }), make('text', { class: 'mark', x: 17, y }, '!'));
      item.priority = alarm.priority;
    }
    root.querySelector('h3').textContent = back ? 'Input back' : `${alarm.priority.toUpperCase()}: ${nameOf(alarm)}`;
    const places = alarm.members.map((each) => each.bearing);
    const where = places.length > 1 ? `${places.length} bearings${alarm.shaft ? ` of ${alarm.shaft}` : ''}` : alarm.bearing;
    root.querySelector('.state').textContent = `${where}, ${stateOf(alarm)}`;
    root.querySelector('.course').textContent = courseOf(alarm);
    root.querySelector('.places').textContent = places.length > 1 ? `${places.slice(0, NAMED).join(', ')}${places.length > NAMED ? ` and ${places.length - NAMED} more` : ''}` : '';
    this.describe(item);
    const focused = document.activeElement;
    for (const [action, button] of Object.entries(item.buttons)) {
      button.hidden = !alarm.actions.includes(action);
      button.setAttribute('aria-label', `${BUTTONS[action]}: ${nameOf(alarm)}, ${where}`);
    }
    if (focused?.hidden && root.contains(focused)) (root.querySelector('button:not([hidden])') ?? this.section).focus({ preventScroll: true });
  }
}
