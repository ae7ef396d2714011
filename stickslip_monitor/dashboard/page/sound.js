// SPDX-License-Identifier: Apache-2.0
// A tone for each priority while an alarm sounds, and one when the monitor or the dashboard is not
// heard; where somebody has asked for it: off whenever the page is opened. A browser may take the sound
// away at any time (a locked tablet, a call): it is asked for again, and what cannot be heard is said.

// Frequencies [Hz] of the beeps of a call, and how often the call comes [ms].
const TONES = {
  dead: { beeps: [400, 300, 200], every: 5000 },
  alarm: { beeps: [1000, 1000, 1000], every: 2000 },
  warning: { beeps: [700, 700], every: 4000 },
  caution: { beeps: [500], every: 10000 },
};
const BEEP = 0.18, STEP = 0.28;
// How often the sound is checked [ms]: a context that plays has moved its clock by then.
const CHECK = 1000;
// A mouse may start sound when pressed, a finger when lifted.
const TOUCHES = ['pointerdown', 'pointerup', 'keydown'];
export const MUTE = 'no sound: touch the page';

export class Sound {
  /** The choice has the values off, on and mute; report is called with words when these change. */
  constructor(choice, report = () => {}) {
    Object.assign(this, { choice, report, wanted: '', dead: false, tone: '' });
    choice.value = 'off';
    choice.addEventListener('change', () => this.choose());
    for (const kind of TOUCHES) globalThis.addEventListener?.(kind, () => this.touch(), true);
    globalThis.document?.addEventListener('visibilitychange', () => this.check());
  }

  get isOn() { return this.choice.value !== 'off'; }

  /** The worst priority that sounds; empty for none. */
  ring(priority) { this.wanted = priority; this.update(); }

  /** Whether what is shown is not current. */
  die(dead) { this.dead = dead; this.update(); }

  choose() {
    clearInterval(this.checking);
    this.report('');
    if (this.isOn) {
      // A browser gives sound only after somebody has touched the page, as by this very choice.
      this.open();
      this.checking = setInterval(() => this.check(), CHECK);
    } else this.close();
    this.update();
  }

  /** Make a new context; one that a browser has taken away may never play again. */
  open() {
    this.close();
    try {
      const context = new AudioContext();
      [this.context, this.clock] = [context, null];
      context.addEventListener('statechange', () => { if (context === this.context) this.resume(); });
      this.resume();
    } catch { this.tell(false); }
  }

  close() {
    const { context } = this;
    this.context = null;
    try { context?.close?.()?.catch(() => { /* it is closed already */ }); } catch { /* it is closed already */ }
  }

  get plays() { return this.context?.state === 'running'; }

  /** Ask for the sound again where it was taken away. */
  resume() {
    if (this.plays) { this.tell(true); return; }
    if (this.context?.state === 'closed' || this.resuming) return;
    this.resuming = true;
    let answer = null;
    try { answer = this.context?.resume(); } catch { /* the next check reports it */ }
    Promise.resolve(answer).then(() => this.tell(this.plays), () => this.tell(false));
    this.resuming = false;
  }

  /** Prove that the context plays: it says so, and its clock has moved since the last check. */
  check() {
    if (!this.isOn) return;
    const clock = this.context?.currentTime, moved = clock !== this.clock;
    this.clock = clock;
    if (this.plays) this.tell(moved);
    else { this.tell(false); this.resume(); }
  }

  /** A touch lets a page play: what does not is made anew. */
  touch() {
    if (this.choice.value === 'mute' || (this.isOn && !this.plays)) this.open();
  }

  /** Let the choice say whether alarms can be heard. */
  tell(heard) {
    const value = heard ? 'on' : 'mute';
    if (!this.isOn || this.choice.value === value) return;
    this.choice.value = value;
    this.report(heard ? '' : MUTE);
    if (heard && this.tone) this.call();
  }

  update() {
    const tone = this.isOn ? (this.dead ? 'dead' : this.wanted) : '';
    if (tone === this.tone) return;
    clearInterval(this.timer);
    this.tone = tone;
    if (!tone) return;
    this.timer = setInterval(() => this.call(), TONES[tone].every);
    this.call();
  }

  call() {
    this.choice.dataset.tone = this.tone;
    // Beeps that wait for a context would all be heard at once when it comes back.
    if (!this.plays) { this.check(); return; }
    TONES[this.tone].beeps.forEach((frequency, k) => {
      const beep = this.context.createOscillator(), at = this.context.currentTime + k * STEP;
      beep.frequency.value = frequency;
      beep.connect(this.context.destination);
      beep.start(at);
      beep.stop(at + BEEP);
    });
  }
}
