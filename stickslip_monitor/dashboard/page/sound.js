// SPDX-License-Identifier: Apache-2.0
// A tone while an alarm sounds, where somebody has asked for it: off whenever the page is opened.

export class Sound {
  constructor(choice) {
    this.choice = choice;
    this.ringing = false;
    choice.value = 'off';
    // A browser gives sound only after somebody has touched the page, as by this very choice.
    choice.addEventListener('change', () => { this.context ??= new AudioContext(); this.context.resume(); this.set(); });
  }

  ring(sounding) {
    this.ringing = sounding;
    this.set();
  }

  set() {
    const on = this.ringing && this.choice.value === 'on';
    if (on === Boolean(this.timer)) return;
    clearInterval(this.timer);
    this.timer = on ? setInterval(() => this.beep(), 2000) : null;
    if (on) this.beep();
  }

  beep() {
    const tone = this.context.createOscillator();
    tone.frequency.value = 800;
    tone.connect(this.context.destination);
    tone.start();
    tone.stop(this.context.currentTime + 0.3);
    this.beeps = (this.beeps ?? 0) + 1;
    this.choice.dataset.beeps = this.beeps;
  }
}
