// SPDX-License-Identifier: MIT
// Draws the histogram of each detector zone at the position of the zone in the field of view. All histograms have the
// same scale.

// Returns the centres [x, y] of the zones, and the side length of equal squares around them that do not overlap. If the
// direction of any zone is unknown, arranges the zones in rows of equal length.
function places(directions) {
  const columns = Math.ceil(Math.sqrt(directions.length));
  if (directions.some(zone => !zone)) return {side: 1, centres: directions.map((_, i) => [i % columns, -Math.floor(i / columns)])};
  const apart = directions.flatMap(([x, y], i) => directions.slice(i + 1).map(other => Math.max(Math.abs(x - other[0]), Math.abs(y - other[1]))));
  return {side: Math.min(directions[0][2] * 4, ...apart.filter(d => d > 1e-6)), centres: directions};
}

class Zones {
  constructor() {
    this.canvas = document.getElementById('zones');
  }
  // counts: array of shape [zones, bins]. directions: [x, y, width] of each zone, or null if unknown.
  show(counts, directions) {
    const {canvas} = this, ratio = devicePixelRatio, c = canvas.getContext('2d');
    const {side, centres} = places(directions), half = side / 2;
    const [left, right, low, top] = [[0, -1], [0, 1], [1, -1], [1, 1]].map(([at, sign]) => sign * Math.max(...centres.map(centre => sign * centre[at])) + sign * half);
    const width = canvas.clientWidth, scale = Math.min(width / (right - left), 420 / (top - low)), box = side * scale;
    canvas.style.height = `${Math.round((top - low) * scale)}px`;
    canvas.width = width * ratio, canvas.height = (top - low) * scale * ratio;
    c.scale(ratio, ratio);
    c.font = text(), c.textBaseline = 'top';
    const bins = counts.shape[1], most = Math.max(1, counts.reduce((high, n) => n > high ? n : high, 0));
    const middle = (width - (right - left) * scale) / 2;
    centres.forEach(([x, y], zone) => {
      const from = middle + (x - half - left) * scale, floor = (top - y + half) * scale - 2, high = box - textSize() - 8;
      let sum = 0;
      c.beginPath(), c.moveTo(from + 2, floor);
      for (let i = 0; i < bins; ++i) {
        const n = counts[zone * bins + i], at = from + 2 + (box - 4) * i / bins, level = floor - high * n / most;
        sum += n;
        c.lineTo(at, level), c.lineTo(at + (box - 4) / bins, level);
      }
      c.lineTo(from + box - 2, floor), c.closePath();
      c.fillStyle = colour('--spd-fill'), c.strokeStyle = colour('--spd'), c.fill(), c.stroke();
      c.strokeStyle = colour('--grid'), c.strokeRect(from + 0.5, floor - box + 2.5, box - 1, box - 1);
      c.fillStyle = colour('--ink'), c.fillText(siNumber(sum), from + 5, floor - box + 6);
    });
  }
}
