// The page's data: JSON for facts, one block of bytes for arrays.

const page = JSON.parse(document.getElementById("document").textContent);
const block = decodeBase64(document.getElementById("block"));

function decodeBase64(element) {
  const text = element.textContent.trim();
  element.remove();  // megabytes that nobody needs twice
  if (Uint8Array.fromBase64) return Uint8Array.fromBase64(text);
  const binary = atob(text);
  const bytes = new Uint8Array(binary.length);
  for (let i = 0; i < binary.length; i++) bytes[i] = binary.charCodeAt(i);
  return bytes;
}

// A packed array as a typed array over the block.
function codes(packed) {
  const kinds = { uint8: Uint8Array, uint16: Uint16Array, int16: Int16Array, uint32: Uint32Array, float32: Float32Array, float64: Float64Array };
  const count = packed.shape.reduce((product, length) => product * length, 1);
  return new kinds[packed.kind](block.buffer, block.byteOffset + packed.at, count);
}

// A packed array as numbers; NaN where there is no value.
function numbers(packed) {
  const values = codes(packed);
  if (!packed.step.length) return values;
  const columns = packed.step.length;
  const result = new Float32Array(values.length);
  for (let i = 0; i < values.length; i++) {
    const column = i % columns;
    result[i] = values[i] === 65535 ? NaN : packed.low[column] + packed.step[column] * values[i];
  }
  return result;
}

const times = numbers(page.times);
const frameCount = times.length;
const joint = Object.fromEntries(page.joint_names.map((name, index) => [name, index]));
const JOINTS = page.joint_names.length;
const FEET = [joint.left_ankle, joint.left_foot, joint.right_ankle, joint.right_foot];

// The colour, mixed with white where thin lines of it would drown on a dark page.
function legible([red, green, blue]) {
  const bright = 0.3 * red + 0.55 * green + 0.15 * blue, least = 0.4;
  const white = bright < least ? (least - bright) / (1 - bright) : 0;
  return [red, green, blue].map((part) => part + white * (1 - part));
}

const people = page.people.map((person, index) => ({
  index,
  id: person.id,
  name: person.name,
  colour: person.colour,
  css: `rgb(${legible(person.colour).map((part) => Math.round(255 * part)).join(" ")})`,
  height: person.height_m,
  seen: person.seen,
  mesh: person.mesh,
  restVertices: numbers(person.rest_vertices),
  restJoints: numbers(person.rest_joints),
  joints: numbers(person.joints),
  turns: codes(person.turns),
  valid: codes(person.valid),
  contacts: codes(person.contacts),
  top: numbers(person.top),
  lowest: numbers(person.lowest),
  confidence: numbers(person.confidence),
  skate: numbers(person.skate),
  reprojection: person.reprojection && numbers(person.reprojection),
}));

const cloud = { points: numbers(page.points), colours: codes(page.colours), count: page.points.shape[0] };

// [x, y, z] of a person's joint in the world.
function jointAt(person, frame, index) {
  const at = (frame * JOINTS + index) * 3;
  return [person.joints[at], person.joints[at + 1], person.joints[at + 2]];
}

// The frame's number in the video.
function videoFrame(frame) {
  return page.first_frame + page.frame_step * frame;
}
