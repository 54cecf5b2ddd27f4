// The scene from above: cloud as a faint picture, paths, people and the camera as lines over it.

const SVG = "http://www.w3.org/2000/svg";
const CEILING = 2.6;  // metres: what hangs higher would hide the floor

function svg(parent, name, attributes, text) {
  const element = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  if (text !== undefined) element.textContent = text;
  parent.append(element);
  return element;
}

class TopView {
  constructor() {
    this.box = document.getElementById("top-view");
    this.canvas = document.getElementById("top-cloud");
    this.lines = document.getElementById("top-lines");
    this.now = document.getElementById("top-now");  // of its own: what moves must not paint the paths again
    this.lines.addEventListener("click", (event) => this.tap(event));
    new ResizeObserver(() => {
      this.build();
      redraw();
    }).observe(this.box);
  }

  // A scale at which people and camera fit; then all that stays the same over time.
  build() {
    const width = this.box.clientWidth, height = this.box.clientHeight;
    if (!width || !height) return;
    const low = [lens.place[0], lens.place[1]], high = [...low];
    for (const person of people)
      for (let frame = 0; frame < frameCount; frame++) {
        const place = jointAt(person, frame, 0);
        for (const k of [0, 1]) [low[k], high[k]] = [Math.min(low[k], place[k]), Math.max(high[k], place[k])];
      }
    const margin = 1;
    this.scale = Math.min(width / (high[0] - low[0] + 2 * margin), height / (high[1] - low[1] + 2 * margin), 160);
    this.origin = [width / 2 - (this.scale * (low[0] + high[0])) / 2, height / 2 + (this.scale * (low[1] + high[1])) / 2];
    this.drawCloud();
    for (const layer of [this.lines, this.now]) {
      layer.replaceChildren();
      layer.setAttribute("viewBox", `0 0 ${width} ${height}`);
    }
    this.drawGrid(width, height);
    this.drawCamera();
    this.paths = people.map((person) => this.drawPath(person));
    this.dots = people.map((person) => this.drawPerson(person));
    this.shownPerson = undefined;
  }

  at(place) {
    return [this.origin[0] + this.scale * place[0], this.origin[1] - this.scale * place[1]];
  }

  drawCloud() {
    if (!fitCanvas(this.canvas)) return;
    const context = this.canvas.getContext("2d"), sharp = this.canvas.width / this.canvas.clientWidth;
    context.setTransform(sharp, 0, 0, sharp, 0, 0);
    const order = [...Array(cloud.count).keys()].filter((i) => cloud.points[3 * i + 2] < CEILING);
    order.sort((a, b) => cloud.points[3 * a + 2] - cloud.points[3 * b + 2]);
    context.globalAlpha = 0.45;
    for (const i of order) {
      const [x, y] = this.at(cloud.points.subarray(3 * i, 3 * i + 2));
      context.fillStyle = `rgb(${cloud.colours[3 * i]} ${cloud.colours[3 * i + 1]} ${cloud.colours[3 * i + 2]})`;
      context.fillRect(x, y, 1.5, 1.5);
    }
  }

  drawGrid(width, height) {
    const apart = [0.5, 1, 2, 5, 10, 20, 50, 100].find((metres) => metres * this.scale >= 45) || 200;
    for (let line = Math.ceil(-this.origin[0] / this.scale / apart); this.at([line * apart, 0])[0] < width; line++) {
      const [x] = this.at([line * apart, 0]);
      svg(this.lines, "line", { x1: x, x2: x, y1: 0, y2: height, stroke: "#fff", "stroke-opacity": line ? 0.08 : 0.2 });
      svg(this.lines, "text", { x: x + 3, y: height - 5 }, `${line * apart}`);
    }
    for (let line = Math.ceil((this.origin[1] - height) / this.scale / apart); this.at([0, line * apart])[1] > 0; line++) {
      const [, y] = this.at([0, line * apart]);
      svg(this.lines, "line", { x1: 0, x2: width, y1: y, y2: y, stroke: "#fff", "stroke-opacity": line ? 0.08 : 0.2 });
      svg(this.lines, "text", { x: 4, y: y - 3 }, `${line * apart}`);
    }
  }

  drawCamera() {
    const eye = this.at(lens.place);
    const edges = [0, lens.width].map((u) => {
      const ray = [(u - lens.cx) / lens.fx, (lens.height / 2 - lens.cy) / lens.fy, 1];
      const along = unit(ray.reduce((sum, part, k) => add(sum, times3(lensAxes[k], part)), [0, 0, 0]));
      return [eye[0] + 4000 * along[0], eye[1] - 4000 * along[1]];
    });
    const wedge = [eye, ...edges].map((p) => p.join(",")).join(" ");
    svg(this.lines, "polygon", { points: wedge, fill: "#fff", "fill-opacity": 0.04, stroke: "#fff", "stroke-opacity": 0.25 });
    svg(this.lines, "circle", { cx: eye[0], cy: eye[1], r: 4, fill: "#fff" });
    svg(this.lines, "text", { x: eye[0] + 8, y: eye[1] + 4 }, "camera");
  }

  // Strong where the person was seen, faint where filled.
  drawPath(person) {
    const group = svg(this.lines, "g", { fill: "none", stroke: person.css, "stroke-linejoin": "round" });
    const place = (frame) => this.at(jointAt(person, frame, 0)).map((x) => x.toFixed(1)).join(",");
    const all = [...Array(frameCount).keys()];
    svg(group, "polyline", { points: all.map(place).join(" "), "stroke-opacity": 0.45, "stroke-width": 1, "stroke-dasharray": "2 3" });
    for (const [first, last] of stretches((frame) => person.valid[frame]))
      svg(group, "polyline", { points: all.slice(first, last + 1).map(place).join(" "), "stroke-width": 2 });
    return group;
  }

  drawPerson(person) {
    const group = svg(this.now, "g", {});
    svg(group, "path", { d: "M0 -13 L5 -5 L-5 -5 Z", fill: person.css, stroke: "#131416" });  // where the chest points
    svg(group, "circle", { r: 6, fill: person.css, stroke: "#fff", "stroke-width": 1.5 });
    return group;
  }

  draw() {
    if (!this.dots) return;
    people.forEach((person, index) => {
      const [x, y] = this.at(jointAt(person, state.frame, 0));
      const [left, right] = [joint.left_hip, joint.right_hip].map((hip) => jointAt(person, state.frame, hip));
      // Left minus right hip points to the body's left; a quarter turn clockwise from there is ahead.
      const turn = (Math.atan2(left[1] - right[1], left[0] - right[0]) * 180) / Math.PI;
      this.dots[index].setAttribute("transform", `translate(${x.toFixed(1)} ${y.toFixed(1)}) rotate(${(180 - turn).toFixed(1)})`);
      this.dots[index].setAttribute("opacity", isFaded(person) ? 0.3 : isFilled(person) ? 0.6 : 1);
    });
    if (this.shownPerson !== state.person) people.forEach((person, index) => this.paths[index].setAttribute("opacity", isFaded(person) ? 0.2 : 1));
    this.shownPerson = state.person;
  }

  // A tap near a path goes to the moment when that person was there.
  tap(event) {
    const box = this.box.getBoundingClientRect(), tapped = [event.clientX - box.left, event.clientY - box.top];
    let nearest = 20, found = null;
    for (const person of people.filter((one) => !isFaded(one)))
      for (let frame = 0; frame < frameCount; frame++) {
        const [x, y] = this.at(jointAt(person, frame, 0));
        const distance = Math.hypot(x - tapped[0], y - tapped[1]);
        if (distance < nearest) [nearest, found] = [distance, frame];
      }
    if (found !== null) scrubTo(found);
  }
}

// Stretches [first, last] of the frames for which something holds.
function stretches(holds) {
  const found = [];
  for (let frame = 0; frame < frameCount; frame++) {
    if (!holds(frame)) continue;
    const last = found[found.length - 1];
    if (last && last[1] === frame - 1) last[1] = frame; else found.push([frame, frame]);
  }
  return found;
}
