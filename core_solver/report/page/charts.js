// Measures over time. All charts share the frames as their axis, one cursor, and the choice of a person.

const CHART = { left: 40, right: 8, top: 8, bottom: 18, height: 118 };

const worseFoot = (person, frame) => {
  const [left, right] = [person.skate[2 * frame], person.skate[2 * frame + 1]];
  return Number.isNaN(left) ? right : Number.isNaN(right) ? left : Math.max(left, right);
};

// `value`: of a person in a frame, NaN for none. `least`: what the axis shows at least.
const MEASURES = [
  { title: "Highest point", unit: "m above ground", digits: 2, value: (p, f) => p.top[f], least: [0, 1.8] },
  { title: "Lowest point", unit: "cm above ground", digits: 1, value: (p, f) => 100 * p.lowest[f], least: [-5, 5] },
  { title: "Skate of resting feet", unit: "mm a frame", digits: 1, value: worseFoot, least: [0, 5] },
  { title: "Confidence", unit: "", digits: 2, value: (p, f) => p.confidence[f], least: [0, 1] },
  { title: "Reprojection error", unit: "px", digits: 1, value: (p, f) => (p.reprojection ? p.reprojection[f] : NaN), least: [0, 10], missing: page.no_reprojection },
];

class Chart {
  constructor(parent, title, note) {
    const panel = document.createElement("section");
    panel.className = "panel chart";
    const bar = document.createElement("div");
    bar.className = "bar";
    const heading = document.createElement("h2");
    heading.textContent = title;
    const unitNote = document.createElement("span");
    unitNote.className = "note";
    unitNote.textContent = note;
    heading.append(" ", unitNote);
    this.now = document.createElement("div");
    this.now.className = "now";
    bar.append(heading, this.now);
    panel.append(bar);
    parent.append(panel);
    this.panel = panel;
  }

  say(text) {
    const line = document.createElement("p");
    line.className = "missing";
    line.textContent = text;
    this.panel.append(line);
  }

  makeDrawing(label) {
    const plot = document.createElement("div");
    plot.className = "plot";
    this.drawing = svg(plot, "svg", { role: "img", "aria-label": label });
    // The cursor is no part of the drawing: moving it must not paint thousands of lines again.
    this.cursor = document.createElement("div");
    this.cursor.className = "cursor";
    plot.append(this.cursor);
    this.panel.append(plot);
    new ResizeObserver(() => {
      this.width = this.drawing.clientWidth;
      this.drawing.replaceChildren();
      this.drawing.setAttribute("viewBox", `0 0 ${this.width} ${CHART.height}`);
      this.groups = this.build();
      this.shownPerson = undefined;
      redraw();
    }).observe(this.drawing);
    const toFrame = (event) => {
      const share = (event.clientX - this.drawing.getBoundingClientRect().left - CHART.left) / (this.width - CHART.left - CHART.right);
      scrubTo(share * (frameCount - 1));
    };
    this.drawing.addEventListener("pointerdown", (event) => {
      this.drawing.setPointerCapture(event.pointerId);
      toFrame(event);
    });
    this.drawing.addEventListener("pointermove", (event) => event.buttons && toFrame(event));
  }

  across(frame) {
    return CHART.left + (frame / Math.max(frameCount - 1, 1)) * (this.width - CHART.left - CHART.right);
  }

  drawFrameNumbers() {
    const apart = niceStep((frameCount - 1) * page.frame_step / Math.max(2, this.width / 80), true);
    const last = videoFrame(frameCount - 1);
    for (let number = Math.ceil(page.first_frame / apart) * apart; number <= last; number += apart) {
      const x = this.across((number - page.first_frame) / page.frame_step);
      svg(this.drawing, "line", { class: "rule", x1: x, x2: x, y1: CHART.top, y2: CHART.height - CHART.bottom });
      svg(this.drawing, "text", { x, y: CHART.height - 5, "text-anchor": "middle" }, `${number}`);
    }
  }

  // Move the cursor, fade those who are not chosen; false before anything is built.
  follow() {
    if (!this.groups) return false;
    this.cursor.style.transform = `translateX(${this.across(state.frame).toFixed(1)}px)`;
    if (this.shownPerson !== state.person) people.forEach((person, i) => this.groups[i].setAttribute("opacity", isFaded(person) ? 0.15 : 1));
    this.shownPerson = state.person;
    return true;
  }

  // The numbers at the cursor, of the chosen person or of a few.
  sayNow(words) {
    const shown = state.person === null ? people.slice(0, people.length > 4 ? 0 : 4) : [people[state.person]];
    while (this.now.children.length < shown.length) this.now.append(document.createElement("span"));
    while (this.now.children.length > shown.length) this.now.lastChild.remove();
    shown.forEach((person, i) => {
      const span = this.now.children[i];
      span.style.setProperty("--colour", person.css);
      span.title = person.name;
      span.textContent = words(person);
    });
  }
}

class MeasureChart extends Chart {
  constructor(parent, measure) {
    super(parent, measure.title, measure.unit);
    this.measure = measure;
    if (measure.missing) this.say(measure.missing);
    else this.makeDrawing(`${measure.title} over time`);
  }

  build() {
    [this.low, this.high] = this.range();
    const apart = niceStep((this.high - this.low) / 3, false);
    for (let tick = Math.ceil(this.low / apart - 1e-9); tick * apart <= this.high + 1e-9; tick++) {
      const y = this.up(tick * apart);
      svg(this.drawing, "line", { class: tick ? "rule" : "zero", x1: CHART.left, x2: this.width - CHART.right, y1: y, y2: y });
      svg(this.drawing, "text", { x: CHART.left - 5, y: y + 3, "text-anchor": "end" }, `${Number((tick * apart).toFixed(3))}`);
    }
    this.drawFrameNumbers();
    return people.map((person) => {
      const group = svg(this.drawing, "g", { fill: "none", stroke: person.css, "stroke-width": 1.5, "stroke-linejoin": "round", "stroke-linecap": "round" });
      svg(group, "path", { d: this.path(person, () => true), "stroke-opacity": 0.35, "stroke-width": 1 });
      svg(group, "path", { d: this.path(person, (frame) => person.valid[frame]) });
      return group;
    });
  }

  range() {
    let [low, high] = this.measure.least;
    for (const person of people)
      for (let frame = 0; frame < frameCount; frame++) {
        const value = this.measure.value(person, frame);
        if (value < low) low = value;
        if (value > high) high = value;
      }
    return [low, high];
  }

  up(value) {
    return CHART.top + ((this.high - value) / (this.high - this.low)) * (CHART.height - CHART.top - CHART.bottom);
  }

  // Where many frames share a pixel, the least and the greatest value stand for them.
  path(person, counts) {
    const together = Math.max(1, Math.floor(frameCount / this.width));
    let path = "", drawing = false;
    for (let first = 0; first < frameCount; first += together) {
      let low = Infinity, high = -Infinity;
      for (let frame = first; frame < Math.min(first + together, frameCount); frame++) {
        const value = counts(frame) ? this.measure.value(person, frame) : NaN;
        if (value < low) low = value;
        if (value > high) high = value;
      }
      const shown = low <= high, x = this.across(first).toFixed(1);
      // A lone value is a dot: a line of no length with round ends.
      if (shown) path += `${drawing ? "L" : "M"}${x} ${this.up(low).toFixed(1)}${drawing ? "" : "h0"}`;
      if (high > low) path += `L${x} ${this.up(high).toFixed(1)}`;
      drawing = shown;
    }
    return path;
  }

  draw() {
    if (!this.follow()) return;
    const { value, digits, unit: unitName } = this.measure;
    this.sayNow((person) => {
      const now = value(person, state.frame);
      return Number.isNaN(now) ? "-" : `${now.toFixed(digits)}${unitName ? " " + unitName.split(" ")[0] : ""}`;
    });
  }
}

// When feet rest: a lane a foot.
class ContactChart extends Chart {
  constructor(parent) {
    super(parent, "Resting feet", "left above right");
    this.makeDrawing("Contacts of the feet over time");
  }

  build() {
    this.drawFrameNumbers();
    const room = CHART.height - CHART.top - CHART.bottom, lane = room / Math.max(people.length, 1);
    const width = (this.width - CHART.left - CHART.right) / Math.max(frameCount - 1, 1);
    return people.map((person, index) => {
      const group = svg(this.drawing, "g", { fill: person.css });
      const top = CHART.top + index * lane, thick = Math.max(1, Math.min(16, lane * 0.4));
      if (lane >= 9) svg(group, "text", { x: CHART.left - 5, y: top + lane / 2 + 3, "text-anchor": "end" }, `${person.id}`);
      for (const foot of [0, 1])
        for (const [first, last] of stretches((frame) => person.contacts[2 * frame + foot] > 127))
          svg(group, "rect", {
            x: this.across(first - 0.5), width: width * (last - first + 1), height: thick, rx: 1,
            y: top + lane / 2 + (foot ? 0.5 : -thick - 0.5), "fill-opacity": foot ? 0.65 : 1,
          });
      return group;
    });
  }

  draw() {
    if (this.follow()) this.sayNow((person) => restingFeet(person) || "none");
  }
}

function restingFeet(person) {
  return ["L", "R"].filter((_, foot) => person.contacts[2 * state.frame + foot] > 127).join(" ");
}

// 1, 2 or 5 times a power of ten, at least as much as asked for.
function niceStep(least, whole) {
  const power = 10 ** Math.floor(Math.log10(Math.max(least, 1e-6)));
  const step = [1, 2, 5, 10].find((factor) => factor * power >= least) * power;
  return whole ? Math.max(1, Math.round(step)) : step;
}
