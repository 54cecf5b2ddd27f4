// Vectors as arrays of three numbers, matrices as 16 numbers column by column, as WebGL takes them.

const add = (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
const subtract = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const times3 = (a, s) => [a[0] * s, a[1] * s, a[2] * s];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const clamp = (value, low, high) => Math.min(Math.max(value, low), high);

function unit(a) {
  const length = Math.hypot(...a) || 1;
  return times3(a, 1 / length);
}

// The world seen by an eye at `place` with these axes (unit vectors in the world).
function viewMatrix(right, up, back, place) {
  return new Float32Array([
    right[0], up[0], back[0], 0, right[1], up[1], back[1], 0, right[2], up[2], back[2], 0,
    -dot(right, place), -dot(up, place), -dot(back, place), 1,
  ]);
}

function perspective(fovRadians, aspect, near, far) {
  const f = 1 / Math.tan(fovRadians / 2);
  return new Float32Array([
    f / aspect, 0, 0, 0, 0, f, 0, 0, 0, 0, (near + far) / (near - far), -1, 0, 0, (2 * near * far) / (near - far), 0,
  ]);
}

function product(a, b) {
  const result = new Float32Array(16);
  for (let column = 0; column < 4; column++)
    for (let row = 0; row < 4; row++)
      for (let k = 0; k < 4; k++) result[4 * column + row] += a[4 * k + row] * b[4 * column + k];
  return result;
}

// A point through a 4x4 matrix, before the division: [x, y, z, w].
function transform(m, p) {
  return [0, 1, 2, 3].map((row) => m[row] * p[0] + m[4 + row] * p[1] + m[8 + row] * p[2] + m[12 + row]);
}

// --- the camera of the footage, as OpenCV describes it ---

const lens = page.camera;
const lensAxes = [0, 1, 2].map((row) => lens.rotation.slice(3 * row, 3 * row + 3));  // right, down, forward in the world

// A world point to pixels of the footage and metres of depth; null behind the lens or far outside the picture.
function throughLens(point) {
  const [cx, cy, cz] = lensAxes.map((axis) => dot(axis, subtract(point, lens.place)));
  if (cz < 0.05) return null;
  const [x, y] = [cx / cz, cy / cz];
  const [u, v] = [x * lens.fx + lens.cx, y * lens.fy + lens.cy];
  if (Math.abs(u / lens.width - 0.5) > 1.5 || Math.abs(v / lens.height - 0.5) > 1.5) return null;
  const [k1, k2, p1, p2, k3] = lens.distortion;
  const r2 = x * x + y * y;
  const radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3));
  const xd = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x);
  const yd = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y;
  return [xd * lens.fx + lens.cx, yd * lens.fy + lens.cy, cz];
}

// Each joint's rotation and shift as three rows of four numbers: 72 vectors for 24 joints.
function boneRows(person, frame, rows) {
  for (let j = 0; j < JOINTS; j++) {
    const q = (frame * JOINTS + j) * 4, at = (frame * JOINTS + j) * 3;
    const length = Math.hypot(person.turns[q], person.turns[q + 1], person.turns[q + 2], person.turns[q + 3]) || 1;
    const w = person.turns[q] / length, x = person.turns[q + 1] / length;
    const y = person.turns[q + 2] / length, z = person.turns[q + 3] / length;
    const turn = [
      1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
      2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
      2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y),
    ];
    for (let row = 0; row < 3; row++) {
      const to = 12 * j + 4 * row;
      let shift = person.joints[at + row];
      for (let k = 0; k < 3; k++) {
        rows[to + k] = turn[3 * row + k];
        shift -= turn[3 * row + k] * person.restJoints[3 * j + k];
      }
      rows[to + 3] = shift;
    }
  }
  return rows;
}
