// SPDX-License-Identifier: MIT
// Draws depth maps as images. The colour map viridis covers the distances in the scene; near pixels are bright. Pixels
// without a return are grey. Areas of returns are outlined, because some colours are similar to grey. The axes are in
// degrees, the colour bar is in metres.

const viridis = ['440154', '482475', '414487', '355f8d', '2a788e', '21918c', '22a884', '44bf70', '7ad151', 'bddf26', 'fde725'];
const inferno = ['000004', '1b0c41', '4a0c6b', '781c6d', 'a52c60', 'cf4446', 'ed6925', 'fb9b06', 'f7d13d', 'fcffa4'];
const table = anchors => {
  const rgb = anchors.map(hex => [0, 2, 4].map(i => parseInt(hex.slice(i, i + 2), 16)));
  return Array.from({length: 256}, (_, k) => {
    const at = k / 255 * (rgb.length - 1), i = Math.min(Math.floor(at), rgb.length - 2), t = at - i;
    return rgb[i].map((v, c) => Math.round(v + t * (rgb[i + 1][c] - v)));
  });
};
const tables = {near: table([...viridis].reverse()), level: table(viridis), sure: table(inferno)};
const isDark = () => {
  const chosen = document.documentElement.dataset.theme;
  return chosen ? chosen === 'dark' : matchMedia('(prefers-color-scheme: dark)').matches;
};
const noReturn = () => isDark() ? [38, 43, 48] : [232, 234, 237];

function rgbOf(value, span, map) {
  const share = (value - span[0]) / (span[1] - span[0]);
  return map[Math.round(255 * Math.min(Math.max(share, 0), 1))];
}

// Returns the range that contains 96 % of the returns, rounded outwards to multiples of 0.5 m. Returns 2.5 to 5 m if
// there are fewer than 50 returns.
function spanOf(values) {
  const there = Float32Array.from(values).filter(v => v > 0).sort();
  if (there.length < 50) return [2.5, 5];
  const at = share => there[Math.floor(share * (there.length - 1))];
  const near = Math.floor(at(0.02) * 2) / 2, far = Math.ceil(at(0.98) * 2) / 2;
  return [near, Math.max(far, near + 1)];
}

// values: row-major, [rows, columns]. NaN means no return; 0 also means no return unless `zero` is true.
function picture(values, rows, columns, span, map, scale = 1, zero = false) {
  const image = new ImageData(columns, rows), grey = noReturn();
  for (let i = 0; i < rows * columns; ++i) {
    const v = values[i] * scale;
    const rgb = v > 0 || zero && v === v ? rgbOf(v, span, map) : grey;
    image.data.set([...rgb, 255], 4 * i);
  }
  const canvas = new OffscreenCanvas(columns, rows);
  canvas.getContext('2d').putImageData(image, 0, 0);
  if (!zero) canvas.returns = Uint8Array.from(values, v => v > 0);
  return canvas;
}

// Draws an outline around each area of returns. width and height: size of the image on the canvas.
function outline(c, image, left, top, width, height) {
  if (!image.returns || width < image.width) return;
  const {width: columns, height: rows, returns} = image, dx = width / columns, dy = height / rows;
  const there = (x, y) => x >= 0 && y >= 0 && x < columns && y < rows && returns[y * columns + x];
  c.beginPath();
  for (let y = 0; y < rows; ++y)
    for (let x = 1; x < columns; ++x)
      if (there(x, y) !== there(x - 1, y)) c.moveTo(left + x * dx, top + y * dy), c.lineTo(left + x * dx, top + (y + 1) * dy);
  for (let y = 1; y < rows; ++y)
    for (let x = 0; x < columns; ++x)
      if (there(x, y) !== there(x, y - 1)) c.moveTo(left + x * dx, top + y * dy), c.lineTo(left + (x + 1) * dx, top + y * dy);
  c.strokeStyle = colour('--ink');
  c.lineWidth = 1;
  c.stroke();
}

// Draws the image so that it fills the canvas.
function fill(canvas, image) {
  const c = canvas.getContext('2d'), {width, height} = canvas;
  c.imageSmoothingEnabled = false;
  c.drawImage(image, 0, 0, width, height);
  outline(c, image, 0, 0, width, height);
}

// Height of the upper margin, px. The other margins depend on the size of their labels: elevation on the left, azimuth
// below, colour bar on the right.
const above = 8;
const roomOf = size => ({left: 3.9 * size, bottom: 2.8 * size, bar: 28 + 4.4 * size});

const writeLines = (c, text, x, y, width) => text.split('; ').forEach((line, i) => c.fillText(line, x, y + 1.3 * i * textSize(), width));

class MapView {
  // id: id of the canvas; kind: key of `tables`, which defines the colours.
  constructor(id, kind = 'near') {
    this.canvas = document.getElementById(id);
    this.kind = kind;
    this.ratio = 1;
    new ResizeObserver(() => this.draw()).observe(this.canvas.parentElement);
    this.value = document.getElementById(`${id}-value`), this.note = '';
    for (const move of ['pointermove', 'pointerdown', 'pointerleave'])
      this.canvas.addEventListener(move, e => {
        this.pointer = move === 'pointerleave' ? null : [e.offsetX, e.offsetY];
        this.readOut();
      });
  }
  // Shows the value under the pointer or, if the pointer is outside the image, the note.
  readOut() {
    if (!this.value) return;
    const {pointer, inner, image, values} = this;
    let words = this.note;
    if (pointer && image && values && inner) {
      const [u, v] = [(pointer[0] - inner.left) / inner.width, (pointer[1] - inner.top) / inner.height];
      if (u >= 0 && u < 1 && v >= 0 && v < 1) words = this.wordsAt(u, v);
    }
    if (this.value.textContent !== words) this.value.textContent = words;
  }
  wordsAt(u, v) {
    const {width, height} = this.image, {values, scale = 1, tangents: [x0, x1, y0, y1]} = this;
    const column = Math.floor(u * width), z = values[Math.floor(v * height) * width + column] * scale;
    const tangent = x0 + (column + 0.5) / width * (x1 - x0), degrees = t => `${(Math.atan(t) * 180 / Math.PI).toFixed(1)}°`;
    const where = `azimuth ${degrees(tangent)}, elevation ${degrees(y1 + v * (y0 - y1))}`;
    if (!(z > 0)) return `no ${this.kind === 'sure' ? 'value' : 'return'}; ${where}`;
    return this.kind === 'sure' ? `±${(100 * z).toFixed(1)} cm; ${where}`
      : `depth ${z.toFixed(3)} m; ${where}; x ${(tangent * z).toFixed(2)} m, z ${z.toFixed(2)} m`;
  }
  // tangents: [left, right, bottom, top] of the image edges. values: pixel values, in units of `scale` metres.
  set(image, tangents, span, values = null, scale = 1) {
    Object.assign(this, {image, tangents, span, values, scale, why: ''});
    this.ratio = (tangents[3] - tangents[2]) / (tangents[1] - tangents[0]);
    this.draw();
  }
  // Shows the reason why an image is missing. If `keep` is true, the previous image stays visible, dimmed.
  lack(why, keep) {
    this.why = why;
    if (!keep) this.image = null, this.note = '';
    this.draw();
  }
  draw() {
    const ratio = devicePixelRatio, size = textSize(), far = document.documentElement.classList.contains('far');
    const width = Math.min(this.canvas.parentElement.clientWidth, far ? 0.4 * innerHeight + 6 * size : 620);
    const {left, bottom, bar} = roomOf(size);
    const inner = width - left - bar, high = inner * Math.abs(this.ratio), height = high + bottom + above;
    if (inner < 40) return;
    this.inner = {left, top: above, width: inner, height: high};
    this.readOut();
    this.canvas.width = width * ratio, this.canvas.height = height * ratio;
    this.canvas.style.width = `${width}px`, this.canvas.style.height = `${height}px`;
    const c = this.canvas.getContext('2d');
    c.scale(ratio, ratio);
    c.font = text();
    c.fillStyle = colour('--ink');
    if (!this.image) {
      c.fillStyle = colour('--grid');
      c.fillRect(left, above, inner, high);
      c.fillStyle = colour('--ink');
      c.textAlign = 'center';
      writeLines(c, this.why || 'no data', left + inner / 2, above + high / 2, inner);
      return;
    }
    c.imageSmoothingEnabled = false;
    c.globalAlpha = this.why ? 0.35 : 1;
    c.drawImage(this.image, left, above, inner, high);
    outline(c, this.image, left, above, inner, high);
    c.globalAlpha = 1;
    if (this.why) {
      c.textAlign = 'center';
      writeLines(c, this.why, left + inner / 2, above + 1.6 * size, inner);
    }
    this.ticks(c, inner, high, left, size);
    this.bar(c, left + inner + 12, high, size);
  }
  ticks(c, inner, high, left, size) {
    const [x0, x1, y0, y1] = this.tangents;
    const step = [1, 2, 5, 10, 20].find(s => Math.tan(s * Math.PI / 180) / (x1 - x0) * inner > 3.2 * size) ?? (x1 < 0.85 ? 20 : 40);
    c.strokeStyle = colour('--ink');
    c.textAlign = 'center';
    for (let degrees = -80; degrees <= 80; degrees += step) {
      const t = Math.tan(degrees * Math.PI / 180), x = left + (t - x0) / (x1 - x0) * inner;
      const y = above + (y1 - t) / (y1 - y0) * high;
      if (t > x0 && t < x1) {
        c.strokeRect(x, above + high, 0, 4);
        c.fillText(`${degrees}°`, x, above + high + 4 + size);
      }
      if (t > Math.min(y0, y1) && t < Math.max(y0, y1)) {
        c.strokeRect(left - 4, y, 4, 0);
        c.textAlign = 'right';
        c.fillText(`${degrees}°`, left - 6, y + size / 3);
        c.textAlign = 'center';
      }
    }
    c.fillText('azimuth', left + inner / 2, above + high + 2.45 * size);
    c.save();
    c.translate(0.9 * size, above + high / 2);
    c.rotate(-Math.PI / 2);
    c.fillText('elevation', 0, 0);
    c.restore();
  }
  bar(c, x, high, size) {
    const map = tables[this.kind], steps = 128;
    for (let k = 0; k < steps; ++k) {
      c.fillStyle = `rgb(${map[Math.round(255 * (1 - k / (steps - 1)))]})`;
      c.fillRect(x, above + k / steps * high, 12, high / steps + 0.7);
    }
    c.strokeStyle = colour('--edge');
    c.strokeRect(x + 0.5, above + 0.5, 11, high - 1);
    c.fillStyle = colour('--ink');
    c.textAlign = 'left';
    const [low, far] = this.span, step = [0.25, 0.5, 1].find(s => s / (far - low) * high > 2.6 * size) ?? 2;
    for (let v = Math.ceil(low / step) * step; v <= far + 1e-9; v += step) {
      const y = above + (1 - (v - low) / (far - low)) * high;
      // The end colours also represent all values beyond the scale.
      const last = v + step > far + 1e-9, end = Math.abs(v - far) < 1e-9 ? '≥ ' : Math.abs(v - low) < 1e-9 && this.kind !== 'sure' ? '≤ ' : '';
      c.fillText(`${end}${+v.toFixed(2)}${last ? ' m' : ''}`, x + 16, Math.min(Math.max(y + size / 3, above + 0.8 * size), above + high));
    }
  }
}
