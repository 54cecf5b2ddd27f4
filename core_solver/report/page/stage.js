// A canvas for WebGL 2 and its small helpers.

// A WebGL 2 context that clears to nothing, or null where the browser has none.
function openStage(canvas, alpha) {
  const gl = canvas.getContext("webgl2", { alpha, antialias: true, powerPreference: "low-power" });
  if (!gl || gl.getParameter(gl.MAX_VERTEX_UNIFORM_VECTORS) < 3 * 24 + 24) return null;
  return gl;
}

// Whether any of an element can be seen: what has been scrolled away need not be drawn.
function isOnScreen(element) {
  const { top, bottom } = element.getBoundingClientRect();
  return bottom > 0 && top < innerHeight;
}

// Give the canvas as many pixels as it covers on the screen; true if it covers any.
function fitCanvas(canvas) {
  const sharp = Math.min(window.devicePixelRatio || 1, 2);
  const width = Math.round(canvas.clientWidth * sharp), height = Math.round(canvas.clientHeight * sharp);
  if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
  return width > 0 && height > 0;
}

function linkProgram(gl, vertex, fragment) {
  const handle = gl.createProgram();
  for (const [kind, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    gl.attachShader(handle, shader);
  }
  gl.linkProgram(handle);
  if (!gl.getProgramParameter(handle, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(handle) || "no shader program");
  const at = {};
  for (let i = 0; i < gl.getProgramParameter(handle, gl.ACTIVE_UNIFORMS); i++) {
    const name = gl.getActiveUniform(handle, i).name.replace("[0]", "");
    at[name] = gl.getUniformLocation(handle, name);
  }
  return { handle, at };
}

function attribute(gl, location, values, width, kind, normalised) {
  const buffer = gl.createBuffer();
  gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
  gl.bufferData(gl.ARRAY_BUFFER, values, gl.STATIC_DRAW);
  gl.enableVertexAttribArray(location);
  gl.vertexAttribPointer(location, width, kind, normalised, 0, 0);
  return buffer;
}

const MARK_VERTEX = `#version 300 es
layout(location = 0) in vec3 position;
layout(location = 1) in vec4 paint;
uniform mat4 seen;
uniform float dot_size;
out vec4 colour;
void main() {
  gl_Position = seen * vec4(position, 1.0);
  gl_PointSize = clamp(dot_size / max(gl_Position.w, 0.01), 1.0, 12.0);
  colour = paint;
}`;

const MARK_FRAGMENT = `#version 300 es
precision mediump float;
in vec4 colour;
uniform float strength;
out vec4 result;
void main() { result = vec4(colour.rgb, colour.a * strength); }`;

// Points and lines with a colour at each end.
class Marks {
  constructor(gl) {
    this.gl = gl;
    this.program = linkProgram(gl, MARK_VERTEX, MARK_FRAGMENT);
  }

  // `positions`: 3 numbers a point; `colours`: 4 bytes a point.
  upload(positions, colours) {
    const { gl } = this, array = gl.createVertexArray();
    gl.bindVertexArray(array);
    const buffers = [
      attribute(gl, 0, new Float32Array(positions), 3, gl.FLOAT, false),
      attribute(gl, 1, new Uint8Array(colours), 4, gl.UNSIGNED_BYTE, true),
    ];
    gl.bindVertexArray(null);
    return { array, buffers, count: positions.length / 3 };
  }

  discard({ array, buffers }) {
    for (const buffer of buffers) this.gl.deleteBuffer(buffer);
    this.gl.deleteVertexArray(array);
  }

  draw(marks, seen, { mode, dotSize = 1, strength = 1, above = false }) {
    const { gl } = this, { at, handle } = this.program;
    if (!marks.count) return;
    gl.useProgram(handle);
    gl.uniformMatrix4fv(at.seen, false, seen);
    gl.uniform1f(at.dot_size, dotSize);
    gl.uniform1f(at.strength, strength);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
    (above ? gl.disable : gl.enable).call(gl, gl.DEPTH_TEST);
    gl.bindVertexArray(marks.array);
    gl.drawArrays(mode, 0, marks.count);
    gl.bindVertexArray(null);
  }
}
