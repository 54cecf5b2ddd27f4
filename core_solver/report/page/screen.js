// The footage as a picture inside the camera's pyramid, so that one sees in 3D what the camera saw.

const SCREEN_VERTEX = `#version 300 es
layout(location = 0) in vec3 position;
layout(location = 1) in vec2 share;
uniform mat4 seen;
out vec2 place;
void main() {
  gl_Position = seen * vec4(position, 1.0);
  place = share;
}`;

const SCREEN_FRAGMENT = `#version 300 es
precision mediump float;
in vec2 place;
uniform sampler2D picture;
out vec4 paint;
void main() { paint = vec4(texture(picture, place).rgb, 1.0); }`;

class Screen {
  constructor(gl, corners) {
    this.gl = gl;
    this.program = linkProgram(gl, SCREEN_VERTEX, SCREEN_FRAGMENT);
    this.array = gl.createVertexArray();
    gl.bindVertexArray(this.array);
    attribute(gl, 0, new Float32Array(corners.flat()), 3, gl.FLOAT, false);
    attribute(gl, 1, new Float32Array([0, 0, 1, 0, 1, 1, 0, 1]), 2, gl.FLOAT, false);
    gl.bindVertexArray(null);
    this.texture = gl.createTexture();
    this.loaded = -1;
  }

  // `picture`: a canvas that shows picture number `shown`, -1 before there is one.
  draw(seen, picture, shown) {
    if (shown < 0) return;
    const { gl } = this;
    gl.bindTexture(gl.TEXTURE_2D, this.texture);
    if (shown !== this.loaded) this.load(picture);
    this.loaded = shown;
    gl.useProgram(this.program.handle);
    gl.uniformMatrix4fv(this.program.at.seen, false, seen);
    gl.enable(gl.DEPTH_TEST);
    gl.disable(gl.BLEND);
    gl.bindVertexArray(this.array);
    gl.drawArrays(gl.TRIANGLE_FAN, 0, 4);
    gl.bindVertexArray(null);
  }

  load(picture) {
    const { gl } = this;
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, gl.RGBA, gl.UNSIGNED_BYTE, picture);
    gl.generateMipmap(gl.TEXTURE_2D);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR_MIPMAP_LINEAR);
    for (const side of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, side, gl.CLAMP_TO_EDGE);
  }
}
