"use strict";
// Panes that share one camera. One WebGL context draws them all, each into a canvas of its own:
// browsers allow only a few contexts on a page.
const Viewer = (() => {
  const MESH_VERTEX = `#version 300 es
    in vec3 place; in float error;
    uniform vec3 low, span; uniform mat3 turn; uniform vec3 center; uniform vec4 window;
    out vec3 seen; out float share;
    void main() {
      seen = turn * (low + span * place - center) * window.w;
      share = error;
      gl_Position = vec4((seen.xy + window.xy) * vec2(window.z, 1.0), -0.04 * seen.z, 1.0);
    }`;
  const MESH_FRAGMENT = `#version 300 es
    precision highp float;
    in vec3 seen; in float share;
    uniform vec3 heat[4];
    out vec4 color;
    void main() {
      vec3 normal = normalize(cross(dFdx(seen), dFdy(seen)));
      float place = clamp(share, 0.0, 1.0) * 3.0;
      int k = min(int(place), 2);
      vec3 own = mix(heat[k], heat[k + 1], place - float(k));
      if (!gl_FrontFacing) own = vec3(0.80, 0.42, 0.34);
      float lit = 0.45 + 0.6 * abs(dot(normal, normalize(vec3(0.35, 0.45, 0.82))));
      color = vec4(own * lit, 1.0);
    }`;
  const DOT_VERTEX = `#version 300 es
    in vec3 place; in vec3 tint;
    uniform vec3 low, span; uniform mat3 turn; uniform vec3 center; uniform vec4 window;
    uniform float size; uniform float fade;
    out vec3 own;
    void main() {
      vec3 seen = turn * (low + span * place - center) * window.w;
      gl_Position = vec4((seen.xy + window.xy) * vec2(window.z, 1.0), -0.04 * seen.z, 1.0);
      gl_PointSize = size;
      own = mix(tint, vec3(0.75, 0.80, 0.88), fade * clamp(0.5 - 0.6 * seen.z, 0.0, 1.0));
    }`;
  const DOT_FRAGMENT = `#version 300 es
    precision highp float;
    in vec3 own;
    out vec4 color;
    void main() {
      if (length(gl_PointCoord - 0.5) > 0.5) discard;
      color = vec4(own, 1.0);
    }`;
  const INK = [60, 95, 160], FLIPPED = [204, 13, 26], RIGHT = [150, 160, 174];

  const bytes = text => Uint8Array.from(atob(text), letter => letter.charCodeAt(0));
  const shorts = text => new Uint16Array(bytes(text).buffer);

  const product = (a, b) => [0, 1, 2].flatMap(i => [0, 1, 2].map(j =>
    a[3 * i] * b[j] + a[3 * i + 1] * b[3 + j] + a[3 * i + 2] * b[6 + j]));
  const rotation = (across, down) => {
    const [c, s, d, t] = [Math.cos(across), Math.sin(across), Math.cos(down), Math.sin(down)];
    return product([1, 0, 0, 0, d, -t, 0, t, d], [c, 0, s, 0, 1, 0, -s, 0, c]);
  };
  const START = () => ({ turn: [1, 0, 0, 0, 1, 0, 0, 0, 1], zoom: 1, shift: [0, 0] });

  class Viewer {
    // heat: four colours of errors; changed(): called once a frame in which the camera moved.
    constructor(heat) {
      this.canvas = document.createElement("canvas");
      this.gl = this.canvas.getContext("webgl2", { antialias: true, alpha: true });
      this.camera = START();
      this.mode = "surface";
      this.panes = [];
      this.heat = heat.flat().map(value => value / 255);
      this.waiting = false;
      if (!this.gl) return;
      this.seen = new IntersectionObserver(entries => {
        for (const entry of entries) this.paneOf(entry.target).visible = entry.isIntersecting;
        this.redraw();
      }, { rootMargin: "200px" });
      this.sized = new ResizeObserver(() => this.redraw());
      this.prepare();
      this.canvas.addEventListener("webglcontextlost", event => event.preventDefault());
      this.canvas.addEventListener("webglcontextrestored", () => {
        this.prepare();
        for (const pane of this.panes) this.load(pane);
        this.redraw();
      });
    }

    get works() { return this.gl !== null; }

    prepare() {
      this.programs = {
        mesh: this.program(MESH_VERTEX, MESH_FRAGMENT),
        dots: this.program(DOT_VERTEX, DOT_FRAGMENT),
      };
    }

    program(vertex, fragment) {
      const gl = this.gl, program = gl.createProgram();
      for (const [kind, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
        const shader = gl.createShader(kind);
        gl.shaderSource(shader, source);
        gl.compileShader(shader);
        gl.attachShader(program, shader);
      }
      gl.linkProgram(program);
      if (!gl.getProgramParameter(program, gl.LINK_STATUS) && !gl.isContextLost()) {
        throw new Error(gl.getProgramInfoLog(program));
      }
      return program;
    }

    // Show a scene: elements[k] holds pane k.
    show(scene, elements) {
      for (const pane of this.panes) {
        this.seen.unobserve(pane.element);
        this.sized.unobserve(pane.element);
        for (const buffer of pane.buffers) this.gl.deleteBuffer(buffer);
      }
      this.scene = scene;
      this.panes = scene.panes.map((data, k) => ({ data, element: elements[k], visible: false, buffers: [] }));
      for (const pane of this.panes) {
        this.load(pane);
        this.listen(pane);
        this.seen.observe(pane.element);
        this.sized.observe(pane.element);
      }
    }

    paneOf(element) { return this.panes.find(pane => pane.element === element) ?? {}; }

    load(pane) {
      const { mesh, normals, flipped, method } = pane.data, { dots } = this.scene;
      pane.buffers = [];
      pane.draws = {};
      if (mesh) {
        const errors = bytes(mesh.errors);
        pane.draws.surface = {
          program: "mesh", low: mesh.low, span: mesh.span,
          place: this.buffer(pane, shorts(mesh.places)),
          extra: this.buffer(pane, errors),
          index: this.buffer(pane, mesh.wide ? new Uint32Array(bytes(mesh.triangles).buffer)
            : shorts(mesh.triangles), true),
          wide: mesh.wide,
          count: bytes(mesh.triangles).length / (mesh.wide ? 4 : 2),
        };
      }
      if (!dots) return;
      const places = shorts(dots.places), count = places.length / 3;
      const shared = { program: "dots", low: dots.low, span: dots.span, count, fade: 0 };
      const tints = color => {
        const values = new Uint8Array(3 * count);
        for (let k = 0; k < count; k++) values.set(color(k), 3 * k);
        return this.buffer(pane, values);
      };
      if (method === "input" || normals) shared.place = this.buffer(pane, places);
      if (method === "input") pane.draws.surface = { ...shared, fade: 1, extra: tints(() => INK) };
      if (normals) {
        const n = new Int8Array(bytes(normals).buffer);
        pane.draws.normals = {
          ...shared, extra: tints(k => [0, 1, 2].map(i => 127.5 + n[3 * k + i])),
        };
      }
      if (flipped) {
        const wrong = bytes(flipped);
        pane.draws.flipped = { ...shared, extra: tints(k => wrong[k] ? FLIPPED : RIGHT) };
      }
    }

    buffer(pane, values, index = false) {
      const gl = this.gl, target = index ? gl.ELEMENT_ARRAY_BUFFER : gl.ARRAY_BUFFER;
      const buffer = gl.createBuffer();
      gl.bindBuffer(target, buffer);
      gl.bufferData(target, values, gl.STATIC_DRAW);
      pane.buffers.push(buffer);
      return buffer;
    }

    redraw() {
      if (this.waiting) return;
      this.waiting = true;
      requestAnimationFrame(() => {
        this.waiting = false;
        for (const pane of this.panes) if (pane.visible) this.draw(pane);
      });
    }

    draw(pane) {
      const canvas = pane.element.querySelector("canvas"), draw = pane.draws[this.mode];
      const ratio = Math.min(devicePixelRatio || 1, 2);
      const width = Math.max(1, Math.round(pane.element.clientWidth * ratio));
      const height = Math.max(1, Math.round(pane.element.clientHeight * ratio));
      if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
      const flat = canvas.getContext("2d");
      flat.clearRect(0, 0, width, height);
      canvas.dataset.drawn = draw ? this.mode : "";
      if (!draw) return;
      if (this.canvas.width < width) this.canvas.width = width;
      if (this.canvas.height < height) this.canvas.height = height;
      const gl = this.gl, program = this.programs[draw.program];
      gl.viewport(0, 0, width, height);
      gl.clearColor(0, 0, 0, 0);
      gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
      gl.enable(gl.DEPTH_TEST);
      gl.useProgram(program);
      const at = name => gl.getUniformLocation(program, name);
      const { turn, zoom, shift } = this.camera, { axes, center, radius } = this.scene;
      gl.uniform3fv(at("low"), draw.low);
      gl.uniform3fv(at("span"), draw.span);
      gl.uniform3fv(at("center"), center);
      gl.uniformMatrix3fv(at("turn"), true, product(turn, axes));
      gl.uniform4f(at("window"), ...shift, height / width, 0.97 * zoom / radius);
      this.attribute(program, "place", draw.place, 3, gl.UNSIGNED_SHORT);
      if (draw.program === "mesh") {
        gl.uniform3fv(at("heat"), this.heat);
        this.attribute(program, "error", draw.extra, 1, gl.UNSIGNED_BYTE);
        gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, draw.index);
        gl.drawElements(gl.TRIANGLES, draw.count, draw.wide ? gl.UNSIGNED_INT : gl.UNSIGNED_SHORT, 0);
      } else {
        const space = this.scene.dots.spacing * 0.485 * zoom / radius * height;
        gl.uniform1f(at("size"), Math.max(1.5, Math.min(draw.fade ? 0.4 * space : 1.6 * space, 60)));
        gl.uniform1f(at("fade"), draw.fade);
        this.attribute(program, "tint", draw.extra, 3, gl.UNSIGNED_BYTE);
        gl.drawArrays(gl.POINTS, 0, draw.count);
      }
      flat.drawImage(this.canvas, 0, this.canvas.height - height, width, height, 0, 0, width, height);
    }

    attribute(program, name, buffer, size, kind) {
      const gl = this.gl, place = gl.getAttribLocation(program, name);
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
      gl.enableVertexAttribArray(place);
      gl.vertexAttribPointer(place, size, kind, true, 0, 0);
    }

    reset() { this.camera = START(); this.redraw(); }

    turnBy(across, down) {
      this.camera.turn = product(rotation(across, down), this.camera.turn);
      this.redraw();
    }

    zoomBy(factor) {
      this.camera.zoom = Math.max(0.2, Math.min(50, this.camera.zoom * factor));
      this.redraw();
    }

    moveBy(x, y) {
      this.camera.shift = [this.camera.shift[0] + x, this.camera.shift[1] + y];
      this.redraw();
    }

    listen(pane) {
      const element = pane.element, fingers = new Map();
      const size = () => element.clientHeight || 1;
      element.addEventListener("pointerdown", event => {
        element.setPointerCapture(event.pointerId);
        fingers.set(event.pointerId, [event.clientX, event.clientY]);
      });
      for (const kind of ["pointerup", "pointercancel"]) {
        element.addEventListener(kind, event => fingers.delete(event.pointerId));
      }
      element.addEventListener("pointermove", event => {
        const before = fingers.get(event.pointerId);
        if (!before) return;
        const now = [event.clientX, event.clientY];
        const x = (now[0] - before[0]) / size(), y = (now[1] - before[1]) / size();
        if (fingers.size === 2) {
          const [other] = [...fingers].filter(([id]) => id !== event.pointerId).map(([, place]) => place);
          const far = place => Math.hypot(place[0] - other[0], place[1] - other[1]) || 1;
          this.zoomBy(far(now) / far(before));
          this.turnBy(1.5 * x, 1.5 * y);
        } else if (event.shiftKey || event.buttons === 4) {
          this.moveBy(2 * x, -2 * y);
        } else {
          this.turnBy(3 * x, 3 * y);
        }
        fingers.set(event.pointerId, now);
      });
      element.addEventListener("wheel", event => {
        if (!event.ctrlKey) return;
        event.preventDefault();
        this.zoomBy(Math.exp(-0.004 * event.deltaY));
      }, { passive: false });
      element.addEventListener("dblclick", () => this.reset());
      element.addEventListener("keydown", event => {
        const step = 0.12, keys = {
          ArrowLeft: () => this.turnBy(-step, 0), ArrowRight: () => this.turnBy(step, 0),
          ArrowUp: () => this.turnBy(0, -step), ArrowDown: () => this.turnBy(0, step),
          "+": () => this.zoomBy(1.15), "=": () => this.zoomBy(1.15), "-": () => this.zoomBy(1 / 1.15),
        };
        if (!keys[event.key] || event.ctrlKey || event.metaKey || event.altKey) return;
        event.preventDefault();
        keys[event.key]();
      });
    }
  }
  return Viewer;
})();
