// Skinned bodies with WebGL 2, seen by the 3D view's eye or through the lens of the footage's camera.

const BODY_VERTEX = `#version 300 es
layout(location = 0) in vec3 position;
layout(location = 1) in vec3 normal;
layout(location = 2) in vec4 carrier;
layout(location = 3) in vec4 weight;
uniform vec4 bones[${3 * 24}];
uniform mat4 view, projection;
uniform bool lens;
uniform vec4 intrinsics;   // fx fy cx cy
uniform vec2 size;         // of the footage, pixels
uniform float distortion[5];
uniform float farthest;
uniform vec2 contact;      // left and right foot
uniform vec4 feet;         // joints: left ankle, left foot, right ankle, right foot
out vec3 facing;
out float rests, outside;

vec4 seenThroughLens(vec3 p) {
  vec2 xy = p.xy / max(p.z, 0.05);
  vec2 ideal = abs((xy * intrinsics.xy + intrinsics.zw) / size - 0.5);
  outside = p.z < 0.05 || max(ideal.x, ideal.y) > 1.5 ? 1.0 : 0.0;
  float r2 = dot(xy, xy);
  float radial = 1.0 + r2 * (distortion[0] + r2 * (distortion[1] + r2 * distortion[4]));
  vec2 bent = xy * radial + 2.0 * xy.x * xy.y * vec2(distortion[2], distortion[3])
            + vec2(distortion[3], distortion[2]) * (r2 + 2.0 * xy * xy);
  vec2 share = (bent * intrinsics.xy + intrinsics.zw) / size;
  return vec4(2.0 * share.x - 1.0, 1.0 - 2.0 * share.y, clamp(p.z / farthest, 0.0, 1.0) * 1.98 - 0.99, 1.0);
}

void main() {
  vec4 part = weight / (weight.x + weight.y + weight.z + weight.w);
  vec4 row0 = vec4(0.0), row1 = vec4(0.0), row2 = vec4(0.0);
  rests = 0.0;
  for (int k = 0; k < 4; k++) {
    int j = int(carrier[k] + 0.5);
    row0 += part[k] * bones[3 * j];
    row1 += part[k] * bones[3 * j + 1];
    row2 += part[k] * bones[3 * j + 2];
    bvec4 same = equal(ivec4(feet + 0.5), ivec4(j));
    rests += part[k] * ((same.x || same.y ? contact.x : 0.0) + (same.z || same.w ? contact.y : 0.0));
  }
  vec4 rest = vec4(position, 1.0);
  vec3 world = vec3(dot(row0, rest), dot(row1, rest), dot(row2, rest));
  vec4 eye = view * vec4(world, 1.0);
  facing = mat3(view) * vec3(dot(row0.xyz, normal), dot(row1.xyz, normal), dot(row2.xyz, normal));
  outside = 0.0;
  gl_Position = lens ? seenThroughLens(eye.xyz) : projection * eye;
}`;

const BODY_FRAGMENT = `#version 300 es
precision highp float;
in vec3 facing;
in float rests, outside;
uniform vec3 colour, light;
uniform float alpha, stripe;   // stripe: pixels, 0 for a body that was seen
out vec4 paint;
void main() {
  if (outside > 0.0) discard;
  if (stripe > 0.0 && mod(floor((gl_FragCoord.x + gl_FragCoord.y) / stripe), 2.0) < 1.0) discard;
  float bright = 0.32 + 0.68 * clamp(0.5 + 0.6 * dot(normalize(facing), light), 0.0, 1.0);
  vec3 shown = mix(colour * bright, vec3(bright), 0.75 * clamp(rests, 0.0, 1.0));
  paint = vec4(shown * alpha, alpha);
}`;

class Bodies {
  constructor(gl) {
    this.gl = gl;
    this.program = linkProgram(gl, BODY_VERTEX, BODY_FRAGMENT);
    this.rows = new Float32Array(12 * JOINTS);
    this.people = people.map((person) => this.upload(person));
  }

  upload(person) {
    const { gl } = this, mesh = page.meshes[person.mesh];
    const faces = codes(mesh.faces), array = gl.createVertexArray();
    gl.bindVertexArray(array);
    attribute(gl, 0, person.restVertices, 3, gl.FLOAT, false);
    attribute(gl, 1, restNormals(person.restVertices, faces), 3, gl.FLOAT, false);
    attribute(gl, 2, codes(mesh.joints), 4, gl.UNSIGNED_BYTE, false);
    attribute(gl, 3, codes(mesh.weights), 4, gl.UNSIGNED_BYTE, true);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, faces, gl.STATIC_DRAW);
    gl.bindVertexArray(null);
    return { person, array, count: faces.length, kind: faces instanceof Uint32Array ? gl.UNSIGNED_INT : gl.UNSIGNED_SHORT };
  }

  // `eye`: {view, projection, light} and, through the lens, {lens: true, farthest}.
  draw(eye, fadedAlpha) {
    const { gl } = this, { at } = this.program;
    gl.useProgram(this.program.handle);
    gl.enable(gl.DEPTH_TEST);
    gl.disable(gl.BLEND);
    gl.uniformMatrix4fv(at.view, false, eye.view);
    gl.uniformMatrix4fv(at.projection, false, eye.projection);
    gl.uniform1i(at.lens, eye.lens ? 1 : 0);
    gl.uniform4f(at.intrinsics, lens.fx, lens.fy, lens.cx, lens.cy);
    gl.uniform2f(at.size, lens.width, lens.height);
    gl.uniform1fv(at.distortion, lens.distortion);
    gl.uniform1f(at.farthest, eye.farthest || 1);
    gl.uniform4fv(at.feet, FEET);
    gl.uniform3fv(at.light, eye.light);
    for (const body of this.people) this.drawOne(body, fadedAlpha);
    gl.bindVertexArray(null);
  }

  drawOne({ person, array, count, kind }, fadedAlpha) {
    const { gl } = this, { at } = this.program;
    const faded = isFaded(person), grey = faded ? 0.55 : 0;
    gl.uniform4fv(at.bones, boneRows(person, state.frame, this.rows));
    gl.uniform3fv(at.colour, person.colour.map((part) => part * (1 - grey) + 0.3 * grey));
    gl.uniform1f(at.alpha, faded ? fadedAlpha : 1);
    gl.uniform1f(at.stripe, isFilled(person) ? Math.max(3, gl.drawingBufferHeight / 140) : 0);
    gl.uniform2f(at.contact, ...[0, 1].map((foot) => clamp(person.contacts[2 * state.frame + foot] / 127 - 1, 0, 1)));
    gl.bindVertexArray(array);
    gl.drawElements(gl.TRIANGLES, count, kind, 0);
  }
}

function restNormals(vertices, faces) {
  const normals = new Float32Array(vertices.length);
  const at = (i) => [vertices[3 * i], vertices[3 * i + 1], vertices[3 * i + 2]];
  for (let f = 0; f < faces.length; f += 3) {
    const [a, b, c] = [at(faces[f]), at(faces[f + 1]), at(faces[f + 2])];
    const outward = cross(subtract(b, a), subtract(c, a));
    for (let corner = 0; corner < 3; corner++)
      for (let k = 0; k < 3; k++) normals[3 * faces[f + corner] + k] += outward[k];
  }
  return normals;
}
