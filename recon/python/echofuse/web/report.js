// SPDX-License-Identifier: MIT
// Draws the report from the blocks created by recon/python/echofuse/report/blocks.py, with one function per kind of block.
/* global uPlot */
import {Chart, Histogram, Profile, Strips, Waterfall, axis, colour, metresPerPs, short, siNumber, text, textSize} from './charts.js';
import {Cloud} from './cloud.js';
import {MapView, errorPicture, isDark, picture, tables} from './maps.js';

const report = JSON.parse(document.getElementById('data').textContent), errorSpan = [-0.5, 0.5];
const redraws = [];  // functions that redraw their charts when the theme or the width changes
let ids = 0;
const newId = kind => `${kind}-${++ids}`;
// Appends a new element to its parent, and returns it.
function make(parent, kind, more = {}) {
  const {data, ...properties} = more, at = Object.assign(document.createElement(kind), properties);
  if (data) Object.assign(at.dataset, data);
  parent.append(at);
  return at;
}
const pictured = new Set(report.records.map(r => r.index));
// Appends the indices of records. Indices of records that have pictures become links.
function links(parent, {records, more}) {
  records.forEach((index, i) => {
    parent.append(i ? ', ' : '');
    pictured.has(index) ? make(parent, 'a', {href: `#record-${index}`, textContent: index}) : parent.append(index);
  });
  parent.append(more ? ', ...' : '');
}
// Appends a sentence. The words "record N" become a link if the scored run has pictures of that record.
function sentence(parent, text) {
  for (const part of text.split(/(record \d+)/)) {
    const index = /^record (\d+)$/.exec(part)?.[1];
    if (index && pictured.has(+index) && !text.startsWith('Recorded run')) make(parent, 'a', {href: `#record-${index}`, textContent: part});
    else parent.append(part);
  }
}
const add = (parent, blocks) => blocks.forEach(block => kinds[block.kind](parent, block));

// A chart of series with different x values. uPlot needs a common x axis, so all x values are merged. A series may have
// error bars ("bars": [low, high] per point), crosses ("crossed") and names ("names"). It may be dashed, with the area
// below it shaded. "ticks" are labels at x = 0, 1, 2 ...
class Plot extends Chart {
  constructor(parent, block) {
    const id = newId('chart');
    make(parent, 'div', {id, className: 'chart', role: 'group', ariaLabel: block.title});
    super(id, block.height ?? 300);
    Object.assign(this, {block, rules: block.rules});
    const points = block.series.flatMap((s, k) => s.x.map((x, i) => [x, k, s.y[i]])).sort((a, b) => a[0] - b[0]);
    this.set([points.map(p => p[0]), ...block.series.map((_, k) => points.map(p => p[1] === k ? p[2] : undefined))]);
  }
  options() {
    const {block} = this, rules = this.rules.filter(rule => !rule.across).map(rule => rule.at), format = (_, v) => v == null ? '–' : siNumber(v);
    const nearest = (u, series, index) => {
      const y = u.data[series];
      for (let by = 0; series && by < y.length; ++by)
        for (const i of [index - by, index + by]) if (y[i] != null) return i;
      return index;
    };
    const look = {
      dots: at => ({paths: () => null, points: {show: true, size: 4, width: 0, fill: `${at}99`}}),
      points: at => ({paths: () => null, points: {show: true, size: 10, width: 0, fill: at}}),
      line: () => ({points: {show: false}}),
      marked: at => ({points: {show: true, size: 8, width: 0, fill: at}}),
      steps: () => ({paths: uPlot.paths.stepped({align: 1}), points: {show: false}}),
    };
    const ends = block.series.flatMap(s => [...s.y, ...(s.bars ?? []).flat()]).concat(this.rules.filter(rule => rule.across).map(rule => rule.at)).filter(v => v != null);
    const wide = (low, high) => block.log ? [low / 1.15, high * 1.15] : [Math.min(low, 0), 1.06 * high];
    const span = block.span ?? (ends.length && block.series.some(s => s.bars || s.names) && wide(Math.min(...ends), Math.max(...ends)));
    const words = block.ticks && {splits: block.ticks.map((_, i) => i), values: () => block.ticks, ...this.turned(block.ticks)};
    const x = words ? [-0.3, block.ticks.length - 0.7] : null;
    return {
      legend: {show: !block.series.some(s => s.names), live: !words},
      cursor: {y: false, dataIdx: nearest, points: {size: 9}},
      hooks: {drawClear: [u => this.under(u)], draw: [u => this.over(u)]},
      scales: {x: {time: false, distr: block.log_x ? 3 : 1, ...x ? {range: () => x} : rules.length && {range: (_, low, high) => [Math.min(low, ...rules), Math.max(high, ...rules)]}},
               y: {distr: block.log ? 3 : 1, ...span && {range: () => span}}},
      axes: [axis(block.x, {values: short, ...words}), axis(block.y, {values: short, size: 4 * textSize()})],
      series: [{label: block.x, value: words ? (_, v) => block.ticks[v] ?? '–' : format},
               ...block.series.map(s => ({label: s.name, value: format, width: 2, stroke: colour(`--${s.colour}`), ...s.shaded && {dash: [6, 4], fill: colour('--look-paper')}, ...look[s.look](colour(`--${s.colour}`))}))],
    };
  }
  // Rotates the tick labels if they do not fit side by side.
  turned(words) {
    const c = document.createElement('canvas').getContext('2d');
    c.font = text();
    const widest = Math.max(...words.map(word => c.measureText(word).width)), fits = u => widest + 8 < (u.width - 5 * textSize()) / words.length;
    return {rotate: u => fits(u) ? 0 : 45, size: u => fits(u) ? 2 * textSize() : 0.72 * widest + 1.6 * textSize()};
  }
  // Draws the error bars, crosses and names over the points.
  over(u) {
    const c = u.ctx, ratio = devicePixelRatio, points = [], taken = [];
    const stroke = (...lines) => (c.beginPath(), lines.forEach(([a, b, x, y]) => (c.moveTo(a * ratio, b * ratio), c.lineTo(x * ratio, y * ratio))), c.stroke());
    u.over.querySelectorAll('.named').forEach(at => at.remove());
    c.save(), c.translate(u.bbox.left, u.bbox.top);
    for (const s of this.block.series) {
      c.strokeStyle = colour(`--${s.colour}`), c.lineWidth = 1.5 * ratio;
      s.x.forEach((value, i) => {
        if (s.y[i] == null) return;
        const x = u.valToPos(value, 'x'), y = u.valToPos(s.y[i], 'y'), bar = s.bars?.[i]?.map(v => u.valToPos(v, 'y'));
        if (bar) stroke([x, bar[0], x, bar[1]], [x - 4, bar[0], x + 4, bar[0]], [x - 4, bar[1], x + 4, bar[1]]), taken.push([x - 4, bar[1], x + 4, bar[0]]);
        if (s.crossed?.[i]) c.lineWidth = 3 * ratio, stroke([x - 6, y - 6, x + 6, y + 6], [x - 6, y + 6, x + 6, y - 6]), c.lineWidth = 1.5 * ratio;
        if (s.names) points.push({x, y, name: s.names[i], colour: c.strokeStyle}), taken.push([x - 6, y - 6, x + 6, y + 6]);
      });
    }
    for (const {across, at} of this.rules) if (across && points.length) taken.push([0, u.valToPos(at, 'y') - 20, 220, u.valToPos(at, 'y')]);
    const wide = u.over.clientWidth, high = u.over.clientHeight;
    for (const {x, y, name, colour: ink} of points.sort((a, b) => a.y - b.y)) {
      const at = make(u.over, 'span', {className: 'named', textContent: name}), w = at.offsetWidth, h = at.offsetHeight;
      // Returns the area in which a label at this position overlaps other items, plus a penalty for parts outside the
      // chart.
      const cost = ([left, top]) => taken.reduce((sum, b) => sum + Math.max(0, Math.min(left + w, b[2]) - Math.max(left, b[0])) * Math.max(0, Math.min(top + h, b[3]) - Math.max(top, b[1])), 0)
        + 1e4 * (Math.max(0, -left) + Math.max(0, left + w - wide) + Math.max(0, -top) + Math.max(0, top + h - high));
      let best = null, least = Infinity;
      for (let away = 9; away < 200 && least > 0; away *= 1.35)
        for (let k = 0; k < 16 && least > 0; ++k) {
          const turn = k * Math.PI / 8, place = [x + Math.cos(turn) * (away + w / 2) - w / 2, y + Math.sin(turn) * (away + h / 2) - h / 2], now = cost(place);
          if (now < least) best = place, least = now;
        }
      const [left, top] = best, end = [Math.min(Math.max(x, left), left + w), Math.min(Math.max(y, top), top + h)];
      Object.assign(at.style, {left: `${left}px`, top: `${top}px`, color: ink});
      taken.push([left, top, left + w, top + h]);
      c.strokeStyle = ink, c.lineWidth = ratio;
      if (Math.hypot(end[0] - x, end[1] - y) > 14) stroke([x, y, ...end]);
    }
    c.restore();
  }
}

// Decodes base64 text into integers of `bytes` bytes, and multiplies them by `unit`.
function unpacked(text, bytes, unit) {
  const raw = Uint8Array.from(atob(text), c => c.charCodeAt(0));
  return Float32Array.from({length: raw.length / bytes}, (_, i) => (bytes === 2 ? raw[2 * i] + 256 * raw[2 * i + 1] : raw[i]) * unit);
}
const record = i => {
  const r = report.records[i];
  if (!r.side) {
    r.truth = unpacked(r.truth, 2, 1e-3), r.side = Math.round(Math.sqrt(r.truth.length));
    for (const m of r.maps) {
      m.map = unpacked(m.map, 2, 1e-3), m.share = unpacked(m.share, 1, 0.005);
      m.deviation &&= unpacked(m.deviation, 1, 0.01);
    }
  }
  return r;
};

// Returns the square part of the map that contains the bodies in the ground-truth and predicted maps, with a margin.
function about(r) {
  const all = {left: 0, top: 0, size: r.side}, at = [];
  for (const map of [r.truth, ...r.maps.map(m => m.map)])
    for (let i = 0; i < map.length; ++i) if (map[i] > 0) at.push([i % r.side, Math.floor(i / r.side)]);
  if (!at.length) return all;
  const [low, high] = [Math.min, Math.max].map(of => [0, 1].map(k => at.reduce((end, p) => of(end, p[k]), at[0][k])));
  return squareOf(r, low, high, 2 * Math.floor(r.side / 12));
}
function squareOf(r, low, high, room) {
  const size = Math.min(Math.max(high[0] - low[0], high[1] - low[1]) + 1 + room, r.side);
  const [left, top] = [0, 1].map(k => Math.min(Math.max(Math.round((low[k] + high[k] + 1 - size) / 2), 0), r.side - size));
  return size > 0.8 * r.side ? {left: 0, top: 0, size: r.side} : {left, top, size};
}

// Maps of one record that show the same part of the field of view. Drag to select a part; double-click to switch
// between the bodies and the whole field. The text below each map shows its value under the pointer.
class Pictures {
  constructor(parent, block) {
    Object.assign(this, {r: record(block.record), views: [], start: about(record(block.record))});
    this.frame = block.whole ? {left: 0, top: 0, size: this.r.side} : this.start;
    for (const show of block.show) {
      const [what, model] = show.split(' '), box = make(parent, 'div', {className: 'map', data: {show: what}});
      if (what === 'spd' || what === 'radar') this.measured(box, what);
      else this.picture(box, what, this.r.maps[+model], block.show.filter(other => other.startsWith('map')).length > 1);
    }
    this.draw();
    redraws.push(() => this.draw());
  }
  measured(box, what) {
    const {r} = this, axes = r[what], id = newId(what), values = what === 'spd' ? axes.clicks : axes.db;
    const ariaLabel = what === 'spd' ? 'SPD histogram' : 'Radar range profile';
    make(box, 'h3', {textContent: ariaLabel});
    make(box, 'p', {id: `${id}-readout`, className: 'readout'});
    make(box, 'div', {id, className: 'chart', role: 'img', ariaLabel});
    if (!values) return void (box.lastChild.textContent = 'no data in this record');
    const chart = what === 'spd' ? new Histogram(id) : new Profile(id);
    chart.farthest = r.spd.clicks ? (r.spd.start + r.spd.count * r.spd.step) * metresPerPs : r.radar.start + r.radar.count * r.radar.step;
    if (r.body_m) chart.rules = [{at: r.body_m, name: 'body (camera)'}];
    chart.axes(axes);
    chart.take(values, '', false);
    redraws.push(() => chart.renew());
  }
  picture(box, what, model, named) {
    const id = newId('map'), {r} = this, of = named ? `: ${model?.name}` : '';
    const title = {truth: 'Ground truth (depth camera)', map: `Map: ${model?.name}`, error: `Error${of}`, deviation: `Uncertainty${of}`, share: model?.name};
    const values = what === 'truth' ? r.truth : what === 'error' ? model.map.map((v, i) => v > 0 && r.truth[i] > 0 ? v - r.truth[i] : 0) : model[what];
    make(box, 'h3', {textContent: title[what]});
    const canvas = make(box, 'canvas', {id, role: 'img', ariaLabel: title[what]});
    const note = make(box, 'p', {className: 'pixel'});
    const missed = what === 'error' && model.map.reduce((sum, v, i) => sum + (r.truth[i] > 0 && !(v > 0)), 0);
    const invented = what === 'error' && model.map.reduce((sum, v, i) => sum + (v > 0 && !(r.truth[i] > 0)), 0);
    note.textContent = what === 'map' ? model.scores : what === 'deviation' ? `Position of the body: ${model.stated}.`
      : what === 'error' ? `${missed} of ${r.truth.reduce((sum, v) => sum + (v > 0), 0)} true returns missed, ${invented} false returns.` : '';
    const view = new MapView(id, what === 'error' ? 'error' : what === 'deviation' || what === 'share' ? 'sure' : 'near');
    if (what === 'share') view.unit = '';
    Object.assign(view, {what, values, model, note, text: note.textContent, cross: make(box, 'i', {className: 'cross', hidden: true}), box});
    this.views.push(view);
    this.handle(canvas, view);
  }
  draw() {
    const {left, top, size} = this.frame, {side, half_tangent: half} = this.r;
    const cut = values => Float32Array.from({length: size * size}, (_, i) => values[(top + Math.floor(i / size)) * side + left + i % size]);
    const at = pixel => (2 * pixel / side - 1) * half, edges = [at(left), at(left + size), -at(top + size), -at(top)];
    for (const v of this.views) {
      const span = v.what === 'error' ? errorSpan : v.what === 'deviation' ? [0, 2] : v.what === 'share' ? [0, 1] : report.span;
      v.set(v.what === 'error' ? errorPicture(cut(v.model.map), cut(this.r.truth), size, size, span)
              : picture(cut(v.values), size, size, span, tables[v.kind], 1, v.kind === 'sure'), edges, span, v.values);
    }
  }
  // Returns the position of the pointer in the image, as fractions of its width and height from the top left.
  place(event, view) {
    const box = view.canvas.getBoundingClientRect(), {left, top, width, height} = view.inner;
    return [(event.clientX - box.left - left) / width, (event.clientY - box.top - top) / height].map(v => Math.min(Math.max(v, 0), 0.9999));
  }
  point(at) {
    const {left, top, size} = this.frame, {side, half_tangent: half} = this.r;
    for (const v of this.views) {
      v.cross.hidden = !at, v.note.textContent = v.text;
      if (!at) continue;
      const [x, y] = at.map((share, k) => [left, top][k] + Math.floor(share * size)), value = v.values[y * side + x];
      const tangents = [(x + 0.5) / side * 2 - 1, 1 - (y + 0.5) / side * 2].map(t => t * half), degrees = t => `${(Math.atan(t) * 180 / Math.PI).toFixed(1)}°`;
      const [there, drawn] = [this.r.truth[y * side + x] > 0, v.model?.map[y * side + x] > 0];
      const words = v.what === 'share' ? value.toFixed(2) : v.what === 'deviation' ? `±${value.toFixed(2)} m`
        : v.what === 'error' ? there && drawn ? `${value > 0 ? '+' : ''}${(100 * value).toFixed(0)} cm` : there ? 'missed' : drawn ? 'false return' : 'no return in both'
          : value > 0 ? `${value.toFixed(2)} m` : 'no return';
      v.note.textContent = `${words} at ${degrees(tangents[0])}, ${degrees(tangents[1])}`;
      v.cross.style.left = `${v.canvas.offsetLeft + v.inner.left + at[0] * v.inner.width}px`;
      v.cross.style.top = `${v.canvas.offsetTop + v.inner.top + at[1] * v.inner.height}px`;
    }
  }
  handle(canvas, view) {
    let from = null;
    const chosen = make(view.box, 'i', {className: 'chosen', hidden: true});
    canvas.addEventListener('pointerdown', e => {
      if (e.pointerType !== 'touch') from = this.place(e, view), canvas.setPointerCapture(e.pointerId);
      this.point(this.place(e, view));
    });
    canvas.addEventListener('pointermove', e => {
      const at = this.place(e, view);
      this.point(at);
      chosen.hidden = !from;
      if (!from) return;
      for (const [side, extent, k, begin, whole] of [['left', 'width', 0, canvas.offsetLeft + view.inner.left, view.inner.width],
                                                     ['top', 'height', 1, canvas.offsetTop + view.inner.top, view.inner.height]])
        chosen.style[side] = `${begin + Math.min(from[k], at[k]) * whole}px`, chosen.style[extent] = `${Math.abs(from[k] - at[k]) * whole}px`;
    });
    canvas.addEventListener('pointerup', e => {
      const at = this.place(e, view), pixels = [from, at].map(p => p?.map((share, k) => [this.frame.left, this.frame.top][k] + Math.floor(share * this.frame.size)));
      const wide = from && Math.max(...[0, 1].map(k => Math.abs(pixels[0][k] - pixels[1][k])));
      from = null, chosen.hidden = true;
      if (!(wide >= 4)) return;
      this.frame = squareOf(this.r, ...[Math.min, Math.max].map(of => [0, 1].map(k => of(pixels[0][k], pixels[1][k]))), 0);
      this.draw();
    });
    canvas.addEventListener('pointerleave', () => this.point(null));
    canvas.addEventListener('dblclick', () => {
      this.frame = this.frame.size === this.r.side ? this.start : {left: 0, top: 0, size: this.r.side};
      this.draw();
    });
  }
}

const kinds = {
  text: (parent, {text}) => sentence(make(parent, 'p'), text),
  note: (parent, {text}) => make(parent, 'p', {className: 'note', textContent: text}),
  fails(parent, {items}) {
    const list = make(make(parent, 'div', {className: 'fail'}), 'ul');
    for (const text of items) sentence(make(list, 'li'), text);
  },
  list(parent, {rows}) {
    const list = make(parent, 'dl');
    for (const [name, text] of rows) make(list, 'dt', {textContent: name}), make(list, 'dd', {textContent: text});
  },
  details(parent, {summary, blocks}) {
    const at = make(parent, 'details');
    make(at, 'summary', {textContent: summary});
    add(at, blocks);
  },
  table(parent, {caption, head, rows, baselines}) {
    if (caption) make(parent, 'p', {className: 'caption', textContent: caption});
    const table = make(make(parent, 'div', {className: 'scroll', tabIndex: 0}), 'table', {ariaLabel: caption});
    const fill = (row, cells, scope) => cells.forEach((cell, i) => {
      const {text, small, mark} = typeof cell === 'string' ? {text: cell} : cell, head0 = head[i];
      const at = make(row, scope === 'col' || i === 0 ? 'th' : 'td', {className: head0.words ? 'words' : ''});
      if (at.tagName === 'TH') at.scope = scope;
      make(at, mark ? 'b' : 'span', {textContent: text, className: mark ?? ''});
      if (cell.records) links(at, cell);
      if (small) make(at, 'small', {textContent: small});
    });
    fill(make(make(table, 'thead'), 'tr'), head, 'col');
    const body = make(table, 'tbody');
    rows.forEach((row, i) => fill(make(body, 'tr', {className: i >= rows.length - baselines ? 'baseline' : ''}), row, 'row'));
  },
  charts(parent, {blocks, panels}) {
    add(make(parent, 'div', {className: panels ? 'charts panels' : 'charts'}), blocks);
  },
  chart(parent, block) {
    const box = make(parent, 'figure', {className: 'card'});
    make(box, 'h3', {textContent: block.title});
    const plot = new Plot(box, block);
    if (block.note) make(box, 'figcaption', {textContent: block.note});
    redraws.push(() => plot.renew());
  },
  pictures(parent, block) {
    const box = make(parent, 'figure', {className: 'card'}), {index} = record(block.record), id = `record-${index}`;
    if (index !== null && !document.getElementById(id)) box.id = id;
    if (block.title) make(box, 'h3', {textContent: block.title});
    const pictures = make(box, 'div', {className: block.compare ? 'maps compare' : 'maps'});
    new Pictures(pictures, block);
    if (block.caption) make(box, 'figcaption', {textContent: block.caption});
  },
  columns(parent, {blocks}) {
    add(make(parent, 'div', {className: 'columns'}), blocks);
  },
  strips(parent, block) {
    const box = make(parent, 'figure', {className: 'card'}), key = {spd: 'SPD', radar: 'radar', depth: 'depth camera'};
    const unit = {spd: 'clicks/s', radar: 'frames/s', depth: 'frames/s used'};
    for (const sensor in key) {
      const head = make(box, 'h3', {textContent: `${key[sensor]} `}), small = make(head, 'small', {textContent: unit[sensor]});
      make(small, 'span', {id: `lost-${sensor}`, className: 'lost'});
      if (block.gaps[sensor].length) make(small, 'span', {className: 'lost', textContent: '; no data in red intervals'});
      make(box, 'div', {id: `strip-${sensor}`, className: 'strip', role: 'img', ariaLabel: `${key[sensor]} over the run`});
    }
    const head = make(make(box, 'h3', {textContent: 'clock residuals '}), 'small', {textContent: 'µs: '});
    for (const sensor in key) {
      make(make(head, 'span'), 'i', {className: `key ${sensor}`});
      head.lastChild.append(` ${key[sensor]} `);
    }
    make(box, 'div', {id: 'strip-clock', className: 'strip', role: 'img', ariaLabel: 'clock residuals over the run'});
    const strips = new Strips(`time, ${block.unit}`);
    for (const strip of strips.rates) strip.gaps = block.gaps[strip.sensor];
    strips.take(block.arrays, block.window_s);
    redraws.push(() => strips.renew());
  },
  // Draws the data of each sensor as a function of time. Each column is a group of records, with the nearest bin first;
  // 255 means no data.
  waterfalls(parent, {tables: all, unit, end}) {
    const box = make(parent, 'figure', {className: 'card waterfalls'}), head = {spd: ['SPD', 'clicks by range and time'], radar: ['radar', 'power by range and time']};
    for (const {sensor, values, columns, bins, start_m: start, end_m: far, most} of all) {
      const [name, what] = head[sensor], id = `waterfall-${sensor}`, raw = unpacked(values, 1, 1);
      make(make(box, 'h3', {textContent: `${name} `}), 'small', {textContent: what});
      make(box, 'div', {id, className: 'chart', role: 'img', ariaLabel: `${name}: ${what}`});
      const words = sensor === 'spd' ? ['0', siNumber(Math.expm1(most))] : ['0 dB', `${siNumber(most)} dB`];
      const chart = new Waterfall(id, 150, {values: short}, `time, ${unit}`), below = Math.max(0, Math.round(bins * start / (far - start)));
      // The farthest range is at the top. Rows below the first bin of the sensor are blank.
      const image = Float32Array.from({length: (bins + below) * columns}, (_, i) => {
        const v = raw[i % columns * bins + bins - 1 - Math.floor(i / columns)];
        return i < bins * columns && v < 255 ? v : NaN;
      });
      const draw = () => {
        chart.show(picture(image, bins + below, columns, [0, 254], tables.level, 1, true), [0, end], far, tables.level, words);
        chart.renew();
      };
      draw();
      redraws.push(draw);
    }
  },
  cloud(parent, block) {
    const r = record(block.record);
    make(parent, 'p', {textContent: `${r.title}: drag or use the arrow keys to rotate; use the wheel or two fingers to zoom.`});
    const buttons = make(parent, 'div', {className: 'tools'});
    const maps = [...r.maps.map(m => [m.name, m.map]), ['truth', r.truth]];
    make(make(parent, 'div', {id: 'cloud-box'}), 'canvas', {id: 'cloud', tabIndex: 0, role: 'img', ariaLabel: 'point cloud of the map'});
    const cloud = new Cloud();
    let shown = 0;
    const show = i => {
      shown = i;
      [...buttons.children].forEach((button, k) => button.setAttribute('aria-pressed', k === i));
      cloud.set(maps[i][1], r.half_tangent, report.span);
    };
    maps.forEach(([name], i) => make(buttons, 'button', {type: 'button', textContent: name}).addEventListener('click', () => show(i)));
    show(0);
    redraws.push(() => show(shown));
  },
};

const redraw = () => redraws.forEach(one => one());
const root = document.documentElement;
function turnTheme() {
  root.dataset.theme = isDark() ? 'light' : 'dark';
  redraw();
}

document.title = report.title;
const header = make(document.body, 'header', {id: 'top'});
make(header, 'h1', {textContent: report.title});
make(header, 'button', {type: 'button', id: 'theme', textContent: 'light or dark'}).addEventListener('click', turnTheme);
make(header, 'p', {className: 'verdict', textContent: report.verdict});
if (report.fails.length) {
  kinds.fails(header, {items: report.fails});
  const box = header.lastChild;
  box.prepend(Object.assign(document.createElement('b'), {textContent: 'What fails'}));
  if (report.more) make(box, 'a', {href: '#failures', textContent: report.more});
}
make(header, 'p', {className: 'quiet', textContent: report.origin});
const contents = make(make(document.body, 'nav', {ariaLabel: 'contents'}), 'ol'), main = make(document.body, 'main');
add(main, report.first);
const chapters = report.sections.map(({id, heading, blocks}) => {
  const entry = make(contents, 'li'), section = make(main, 'section', {ariaLabel: heading});
  make(section, 'h2', {id, textContent: heading});
  make(entry, 'a', {href: `#${id}`, textContent: heading});
  add(section, blocks);
  return [entry, section];
});
// A section is not printed if all its parts are collapsed, or if it contains the 3D view.
const isEmpty = section => [...section.children].every(part => part.matches('h2, details:not([open])')) || section.querySelector('#cloud') !== null;
if (location.hash) document.getElementById(location.hash.slice(1))?.scrollIntoView();
matchMedia('(prefers-color-scheme: dark)').addEventListener('change', redraw);
// Uses the light theme and a fixed width for printed pages.
let theme;
addEventListener('beforeprint', () => {
  theme = root.dataset.theme, root.dataset.theme = 'light', root.classList.add('paper');
  for (const [entry, section] of chapters)
    for (const part of [entry, section]) part.classList.toggle('unprinted', isEmpty(section));
  redraw();
});
addEventListener('afterprint', () => {
  document.querySelectorAll('.unprinted').forEach(part => part.classList.remove('unprinted'));
  root.classList.remove('paper');
  if (theme) root.dataset.theme = theme;
  else delete root.dataset.theme;
  redraw();
});
