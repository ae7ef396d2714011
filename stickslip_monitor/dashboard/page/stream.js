// SPDX-License-Identifier: Apache-2.0
// The stream of events. Run as a shared worker it is one for all tabs of a browser, which opens no
// more than six connections to a server; where there are no shared workers each tab has its own.

const AGAIN = 2000;
const KINDS = ['state', 'status', 'map', 'alarms', 'monitor', 'replay', 'beat'];

export class Stream {
  constructor() {
    this.tabs = new Set();
    // The state, and the newest of every kind and bearing since: all that a new tab must get.
    this.known = new Map();
  }

  join(send) {
    this.tabs.add(send);
    for (const message of this.known.values()) send(message);
    if (!this.source) this.open();
  }

  leave(send) {
    this.tabs.delete(send);
    if (this.tabs.size) return;
    this.source?.close();
    this.source = null;
    this.known.clear();
  }

  open() {
    this.source?.close();
    this.source = new EventSource('events');
    for (const kind of KINDS) this.source.addEventListener(kind, (event) => this.send({ kind, data: JSON.parse(event.data) }));
    this.source.onerror = () => {
      this.send({ kind: 'lost' });
      // The browser itself comes back after a broken connection, but not after a refusal.
      if (this.source?.readyState === EventSource.CLOSED) this.retry();
    };
  }

  retry() {
    setTimeout(async () => {
      if (!this.tabs.size || this.source?.readyState !== EventSource.CLOSED) return;
      const answer = await fetch('page.js', { method: 'HEAD', cache: 'no-store' }).catch(() => null);
      if (answer?.status === 401) for (const send of this.tabs) send({ kind: 'login' });
      if (answer?.ok) this.open(); else this.retry();
    }, AGAIN);
  }

  send(message) {
    if (['state', 'lost'].includes(message.kind)) this.known.clear();
    this.known.set(`${message.kind} ${message.data?.bearing}`, message);
    for (const send of this.tabs) send(message);
  }

  /** Nothing has come for long. */
  again() {
    if (this.source?.readyState !== EventSource.CLOSED) this.open();
  }
}

if (typeof SharedWorkerGlobalScope !== 'undefined' && self instanceof SharedWorkerGlobalScope) {
  const stream = new Stream();
  self.onconnect = ({ ports: [port] }) => {
    const send = (message) => port.postMessage(message);
    port.onmessage = ({ data }) => {
      if (data === 'join') stream.join(send);
      else if (data === 'leave') stream.leave(send);
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
  const { port } = new SharedWorker('stream.js', { type: 'module' });
  port.onmessage = ({ data }) => take(data);
  port.postMessage('join');
  addEventListener('pagehide', () => port.postMessage('leave'));
  addEventListener('pageshow', (event) => { if (event.persisted) port.postMessage('join'); });
  return () => port.postMessage('again');
}
