// People and scene in the world, with an eye that circles them.

const BACKGROUND = [0.055, 0.059, 0.063];
const FRUSTUM_DEPTH = 0.7;  // metres
const GRID_REACH = 60;  // lines at most to each side of the middle

class Space {
  constructor() {
    this.box = document.getElementById("space-view");
    this.labels = new Labels(document.getElementById("space-labels"));
    this.lines = { grid: gridLines(), frustum: frustumLines(), paths: people.map(pathLines) };
    this.begin(this.makeCanvas(), true);
  }

  makeCanvas() {
    const canvas = document.createElement("canvas");
    canvas.setAttribute("aria-hidden", "true");
    if (this.canvas) this.canvas.replaceWith(canvas); else this.box.prepend(canvas);
    this.canvas = canvas;
    controlOrbit(canvas, (place) => choose(personAt(place, this.projector())));
    return canvas;
  }

  begin(canvas, tryWebgl) {
    this.gl = tryWebgl ? openStage(canvas, false) : null;
    this.kind = this.gl ? "webgl2" : "canvas";
    if (!this.gl) {
      this.flat = canvas.getContext("2d") || this.makeCanvas().getContext("2d");
      return;
    }
    canvas.addEventListener("webglcontextlost", () => {
      this.begin(this.makeCanvas(), false);  // the old canvas can never be drawn flat
      redraw();
    });
    this.bodies = new Bodies(this.gl);
    this.marks = new Marks(this.gl);
    const upload = ({ positions, colours }) => this.marks.upload(positions, colours);
    this.grid = upload(this.lines.grid);
    this.frustum = upload(this.lines.frustum);
    this.screen = new Screen(this.gl, pictureCorners(FRUSTUM_DEPTH));
    this.paths = this.lines.paths.map(upload);
    this.cloud = upload({ positions: cloud.points, colours: opaque(cloud.colours) });
  }

  view() {
    if (!state.follow) return state.view;
    const person = people[state.person === null ? 0 : state.person];
    if (!person) return state.view;
    const [x, y] = jointAt(person, state.frame, 0);
    return { ...state.view, target: [x, y, state.view.target[2]] };
  }

  matrices() {
    const view = this.view(), { right, up, back, place } = eyeOf(view);
    const aspect = this.canvas.clientWidth / Math.max(this.canvas.clientHeight, 1);
    const near = Math.max(0.05, view.distance / 100);
    const projection = perspective(view.fov, aspect, near, near * 5000);
    const seen = viewMatrix(right, up, back, place);
    return { view: seen, projection, both: product(projection, seen), place, light: unit([-0.35, 0.6, 0.72]) };
  }

  // World points to [x, y, depth, pixels a metre] of the canvas on the page.
  projector(both = this.matrices().both) {
    const width = this.canvas.clientWidth, height = this.canvas.clientHeight;
    const perMetre = height / (2 * Math.tan(state.view.fov / 2));
    return (point) => {
      const [x, y, , w] = transform(both, point);
      return w < 0.05 ? null : [(x / w + 1) * 0.5 * width, (1 - y / w) * 0.5 * height, w, perMetre / w];
    };
  }

  draw() {
    if (!isOnScreen(this.box) || !fitCanvas(this.canvas)) return;
    const eye = this.matrices(), project = this.projector(eye.both);
    if (this.gl) this.drawStage(eye); else this.drawFlat(project);
    this.labels.draw(project, this.canvas.clientWidth, this.canvas.clientHeight, state.layers.names);
  }

  drawStage(eye) {
    const { gl, canvas } = this, { layers } = state;
    gl.viewport(0, 0, canvas.width, canvas.height);
    gl.clearColor(...BACKGROUND, 1);
    gl.depthMask(true);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    if (layers.cloud) this.marks.draw(this.cloud, eye.both, { mode: gl.POINTS, dotSize: 0.018 * canvas.height, strength: 0.95 });
    this.marks.draw(this.grid, eye.both, { mode: gl.LINES });
    // Who looks through the camera would see nothing else.
    if (Math.hypot(...subtract(eye.place, lens.place)) > 2 * FRUSTUM_DEPTH) {
      this.screen.draw(eye.both, footageView.picture, footageView.shown);
      this.marks.draw(this.frustum, eye.both, { mode: gl.LINES });
    }
    if (layers.paths) this.paths.forEach((path, i) => this.marks.draw(path, eye.both, { mode: gl.LINE_STRIP, strength: isFaded(people[i]) ? 0.2 : 1, above: true }));
    if (layers.bodies) this.bodies.draw(eye, 1);
    if (layers.bones) this.drawBones(eye);
  }

  // Bones change with every frame, so their few lines are made anew.
  drawBones(eye) {
    const positions = [], colours = [];
    for (const person of people) {
      const paint = [...person.colour.map((part) => 255 * Math.min(1, 0.35 + part)), isFaded(person) ? 70 : 255];
      page.parents.forEach((parent, child) => {
        if (parent < 0) return;
        positions.push(...jointAt(person, state.frame, parent), ...jointAt(person, state.frame, child));
        colours.push(...paint, ...paint);
      });
    }
    const marks = this.marks.upload(positions, colours);
    this.marks.draw(marks, eye.both, { mode: this.gl.LINES, above: true });
    this.marks.draw(marks, eye.both, { mode: this.gl.POINTS, dotSize: 0.03 * this.canvas.height, above: true });
    this.marks.discard(marks);
  }

  drawFlat(project) {
    const { flat, canvas } = this, sharp = canvas.width / canvas.clientWidth;
    flat.setTransform(sharp, 0, 0, sharp, 0, 0);
    flat.fillStyle = "#0e0f10";
    flat.fillRect(0, 0, canvas.clientWidth, canvas.clientHeight);
    if (state.layers.cloud) sketchCloud(flat, project);
    sketchLines(flat, project, this.lines.grid, false);
    sketchLines(flat, project, this.lines.frustum, false);
    if (state.layers.paths) this.lines.paths.forEach((path) => sketchLines(flat, project, path, true));
    if (state.layers.bodies || state.layers.bones) sketchSkeletons(flat, project, state.layers.bodies ? 1.4 * THICKNESS : THICKNESS / 2);
  }
}

function opaque(colours) {
  const result = new Uint8Array((colours.length / 3) * 4);
  for (let i = 0; i < colours.length / 3; i++) {
    for (let k = 0; k < 3; k++) result[4 * i + k] = colours[3 * i + k];
    result[4 * i + 3] = 255;
  }
  return result;
}

// Lines on the ground a metre apart, every fifth brighter, fading outwards.
function gridLines() {
  const { middle, reach } = extentOfPeople();
  const far = clamp(Math.ceil(reach + 4), 5, GRID_REACH);
  const [x, y] = [Math.round(middle[0]), Math.round(middle[1])];
  const positions = [], colours = [];
  for (let line = -far; line <= far; line++)
    for (let piece = -far; piece < far; piece++)
      for (const upright of [true, false])
        for (const end of [piece, piece + 1]) {
          const [across, along] = upright ? [x + line, y + end] : [x + end, y + line];
          const fade = clamp(1 - Math.hypot(line, end) / far, 0, 1);
          positions.push(across, along, 0);
          colours.push(190, 195, 205, ((upright ? across : along) % 5 === 0 ? 130 : 70) * fade);
        }
  return { positions, colours };
}

// The corners of the footage's picture, this far in front of its lens: clockwise from the top left.
function pictureCorners(depth) {
  return [[0, 0], [lens.width, 0], [lens.width, lens.height], [0, lens.height]].map(([u, v]) =>
    [(u - lens.cx) / lens.fx, (v - lens.cy) / lens.fy, 1].reduce((sum, part, k) => add(sum, times3(lensAxes[k], part * depth)), lens.place));
}

// The footage's camera as a pyramid, and a line down to the ground.
function frustumLines() {
  const corners = pictureCorners(FRUSTUM_DEPTH), positions = [], colours = [];
  const segments = corners.flatMap((corner, i) => [[lens.place, corner], [corner, corners[(i + 1) % 4]]]);
  segments.push([lens.place, [lens.place[0], lens.place[1], 0]]);
  for (const [from, to] of segments) {
    positions.push(...from, ...to);
    colours.push(230, 230, 235, 220, 230, 230, 235, 220);
  }
  return { positions, colours };
}

// Where the pelvis went, laid on the ground: bright where the person was seen.
function pathLines(person) {
  const positions = [], colours = [];
  for (let frame = 0; frame < frameCount; frame++) {
    const [x, y] = jointAt(person, frame, 0);
    positions.push(x, y, 0.01);
    colours.push(...person.colour.map((part) => 255 * part), person.valid[frame] ? 200 : 60);
  }
  return { positions, colours };
}
