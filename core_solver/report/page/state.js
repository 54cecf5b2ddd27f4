// The one state that drives every view. Views register how they draw it; a change draws them all at the next refresh.

const state = {
  frame: 0,
  playing: false,
  speed: 1,
  person: null,  // index of the chosen one; null is everybody
  overlay: "bodies",  // or "bones", "none"
  opacity: 0.7,
  layers: { bodies: true, bones: false, cloud: true, paths: true, names: true },
  follow: false,
  view: { target: [0, 0, 1], distance: 6, yaw: 0.5, pitch: 0.35, roll: 0, fov: 0.7 },
};

const views = [];
let refresh = 0;

function whenDrawn(draw) {
  views.push(draw);
}

function change(values) {
  Object.assign(state, values);
  redraw();
}

function redraw() {
  if (!refresh) refresh = requestAnimationFrame(drawAll);
}

function drawAll() {
  refresh = 0;
  for (const draw of views) draw();
}

function seek(frame) {
  const whole = clamp(Math.round(Number(frame) || 0), 0, frameCount - 1);
  if (whole !== state.frame) change({ frame: whole });
}

function choose(person) {
  change({ person: person === null || person === state.person || !people[person] ? null : person });
}

const isFaded = (person) => state.person !== null && state.person !== person.index;
const isFilled = (person) => !person.valid[state.frame];

// --- playing: seconds of the take pass with seconds of the clock ---

let playedAt = 0, takeTime = 0;

function play() {
  if (state.playing || frameCount < 2) return;
  takeTime = times[state.frame === frameCount - 1 ? 0 : state.frame];
  playedAt = performance.now();
  change({ playing: true });
  requestAnimationFrame(playOn);
}

function pause() {
  if (state.playing) change({ playing: false });
}

function playOn(now) {
  if (!state.playing) return;
  takeTime += (Math.max(0, now - playedAt) / 1000) * state.speed;
  playedAt = Math.max(now, playedAt);
  if (takeTime > times[frameCount - 1] + frameInterval()) takeTime = times[0];
  seek(frameAtTime(takeTime));
  requestAnimationFrame(playOn);
}

function frameInterval() {
  return frameCount > 1 ? (times[frameCount - 1] - times[0]) / (frameCount - 1) : 0;
}

// The last frame that begins at or before this second.
function frameAtTime(second) {
  let low = 0, high = frameCount - 1;
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (times[middle] <= second + 1e-6) low = middle; else high = middle - 1;
  }
  return low;
}

// Somebody moves the timeline by hand: playing goes on from there.
function scrubTo(frame) {
  seek(frame);
  takeTime = times[state.frame];
}
