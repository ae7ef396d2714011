// SPDX-License-Identifier: Apache-2.0
// Margins and amplitude as horizontal gauges, each with its number and a sentence beside it.

import { give, make, put } from './dom.js';

const W = 400;

function build(name) {
  const root = document.createElement('div');
  root.className = 'gauge';
  root.innerHTML = '<div class="row"><span class="name"></span><b></b></div><div class="scale" aria-hidden="true"><span></span><span></span><span></span></div><small></small>';
  const svg = make('svg', { viewBox: `0 0 ${W} 30`, preserveAspectRatio: 'none', 'aria-hidden': 'true' });
  const [number, scale, note] = ['b', '.scale', 'small'].map((part) => root.querySelector(part));
  scale.before(svg);
  root.querySelector('.name').textContent = name;
  give(root, { role: 'meter', 'aria-label': name });
  return { root, svg, note, scale, number };
}

function describe(parts, low, high, now, number, note) {
  parts.number.textContent = number;
  parts.note.textContent = note;
  give(parts.root, { 'aria-valuemin': low, 'aria-valuemax': high, 'aria-valuenow': now, 'aria-valuetext': `${number}, ${note}` });
}

/** What the ends and the middle of a gauge stand for. */
function mark(parts, texts) {
  texts.forEach((text, k) => put(parts.scale.children[k], text));
}

const rect = (look, x, width, y = 6, height = 16) => make('rect', { class: look, x, y, width: Math.max(width, 0), height });

/** A margin to a boundary, from -100 % to +100 %. */
export class MarginGauge {
  constructor(name, bearing, inside, outside) {
    this.parts = build(name);
    this.root = this.parts.root;
    this.near = inside.near ? bearing.caution_margin : 0;
    this.look = inside.look;
    this.words = [inside.words, outside];
    mark(this.parts, ['−100 %', '0', '+100 %']);
  }

  x(margin) {
    return ((Math.min(Math.max(margin, -1), 1) + 1) / 2) * W;
  }

  show(margin, known) {
    const zero = this.x(0), near = this.x(this.near);
    const bars = [rect('track', 0, W), rect(this.look, 0, zero), rect('near', zero, near - zero)];
    if (this.look === 'bad') bars.push(rect('hatched', 0, zero));
    bars.push(make('path', { class: 'zero', d: `M${zero} 3V25` }));
    if (margin === null) {
      describe(this.parts, -100, 100, known ? 100 : 0, '–', known ? 'no such boundary at this load' : 'unknown');
    } else {
      const x = Math.min(Math.max(this.x(margin), 8), W - 8), percent = 100 * margin, size = Math.abs(percent);
      bars.push(make('path', { class: 'needle', d: `M${x} 22L${x - 8} 0H${x + 8}Z` }));
      const number = size > 999 ? '> +999 %' : `${percent < 0 ? '−' : '+'}${size.toFixed(size < 99.95 ? 1 : 0)} %`;
      describe(this.parts, -100, 100, Math.min(Math.max(percent, -100), 100).toFixed(1), number, this.words[margin < 0 ? 0 : 1]);
    }
    this.parts.svg.replaceChildren(...bars);
  }
}

/** The amplitude of stick-slip: exact as a bar, by averaging as a mark, the limit as a line. */
export class AmplitudeGauge {
  constructor(bearing) {
    this.parts = build('Stick-slip amplitude');
    this.root = this.parts.root;
    this.limit = bearing.amplitude_limit;
    this.top = 1.5 * (this.limit ?? 1e-3);
  }

  show(status) {
    const { amplitude, amplitude_exact: exact, sticking } = status;
    const best = exact ?? amplitude;
    // The scale only ever grows, so that a glance can be trusted.
    while (Math.max(best ?? 0, amplitude ?? 0) > this.top) this.top *= 2;
    const x = (value) => (value / this.top) * W;
    const bars = [rect('track', 0, W)];
    if (best !== null) bars.push(rect(sticking ? 'bar' : 'would', 1, x(best) - 1, 7, 14));
    if (amplitude !== null) bars.push(make('path', { class: 'kbm', d: `M${x(amplitude)} 2V26` }));
    if (this.limit !== null) bars.push(make('path', { class: 'limit', d: `M${x(this.limit)} 1V27` }));
    this.parts.svg.replaceChildren(...bars);
    const mm = (value) => `${(1e3 * value).toFixed(2)} mm`;
    mark(this.parts, ['0', `${+(500 * this.top).toPrecision(3)}`, `${+(1e3 * this.top).toPrecision(3)} mm`]);
    const known = status.regime !== null;
    const number = best === null ? (known ? '0 mm' : '–') : mm(best);
    const about = best === null ? (known ? 'no stick-slip cycle exists' : 'unknown') : `${sticking ? 'predicted' : 'if something starts it'}${amplitude === null ? '' : `; by averaging (KBM) ${mm(amplitude)}`}`;
    const limit = this.limit === null ? '' : `; limit ${mm(this.limit)}`;
    describe(this.parts, 0, 1e3 * this.top, (1e3 * (best ?? 0)).toFixed(3), number, about + limit);
  }
}
