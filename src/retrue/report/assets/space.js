"use strict";
// Points, surfaces and devices in space, drawn by WebGL 2: one for pages of results, notebooks and `retrue view`.
// Points come shuffled: the first n of them are an even thinning, and n is what this machine draws 20 times a second.

const SLOWEST = 1000 / 24; // milliseconds a frame, while the view moves
const MOST_AT_ONCE = 400000; // points a step, while a view at rest is filled in
const LEAST_POINTS = 5000; // while the view moves; where even those take too long, pixels are coarser
const STILL = 160; // milliseconds without a move after which the view is at rest
const CLICK_PX = 12;
const DOT_PX = 2; // of points on a surface that is drawn
const MODES = { true: 0, height: 1, depth: 2, sigma: 3, residual: 4, normal: 5 };
const METRES = { um: 1e-6, mm: 1e-3, cm: 1e-2, m: 1, in: 0.0254, ft: 0.3048 };

const VERTEX = `#version 300 es
in vec3 place; in vec3 tint; in vec2 known; in vec3 facing;
uniform mat4 seen; uniform vec3 low, extent, cutLow, cutHigh; uniform int mode; uniform float size; uniform vec2 range;
uniform vec4 only;
out vec3 color; out vec3 at;
vec3 scale(float t) {
  t = clamp(t, 0.0, 1.0) * 4.0;
  vec3 a = vec3(.17, .48, .71), b = vec3(.40, .76, .65), c = vec3(.96, .88, .54), d = vec3(.94, .54, .28), e = vec3(.70, .09, .17);
  return t < 1.0 ? mix(a, b, t) : t < 2.0 ? mix(b, c, t - 1.0) : t < 3.0 ? mix(c, d, t - 2.0) : mix(d, e, t - 3.0);
}
void main() {
  at = low + place * extent;
  gl_Position = seen * vec4(at, 1.0);
  gl_PointSize = size;
  color = tint;
  if (mode == 1) color = scale((-at.y - range.x) / (range.y - range.x));
  if (mode == 2) color = scale((at.z - range.x) / (range.y - range.x));
  if (mode == 3) color = known.x > 0.0 ? scale(known.x) : vec3(.6);
  if (mode == 4) color = known.y > 0.0 ? scale(known.y) : vec3(.6);
  if (mode == 5) color = dot(facing, facing) > .1 ? .5 + .5 * vec3(facing.x, -facing.y, -facing.z) : vec3(.6);
  if (only.a > 0.0) color = only.rgb;
  if (any(lessThan(at, cutLow)) || any(greaterThan(at, cutHigh))) gl_Position = vec4(2.0, 2.0, 2.0, 1.0);
}`;
const FRAGMENT = `#version 300 es
precision highp float;
in vec3 color; in vec3 at; out vec4 ink; uniform vec2 part; uniform int round; uniform int shaded; uniform float veil;
void main() {
  if (gl_FragCoord.x < part.x || gl_FragCoord.x >= part.y) discard;
  if (round == 1 && length(gl_PointCoord - .5) > .5) discard;
  vec3 c = color;
  if (shaded == 1) { vec3 n = normalize(cross(dFdx(at), dFdy(at))); c *= .55 + .45 * abs(n.z); }
  ink = vec4(c, veil);
}`;

async function unpacked(text, Kind) {
  const packed = Uint8Array.from(atob(text), (character) => character.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Kind(await new Response(stream).arrayBuffer());
}

class Space {
  static async open(root) {
    const spec = JSON.parse(root.querySelector("script").textContent);
    for (const layer of spec.layers) {
      layer.place = await unpacked(layer.place, Uint16Array);
      layer.tint = await unpacked(layer.tint, Uint8Array);
      layer.known = await unpacked(layer.known, Uint8Array);
      layer.facing = layer.facing && (await unpacked(layer.facing, Int8Array));
      layer.faces = layer.faces && (await unpacked(layer.faces, Uint32Array));
      layer.shown = true;
    }
    const space = new Space(root, spec);
    space.draw();
    return space;
  }

  constructor(root, spec) {
    Object.assign(this, { root, spec, canvas: root.querySelector("canvas"), split: 0.5, clicks: [], budget: 100000, fineness: 1, mode: spec.mode, unit: spec.unit, moment: {} });
    this.gl = this.canvas.getContext("webgl2", { alpha: false, antialias: false, preserveDrawingBuffer: true });
    if (!this.gl) throw new Error("WebGL 2 is switched off");
    this.low = spec.low; this.high = spec.high;
    this.cut = { low: [...spec.low], high: [...spec.high] };
    this.reset();
    this.lines = spec.lines.map((line) => ({ ...line, shown: true }));
    this.prepare();
    this.controls();
    this.listen();
    // Of many drawings on a page, such as a notebook, a browser keeps the latest; this one comes back when it is touched.
    this.canvas.addEventListener("webglcontextlost", (event) => { event.preventDefault(); this.lost = true; });
    this.canvas.addEventListener("webglcontextrestored", () => { this.lost = false; this.prepare(); this.draw(); });
    addEventListener("beforeprint", () => this.forPaper());
    new ResizeObserver(() => this.draw()).observe(this.canvas);
  }

  prepare() {
    this.program = this.compiled();
    for (const layer of this.spec.layers) this.upload(layer);
    for (const line of this.lines) this.uploadLine(line);
  }

  // As near as shows all that is to be seen at first, in the middle of the picture.
  reset() {
    this.target = [...this.spec.middle]; this.turn = [...this.spec.turn]; this.distance = 1;
    const m = this.matrix(this.canvas.clientWidth || 1, this.canvas.clientHeight || 1), row = (r) => [m[r], m[r + 4], m[r + 8]];
    const along = (r, end) => row(r).reduce((sum, value, axis) => sum + value * (end[axis] - this.target[axis]), 0);
    for (let round = 0; round < 5; round++) {
      this.distance = Math.max(1e-9, ...this.spec.ends.map((end) => Math.max(Math.abs(along(0, end)), Math.abs(along(1, end))) / 0.9 - along(3, end)));
      if (round === 4) break;
      for (const r of [0, 1]) {
        const seen = this.spec.ends.map((end) => along(r, end) / (this.distance + along(3, end)));
        const off = this.distance * (Math.min(...seen) + Math.max(...seen)) / 2, square = row(r).reduce((sum, value) => sum + value * value, 0);
        this.target = this.target.map((value, axis) => value + off * row(r)[axis] / square);
      }
    }
  }

  compiled() {
    const gl = this.gl, program = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text); gl.compileShader(shader);
      if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
      gl.attachShader(program, shader);
    }
    ["place", "tint", "known", "facing"].forEach((name, index) => gl.bindAttribLocation(program, index, name));
    gl.linkProgram(program); gl.useProgram(program);
    this.at = Object.fromEntries(["seen", "low", "extent", "cutLow", "cutHigh", "mode", "size", "range", "only", "part", "round", "shaded", "veil"].map((name) => [name, gl.getUniformLocation(program, name)]));
    gl.enable(gl.DEPTH_TEST); gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
    return program;
  }

  attribute(index, data, width, kind, normalized) {
    const gl = this.gl;
    if (!data) { gl.disableVertexAttribArray(index); gl.vertexAttrib3f(index, 0, 0, 0); return; }
    gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ARRAY_BUFFER, data, gl.STATIC_DRAW);
    gl.enableVertexAttribArray(index);
    gl.vertexAttribPointer(index, width, kind, normalized, 0, 0);
  }

  upload(layer) {
    const gl = this.gl;
    layer.array = gl.createVertexArray(); gl.bindVertexArray(layer.array);
    this.attribute(0, layer.place, 3, gl.UNSIGNED_SHORT, true);
    this.attribute(1, layer.tint, 3, gl.UNSIGNED_BYTE, true);
    this.attribute(2, layer.known, 2, gl.UNSIGNED_BYTE, true);
    this.attribute(3, layer.facing, 3, gl.BYTE, true);
    if (layer.faces) { gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer()); gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, layer.faces, gl.STATIC_DRAW); }
    layer.count = layer.place.length / 3;
  }

  uploadLine(line) {
    const gl = this.gl;
    for (const [array, count, places] of [["edges", "ends", line.places], ["sides", "corners", line.body]]) {
      if (!places) continue;
      line[array] = gl.createVertexArray(); gl.bindVertexArray(line[array]);
      this.attribute(0, new Float32Array(places.flat()), 3, gl.FLOAT, false);
      [1, 2, 3].forEach((index) => this.attribute(index, null));
      line[count] = places.length;
    }
  }

  matrix(width, height) {
    // The camera looks along z, y down; turned about the target, then perspective.
    const [a, b] = this.turn, [ca, sa, cb, sb] = [Math.cos(a), Math.sin(a), Math.cos(b), Math.sin(b)];
    const rows = [[ca, 0, -sa], [-sa * sb, cb, -ca * sb], [sa * cb, sb, ca * cb]];
    this.rows = rows;
    const shift = rows.map((row) => -(row[0] * this.target[0] + row[1] * this.target[1] + row[2] * this.target[2]));
    shift[2] += this.distance;
    const f = 1.6, near = this.distance / 200, far = this.distance * 20 + 1;
    const wide = width > height ? f * height / width : f, tall = width > height ? f : f * width / height;
    const p = (far + near) / (far - near), q = (-2 * far * near) / (far - near);
    const out = new Float32Array(16);
    for (let column = 0; column < 4; column++) {
      const value = (row) => (column < 3 ? rows[row][column] : shift[row]);
      out[4 * column] = wide * value(0);
      out[4 * column + 1] = -tall * value(1);
      out[4 * column + 2] = p * value(2) + (column === 3 ? q : 0);
      out[4 * column + 3] = value(2);
    }
    return out;
  }

  // While the view moves, frame follows frame, each as full as this machine draws in time; at rest all points come in.
  move() {
    this.moving = true; this.filled = 0; this.movedAt = performance.now(); this.asked = true;
    this.next();
  }

  draw() {
    this.moving = false; this.before = null; this.filled = 0; this.step = Math.max(this.budget, 20000);
    this.next();
  }

  next() {
    this.waiting ||= requestAnimationFrame(() => { this.waiting = null; this.frame(); });
  }

  frame() {
    if (this.lost) return;
    const gl = this.gl, ratio = Math.min(devicePixelRatio || 1, 1.5) * (this.moving ? this.fineness : 1), start = performance.now();
    if (this.moving && !this.asked && start - this.movedAt > STILL) this.draw();
    this.asked = false;
    if (this.moving) { if (this.before) this.learn(start - this.before); this.before = start; }
    const width = Math.max(1, Math.round(this.canvas.clientWidth * ratio)), height = Math.max(1, Math.round(this.canvas.clientHeight * ratio));
    if (this.canvas.width !== width || this.canvas.height !== height) { this.canvas.width = width; this.canvas.height = height; this.filled = 0; }
    const first = this.filled, step = this.moving ? this.budget : this.step;
    this.step = Math.min(2 * step, MOST_AT_ONCE);
    this.seen = this.matrix(width, height);
    gl.viewport(0, 0, width, height);
    if (first === 0) { gl.clearColor(0.15, 0.17, 0.2, 1); gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT); }
    gl.uniformMatrix4fv(this.at.seen, false, this.seen);
    gl.uniform3fv(this.at.cutLow, this.cut.low); gl.uniform3fv(this.at.cutHigh, this.cut.high);
    gl.uniform2fv(this.at.range, this.mode === "height" ? [-this.high[1], -this.low[1]] : [this.low[2], this.high[2]]);
    const size = Math.max(1, ratio * this.pointSize(this.moving ? step : Infinity));
    const shown = this.spec.layers.filter((layer) => layer.shown), total = shown.reduce((sum, layer) => sum + layer.count, 0) || 1;
    gl.uniform1f(this.at.veil, 1);
    for (const layer of shown) {
      const part = this.part(layer, width);
      gl.uniform2fv(this.at.part, part);
      gl.uniform3fv(this.at.low, layer.low); gl.uniform3fv(this.at.extent, layer.extent);
      gl.uniform4fv(this.at.only, layer.aside ? [0.85, 0.3, 0.75, 1] : [0, 0, 0, 0]);
      gl.uniform1i(this.at.mode, layer.aside ? 0 : MODES[this.mode]);
      gl.uniform1i(this.at.shaded, layer.faces && this.mode === "true" ? 1 : 0);
      gl.bindVertexArray(layer.array);
      if (layer.faces && first === 0) { gl.uniform1i(this.at.round, 0); gl.drawElements(gl.TRIANGLES, layer.faces.length, gl.UNSIGNED_INT, 0); }
      if (!layer.dots) continue;
      gl.uniform1i(this.at.round, 1); gl.uniform1i(this.at.shaded, 0);
      gl.uniform1f(this.at.size, layer.faces ? DOT_PX * ratio : size);
      const share = layer.count / total, from = Math.min(Math.floor(first * share), layer.count), to = Math.min(Math.ceil((first + step) * share), layer.count);
      if (to > from) gl.drawArrays(gl.POINTS, from, to - from);
    }
    this.filled = Math.min(first + step, total);
    if (first === 0) this.drawEdges();
    if (this.moving || this.filled >= total) this.drawBodies();
    this.drawn = this.filled; this.total = total;
    this.mark();
    if (this.moving || this.filled < total) this.next();
  }

  // Few points are drawn larger, so that they read as a surface.
  pointSize(most) {
    const area = this.canvas.clientWidth * this.canvas.clientHeight;
    const shown = this.spec.layers.reduce((sum, layer) => sum + (layer.when === "before" ? 0 : layer.count), 0) || 1;
    return Math.min(8, Math.max(1.8, 0.3 * Math.sqrt(area / Math.min(most, shown))));
  }

  learn(milliseconds) {
    this.frameTime = milliseconds;
    const share = SLOWEST / milliseconds; // what of this frame would have been in time
    if (share < 1) {
      if (this.budget <= 3 * LEAST_POINTS) this.fineness = Math.max(0.35, Math.max(0.6, Math.sqrt(share)) * this.fineness);
      this.budget = Math.max(LEAST_POINTS, Math.round(this.budget * Math.max(0.1, 0.9 * share)));
    } else if (milliseconds < 0.8 * SLOWEST) {
      if (this.fineness < 1) this.fineness = Math.min(1, 1.05 * this.fineness);
      else this.budget = Math.round(Math.min(1.15 * this.budget, 4e6));
    }
  }

  part(layer, width) {
    if (!this.compared || layer.aside) return [0, 1e9];
    return layer.when === "before" ? [0, this.split * width] : layer.when === "after" ? [this.split * width, 1e9] : [0, 1e9];
  }

  // The slider opens amid the points: devices beside them would leave one side of it empty.
  splitMiddle(slider) {
    const { low, extent } = this.spec.layers.find((layer) => layer.when === "after");
    this.seen = this.matrix(this.canvas.clientWidth || 1, this.canvas.clientHeight || 1);
    const [x] = this.onScreen(low.map((value, axis) => value + extent[axis] / 2));
    this.split = Math.min(0.9, Math.max(0.1, x / (this.canvas.clientWidth || 1)));
    slider.value = 100 * this.split;
  }

  plain() {
    const gl = this.gl;
    gl.uniform2fv(this.at.part, [0, 1e9]); gl.uniform1i(this.at.round, 0); gl.uniform1i(this.at.mode, 0); gl.uniform1i(this.at.shaded, 0);
    gl.uniform3fv(this.at.low, [0, 0, 0]); gl.uniform3fv(this.at.extent, [1, 1, 1]);
    gl.uniform3fv(this.at.cutLow, [-1e30, -1e30, -1e30]); gl.uniform3fv(this.at.cutHigh, [1e30, 1e30, 1e30]);
    return this.lines.filter((line) => line.shown && (!line.moment || this.moment[line.name] === line.moment));
  }

  drawEdges() {
    const gl = this.gl;
    for (const line of this.plain()) {
      gl.uniform4fv(this.at.only, [...line.color, 1]);
      gl.bindVertexArray(line.edges); gl.drawArrays(gl.LINES, 0, line.ends);
    }
  }

  // Last, so that one sees through them to all that lies behind.
  drawBodies() {
    const gl = this.gl;
    gl.enable(gl.BLEND); gl.depthMask(false);
    for (const line of this.plain().filter((one) => one.sides)) {
      gl.uniform4fv(this.at.only, [...line.color, 1]); gl.uniform1f(this.at.veil, 0.2);
      gl.bindVertexArray(line.sides); gl.drawArrays(gl.TRIANGLES, 0, line.corners);
    }
    gl.depthMask(true); gl.disable(gl.BLEND);
  }

  // A browser does not print what a graphics card drew.
  forPaper() {
    this.moving = false; this.filled = 0; this.step = 1e9;
    this.frame();
    this.root.querySelector("img.paper").src = this.canvas.toDataURL();
  }

  onScreen(at) {
    const m = this.seen, w = m[3] * at[0] + m[7] * at[1] + m[11] * at[2] + m[15];
    const x = (m[0] * at[0] + m[4] * at[1] + m[8] * at[2] + m[12]) / w, y = (m[1] * at[0] + m[5] * at[1] + m[9] * at[2] + m[13]) / w;
    return [(x + 1) / 2 * this.canvas.clientWidth, (1 - y) / 2 * this.canvas.clientHeight, w];
  }

  place(layer, k) {
    return [0, 1, 2].map((axis) => layer.low[axis] + layer.place[3 * k + axis] / 65535 * layer.extent[axis]);
  }

  // The point nearest to the eye among those within a few pixels of a click.
  pick(x, y) {
    let best = null;
    for (const layer of this.spec.layers) {
      if (!layer.shown) continue;
      for (let k = 0; k < layer.count; k++) {
        const at = this.place(layer, k);
        if (at.some((value, axis) => value < this.cut.low[axis] || value > this.cut.high[axis])) continue;
        const [sx, sy, depth] = this.onScreen(at), away = Math.hypot(sx - x, sy - y);
        if (depth <= 0 || away > CLICK_PX) continue;
        const cost = depth * (1 + 0.02 * away);
        if (!best || cost < best.cost) best = { at, cost, sigma: this.sigma(layer, k) };
      }
    }
    return best;
  }

  sigma(layer, k) {
    const step = layer.known[2 * k], [low, high] = this.spec.ranges.sigma ?? [0, 0];
    return step ? low * (high / low) ** ((step - 1) / 254) : 0;
  }

  click(x, y) {
    const found = this.pick(x, y);
    if (!found) return;
    this.clicks = this.clicks.length === 2 ? [found] : [...this.clicks, found];
    this.mark();
  }

  // To two digits: of what changes from frame to frame, no more can be read.
  few(count) {
    return Number(count.toPrecision(2)).toLocaleString("en");
  }

  length(value) {
    const known = this.spec.unit in METRES && this.unit in METRES;
    const shown = known ? value * METRES[this.spec.unit] / METRES[this.unit] : value;
    return `${Number(shown.toPrecision(4))} ${known ? this.unit : this.spec.unit}`;
  }

  mark() {
    const overlay = this.root.querySelector("svg"), places = this.clicks.map((one) => this.onScreen(one.at)), wide = this.canvas.clientWidth;
    const named = this.lines.filter((line) => line.label && line.shown && (!line.moment || this.moment[line.name] === line.moment));
    const labels = named.map((line) => [this.onScreen(line.places[0]), line.label]).filter(([[, , depth]]) => depth > 0);
    this.write(overlay, places.map(([x, y]) => `<circle cx="${x}" cy="${y}" r="5"/>`).join("")
      + (places.length === 2 ? `<line x1="${places[0][0]}" y1="${places[0][1]}" x2="${places[1][0]}" y2="${places[1][1]}"/>` : "")
      + (this.compared ? `<line class="split" x1="${this.split * wide}" y1="0" x2="${this.split * wide}" y2="${this.canvas.clientHeight}"/>` : "")
      + labels.map(([[x, y], text]) => `<text x="${x.toFixed(1)}" y="${y.toFixed(1)}">${text.replace(/[&<]/g, (c) => ({ "&": "&amp;", "<": "&lt;" })[c])}</text>`).join("")
      + (this.moving && this.drawn < this.total ? `<text class="thinned" x="10" y="20">${this.few(this.drawn)} of ${this.few(this.total)} points while it moves</text>` : ""));
    const say = this.measured();
    this.root.querySelector(".truth").hidden = this.clicks.length < 2;
    if (this.root.querySelector(".measured").textContent !== say) this.root.querySelector(".measured").textContent = say;
    Object.assign(this.root.dataset, this.moving ? {} : { drawn: Math.round(this.drawn ?? 0), budget: this.budget, frame: (this.frameTime ?? 0).toFixed(1), distance: say });
    this.bar();
  }

  // The clicks in words; and for the command line, places in the unit of the file.
  measured() {
    const command = this.root.querySelector(".command");
    command.hidden = this.clicks.length < 2;
    if (!this.clicks.length) return "Click two points to measure.";
    if (this.clicks.length === 1) return `${this.clicks[0].at.map((value) => this.length(value)).join(", ")}: click the other end.`;
    const [a, b] = this.clicks, apart = Math.hypot(...a.at.map((value, axis) => value - b.at[axis])), sigma = Math.hypot(a.sigma, b.sigma);
    const said = `${this.length(apart)}${sigma ? ` ± ${this.length(sigma)}` : ""}`, truth = Number(this.root.querySelector(".truth input").value);
    const places = this.clicks.flatMap((one) => one.at.map((value) => Number(value.toPrecision(6)))).join(" ");
    this.write(command, `retrue scale rig.json cloud.ply --known points:${truth > 0 ? truth : "LENGTH"}${this.unit} --at ${places} --out scaled.json`);
    if (!(truth > 0)) return said;
    const factor = truth * (this.spec.unit in METRES && this.unit in METRES ? METRES[this.unit] / METRES[this.spec.unit] : 1) / apart;
    return `${said}: lengths × ${factor.toPrecision(5)}${sigma ? ` ± ${(factor * sigma / apart).toPrecision(2)}` : ""}`;
  }

  // Only what changes is written: the browser would paint all of it again, which takes longer than the points.
  write(element, text) {
    if (element.written === text) return;
    element.written = text; element.innerHTML = text;
    if (element.tagName === "svg") element.toggleAttribute("hidden", !text);
  }

  bar() {
    const bar = this.root.querySelector(".bar"), range = !this.spec.layers.length ? null : this.mode === "height" ? [-this.high[1], -this.low[1]] : this.mode === "depth" ? [this.low[2], this.high[2]] : this.spec.ranges[this.mode];
    if (bar.hidden === Boolean(range)) bar.hidden = !range;
    if (!range) return;
    const show = (value) => (this.mode === "residual" ? `${Number(value.toPrecision(2))} px` : this.length(value));
    this.write(bar.querySelector(".least"), show(range[0])); this.write(bar.querySelector(".most"), show(range[1]));
  }

  controls() {
    const find = (name) => this.root.querySelector(name), layers = this.spec.layers;
    const modes = find(".mode"), units = find(".unit");
    const known = { residual: this.spec.ranges.residual, sigma: this.spec.ranges.sigma, normal: layers.some((layer) => layer.facing) };
    for (const option of [...modes.options]) if (option.value in known && !known[option.value]) option.remove();
    modes.value = this.mode;
    modes.onchange = () => { this.mode = modes.value; this.draw(); };
    units.innerHTML = (this.spec.unit in METRES ? Object.keys(METRES) : [this.spec.unit]).map((name) => `<option>${name}</option>`).join("");
    units.value = this.spec.unit;
    units.onchange = () => { this.unit = units.value; this.mark(); };
    this.compared = layers.some((layer) => layer.when === "before") && layers.some((layer) => layer.when === "after");
    for (const name of [".mode", ".unit", ".measured", "details"]) (find(name).closest("label") ?? find(name)).hidden = !layers.length;
    find(".compare").hidden = !this.compared;
    if (this.compared) this.splitMiddle(find(".compare input"));
    find(".compare input").oninput = (event) => { this.split = Number(event.target.value) / 100; this.move(); };
    find(".truth input").oninput = () => this.mark();
    for (const [axis, name] of [..."xyz"].entries()) {
      const [from, to] = find(`.cut-${name}`).querySelectorAll("input");
      const set = () => {
        const at = (input) => this.low[axis] + Number(input.value) / 100 * (this.high[axis] - this.low[axis]);
        this.cut.low[axis] = Number(from.value) === 0 ? -1e30 : at(from); this.cut.high[axis] = Number(to.value) === 100 ? 1e30 : at(to);
        this.move();
      };
      from.oninput = to.oninput = set;
      this.cut.low[axis] = -1e30; this.cut.high[axis] = 1e30;
    }
    const list = find(".layers"), moments = new Map();
    for (const line of this.lines.filter((one) => one.moment)) moments.set(line.name, [...(moments.get(line.name) ?? []), line.moment]);
    const once = this.lines.filter((line, k) => !line.moment && this.lines.findIndex((other) => other.name === line.name) === k);
    for (const shown of [...layers, ...once]) {
      const label = document.createElement("label"), box = Object.assign(document.createElement("input"), { type: "checkbox", checked: true });
      box.onchange = () => { for (const one of [...layers, ...this.lines]) if (one.name === shown.name) one.shown = box.checked; this.draw(); };
      label.append(box, ` ${shown.name}${shown.of ? ` (${shown.of})` : ""}`);
      label.style.setProperty("--own", shown.aside ? "#d94dbf" : shown.color ? `rgb(${shown.color.map((c) => Math.round(255 * c))})` : "transparent");
      list.append(label);
    }
    for (const [name, all] of moments) {
      const label = Object.assign(document.createElement("label"), { className: "moment" }), said = document.createElement("output");
      const range = Object.assign(document.createElement("input"), { type: "range", min: 1, max: all.length, value: all.length });
      range.oninput = () => { this.moment[name] = all[Number(range.value) - 1]; said.textContent = this.moment[name]; this.draw(); };
      label.append(`${name} `, range, said); list.append(label);
      range.oninput();
    }
    find(".home").onclick = () => { this.reset(); this.draw(); };
  }

  listen() {
    const canvas = this.canvas, down = new Map();
    let travelled = 0, apart = 0;
    const at = (event) => { const box = canvas.getBoundingClientRect(); return [event.clientX - box.left, event.clientY - box.top]; };
    canvas.onpointerdown = (event) => { canvas.setPointerCapture(event.pointerId); down.set(event.pointerId, at(event)); travelled = 0; apart = 0; };
    canvas.onpointermove = (event) => {
      const before = down.get(event.pointerId);
      if (!before) return;
      const now = at(event), [dx, dy] = [now[0] - before[0], now[1] - before[1]];
      travelled += Math.abs(dx) + Math.abs(dy);
      down.set(event.pointerId, now);
      if (down.size === 2) {
        const [p, q] = [...down.values()], width = Math.hypot(p[0] - q[0], p[1] - q[1]);
        if (apart) this.distance *= apart / width;
        apart = width;
        this.pan(dx / 2, dy / 2);
      } else if (event.shiftKey || event.buttons === 2) this.pan(dx, dy);
      else { this.turn[0] += dx / 200; this.turn[1] = Math.min(1.5, Math.max(-1.5, this.turn[1] + dy / 200)); }
      this.move();
    };
    const up = (event) => {
      if (!down.delete(event.pointerId)) return;
      if (travelled < 4 && event.type === "pointerup") this.click(...at(event));
    };
    canvas.onpointerup = canvas.onpointercancel = up;
    canvas.oncontextmenu = (event) => event.preventDefault();
    canvas.addEventListener("wheel", (event) => { event.preventDefault(); this.distance *= Math.exp(event.deltaY / 900); this.move(); }, { passive: false });
    canvas.onkeydown = (event) => {
      const turn = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, -0.1], ArrowDown: [0, 0.1] }[event.key], zoom = { "+": 0.9, "-": 1.1 }[event.key];
      if (turn) this.turn = [this.turn[0] + turn[0], this.turn[1] + turn[1]];
      if (zoom) this.distance *= zoom;
      if (turn || zoom) { event.preventDefault(); this.move(); }
    };
  }

  pan(dx, dy) {
    const step = this.distance / (0.8 * Math.min(this.canvas.clientWidth, this.canvas.clientHeight)) / 1;
    for (let axis = 0; axis < 3; axis++) this.target[axis] -= 0.5 * step * (dx * this.rows[0][axis] + dy * this.rows[1][axis]);
  }
}

for (const root of document.querySelectorAll(".space")) {
  Space.open(root).then((space) => { root.space = space; root.dataset.ready = "yes"; }).catch((error) => { root.querySelector(".measured").textContent = `This browser cannot show it: ${error.message}`; });
}
