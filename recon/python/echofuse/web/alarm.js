// SPDX-License-Identifier: MIT
// Plays sounds for alerts. Browsers allow sound only after a click, so a button turns the sound on and shows whether it
// is on.
const repeatS = 10;

class Alarm {
  constructor(id) {
    this.button = document.getElementById(id);
    this.known = new Set(), this.last = -Infinity;
    window.alarms = 0;
  }
  async toggle() {
    this.context ??= new AudioContext();
    await (this.on ? this.context.suspend() : this.context.resume());
    this.on = this.context.state === 'running';
    this.button.setAttribute('aria-pressed', this.on);
    this.button.lastChild.textContent = this.on ? 'ound is on' : 'ound on';  // text after the underlined initial 's'
    this.known.clear();
    if (this.on) this.play([660]);
  }
  // Plays a sound for each new alert, and again every `repeatS` seconds while an alert lasts.
  take(alerts) {
    const fresh = alerts.some(alert => !this.known.has(alert)), now = performance.now() / 1000;
    this.known = new Set(alerts);
    if (!this.on || !alerts.length || !fresh && now - this.last < repeatS) return;
    this.last = now;
    this.play([880, 660, 880, 660]);
    window.alarms++;
  }
  play(tones) {
    tones.forEach((hertz, i) => {
      const tone = new OscillatorNode(this.context, {frequency: hertz}), from = this.context.currentTime + 0.25 * i;
      const level = new GainNode(this.context, {gain: 0});
      level.gain.setTargetAtTime(0.3, from, 0.01), level.gain.setTargetAtTime(0, from + 0.2, 0.01);
      tone.connect(level).connect(this.context.destination);
      tone.start(from), tone.stop(from + 0.25);
    });
  }
}
