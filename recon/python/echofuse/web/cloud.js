// SPDX-License-Identifier: MIT
// Draws a depth map as a point cloud (WebGL). x points to the right, y up, and z away from the camera; unit: m.

const vertex = `attribute vec3 place; attribute vec3 tint; uniform mat4 view; uniform float size; varying vec3 shown;
void main() { gl_Position = view * vec4(place, 1.0); gl_PointSize = size / gl_Position.w; shown = tint; }`;
const fragment = `precision mediump float; varying vec3 shown; void main() { gl_FragColor = vec4(shown, 1.0); }`;

function program(gl) {
  const out = gl.createProgram();
  for (const [kind, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    gl.attachShader(out, shader);
  }
  gl.linkProgram(out);
  gl.useProgram(out);
  return out;
}

// Returns the column-major view matrix: a perspective projection with a field of view of 40 degrees, and a rotation
// around the point (0, -0.5, middle).
function viewOf(turn, tilt, away, middle, aspect) {
  const [cy, sy, cx, sx] = [Math.cos(turn), Math.sin(turn), Math.cos(tilt), Math.sin(tilt)];
  const f = 1 / Math.tan(Math.PI / 9), near = 0.05, far = 60, a = (far + near) / (near - far), b = 2 * far * near / (near - far);
  // Negates z, because z points towards the viewer in camera space, and away from the sensors in the scene.
  const rows = [[cy, 0, -sy], [sx * sy, cx, sx * cy], [-cx * sy, sx, -cx * cy]];
  const t = rows.map((r, i) => r[1] * 0.5 - r[2] * middle - (i === 2 ? away : 0));
  const out = new Float32Array(16);
  for (let j = 0; j < 3; ++j) {
    out[4 * j] = rows[0][j] * f / aspect, out[4 * j + 1] = rows[1][j] * f;
    out[4 * j + 2] = rows[2][j] * a, out[4 * j + 3] = -rows[2][j];
  }
  out[12] = t[0] * f / aspect, out[13] = t[1] * f, out[14] = t[2] * a + b, out[15] = -t[2];
  return out;
}

// Projects a point and returns its clip coordinates x, y and w.
const placed = (view, x, y, z) => [0, 1, 3].map(i => view[i] * x + view[4 + i] * y + view[8 + i] * z + view[12 + i]);

class Cloud {
  constructor() {
    this.canvas = document.getElementById('cloud');
    this.box = document.getElementById('cloud-box');
    this.gl = this.canvas.getContext('webgl', {antialias: true, preserveDrawingBuffer: true});
    if (!this.gl) {
      this.box.textContent = 'Points cannot be drawn, because this browser does not support WebGL.';
      return;
    }
    // away: viewing distance. It is null until the first zoom, so that the whole floor is visible.
    this.turn = -0.6, this.tilt = 0.3, this.away = null, this.middle = 3.5;
    this.program = program(this.gl);
    this.labels = [2, 3, 4, 5].map(z => {
      const at = document.createElement('span');
      at.textContent = `${z} m`, at.hidden = true;
      this.box.append(at);
      return {at, z};
    });
    this.handle();
    new ResizeObserver(() => this.draw()).observe(this.box);
  }
  handle() {
    const turnBy = (x, y) => {
      this.turn -= x, this.tilt = Math.min(Math.max(this.tilt + y, -1.5), 1.5);
      this.draw();
    };
    const zoomBy = factor => {
      this.away = Math.min(Math.max((this.away ?? this.whole) * factor, 0.5), 20);
      this.draw();
    };
    const fingers = new Map();
    const spread = () => {
      const [a, b] = fingers.values();
      return Math.hypot(a[0] - b[0], a[1] - b[1]) + 1;
    };
    this.canvas.addEventListener('pointerdown', e => {
      this.canvas.setPointerCapture(e.pointerId);
      fingers.set(e.pointerId, [e.clientX, e.clientY]);
    });
    for (const end of ['pointerup', 'pointercancel']) this.canvas.addEventListener(end, e => fingers.delete(e.pointerId));
    this.canvas.addEventListener('pointermove', e => {
      const last = fingers.get(e.pointerId);
      if (!last) return;
      const before = fingers.size === 2 ? spread() : 0;
      fingers.set(e.pointerId, [e.clientX, e.clientY]);
      if (before) zoomBy(before / spread());
      else turnBy((e.clientX - last[0]) * 0.008, (e.clientY - last[1]) * 0.008);
    });
    this.canvas.addEventListener('wheel', e => {
      e.preventDefault();
      zoomBy(Math.exp(e.deltaY * 0.001));
    }, {passive: false});
    this.canvas.addEventListener('keydown', e => {
      const by = {ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, 0.1], ArrowDown: [0, -0.1]}[e.key];
      const zoom = {'+': 0.9, '=': 0.9, '-': 1 / 0.9}[e.key];
      if (!by && !zoom) return;
      e.preventDefault(), e.stopPropagation();
      if (by) turnBy(...by);
      else zoomBy(zoom);
    });
  }
  // map: square depth map, m. The tangents x/z and y/z of its pixels range from -halfTangent to halfTangent.
  set(map, halfTangent, span) {
    if (!this.gl) return;
    const places = [], tints = [];
    const side = map ? Math.round(Math.sqrt(map.length)) : 0;
    for (let i = 0; i < side * side; ++i) {
      const z = map[i];
      if (!(z > 0)) continue;
      const x = ((i % side + 0.5) / side * 2 - 1) * halfTangent, y = (1 - (Math.floor(i / side) + 0.5) / side * 2) * halfTangent;
      places.push(x * z, y * z, z);
      tints.push(...rgbOf(z, span, tables.near).map(v => v / 255));
    }
    this.points = places.length / 3;
    const grey = isDark() ? 0.75 : 0.5;
    for (let x = -2; x <= 2; x += 0.5) places.push(x, -1.3, 1.5, x, -1.3, 5.5);
    for (let z = 1.5; z <= 5.5; z += 0.5) places.push(-2, -1.3, z, 2, -1.3, z);
    this.lines = places.length / 3 - this.points;
    while (tints.length < places.length) tints.push(grey);
    const gl = this.gl;
    for (const [name, values] of [['place', places], ['tint', tints]]) {
      gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
      gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(values), gl.STATIC_DRAW);
      const at = gl.getAttribLocation(this.program, name);
      gl.enableVertexAttribArray(at);
      gl.vertexAttribPointer(at, 3, gl.FLOAT, false, 0, 0);
    }
    this.draw();
  }
  draw() {
    if (!this.gl || this.points === undefined) return;
    const gl = this.gl, width = this.box.clientWidth, height = Math.round(Math.min(width * 0.56, 400)), ratio = devicePixelRatio;
    this.canvas.width = width * ratio, this.canvas.height = height * ratio;
    this.canvas.style.height = `${height}px`;
    gl.viewport(0, 0, this.canvas.width, this.canvas.height);
    gl.clearColor(0, 0, 0, 0);
    gl.enable(gl.DEPTH_TEST);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    const viewAt = away => viewOf(this.turn, this.tilt, away, this.middle, width / height);
    const within = ([x, y, w]) => w > 0 && Math.abs(x / w) < 0.97 && Math.abs(y / w) < 0.97;
    this.whole = 4;
    while (this.whole < 20 && ![[-2, 1.5], [2, 1.5], [-2, 5.5], [2, 5.5]].every(([x, z]) => within(placed(viewAt(this.whole), x, -1.3, z)))) this.whole *= 1.05;
    const view = viewAt(this.away ?? this.whole);
    gl.uniformMatrix4fv(gl.getUniformLocation(this.program, 'view'), false, view);
    gl.uniform1f(gl.getUniformLocation(this.program, 'size'), this.canvas.height * 0.055);
    gl.drawArrays(gl.LINES, this.points, this.lines);
    gl.drawArrays(gl.POINTS, 0, this.points);
    for (const {at, z} of this.labels) {
      const [x, y, w] = placed(view, -2.1, -1.3, z);
      at.hidden = w <= 0 || Math.abs(x / w) > 0.95 || Math.abs(y / w) > 0.95;
      at.style.left = `${(x / w + 1) / 2 * width}px`, at.style.top = `${(1 - y / w) / 2 * height}px`;
    }
  }
}
