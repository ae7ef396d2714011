// SPDX-License-Identifier: Apache-2.0
// A tone for each priority while an alarm sounds, and one when the monitor or the dashboard is not
// heard; where somebody has asked for it: off whenever the page is opened.

// Frequencies [Hz] of the beeps of a call, and how often the call comes [ms].
const TONES = {
  dead: { beeps: [400, 300, 200], every: 5000 },
  alarm: { beeps: [1000, 1000, 1000], every: 2000 },
  warning: { beeps: [700, 700], every: 4000 },
  caution: { beeps: [500], every: 10000 },
};
const BEEP = 0.18, STEP = 0.28;

export class Sound {
  constructor(choice) {
    [this.choice, this.wanted, this.dead] = [choice, '', false];
    choice.value = 'off';
    // A browser gives sound only after somebody has touched the page, as by this very choice.
    choice.addEventListener('change', () => { this.context ??= new AudioContext(); this.context.resume(); this.set(); });
  }

  /** The worst priority that sounds; empty for none. */
  ring(priority) { this.wanted = priority; this.set(); }

  /** Whether what is shown is not current. */
  die(dead) { this.dead = dead; this.set(); }

  set() {
    const tone = this.choice.value === 'on' ? (this.dead ? 'dead' : this.wanted) : '';
    if (tone === (this.tone ?? '')) return;
    clearInterval(this.timer);
    this.tone = tone;
    if (!tone) return;
    this.timer = setInterval(() => this.call(TONES[tone].beeps), TONES[tone].every);
    this.call(TONES[tone].beeps);
  }

  call(beeps) {
    beeps.forEach((frequency, k) => {
      const beep = this.context.createOscillator(), at = this.context.currentTime + k * STEP;
      beep.frequency.value = frequency;
      beep.connect(this.context.destination);
      beep.start(at);
      beep.stop(at + BEEP);
    });
    this.choice.dataset.tone = this.tone;
  }
}
