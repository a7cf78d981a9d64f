// SPDX-License-Identifier: MIT
// Draws charts with uPlot: the histogram, the range profile, the waterfalls, and the curves over the run.
/* global uPlot */
const metresPerPs = 299792458 / 2e12;
const colour = name => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
// Returns the font size of charts, px. The key f toggles between normal and large type.
const textSize = () => parseFloat(colour('--chart-text'));
const text = () => `${textSize()}px ${getComputedStyle(document.body).fontFamily}`;

const axis = (label, more = {}) => ({
  label, font: text(), labelFont: text(), stroke: colour('--ink'), labelSize: label ? textSize() + 5 : 0, labelGap: 0,
  size: 2 * textSize(), gap: 3,
  grid: {stroke: colour('--grid'), width: 1}, ticks: {stroke: colour('--grid'), width: 1, size: 4}, ...more,
});
const siNumber = v => Math.abs(v) >= 1e6 ? `${+(v / 1e6).toPrecision(3)}M`
  : Math.abs(v) >= 1e3 ? `${+(v / 1e3).toPrecision(3)}k` : `${+v.toPrecision(3)}`;
const short = (_, values) => values.map(v => v == null ? '' : siNumber(v));

// A chart that fills its element. It is recreated when its style changes.
class Chart {
  constructor(id, height) {
    this.at = document.getElementById(id);
    this.height = height;
    this.data = null;
    new ResizeObserver(() => this.plot?.setSize(this.size())).observe(this.at);
  }
  size() {
    const far = document.documentElement.classList.contains('far');
    return {width: Math.max(this.at.clientWidth, 200), height: Math.round(far ? 0.3 * innerHeight : this.height * (0.5 + textSize() / 26))};
  }
  renew() {
    this.plot?.destroy();
    this.plot = new uPlot({...this.size(), legend: {show: false}, cursor: {y: false},
                           hooks: {drawClear: [u => this.under(u)]}, ...this.options()},
                          this.data ?? [[]], this.at);
  }
  // Draws the cursors {at, name} behind the curves.
  under(u) {
    const c = u.ctx, {left, top, width, height} = u.bbox, at = x => u.valToPos(x, 'x', true), ratio = devicePixelRatio;
    c.save();
    c.beginPath(), c.rect(left, top, width, height), c.clip();
    c.strokeStyle = c.fillStyle = colour('--ink');
    c.font = `${textSize() * ratio}px ${getComputedStyle(document.body).fontFamily}`;
    c.lineWidth = ratio, c.setLineDash([4 * ratio, 3 * ratio]);
    for (const {at: value, name} of this.marks ?? []) {
      const room = 4 * ratio, right = at(value) + room + c.measureText(name).width > left + width;
      c.beginPath(), c.moveTo(at(value), top), c.lineTo(at(value), top + height), c.stroke();
      c.textAlign = right ? 'right' : 'left';
      c.fillText(name, at(value) + (right ? -room : room), top + height - 1.2 * textSize() * ratio);
    }
    c.restore();
  }
  set(data) {
    this.data = data;
    if (this.plot) this.plot.setData(data);
    else this.renew();
  }
}

function save(blob, name) {
  const link = Object.assign(document.createElement('a'), {href: URL.createObjectURL(blob), download: name});
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}

// Units of the range axis of the histogram and the profile: metres, or nanoseconds of two-way time.
const units = {m: {name: 'range, m', perM: 1, words: m => `${m.toFixed(2)} m`, width: m => `${+(100 * m).toPrecision(3)} cm`},
                      ns: {name: 'two-way time, ns', perM: 1e-3 / metresPerPs, words: m => `${(m * 1e-3 / metresPerPs).toFixed(2)} ns`,
                           width: m => `${+(m * 1e-3 / metresPerPs).toPrecision(3)} ns`}};

// A chart with a range axis, for one record or for the sum of several records. Drag to zoom this chart and the partner
// chart; double-click to reset. Two clicks set the cursors A and B. The readout then shows the distance between A and
// B, and the FWHM of the highest peak between them. If no cursors are set, the readout shows the highest peak in the
// visible part.
class Bench extends Chart {
  constructor(id, height) {
    super(id, height);
    this.zoom = null, this.marks = [], this.partner = null;  // the cursor positions and the zoom limits are in `unit`
    this.unit = units.m, this.fit = null;
    this.readout = document.getElementById(`${id}-readout`);
  }
  set(data) {
    super.set(data);
    this.readOut(this.plot.cursor.idx);
  }
  // Sets the reason why data are missing. If the newest record has no data, the previous curve stays visible, dimmed.
  // If a record selected by the user has no data, no curve is shown.
  lack(why, live) {
    this.lacks = why;
    this.at.classList.toggle('old', !!why && live);
    return why && live && this.data;
  }
  get range() {
    return {time: false, range: () => this.zoom ?? [0, (this.farthest ?? 1) * this.unit.perM]};
  }
  // Returns the interval for the peak fit, m: the part between the cursors or, if they are not set, the visible part.
  get part() {
    const ends = this.marks.length === 2 ? this.marks.map(mark => mark.at).sort((a, b) => a - b) : this.zoom ?? [-1e6, 1e6];
    return ends.map(at => at / this.unit.perM);
  }
  measure(unit) {
    this.x = this.x?.map(at => at / this.unit.perM * unit.perM);
    this.unit = unit, this.zoom = null, this.marks = [];
    if (this.data) this.data[0] = this.x, this.renew();
  }
  get hooks() {
    return {
      drawClear: [u => this.under(u)], setCursor: [u => this.readOut(u.cursor.idx)],
      setSelect: [u => u.select.width > 3 && this.show_part([0, u.select.width].map(by => u.posToVal(u.select.left + by, 'x')))],
    };
  }
  show_part(zoom) {
    for (const chart of [this, this.partner]) {
      if (!chart) continue;
      chart.zoom = zoom;
      chart.plot?.setSelect({width: 0, height: 0}, false);
      if (chart.data) chart.set(chart.data);
    }
    this.changed?.();
  }
  renew() {
    super.renew();
    const {over} = this.plot;
    let down = null;
    over.addEventListener('mousedown', e => { down = e.clientX; });
    over.addEventListener('mouseup', e => {
      if (down == null || Math.abs(e.clientX - down) > 3 || e.detail > 1 || !this.data) return;
      const at = this.plot.posToVal(e.clientX - over.getBoundingClientRect().left, 'x');
      this.marks = [...this.marks.length < 2 ? this.marks : [], {at}].map((mark, i) => ({...mark, name: 'AB'[i]}));
      this.set(this.data);
      this.changed?.();
    });
    over.addEventListener('dblclick', () => {
      this.marks = [];
      this.show_part(null);
    });
  }
  // Returns the index of the highest point in the given range, or null if there are no data.
  peak([from, to] = this.part) {
    const [x, y] = this.data ?? [[], []], {perM} = this.unit;
    let top = null;
    for (let i = 0; i < x.length; ++i) if (x[i] >= from * perM && x[i] <= to * perM && y[i] != null && (top == null || y[i] > y[top])) top = i;
    return top;
  }
  // Shows the value under the pointer, or the peak fit if the pointer is outside the chart or two cursors are set.
  readOut(index) {
    if (this.lacks) return void (this.readout.textContent = this.lacks);
    const [x, y] = this.data ?? [[], []], top = this.peak(), {perM, width} = this.unit, words_at = i => this.words(x[i] / perM, y[i]);
    const pair = this.marks.length === 2 ? `A to B ${width(Math.abs(this.marks[1].at - this.marks[0].at) / perM)}; ` : '';
    const fit = this.fit ? `; centre ${this.unit.words(this.fit.centre_m)}, FWHM ${width(this.fit.fwhm_m)}` : '';
    const words = pair || index == null ? top == null ? 'no data' : `${pair}peak ${words_at(top)}${fit}`
      : y[index] == null ? 'no data' : words_at(index);
    if (this.readout.textContent !== words) this.readout.textContent = words;
  }
  save(kind, name) {
    if (!this.data) return;
    if (kind === 'csv') {
      const [x, y] = this.data, {perM} = this.unit, lines = Array.from(x, (v, i) => `${+(v / perM).toFixed(6)},${y[i] ?? ''}`);
      return save(new Blob([`range_m,${this.column}\n${lines.join('\n')}\n`], {type: 'text/csv'}), `${name}.csv`);
    }
    const {canvas} = this.plot.ctx, whole = Object.assign(document.createElement('canvas'), {width: canvas.width, height: canvas.height}), c = whole.getContext('2d');
    c.fillStyle = colour('--card');
    c.fillRect(0, 0, whole.width, whole.height);
    c.drawImage(canvas, 0, 0);
    whole.toBlob(blob => save(blob, `${name}.png`));
  }
}

// Returns the upper limit of the y axis. The limit rises immediately but falls slowly, so that records can be compared
// by eye.
function calmTop(before, values, least) {
  let top = least;
  for (const v of values) if (v > top) top = v;
  return Math.max(top * 1.05, (before ?? 0) * 0.97);
}

const ofTen = v => Number.isInteger(+Math.log10(v).toFixed(9)) ? v : null;
const floor = 0.5;  // lower end of the logarithmic axis, clicks

class Histogram extends Bench {
  constructor() {
    super('histogram', 230);
    this.column = 'clicks';
    this.log = this.difference = false;
    this.held = this.reference = this.counts = null;
    this.records = 1;  // number of records in the displayed sum
  }
  axes(a) {
    this.x = Float64Array.from({length: a.count}, (_, i) => (a.start + (i + 0.5) * a.step) * metresPerPs * this.unit.perM);
    this.binPs = +a.step.toPrecision(3);
    this.held = this.reference = this.counts = this.top = null;
    this.show();
  }
  options() {
    const stepped = uPlot.paths.stepped({align: 1});
    return {
      hooks: this.hooks, cursor: {y: false, drag: {setScale: false}},
      scales: {
        x: this.range,
        y: this.difference ? {range: (_, low, high) => {
          const most = Math.max(Math.abs(low), Math.abs(high), 5) * 1.05;
          return [-most, most];
        }} : {distr: this.log ? 3 : 1, range: () => [this.log ? floor : 0, this.top ?? 10]},
      },
      axes: [axis(this.unit.name), axis(`clicks in ${this.binPs} ps${this.difference ? ', minus the first minute' : ''}`, {
        values: short, size: 4 * textSize(),
        grid: {stroke: colour('--grid'), width: 1, filter: (_, at) => this.log && !this.difference ? at.map(ofTen) : at},
      })],
      series: [{}, {stroke: colour('--spd'), fill: colour('--spd-fill'), width: 1.5, paths: stepped, points: {show: false}},
               {stroke: colour('--ink'), width: 1, dash: [4, 3], paths: stepped, points: {show: false}}],
    };
  }
  words(range, clicks) {
    return `${this.unit.words(range)}, ${siNumber(clicks)} clicks`;
  }
  take(counts, lack, live) {
    if (this.lack(lack, live)) return this.readOut(null);
    this.counts = counts;
    this.show();
  }
  show() {
    if (!this.x) return;
    const n = this.x.length, counts = this.counts?.length === n ? this.counts : null;
    const minus = this.difference && this.reference?.length === n ? this.reference : null;
    const least = v => this.log && !this.difference ? Math.max(v, floor) : v;
    const values = Array.from(this.x, (_, i) => counts ? least(counts[i] - (minus ? minus[i] * this.records : 0)) : null);
    const held = Array.from(this.x, (_, i) => this.held && !minus ? least(this.held[i]) : null);
    if (!minus) this.top = calmTop(this.top, values, 5);
    this.set([this.x, values, held]);
  }
}

class Profile extends Bench {
  constructor() {
    super('profile', 170);
    this.column = 'db_over_median';
  }
  axes(a) {
    this.x = Float64Array.from({length: a.count}, (_, i) => (a.start + i * a.step) * this.unit.perM);
    this.take(null);
  }
  options() {
    return {
      hooks: this.hooks, cursor: {y: false, drag: {setScale: false}},
      scales: {x: this.range, y: {range: () => [this.low ?? -10, this.top ?? 30]}},
      axes: [axis(this.unit.name), axis('dB over the median', {size: 4 * textSize()})],
      series: [{}, {stroke: colour('--radar'), width: 2, points: {show: false}}],
    };
  }
  words(range, db) {
    return `${this.unit.words(range)}, ${db.toFixed(1)} dB`;
  }
  take(db, lack, live) {
    if (!this.x) return;
    if (this.lack(lack, live)) return this.readOut(null);
    const n = this.x.length;
    if (db?.length !== n) return this.set([this.x, new Array(n).fill(null)]);
    const median = Float32Array.from(db).sort()[n >> 1];
    const values = Array.from(db, v => v - median);
    this.top = calmTop(this.top, values, 30), this.low = -calmTop(-(this.low ?? 0), values.map(v => Math.min(-v, 20)), 10);
    this.set([this.x, values]);
  }
}

// Returns the next round number above `most`, as the upper end of an axis.
const niceTop = most => {
  const ten = 10 ** Math.floor(Math.log10(Math.max(most, 1)));
  return [1, 1.5, 2, 3, 4, 5, 6, 8, 10].map(n => n * ten).find(v => v >= most);
};
const fromZero = {range: (_, low, high) => [0, niceTop(Math.max(high, 1))]};
const endsOnly = {values: short, size: 52, splits: (u, i, low, high) => [low, high]};

// Rate of a sensor as a function of time. Marks at the top show when data were lost. The heading shows the number of
// lost tags or frames.
class Strip extends Chart {
  constructor(sensor) {
    super(`strip-${sensor}`, 64);
    this.sensor = sensor;
  }
  options() {
    const bars = uPlot.paths.bars({size: [0.9, 6]});
    return {
      scales: {x: {time: false}, y: fromZero, lost: {range: () => [0, 1]}},
      padding: [6, 14, 4, 0],
      axes: [axis('', {show: false}), axis('', endsOnly)],
      series: [{}, {stroke: colour(`--${this.sensor}`), width: 2, points: {show: false}},
               {scale: 'lost', stroke: colour('--bad'), fill: colour('--bad'), paths: bars, points: {show: false}, fillTo: () => 0.72}],
    };
  }
}
// Formats seconds as m:ss or h:mm:ss, as in the terminal output.
const clock = s => {
  if (s == null) return '–';
  const whole = Math.max(0, Math.floor(s)), two = n => String(n).padStart(2, '0');
  const minutes = Math.floor(whole / 60) % 60;
  return whole < 3600 ? `${minutes}:${two(whole % 60)}` : `${Math.floor(whole / 3600)}:${two(minutes)}:${two(whole % 60)}`;
};
const times = {incrs: [1, 2, 5, 10, 20, 30, ...[1, 2, 5, 10, 20, 30, 60, 120, 180, 360, 720, 1440].map(min => 60 * min)], space: 70,
               values: (_, at) => at.map(clock)};
// Signal of one sensor as a function of range and time. Bright colours mean high values; missing data
// are blank.
class Waterfall extends Chart {
  constructor(id) {
    super(id, 150);
  }
  // image: one column per record, with the farthest range at the top. span: the start of the first column and the end
  // of the last column. table: colour map. ends: labels at both ends of the colour bar.
  show(image, span, farthest, table, ends) {
    Object.assign(this, {image, span, farthest, table, ends});
    this.set([span, [null, null]]);
  }
  options() {
    return {
      cursor: {show: false}, padding: [6, 30 + 4 * textSize(), 4, 0],
      scales: {x: {time: false, range: () => this.span}, y: {range: () => [0, this.farthest]}},
      axes: [axis('', {...times, grid: {show: false}}), axis('range, m', {values: short, size: 52, grid: {show: false}})], series: [{}, {points: {show: false}}],
    };
  }
  under(u) {
    const c = u.ctx, {left, top, width, height} = u.bbox, ratio = devicePixelRatio, size = textSize() * ratio, bar = left + width + 10 * ratio;
    c.imageSmoothingEnabled = false;
    c.drawImage(this.image, left, top, width, height);
    this.table.forEach((rgb, k) => {
      c.fillStyle = `rgb(${rgb})`;
      c.fillRect(bar, top + (255 - k) / 256 * height, 12 * ratio, height / 256 + 0.7);
    });
    c.fillStyle = colour('--ink');
    c.font = `${size}px ${getComputedStyle(document.body).fontFamily}`;
    c.textAlign = 'left';
    c.fillText(this.ends[1], bar + 16 * ratio, top + 0.8 * size);
    c.fillText(this.ends[0], bar + 16 * ratio, top + height);
  }
}
// A single quantity as a function of time, e.g. a temperature.
class Curve extends Chart {
  constructor(id) {
    super(id, 64);
  }
  options() {
    return {
      scales: {x: {time: false}, y: {range: (_, low, high) => [Math.floor(low - 0.5), Math.ceil(high + 0.5)]}}, padding: [6, 14, 4, 0],
      axes: [axis('', {show: false}), axis('', endsOnly)], series: [{}, {stroke: colour('--radar'), width: 2, points: {show: false}}],
    };
  }
}
class Clocks extends Chart {
  constructor() {
    super('strip-clock', 104);
  }
  options() {
    const line = sensor => ({stroke: colour(`--${sensor}`), width: 2, dash: sensor === 'depth' ? [4, 2] : [], points: {show: false}});
    return {
      scales: {x: {time: false}, y: fromZero},
      axes: [axis('time', times), axis('', endsOnly)],
      padding: [6, 14, 4, 0],
      series: [{}, line('spd'), line('radar'), line('depth')],
    };
  }
}

class Strips {
  constructor() {
    this.rates = ['spd', 'radar', 'depth'].map(sensor => new Strip(sensor));
    this.clocks = new Clocks();
  }
  take(arrays, windowS) {
    const x = arrays.first;
    for (const strip of this.rates) {
      const used = Array.from(arrays[`used_${strip.sensor}`], v => v == null ? null : v / windowS);
      const lost = Array.from(arrays[`lost_${strip.sensor}`]), all = lost.reduce((sum, v) => sum + v, 0);
      strip.set([x, used, lost.map(v => v > 0 ? 1 : null)]);
      const words = all > 0 ? `, ${siNumber(all)} ${strip.sensor === 'spd' ? 'tags' : 'frames'} lost where marked` : '';
      document.getElementById(`lost-${strip.sensor}`).textContent = words;
    }
    this.clocks.set([x, ...['spd', 'radar', 'depth'].map(sensor =>
      Array.from(arrays[`residual_s_${sensor}`], v => v == null || Number.isNaN(v) ? null : v * 1e6))]);
  }
  renew() {
    for (const chart of [...this.rates, this.clocks]) if (chart.data) chart.renew();
  }
}
