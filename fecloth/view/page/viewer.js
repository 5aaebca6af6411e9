// A cloth in motion on a WebGL 2 canvas: showCloth(element, data), data as viewer.py packs it.
"use strict";

const LIGHT = normalize([0.35, -0.5, 0.9]);
const CHECKS = -1;
const HALF_ANGLE = (15 * Math.PI) / 180;

const VERTEX = `#version 300 es
in vec3 position; in vec3 normal; in float value; in vec2 material;
uniform mat4 camera; uniform vec3 light; uniform float ground; uniform int part;
out vec3 at; out vec3 across; out float shade; out vec2 weave;
void main() {
  at = position;
  if (part == 1) at -= light * (position.z - ground) / light.z;  // its shadow
  across = normal; shade = value; weave = material;
  gl_Position = camera * vec4(at, 1.0);
}`;

// part 0: the cloth, 1: a shadow, 2: the ground, 3: the rim of the cloth, 4: obstacles
const FRAGMENT = `#version 300 es
precision highp float; precision highp int;
in vec3 at; in vec3 across; in float shade; in vec2 weave;
uniform vec3 light, eye, middle, colours[11], shades[3]; uniform float size;
uniform int part, checked;
out vec4 colour;
const vec3 PAPER = vec3(0.965, 0.97, 0.975);
float lines(vec2 p, float spacing) {
  vec2 q = p / spacing, w = fwidth(q), d = abs(fract(q - 0.5) - 0.5) / max(w, vec2(1e-6));
  return (1.0 - min(min(d.x, d.y), 1.0)) * clamp(1.0 - 2.0 * max(w.x, w.y), 0.0, 1.0);
}
float dark(float p) {  // every second strip of width 1, its edges as soft as a pixel
  float w = max(fwidth(p), 1e-6);
  return clamp((abs(mod(p, 2.0) - 1.5) - 0.5) / -w + 0.5, 0.0, 1.0);
}
void main() {
  float fade = smoothstep(1.0, 0.3, length(at.xy - middle.xy) / (4.0 * size));
  if (part == 1) { colour = vec4(mix(PAPER, vec3(0.80, 0.82, 0.84), fade), 1.0); return; }
  if (part == 3) { colour = vec4(0.1, 0.12, 0.15, 1.0); return; }
  if (part == 2) {
    float spacing = pow(10.0, floor(log(size) / log(10.0)));
    vec3 floor_ = mix(vec3(0.915, 0.925, 0.93), vec3(0.82), 0.8 * lines(at.xy, spacing));
    colour = vec4(mix(PAPER, floor_, fade), 1.0); return;
  }
  vec3 n = normalize(across), to = normalize(eye - at);
  if (dot(n, to) < 0.0) n = -n;
  float s = clamp(shade, 0.0, 1.0) * 10.0;
  int i = int(min(s, 9.0));
  vec3 base = mix(colours[i], colours[i + 1], s - float(i));
  if (checked == 1) {
    float threads = dark(weave.x) + dark(weave.y);
    base = threads < 1.0 ? mix(shades[0], shades[1], threads)
      : mix(shades[1], shades[2], threads - 1.0);
  }
  if (part == 4) base = vec3(0.85, 0.83, 0.795);
  if (!gl_FrontFacing) base *= 0.86;
  float lit = 0.6 + 0.32 * max(dot(n, light), 0.0) + 0.22 * max(dot(n, to), 0.0);
  float gleam = 0.12 * pow(max(dot(n, normalize(light + to)), 0.0), 24.0);
  colour = vec4(base * lit + gleam, 1.0);
}`;

function normalize(a) { const l = Math.hypot(...a) || 1; return a.map((x) => x / l); }
function cross(a, b) {
  return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
}
function dot(a, b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

function unpack(text, Kind) {
  const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  return new Kind(bytes.buffer);
}

// --- what is drawn ------------------------------------------------------------------------------

const WIDTH = 9;  // numbers of a vertex: position, normal, value, material coordinates in squares

// At each point the sum of the normals of its triangles, as long as their areas.
function normalsOf(x, t) {
  const n = new Float32Array(x.length);
  for (let i = 0; i < t.length; i += 3) {
    const [a, b, c] = [3 * t[i], 3 * t[i + 1], 3 * t[i + 2]];
    const u = [x[b] - x[a], x[b + 1] - x[a + 1], x[b + 2] - x[a + 2]];
    const v = [x[c] - x[a], x[c + 1] - x[a + 1], x[c + 2] - x[a + 2]];
    const w = cross(u, v);
    for (const k of [a, b, c]) { n[k] += w[0]; n[k + 1] += w[1]; n[k + 2] += w[2]; }
  }
  return n;
}

// Three corners for each triangle of an obstacle.
function corners(obstacle) {
  const x = unpack(obstacle.points, Float32Array), t = unpack(obstacle.triangles, Uint32Array);
  const n = normalsOf(x, t), out = new Float32Array(WIDTH * t.length);
  t.forEach((node, i) => {
    out.set(x.subarray(3 * node, 3 * node + 3), WIDTH * i);
    out.set(n.subarray(3 * node, 3 * node + 3), WIDTH * i + 3);
  });
  return out;
}

class Cloth {
  constructor(data) {
    this.data = data;
    this.points = unpack(data.points, Uint16Array);
    this.triangles = unpack(data.triangles, Uint32Array);
    this.rim = unpack(data.rim, Uint32Array);
    this.fields = data.fields.map((f) => ({ ...f, values: unpack(f.values, Uint16Array) }));
    this.material = data.checks ? unpack(data.checks.material, Float32Array) : null;
    this.vertices = new Float32Array(WIDTH * this.triangles.length);
    this.edge = new Float32Array(WIDTH * this.rim.length);
    this.obstacles = (data.obstacles || []).map((o) => ({ from: o.from, corners: corners(o) }));
  }

  // The corners of the obstacles in a frame: those given last.
  bodies(frame) {
    const before = this.obstacles.filter((o) => o.from <= frame);
    return before.length ? before[before.length - 1].corners : new Float32Array(0);
  }

  positions(frame) {
    const { nodes, low, high } = this.data, x = new Float32Array(3 * nodes);
    const from = 3 * nodes * frame, step = high.map((h, c) => (h - low[c]) / 65535);
    for (let i = 0; i < x.length; i++) x[i] = low[i % 3] + step[i % 3] * this.points[from + i];
    return x;
  }

  // About so many positions out of the whole motion.
  sample(count) {
    const { low, high } = this.data, step = high.map((h, c) => (h - low[c]) / 65535);
    const stride = 3 * Math.ceil(this.points.length / 3 / count), found = [];
    for (let i = 0; i < this.points.length; i += stride) {
      found.push(low.map((l, c) => l + step[c] * this.points[i + c]));
    }
    return found;
  }

  // Three corners for each triangle; values go from 0 to 1 on the colour bar.
  fill(frame, field) {
    const x = this.positions(frame), t = this.triangles, n = normalsOf(x, t), out = this.vertices;
    const f = this.fields[field], from = frame * f.count, scale = (f.high - f.low) / 65535;
    const span = f.shown[1] - f.shown[0] || 1, parts = t.length / 3 / this.data.cells;
    for (let i = 0; i < t.length; i++) {
      const node = t[i], k = f.per === "node" ? node : Math.floor(i / 3 / parts);
      const value = f.low + scale * f.values[from + k];
      for (let c = 0; c < 3; c++) {
        out[WIDTH * i + c] = x[3 * node + c];
        out[WIDTH * i + 3 + c] = n[3 * node + c];
      }
      out[WIDTH * i + 6] = (value - f.shown[0]) / span;
      if (this.material) out.set(this.material.subarray(2 * node, 2 * node + 2), WIDTH * i + 7);
    }
    this.rim.forEach((node, i) => this.edge.set(x.subarray(3 * node, 3 * node + 3), WIDTH * i));
  }
}

// --- camera -------------------------------------------------------------------------------------

class Camera {
  constructor(cloth) {
    this.data = cloth.data;
    this.reset();
    this.sample = cloth.sample(3000);
    this.first = this.axes();
  }

  reset() {
    const { low, high, azimuth, elevation } = this.data;
    Object.assign(this, { azimuth, elevation, zoom: 1 });
    this.target = low.map((l, c) => (l + high[c]) / 2);
  }

  axes() {
    const [a, e] = [this.azimuth, this.elevation];
    const back = [Math.cos(e) * Math.cos(a), Math.cos(e) * Math.sin(a), Math.sin(e)];
    const right = [-Math.sin(a), Math.cos(a), 0];
    return { back, right, up: cross(back, right) };
  }

  // The distance from which the whole motion just fits, as first looked at.
  fitted(aspect) {
    const { low, high } = this.data, { back, right, up } = this.first;
    const tan = Math.tan(HALF_ANGLE), middle = low.map((l, c) => (l + high[c]) / 2);
    let far = 1e-9;
    for (const x of this.sample) {
      const p = x.map((value, c) => value - middle[c]);
      const wide = Math.max(Math.abs(dot(p, right)) / (tan * aspect), Math.abs(dot(p, up)) / tan);
      far = Math.max(far, 1.08 * wide + dot(p, back));
    }
    return far;
  }

  matrix(aspect) {
    const { back, right, up } = this.axes(), far = this.fitted(aspect) * this.zoom;
    this.distance = far;
    const eye = this.target.map((t, c) => t + far * back[c]);
    const f = 1 / Math.tan(HALF_ANGLE), [near, end] = [0.02 * far, 30 * far];
    const rows = [right.map((r) => (r * f) / aspect), up.map((u) => u * f)];
    const at = rows.map((r) => -dot(r, eye)), depth = -dot(back, eye);
    const [A, B] = [(end + near) / (near - end), (2 * end * near) / (near - end)];
    const m = new Float32Array(16);
    for (let c = 0; c < 3; c++) {
      m.set([rows[0][c], rows[1][c], A * back[c], -back[c]], 4 * c);
    }
    m.set([at[0], at[1], A * depth + B, -depth], 12);
    return { m, eye };
  }
}

// --- drawing ------------------------------------------------------------------------------------

class Scene {
  constructor(canvas, cloth, camera) {
    Object.assign(this, { canvas, cloth, camera });
    const gl = canvas.getContext("webgl2", { antialias: true, preserveDrawingBuffer: true });
    if (!gl) throw new Error("This browser shows no WebGL 2.");
    this.gl = gl;
    this.program = this.compiled();
    const { low, high } = cloth.data;
    this.size = Math.hypot(...low.map((l, c) => high[c] - l)) || 1;
    this.middle = low.map((l, c) => (l + high[c]) / 2);
    this.ground = cloth.data.ground;
    this.buffers = [0, 1, 2, 3].map(() => gl.createBuffer());
    const r = 5 * this.size, corners = [[-r, -r], [r, -r], [-r, r], [r, r]];
    const floor = corners.flatMap(([x, y]) => [
      this.middle[0] + x, this.middle[1] + y, this.ground, 0, 0, 1, 0, 0, 0]);
    this.send(2, new Float32Array(floor));
  }

  compiled() {
    const gl = this.gl, program = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
      const log = gl.getShaderInfoLog(shader);
      if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(log);
    }
    const inputs = ["position", "normal", "value", "material"];
    inputs.forEach((name, i) => gl.bindAttribLocation(program, i, name));
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) {
      throw new Error(gl.getProgramInfoLog(program));
    }
    gl.useProgram(program);
    return program;
  }

  send(i, values) {
    const gl = this.gl;
    gl.bindBuffer(gl.ARRAY_BUFFER, this.buffers[i]);
    gl.bufferData(gl.ARRAY_BUFFER, values, gl.DYNAMIC_DRAW);
  }

  // A field by its number; CHECKS for the squares of a weave in its place.
  show(frame, field) {
    this.checked = field === CHECKS;
    this.cloth.fill(frame, this.checked ? 0 : field);
    this.send(0, this.cloth.vertices);
    this.send(1, this.cloth.edge);
    const bodies = this.cloth.bodies(frame);
    this.bodies = bodies.length / WIDTH;
    this.send(3, bodies);
    this.draw();
  }

  at(name) { return this.gl.getUniformLocation(this.program, name); }

  part(number, buffer, mode, count) {
    const gl = this.gl;
    gl.bindBuffer(gl.ARRAY_BUFFER, this.buffers[buffer]);
    [[0, 3, 0], [1, 3, 12], [2, 1, 24], [3, 2, 28]].forEach(([i, size, offset]) => {
      gl.enableVertexAttribArray(i);
      gl.vertexAttribPointer(i, size, gl.FLOAT, false, 4 * WIDTH, offset);
    });
    gl.uniform1i(this.at("part"), number);
    gl.drawArrays(mode, 0, count);
  }

  draw() {
    const gl = this.gl, canvas = this.canvas, ratio = window.devicePixelRatio || 1;
    canvas.width = Math.max(1, Math.round(canvas.clientWidth * ratio));
    canvas.height = Math.max(1, Math.round(canvas.clientHeight * ratio));
    const { m, eye } = this.camera.matrix(canvas.width / canvas.height);
    gl.viewport(0, 0, canvas.width, canvas.height);
    gl.clearColor(0.965, 0.97, 0.975, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.uniformMatrix4fv(this.at("camera"), false, m);
    gl.uniform3fv(this.at("light"), LIGHT);
    gl.uniform3fv(this.at("eye"), eye);
    gl.uniform3fv(this.at("middle"), this.middle);
    gl.uniform3fv(this.at("colours"), this.cloth.data.colours.flat());
    gl.uniform3fv(this.at("shades"), this.cloth.data.shades.flat().map((x) => x / 255));
    gl.uniform1i(this.at("checked"), this.checked ? 1 : 0);
    gl.uniform1f(this.at("size"), this.size);
    gl.uniform1f(this.at("ground"), this.ground);
    const corners = this.cloth.triangles.length;
    gl.disable(gl.DEPTH_TEST);
    if (eye[2] > this.ground) {  // from below there is no ground to look through
      this.part(2, 2, gl.TRIANGLE_STRIP, 4);
      this.part(1, 3, gl.TRIANGLES, this.bodies);
      this.part(1, 0, gl.TRIANGLES, corners);
    }
    gl.enable(gl.DEPTH_TEST);
    gl.enable(gl.POLYGON_OFFSET_FILL);
    gl.polygonOffset(1, 1);
    this.part(4, 3, gl.TRIANGLES, this.bodies);
    this.part(0, 0, gl.TRIANGLES, corners);
    this.part(3, 1, gl.LINES, this.cloth.rim.length);
  }
}

// --- the hand -----------------------------------------------------------------------------------

// One finger or the left button turns, two fingers or the wheel zoom, shift or the right one moves.
function steer(canvas, camera, draw) {
  const held = new Map();
  const spread = () => {
    const [a, b] = [...held.values()];
    return Math.hypot(a.x - b.x, a.y - b.y);
  };
  canvas.addEventListener("pointerdown", (e) => {
    canvas.setPointerCapture(e.pointerId);
    held.set(e.pointerId, { x: e.clientX, y: e.clientY });
  });
  canvas.addEventListener("pointermove", (e) => {
    const last = held.get(e.pointerId);
    if (!last) return;
    const before = held.size === 2 ? spread() : 0, dx = e.clientX - last.x, dy = e.clientY - last.y;
    held.set(e.pointerId, { x: e.clientX, y: e.clientY });
    if (held.size === 2) camera.zoom *= before / Math.max(spread(), 1);
    else if (e.shiftKey || e.buttons === 2) {
      const { right, up } = camera.axes();
      const unit = (2 * camera.distance * Math.tan(HALF_ANGLE)) / canvas.clientHeight;
      camera.target = camera.target.map((t, c) => t + unit * (dy * up[c] - dx * right[c]));
    } else {
      camera.azimuth -= 0.008 * dx;
      camera.elevation = Math.min(1.56, Math.max(-1.56, camera.elevation + 0.008 * dy));
    }
    draw();
  });
  for (const end of ["pointerup", "pointercancel"]) {
    canvas.addEventListener(end, (e) => held.delete(e.pointerId));
  }
  canvas.addEventListener("wheel", (e) => {
    e.preventDefault();
    camera.zoom *= Math.exp(0.001 * e.deltaY);
    draw();
  }, { passive: false });
  canvas.addEventListener("contextmenu", (e) => e.preventDefault());
  canvas.addEventListener("dblclick", () => { camera.reset(); draw(); });
}

function figures(value) { return Number(value.toPrecision(4)).toString(); }

function legend(element, field, side, colours) {
  element.querySelector(".ramp").hidden = !field;
  const stops = colours.map((c) => `rgb(${c.map((x) => 255 * x)})`).join(",");
  element.querySelector(".ramp").style.background = `linear-gradient(to right, ${stops})`;
  const [low, high] = element.querySelectorAll(".end");
  if (!field) {
    [low.textContent, high.textContent] = [`squares of ${figures(side)} m`, ""];
    return;
  }
  low.textContent = figures(field.shown[0]);
  high.textContent = `${figures(field.shown[1])} ${field.unit}`;
}

function showCloth(element, data) {
  const find = (name) => element.querySelector(name);
  const [canvas, slider, chooser, play] = ["canvas", ".time", ".field", ".play"].map(find);
  const cloth = new Cloth(data), camera = new Camera(cloth);
  let scene;
  try { scene = new Scene(canvas, cloth, camera); } catch (error) {
    canvas.replaceWith(Object.assign(document.createElement("p"), { textContent: error.message }));
    return;
  }
  const show = () => {
    const frame = Number(slider.value), field = Number(chooser.value);
    find(".now").textContent = `t = ${figures(data.times[frame])}${data.unit}`;
    legend(find(".legend"), cloth.fields[field], data.checks && data.checks.side, data.colours);
    scene.show(frame, field);
  };
  slider.max = data.times.length - 1;
  slider.value = data.start;
  cloth.fields.forEach((f, i) => chooser.add(new Option(f.title, i)));
  if (data.checks) chooser.add(new Option("checks", CHECKS));
  for (const input of [slider, chooser]) input.addEventListener("input", show);
  let timer = 0;
  const stop = () => { clearInterval(timer); timer = 0; play.textContent = "▶\uFE0E"; };
  const move = (by) => {
    slider.value = (Number(slider.value) + by + data.times.length) % data.times.length;
    show();
  };
  const length = data.times[data.times.length - 1] - data.times[0];
  const pace = Math.min(200, Math.max(33, (1000 * length) / Math.max(data.times.length - 1, 1)));
  const toggle = () => {
    if (timer) { stop(); return; }
    timer = setInterval(() => move(1), pace);
    play.textContent = "❚❚";
  };
  play.addEventListener("click", toggle);
  slider.addEventListener("pointerdown", stop);
  const keys = {
    " ": toggle,
    ArrowRight: () => { stop(); move(1); },
    ArrowLeft: () => { stop(); move(-1); },
    Home: () => { stop(); slider.value = 0; show(); },
    End: () => { stop(); slider.value = slider.max; show(); },
  };
  document.addEventListener("keydown", (e) => {
    const used = e.altKey || e.ctrlKey || e.metaKey || e.target.closest("select, summary");
    if (used || !(e.key in keys) || data.times.length < 2) return;
    e.preventDefault();  // the button and the slider have these keys, too
    keys[e.key]();
  });
  if (data.times.length < 2) {
    element.classList.add("still");
    for (const part of [slider, play]) part.hidden = true;
  }
  steer(canvas, camera, () => scene.draw());
  new ResizeObserver(() => scene.draw()).observe(canvas);
  show();
}
