// SPDX-License-Identifier: Apache-2.0
// The stability map: what divides it is drawn once for a width, the point and its trail each time.

import { make } from './dom.js';

const LEFT = 62, RIGHT = 14, TOP = 12, BOTTOM = 44;
const FADES = [0.25, 0.4, 0.6, 0.85];

/** Round numbers that divide a range into a few parts. */
export function ticks(top, most) {
  const raw = top / most;
  const decade = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map((s) => s * decade).find((s) => s >= raw);
  const found = [];
  for (let value = 0; value <= top * 1.0001; value += step) found.push(value);
  return found;
}

export class StabilityMap {
  constructor(svg, bearing) {
    this.svg = svg;
    this.bearing = bearing;
    this.live = make('g');
    this.width = 0;
    new ResizeObserver(() => this.redraw()).observe(svg.parentElement);
  }

  x(speed) {
    return LEFT + (speed / this.bearing.speeds[1]) * this.plotWidth;
  }

  y(load) {
    return TOP + (1 - load / this.bearing.loads[1]) * this.plotHeight;
  }

  /** Take over another range of speeds and loads. */
  remake(map) {
    Object.assign(this.bearing, map);
    this.width = 0;
    this.redraw();
  }

  redraw() {
    const width = Math.round(this.svg.parentElement.clientWidth);
    if (!width || width === this.width) return;
    this.width = width;
    this.height = Math.round(Math.min(Math.max(0.6 * width, 250), 470));
    this.plotWidth = width - LEFT - RIGHT;
    this.plotHeight = this.height - TOP - BOTTOM;
    this.svg.setAttribute('viewBox', `0 0 ${width} ${this.height}`);
    this.svg.replaceChildren(hatching(), ...this.areas(), ...this.axes(), ...this.lines(), this.live);
    if (this.shown) this.show(...this.shown);
  }

  areas() {
    const { plotWidth: width, plotHeight: height } = this;
    const frame = make('rect', { class: 'frame', x: LEFT, y: TOP, width, height });
    const area = (name, look) => make('path', { class: look, d: this.above(this.bearing.curves[name]) });
    return [frame, area('caution', 'area-caution'), area('fold', 'area-fold'), area('hopf', 'area-hopf'), area('hopf', 'area-hatch')];
  }

  above(loads) {
    const top = this.bearing.loads[1];
    const points = this.bearing.curves.speed.map((speed, k) => [this.x(speed), this.y(Math.min(loads[k] ?? top, top))]);
    const path = points.map(([x, y]) => `${x.toFixed(1)} ${y.toFixed(1)}`).join('L');
    return `M${LEFT} ${TOP}L${path}L${LEFT + this.plotWidth} ${TOP}Z`;
  }

  lines() {
    const [, top] = this.bearing.loads;
    return ['fold', 'hopf'].map((name) => {
      let path = '', pen = false;
      this.bearing.curves[name].forEach((load, k) => {
        const inside = load !== null && load <= top;
        if (inside) path += `${pen ? 'L' : 'M'}${this.x(this.bearing.curves.speed[k]).toFixed(1)} ${this.y(load).toFixed(1)}`;
        pen = inside;
      });
      return make('path', { class: name, d: path });
    });
  }

  axes() {
    const { bearing, height } = this;
    const parts = [];
    const kilo = bearing.loads[1] >= 5000;
    for (const rpm of ticks(bearing.speeds[1] * bearing.rpm, Math.max(3, this.plotWidth / 60))) {
      const x = this.x(rpm / bearing.rpm);
      parts.push(make('path', { class: 'grid', d: `M${x} ${TOP}V${TOP + this.plotHeight}` }));
      parts.push(make('text', { x, y: height - 26, 'text-anchor': 'middle' }, String(+rpm.toPrecision(6))));
    }
    for (const load of ticks(bearing.loads[1], Math.max(3, this.plotHeight / 55))) {
      const y = this.y(load);
      parts.push(make('path', { class: 'grid', d: `M${LEFT} ${y}H${LEFT + this.plotWidth}` }));
      parts.push(make('text', { x: LEFT - 7, y: y + 4, 'text-anchor': 'end' }, String(+(load / (kilo ? 1000 : 1)).toPrecision(6))));
    }
    parts.push(make('text', { x: LEFT + this.plotWidth / 2, y: height - 7, 'text-anchor': 'middle' }, 'shaft speed [rpm]'));
    const middle = TOP + this.plotHeight / 2;
    parts.push(make('text', { x: 13, y: middle, 'text-anchor': 'middle', transform: `rotate(-90 13 ${middle})` }, `bearing load [${kilo ? 'kN' : 'N'}]`));
    return parts;
  }

  /** Show the operating point (null for none), its trail, and what to say of it. */
  show(point, trail, words) {
    this.shown = [point, trail, words];
    this.svg.setAttribute('aria-label', `Stability map of ${this.bearing.name}: ${words}`);
    if (!this.width) return;
    const parts = this.trail(trail.map((each) => this.place(each)));
    if (point) parts.push(...this.mark(this.place(point)));
    this.live.replaceChildren(...parts);
  }

  /** Where a point is drawn; one beyond the map is drawn at its edge. */
  place([speed, load]) {
    const [x, y] = [this.x(Math.abs(speed)), this.y(load)];
    const [right, low] = [LEFT + this.plotWidth, TOP + this.plotHeight];
    const inside = [Math.min(x, right), Math.min(Math.max(y, TOP), low)];
    return { x: inside[0], y: inside[1], off: inside[0] !== x || inside[1] !== y, right: x > right, above: y < TOP };
  }

  trail(places) {
    const size = Math.ceil(places.length / FADES.length);
    return FADES.flatMap((opacity, k) => {
      const part = places.slice(k * size, (k + 1) * size + 1);
      if (part.length < 2) return [];
      const points = part.map(({ x, y }) => `${x.toFixed(1)},${y.toFixed(1)}`).join(' ');
      return [make('polyline', { class: 'trail', points, opacity })];
    });
  }

  mark({ x, y, off, right, above }) {
    const cross = make('path', { class: 'cross', d: `M${LEFT} ${y}H${x}M${x} ${y}V${TOP + this.plotHeight}` });
    if (!off) return [cross, make('circle', { class: 'ring', cx: x, cy: y, r: 11 }), make('circle', { class: 'point', cx: x, cy: y, r: 6.5 })];
    const turn = right ? 90 : above ? 0 : 180;
    const arrow = make('path', { class: 'point', d: 'M0 -11L9 8H-9Z', transform: `translate(${x - (right ? 9 : 0)} ${y + (above ? 11 : 0)}) rotate(${turn})` });
    const text = make('text', { class: 'off', x: x - (right ? 24 : -14), y: Math.max(y + 4, TOP + 16), 'text-anchor': right ? 'end' : 'start' }, 'beyond the map');
    return [cross, arrow, text];
  }
}

/** Hatching for what must be distinct without colour. */
function hatching() {
  const pattern = make('pattern', { id: 'hatch', width: 8, height: 8, patternUnits: 'userSpaceOnUse', patternTransform: 'rotate(45)' });
  pattern.append(make('path', { class: 'hatch', d: 'M0 0V8' }));
  const holder = make('defs');
  holder.append(pattern);
  return holder;
}
