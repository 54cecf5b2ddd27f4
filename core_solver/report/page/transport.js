// The timeline that drives everything, its buttons and the keys.

const LANE = { most: 12, least: 3, room: 72 };

class Transport {
  constructor() {
    const get = (id) => document.getElementById(id);
    Object.assign(this, { lanes: get("lanes"), drawing: get("lane-lines"), marker: get("lane-marker"), scrub: get("scrub"), play: get("play"), number: get("number"), clock: get("clock"), speed: get("speed") });
    this.icon = this.play.querySelector("path");
    this.scrub.max = frameCount - 1;
    Object.assign(this.number, { min: videoFrame(0), max: videoFrame(frameCount - 1), step: page.frame_step });
    this.lane = clamp(LANE.room / Math.max(people.length, 1), LANE.least, LANE.most);
    this.lanes.style.setProperty("--lanes", `${Math.max(people.length, 1) * this.lane + 14}px`);
    this.listen(get);
    new ResizeObserver(() => {
      this.build();
      redraw();
    }).observe(this.lanes);
  }

  listen(get) {
    const press = (id, action) => get(id).addEventListener("click", action);
    press("play", togglePlay);
    press("to-start", () => scrubTo(0));
    press("to-end", () => scrubTo(frameCount - 1));
    press("step-back", () => step(-1));
    press("step-on", () => step(1));
    this.scrub.addEventListener("input", () => scrubTo(this.scrub.value));
    this.number.addEventListener("change", () => {
      scrubTo((this.number.value - page.first_frame) / page.frame_step);
      this.draw();  // puts the number right where it was out of range
    });
    this.speed.addEventListener("change", () => change({ speed: Number(this.speed.value) }));
    document.addEventListener("keydown", onKey);
  }

  // The native slider's thumb keeps half its width away from both ends: so do the lanes.
  across(frame) {
    const edge = 8, width = this.lanes.clientWidth - 2 * edge;
    return edge + (width * frame) / Math.max(frameCount - 1, 1);
  }

  build() {
    const { drawing, lane } = this, height = this.lanes.clientHeight;
    drawing.replaceChildren();
    const wide = Math.max(1.5, this.across(1) - this.across(0));
    people.forEach((person, index) => {
      const y = 8 + index * lane, thick = Math.max(2, lane - 3);
      svg(drawing, "rect", { x: this.across(0), width: this.across(frameCount - 1) - this.across(0), y: y + thick / 2 - 0.5, height: 1, fill: person.css, "fill-opacity": 0.35 });
      for (const [first, last] of stretches((frame) => person.valid[frame]))
        svg(drawing, "rect", { x: this.across(first) - wide / 2, width: this.across(last) - this.across(first) + wide, y, height: thick, rx: 1, fill: person.css, "fill-opacity": 0.75 });
    });
    this.marks = page.findings.map((finding) => {
      const group = svg(drawing, "g", {});
      for (const [first, last] of finding.spans)
        svg(group, "rect", { x: this.across(first) - 1, width: Math.max(3, this.across(last) - this.across(first) + 2), y: 1, height: 3, rx: 1, fill: "#e0b050" });
      return group;
    });
    this.shownPerson = undefined;
    this.marker.replaceChildren();
    this.cursor = svg(this.marker, "g", {});
    svg(this.cursor, "line", { x1: 0, x2: 0, y1: 0, y2: height, stroke: "#fff", "stroke-width": 2 });
    svg(this.cursor, "path", { d: "M-5 0 H5 L0 7 Z", fill: "#fff" });
  }

  draw() {
    const { frame } = state, total = times[frameCount - 1];
    if (this.cursor) this.cursor.setAttribute("transform", `translate(${this.across(frame).toFixed(1)} 0)`);
    if (this.marks && this.shownPerson !== state.person)
      page.findings.forEach(({ person }, i) => this.marks[i].setAttribute("opacity", state.person === null || person === state.person ? 1 : 0.12));
    this.shownPerson = state.person;
    this.scrub.value = frame;
    this.scrub.setAttribute("aria-valuetext", `frame ${videoFrame(frame)}, ${times[frame].toFixed(2)} seconds`);
    if (document.activeElement !== this.number || state.playing) this.number.value = videoFrame(frame);
    this.clock.textContent = `${times[frame].toFixed(2)} of ${total.toFixed(2)} s`;
    this.speed.value = String(state.speed);
    this.icon.setAttribute("d", state.playing ? "M3 2h4v12H3zM9 2h4v12H9z" : "M3 1.5v13L14 8z");
    this.play.setAttribute("aria-label", state.playing ? "Pause" : "Play");
  }
}

function togglePlay() {
  if (state.playing) pause(); else play();
}

function step(frames) {
  pause();
  scrubTo(state.frame + frames);
}

const TURN = 0.08, ZOOM = 1.12;  // radians and share for each press of a key

const KEYS = {
  " ": togglePlay,
  ArrowLeft: (event) => step(event.shiftKey ? -10 : -1),
  ArrowRight: (event) => step(event.shiftKey ? 10 : 1),
  Home: () => scrubTo(0),
  End: () => scrubTo(frameCount - 1),
  0: () => choose(null),
  Escape: () => choose(null),
  a: () => turnView({ yaw: state.view.yaw + TURN }),
  d: () => turnView({ yaw: state.view.yaw - TURN }),
  w: () => turnView({ pitch: state.view.pitch + TURN }),
  s: () => turnView({ pitch: state.view.pitch - TURN }),
  "+": () => turnView({ distance: state.view.distance / ZOOM }),
  "-": () => turnView({ distance: state.view.distance * ZOOM }),
};

function onKey(event) {
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  const { target } = event;
  // Whoever types a number or chooses from a list means that; sliders of other things keep their arrows.
  if (target.matches("select, input[type=number]") || (target.matches("input") && target.id !== "scrub")) return;
  if (event.key === " " && target.matches("button")) return;
  const person = /^[1-9]$/.test(event.key) ? Number(event.key) - 1 : -1;
  const action = KEYS[event.key] || (people[person] && (() => choose(person)));
  if (!action) return;
  event.preventDefault();
  action(event);
}
