// SPDX-License-Identifier: Apache-2.0
// A recording: hold it, go on, go to any place of it, begin again. All of it with the keyboard, too.

import { get } from './dom.js';

const minutes = (seconds) => `${Math.floor(seconds / 60)}:${String(Math.floor(seconds % 60)).padStart(2, '0')}`;

export class ReplayBar {
  constructor() {
    [this.root, this.hold, this.again, this.place, this.label] = ['replay', 'hold', 'again', 'place', 'replay-time'].map(get);
    this.hold.addEventListener('click', () => ask(this.over ? { at: 0, paused: false } : { paused: !this.paused }));
    this.again.addEventListener('click', () => ask({ at: 0, paused: false }));
    // While a finger is on it, it is not moved.
    this.place.addEventListener('input', () => { this.held = true; this.showTime(Number(this.place.value)); });
    this.place.addEventListener('change', () => { this.held = false; ask({ at: Number(this.place.value) }); });
  }

  show(replay, over) {
    if (replay) this.known = replay;
    if (over !== undefined) this.over = over;
    this.root.hidden = !this.known;
    if (!this.known) return;
    this.paused = this.known.paused;
    this.hold.textContent = this.over ? 'Play again' : this.paused ? 'Play' : 'Pause';
    this.place.max = this.known.length;
    this.place.step = Math.max(Math.ceil(this.known.length / 20) / 10, 0.1);
    if (this.held) return;
    this.place.value = this.known.at;
    this.showTime(this.known.at);
  }

  showTime(at) {
    const text = `${minutes(at)} of ${minutes(this.known.length)}`;
    this.label.textContent = text;
    this.place.setAttribute('aria-valuetext', text);
  }
}

function ask(course) {
  fetch('replay', { method: 'POST', headers: { 'Content-Type': 'application/json' }, body: JSON.stringify(course) }).catch(() => { /* the banner reports a lost connection */ });
}
