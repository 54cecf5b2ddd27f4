// Puts the page together.

function buttons(id, options) {
  const group = document.getElementById(id);
  return options.map(({ text, press, pressed, label }) => {
    const button = node("button", "", text);
    button.type = "button";
    if (label) button.title = label;
    button.addEventListener("click", press);
    if (pressed) whenDrawn(() => button.setAttribute("aria-pressed", Boolean(pressed())));
    group.append(button);
    return button;
  });
}

function showControls() {
  const overlay = (name) => ({ press: () => change({ overlay: name }), pressed: () => state.overlay === name });
  buttons("overlay-styles", [
    { text: "Bodies", ...overlay("bodies") }, { text: "Bones", ...overlay("bones") }, { text: "None", ...overlay("none") },
  ]);
  const go = (name) => () => {
    change({ follow: false });
    turnView(VIEWPOINTS[name]());
  };
  buttons("viewpoints", [
    { text: "Fit", press: go("fit"), label: "Everybody, from in front" },
    { text: "Camera", press: go("camera"), label: "As the footage's camera looks" },
    { text: "Side", press: go("side") }, { text: "Top", press: go("top") },
    { text: "Follow", press: () => change({ follow: !state.follow }), pressed: () => state.follow, label: "Stay with the chosen person" },
  ]);
  const layer = (name) => ({
    press: () => change({ layers: { ...state.layers, [name]: !state.layers[name] } }), pressed: () => state.layers[name],
  });
  buttons("layers", [
    { text: "Bodies", ...layer("bodies") }, { text: "Bones", ...layer("bones") }, { text: "Cloud", ...layer("cloud") },
    { text: "Paths", ...layer("paths") }, { text: "Names", ...layer("names") },
  ]);
  const opacity = document.getElementById("opacity");
  opacity.addEventListener("input", () => change({ opacity: opacity.value / 100 }));
}

sayFacts();
state.view = { ...state.view, ...VIEWPOINTS.fit() };
showControls();
const footageView = new FootageView();
const space = new Space();
const chartRoom = document.getElementById("charts");
const charts = [
  ...MEASURES.slice(0, 2).map((measure) => new MeasureChart(chartRoom, measure)),
  new ContactChart(chartRoom),
  ...MEASURES.slice(2).map((measure) => new MeasureChart(chartRoom, measure)),
];
const parts = [footageView, space, new TopView(), ...charts, new PeoplePanel(), new FindingsPanel(), new Transport()];
for (const part of parts) whenDrawn(() => part.draw());
addEventListener("resize", redraw);
addEventListener("scroll", redraw, { passive: true });
document.getElementById("space-view").addEventListener("pointerdown", () => {
  document.getElementById("space-hint").hidden = true;
}, { once: true });
redraw();

// For tests and for whoever wants to drive the page from the console.
window.report = {
  state, seek: scrubTo, play, pause, choose, turnView, frameCount, people,
  kind: () => space.kind,
  shownPicture: () => footageView.shown,
  project: (point) => space.projector()(point),
  throughLens,
};
