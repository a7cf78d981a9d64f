// SPDX-License-Identifier: MIT
// WebSocket connection to the server. recon/live/message.hpp defines the messages.
const types = {u8: Uint8Array, u16: Uint16Array, u32: Uint32Array, f32: Float32Array, f64: Float64Array};

function decode(buffer) {
  const length = new DataView(buffer).getUint32(0, true);
  const message = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  const begin = Math.ceil((4 + length) / 8) * 8;
  for (const [name, a] of Object.entries(message.arrays)) {
    const count = a.shape.reduce((n, side) => n * side, 1);
    const values = new types[a.type](buffer, begin + a.offset, count);
    values.shape = a.shape;
    message.arrays[name] = values;
  }
  return message;
}

// Returns the words for the status of a run, e.g. "stopped: disk full".
const statusWord = status => ({open: 'recording', 'stopped:disk': 'stopped: disk full', 'stopped:failed': 'stopped: failure', 'stopped:interrupted': 'stopped: interrupted'}[status] ?? status);

// Returns why a request was refused: the text sent by the viewer, or the status line if another web server answered.
const refusal = async answer => answer.headers.get('content-type')?.startsWith('text/plain')
  ? (await answer.text()).trim() : `${answer.status} ${answer.statusText}, reported by a web server in front of the viewer`;

// Calls take(message) for each message, and changed(open, why) when the connection opens or closes. If the
// connection is lost, tries to reconnect at intervals of at most 5 s, without a limit on the number of attempts.
class Link {
  constructor(take, changed) {
    this.take = take;
    this.changed = changed;
    this.pause = 250;
    this.open();
  }
  open() {
    const at = new URL(`live${location.search}`, location), url = at.href;
    at.protocol = at.protocol.replace('http', 'ws');
    let opened = false;
    this.socket = new WebSocket(at);
    this.socket.binaryType = 'arraybuffer';
    this.socket.onopen = () => {
      this.pause = 250, opened = true;
      this.changed(true);
    };
    this.socket.onmessage = event => this.take(decode(event.data));
    this.socket.onclose = async () => {
      this.changed(false, opened ? '' : await fetch(url, {cache: 'no-store'}).then(refusal, () => ''));
      setTimeout(() => this.open(), this.pause);
      this.pause = Math.min(this.pause * 2, 5000);
    };
  }
  ask(what) {
    if (this.socket.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(what));
  }
}

// Answers the requests of a page that echofuse-view --save has written, from the messages in its file. A request for
// another record returns the next one that the file contains.
class Saved {
  constructor(take, changed) {
    this.lines = document.getElementById('messages').textContent.trim().split('\n');
    this.take = take;
    this.start(changed);
  }
  async message(line) {
    const bytes = Uint8Array.from(atob(this.lines[line]), c => c.charCodeAt(0));
    return decode(await new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream('deflate'))).arrayBuffer());
  }
  async start(changed) {
    const saved = await this.message(0);
    this.records = saved.records;
    this.take(saved);
    for (let line = saved.records.length + 1; line < this.lines.length; ++line) this.take(await this.message(line));
    changed(true);
  }
  // Returns the saved record that is nearest to `index` in the direction from `from`, otherwise the nearest one.
  next(index, from) {
    const beyond = this.records.filter(at => Math.sign(index - from) * (at - index) >= 0);
    return (beyond.length ? beyond : this.records).reduce((best, at) => Math.abs(at - index) < Math.abs(best - index) ? at : best);
  }
  async ask({show, sum}) {
    if (show != null && this.records.length) {
      const live = show === 'live', message = await this.message(1 + this.records.indexOf(live ? Math.max(...this.records) : show));
      this.fits = message.fits;
      this.take({...message, live});
    }
    // The fits of a part of the range are unknown.
    if (sum) this.take({kind: 'sum', arrays: {}, fits: sum[1] < 0 ? this.fits : null});
  }
}
