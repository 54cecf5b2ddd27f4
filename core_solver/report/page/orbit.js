// The eye of the 3D view: it circles a target. Yaw 0 looks the way the footage's camera looks.

const UPRIGHT = { roll: 0, fov: 0.7 };  // radians; the field of view is that up and down

function eyeOf(view) {
  const [cosine, sine] = [Math.cos(view.pitch), Math.sin(view.pitch)];
  const back = [Math.sin(view.yaw) * cosine, -Math.cos(view.yaw) * cosine, sine];
  const level = [Math.cos(view.yaw), Math.sin(view.yaw), 0], above = cross(back, level);
  const right = add(times3(level, Math.cos(view.roll)), times3(above, Math.sin(view.roll)));
  return { back, right, up: cross(back, right), place: add(view.target, times3(back, view.distance)) };
}

function turnView(values) {
  const view = { ...state.view, ...values };
  view.pitch = clamp(view.pitch, -Math.PI / 2, Math.PI / 2);
  view.distance = clamp(view.distance, 0.3, 500);
  change({ view });
}

// Metres on the screen's plane through the target for one pixel.
function metresPerPixel(canvas) {
  return (2 * state.view.distance * Math.tan(state.view.fov / 2)) / Math.max(canvas.clientHeight, 1);
}

function moveTarget(canvas, across, down) {
  const { right, up } = eyeOf(state.view), scale = metresPerPixel(canvas);
  const target = add(state.view.target, add(times3(right, -across * scale), times3(up, down * scale)));
  change({ follow: false });
  turnView({ target });
}

// Where people are over the take: the middle, and how far most of it reaches, metres. One person far away, or a wild
// frame, must not make all others small.
function extentOfPeople() {
  const places = people.flatMap((person) =>
    [...Array(frameCount).keys()].filter((frame) => person.valid[frame]).map((frame) => jointAt(person, frame, 0)));
  if (!places.length) return { middle: add([lens.place[0], lens.place[1], 1], [0, 4, 0]), reach: 2 };
  const share = (values, part) => values.sort((a, b) => a - b)[Math.floor(part * (values.length - 1))];
  const [x, y] = [0, 1].map((k) => share(places.map((place) => place[k]), 0.5));
  return { middle: [x, y, 0.9], reach: share(places.map((place) => Math.hypot(place[0] - x, place[1] - y)), 0.85) };
}

const VIEWPOINTS = {
  fit() {
    const { middle, reach } = extentOfPeople();
    return { target: middle, distance: 3.6 + 2.6 * reach, yaw: 0.55, pitch: 0.32, ...UPRIGHT };
  },
  // As the footage is seen: tilted as its camera was, and as wide.
  camera() {
    const [right, , forward] = lensAxes, { middle } = extentOfPeople();
    const distance = Math.max(1, dot(subtract(middle, lens.place), forward));
    const yaw = Math.atan2(-forward[0], forward[1]), pitch = Math.asin(clamp(-forward[2], -1, 1));
    const target = add(lens.place, times3(forward, distance));
    const level = eyeOf({ target, distance, yaw, pitch, roll: 0 });
    return { target, distance, yaw, pitch, roll: Math.atan2(dot(right, level.up), dot(right, level.right)), fov: 2 * Math.atan(lens.height / 2 / lens.fy) };
  },
  side() {
    return { ...VIEWPOINTS.fit(), yaw: Math.PI / 2, pitch: 0.06 };
  },
  top() {
    return { ...VIEWPOINTS.fit(), yaw: 0, pitch: Math.PI / 2 };
  },
};

// Mouse, pen and fingers. A press that does not move calls `tapped` with its place.
function controlOrbit(canvas, tapped) {
  const held = new Map();
  let moved = 0;

  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    if (!held.size) moved = 0;
    held.set(event.pointerId, [event.clientX, event.clientY]);
    canvas.parentElement.focus({ preventScroll: true });
  });

  canvas.addEventListener("pointermove", (event) => {
    const before = held.get(event.pointerId);
    if (!before) return;
    const now = [event.clientX, event.clientY];
    const [across, down] = [now[0] - before[0], now[1] - before[1]];
    moved += Math.abs(across) + Math.abs(down);
    if (held.size === 1) {
      if (event.shiftKey || event.buttons & 6) moveTarget(canvas, across, down);
      else turnView({ yaw: state.view.yaw - across * 0.008, pitch: state.view.pitch + down * 0.008, roll: 0 });
    } else {
      pinch(event.pointerId, before, now);
    }
    held.set(event.pointerId, now);
  });

  function pinch(id, before, now) {
    const other = [...held].find(([key]) => key !== id)[1];
    const spread = (place) => Math.max(8, Math.hypot(place[0] - other[0], place[1] - other[1]));
    moveTarget(canvas, (now[0] - before[0]) / 2, (now[1] - before[1]) / 2);
    turnView({ distance: (state.view.distance * spread(before)) / spread(now) });
  }

  function release(event) {
    if (held.delete(event.pointerId) && event.type === "pointerup" && moved < 5 && !held.size) {
      const box = canvas.getBoundingClientRect();
      tapped([event.clientX - box.left, event.clientY - box.top]);
    }
  }
  canvas.addEventListener("pointerup", release);
  canvas.addEventListener("pointercancel", release);
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    const lines = event.deltaMode === 1 ? 16 : 1;
    turnView({ distance: state.view.distance * Math.exp(clamp(event.deltaY * lines, -200, 200) * 0.0015) });
  }, { passive: false });
}
