// SPDX-License-Identifier: Apache-2.0
// The stream of events. Run as a shared worker it is one for all tabs of a browser, which opens no
// more than six connections to a server; where there are no shared workers each tab has its own.

const AGAIN = 2000;
const KINDS = ['state', 'status', 'map', 'alarms', 'monitor', 'replay', 'beat'];
const numberOf = (event) => Number(event.lastEventId.split('-').at(-1));

export class Stream {
  constructor() {
    this.tabs = new Map();
    this.source = null;
  }

  /** A tab begins with all there is, read by a connection of its own that ends with it. */
  join(tell) {
    const waiting = [];
    this.tabs.set(tell, (message) => waiting.push(message));
    const first = new EventSource('/events');
    first.addEventListener('state', (event) => {
      first.close();
      if (!this.tabs.has(tell)) return;
      const number = numberOf(event);
      tell({ kind: 'state', data: event.data });
      for (const message of waiting) if (!(message.number <= number)) tell(message);
      this.tabs.set(tell, tell);
      if (!this.source) this.open();
    });
    first.onerror = () => { first.close(); if (this.tabs.has(tell)) { tell({ kind: 'lost' }); this.retry(() => this.tabs.has(tell) && this.join(tell)); } };
  }

  leave(tell) {
    this.tabs.delete(tell);
    if (!this.tabs.size) { this.source?.close(); this.source = null; }
  }

  open() {
    this.source?.close();
    this.source = new EventSource('/events');
    // What came since a tab began, or while the connection was broken, is in the state.
    for (const kind of KINDS) this.source.addEventListener(kind, (event) => this.send({ kind, data: event.data, number: numberOf(event) }));
    this.source.onerror = () => {
      this.send({ kind: 'lost' });
      if (this.source?.readyState === EventSource.CLOSED) { this.source = null; this.retry(() => this.tabs.size && !this.source && this.open()); }
    };
  }

  /** The browser itself comes back after a broken connection, but not after a refusal. */
  retry(work) {
    setTimeout(async () => {
      const answer = await fetch('/page.js', { method: 'HEAD', cache: 'no-store' }).catch(() => null);
      if (answer?.status === 401) this.send({ kind: 'login' });
      if (answer?.ok) work(); else this.retry(work);
    }, AGAIN);
  }

  send(message) {
    for (const take of this.tabs.values()) take(message);
  }

  /** Nothing has come for long. */
  again() {
    if (this.source) this.open();
  }
}

if (typeof SharedWorkerGlobalScope !== 'undefined' && self instanceof SharedWorkerGlobalScope) {
  const stream = new Stream();
  self.onconnect = ({ ports: [port] }) => {
    const tell = (message) => port.postMessage(message);
    port.onmessage = ({ data }) => {
      if (data === 'join') stream.join(tell);
      else if (data === 'leave') stream.leave(tell);
      else if (data === 'again') stream.again();
    };
  };
}

/** Connect a tab: the messages go to take; what is returned asks for a new connection. */
export function connect(take) {
  if (!('SharedWorker' in globalThis)) {
    const own = new Stream();
    own.join(take);
    return () => own.again();
  }
  const { port } = new SharedWorker('/stream.js', { type: 'module' });
  port.onmessage = ({ data }) => take(data);
  port.postMessage('join');
  addEventListener('pagehide', () => port.postMessage('leave'));
  addEventListener('pageshow', (event) => { if (event.persisted) port.postMessage('join'); });
  return () => port.postMessage('again');
}
