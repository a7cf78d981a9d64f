// SPDX-License-Identifier: MIT
// Plan view, m. The detector is at the origin, and the radar is to its left. x points to the right, and z away from the
// detector. The view shows the power received by the radar antennas, the field of view of the maps, and the track of
// the body.

// Returns the range and the sine of the azimuth of a point, relative to the radar.
const fromRadar = (x, z, baseline) => {
  const range = Math.hypot(x + baseline, z);
  return [range, (x + baseline) / range];
};

class Plan {
  constructor() {
    this.canvas = document.getElementById('plan');
    new ResizeObserver(() => this.shown && this.draw()).observe(this.canvas.parentElement);
  }
  // beams: power in dB by range and sine of the azimuth, or null. track: age (s), x, z and interval (m) of each body
  // position, newest first.
  show(what) {
    this.shown = what;
    this.draw();
  }
  draw() {
    const {beams, axis, baseline, track, halfTangent, label} = this.shown, {canvas} = this, ratio = devicePixelRatio, size = textSize();
    const farthest = Math.min(axis ? axis.start + axis.count * axis.step : 6, 8), half = farthest * Math.max(halfTangent, 0.5);
    const width = Math.max(canvas.parentElement.clientWidth, 100), scale = Math.min((width - 2 * size) / (2 * half), 460 / farthest);
    const height = farthest * scale + 3.4 * size;
    canvas.width = width * ratio, canvas.height = height * ratio;
    canvas.style.width = `${width}px`, canvas.style.height = `${height}px`;
    const c = canvas.getContext('2d'), at = (x, z) => [width / 2 + x * scale, height - 2.4 * size - z * scale];
    c.scale(ratio, ratio);
    c.font = text(), c.lineWidth = 1, c.textAlign = 'center';
    if (beams) {
      const side = 200, most = beams.reduce((top, v) => v > top ? v : top, -Infinity), [bins, directions] = beams.shape;
      const values = Float32Array.from({length: side * side}, (_, i) => {
        const x = ((i % side + 0.5) / side * 2 - 1) * half, z = (1 - (Math.floor(i / side) + 0.5) / side) * farthest;
        const [range, sine] = fromRadar(x, z, baseline), bin = Math.round((range - axis.start) / axis.step);
        return bin >= 0 && bin < bins ? beams[bin * directions + Math.min(Math.floor((sine + 1) / 2 * directions), directions - 1)] : NaN;
      });
      const [left, top] = at(-half, farthest);
      c.drawImage(picture(values, side, side, [most - 30, most], tables.level, 1, true), left, top, 2 * half * scale, farthest * scale);
    }
    this.grid(c, at, farthest, half, halfTangent, size);
    const apart = label && baseline * scale > 12;
    for (const [x, name] of apart ? [[0, 'detector'], [-baseline, label]] : [[0, label ? `detector, ${label}` : 'detector']]) {
      const [left, top] = at(x, 0);
      c.fillStyle = colour(x ? '--radar' : '--spd');
      c.fillRect(left - 5, top - 4, 10, 8);
      c.textAlign = !apart ? 'center' : x ? 'right' : 'left';
      c.fillText(name, left + (apart ? x ? 6 : -6 : 0), top + 1.6 * size);
    }
    if (track?.length) this.walk(c, at, scale, track);
  }
  // Draws circles of equal distance and lines of equal azimuth around the detector.
  grid(c, at, farthest, half, halfTangent, size) {
    const [left, top] = at(-half, farthest), [right, bottom] = at(half, 0), scale = at(1, 0)[0] - at(0, 0)[0];
    c.save();
    c.beginPath(), c.rect(left, top, right - left, bottom - top), c.clip();
    c.strokeStyle = colour('--off');
    for (let r = 1; r <= farthest; ++r) c.beginPath(), c.arc(...at(0, 0), r * scale, -Math.PI, 0), c.stroke();
    for (const degrees of [-60, -40, -20, 0, 20, 40, 60]) {
      const angle = degrees * Math.PI / 180;
      c.beginPath(), c.moveTo(...at(0, 0)), c.lineTo(...at(20 * Math.sin(angle), 20 * Math.cos(angle))), c.stroke();
    }
    c.strokeStyle = colour('--ink'), c.setLineDash([4, 3]);
    c.beginPath(), c.moveTo(...at(-20 * halfTangent, 20)), c.lineTo(...at(0, 0)), c.lineTo(...at(20 * halfTangent, 20)), c.stroke();
    c.restore();
    const word = (words, x, y) => {
      const wide = c.measureText(words).width + 4;
      c.fillStyle = colour('--card'), c.globalAlpha = 0.8, c.fillRect(x - wide / 2, y - size, wide, 1.25 * size);
      c.globalAlpha = 1, c.fillStyle = colour('--ink'), c.fillText(words, x, y);
    };
    // The distances are at the side, because the body is usually in the middle.
    for (let r = 1; r < farthest; ++r) word(`${r} m`, ...at(0.56 * r, 0.83 * r).map((v, i) => i ? v + size / 3 : v));
    for (const degrees of [-20, 20]) {
      const angle = degrees * Math.PI / 180, r = 0.93 * farthest / Math.cos(angle);
      word(`${degrees}°`, ...at(r * Math.sin(angle), r * Math.cos(angle)));
    }
  }
  walk(c, at, scale, track) {
    const places = Array.from({length: track.shape[0]}, (_, i) => track.subarray(4 * i, 4 * i + 4)).filter(place => place[1] === place[1]);
    const line = (from, to, paint, wide) => { c.strokeStyle = paint, c.lineWidth = wide, c.beginPath(), c.moveTo(...from), c.lineTo(...to), c.stroke(); };
    const ends = ([, x, z, interval]) => [at(x - interval, z), at(x + interval, z)];
    // Draws a light line under the dark line, so that the track is visible against the colours of the antenna power.
    for (const [paint, wide] of [['--card', 5], ['--bad', 2.5]]) {
      for (let i = places.length - 1; i > 0; --i) line(at(places[i][1], places[i][2]), at(places[i - 1][1], places[i - 1][2]), colour(paint), wide);
      places.forEach((place, i) => { if (place[3] === place[3]) c.globalAlpha = i ? 0.35 : 1, line(...ends(place), colour(paint), i ? wide / 2 : wide); });
      c.globalAlpha = 1;
    }
    places.forEach(([, x, z], i) => {
      c.beginPath(), c.arc(...at(x, z), i ? 3 : 7, 0, 7), c.fillStyle = colour('--bad'), c.fill();
      c.strokeStyle = colour('--card'), c.lineWidth = 1.5, c.stroke();
    });
  }
}
