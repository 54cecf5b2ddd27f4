// Skeletons, points and lines on a flat canvas: bones over the footage, and everything where WebGL is missing.
// `project` turns a world point into [x, y, depth, pixels a metre], or null where it cannot be seen.

const THICKNESS = 0.07;  // metres of a bone

function sketchSkeletons(context, project, thickness = THICKNESS) {
  const bones = [];
  for (const person of people) {
    const places = [];
    for (let j = 0; j < JOINTS; j++) places.push(project(jointAt(person, state.frame, j)));
    page.parents.forEach((parent, child) => {
      const [a, b] = [places[parent], places[child]];
      if (a && b) bones.push({ person, child, a, b, depth: (a[2] + b[2]) / 2 });
    });
  }
  bones.sort((one, other) => other.depth - one.depth);
  context.lineCap = "round";
  for (const bone of bones) sketchBone(context, bone, thickness);
  context.globalAlpha = 1;
  context.setLineDash([]);
}

function sketchBone(context, { person, child, a, b }, thickness) {
  const width = Math.max(2, ((a[3] + b[3]) / 2) * thickness);
  const foot = [joint.left_foot, joint.right_foot].indexOf(child);
  const rests = foot >= 0 && person.contacts[2 * state.frame + foot] > 127;
  context.globalAlpha = isFaded(person) ? 0.25 : 1;
  context.setLineDash(isFilled(person) ? [width, 2 * width] : []);
  for (const [paint, wide] of [["#0008", width + 2], [rests ? "#fff" : person.css, width]]) {
    context.strokeStyle = paint;
    context.lineWidth = wide;
    context.beginPath();
    context.moveTo(a[0], a[1]);
    context.lineTo(b[0], b[1]);
    context.stroke();
  }
}

function sketchLines(context, project, { positions, colours }, connected) {
  for (let i = 0; i + 1 < positions.length / 3; i += connected ? 1 : 2) {
    const a = project(positions.slice(3 * i, 3 * i + 3)), b = project(positions.slice(3 * i + 3, 3 * i + 6));
    if (!a || !b) continue;
    const [red, green, blue, alpha] = colours.slice(4 * i, 4 * i + 4);
    context.strokeStyle = `rgb(${red} ${green} ${blue} / ${alpha / 255})`;
    context.lineWidth = 1;
    context.beginPath();
    context.moveTo(a[0], a[1]);
    context.lineTo(b[0], b[1]);
    context.stroke();
  }
}

const SKETCHED_POINTS = 8000;

function sketchCloud(context, project) {
  const every = Math.max(1, Math.ceil(cloud.count / SKETCHED_POINTS));
  for (let i = 0; i < cloud.count; i += every) {
    const place = project(cloud.points.subarray(3 * i, 3 * i + 3));
    if (!place) continue;
    const [red, green, blue] = cloud.colours.subarray(3 * i, 3 * i + 3);
    context.fillStyle = `rgb(${red} ${green} ${blue})`;
    context.fillRect(place[0], place[1], 2, 2);
  }
}

// The person whose body is drawn nearest to a place on a view; null where nobody is near.
function personAt(place, project, reach = 40) {
  let best = null, nearest = reach;
  for (const person of people)
    for (let j = 0; j < JOINTS; j++) {
      const joint = project(jointAt(person, state.frame, j));
      const distance = joint ? Math.hypot(joint[0] - place[0], joint[1] - place[1]) : Infinity;
      if (distance < nearest) [best, nearest] = [person.index, distance];
    }
  return best;
}

const LABEL = { width: 64, height: 18 };  // pixels

// Names above heads, as text over a view.
class Labels {
  constructor(element) {
    this.spans = people.map((person) => {
      const span = document.createElement("span");
      span.style.setProperty("--colour", person.css);
      span.textContent = person.name;
      element.append(span);
      return span;
    });
  }

  draw(project, width, height, shown) {
    const placed = [];
    this.spans.forEach((span, index) => {
      const person = people[index], [x, y, z] = jointAt(person, state.frame, joint.head);
      const place = shown && !isFaded(person) ? project([x, y, z + 0.28]) : null;
      span.hidden = !place || place[0] < 0 || place[0] > width || place[1] < 0 || place[1] > height;
      if (!span.hidden) placed.push({ span, person, across: place[0], down: place[1] });
    });
    // From the lowest upwards, each moves up until it covers no other.
    placed.sort((one, other) => other.down - one.down);
    placed.forEach((label, index) => {
      for (const other of placed.slice(0, index))
        if (Math.abs(other.across - label.across) < LABEL.width && Math.abs(other.down - label.down) < LABEL.height) label.down = other.down - LABEL.height;
      label.span.classList.toggle("filled", isFilled(label.person));
      label.span.style.transform = `translate(${label.across.toFixed(1)}px, ${label.down.toFixed(1)}px) translate(-50%, -100%)`;
    });
  }
}
