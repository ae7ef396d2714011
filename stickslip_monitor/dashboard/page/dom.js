// SPDX-License-Identifier: Apache-2.0
// Elements: found, filled and made.

const NS = 'http://www.w3.org/2000/svg';

export const get = (id) => document.getElementById(id);

/** Set a text; one that is the same is not touched, so that no reader begins it anew. */
export function put(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

// Units of time [s], each from two of it on.
const UNITS = [['years', 31557600, 1], ['days', 86400, 0], ['h', 3600, 1], ['min', 60, 1]];

/** A time that has passed [s], to a precision that matters. */
export function about(seconds) {
  const [unit, size, digits] = UNITS.find(([, one]) => seconds >= 2 * one) ?? ['s', 1, seconds < 9.95 ? 1 : 0];
  return `${(seconds / size).toFixed(digits)} ${unit}`;
}

/** Give an element attributes. */
export function give(element, attributes) {
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
}

/** An SVG element with attributes, and text if there is any. */
export function make(kind, attributes = {}, text = '') {
  const element = document.createElementNS(NS, kind);
  give(element, attributes);
  if (text) element.textContent = text;
  return element;
}
