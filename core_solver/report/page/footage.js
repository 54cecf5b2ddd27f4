// The footage with bodies or bones drawn over it, through the lens of its camera.

const KEPT_PICTURES = 48;
const AHEAD = 6;  // pictures decoded before they are needed

// Decodes the JPEG pictures inside the page when they are wanted.
class Pictures {
  constructor(footage) {
    this.footage = footage;
    this.data = codes(footage.data);
    this.decoded = new Map();  // in the order of use
  }

  // The picture of a frame of the take: the last one at or before it.
  numberOf(frame) {
    const { frames } = this.footage;
    let number = Math.min(frames.length - 1, Math.floor((frame / Math.max(frameCount - 1, 1)) * frames.length));
    while (number > 0 && frames[number] > frame) number--;
    while (number + 1 < frames.length && frames[number + 1] <= frame) number++;
    return number;
  }

  // The decoded picture, or undefined until it is; then everything is drawn again.
  get(number) {
    for (let next = number; next <= Math.min(number + AHEAD, this.footage.frames.length - 1); next++) this.request(next);
    const picture = this.decoded.get(number);
    return picture instanceof ImageBitmap ? picture : undefined;
  }

  request(number) {
    const known = this.decoded.get(number);
    if (known) {
      this.decoded.delete(number);
      this.decoded.set(number, known);
      return;
    }
    const { starts } = this.footage;
    const file = new Blob([this.data.subarray(starts[number], starts[number + 1])], { type: "image/jpeg" });
    this.decoded.set(number, "coming");
    createImageBitmap(file).then((picture) => {
      this.decoded.set(number, picture);
      this.forgetOldest();
      redraw();
    });
  }

  forgetOldest() {
    for (const [number, picture] of this.decoded) {
      if (this.decoded.size <= KEPT_PICTURES) return;
      if (picture === "coming") continue;
      picture.close();
      this.decoded.delete(number);
    }
  }
}

class FootageView {
  constructor() {
    this.view = document.getElementById("footage-view");
    this.frame = document.getElementById("footage-frame");
    this.picture = document.getElementById("picture");
    this.overlay = document.getElementById("overlay");
    this.pictures = page.footage ? new Pictures(page.footage) : null;
    this.labels = new Labels(document.getElementById("footage-labels"));
    this.shown = -1;
    document.documentElement.style.setProperty("--aspect", (lens.width / lens.height).toFixed(5));
    if (page.no_footage) {
      const empty = document.getElementById("footage-empty");
      empty.textContent = page.no_footage;
      empty.hidden = false;
    }
    this.begin(true);
    this.frame.addEventListener("click", (event) => {
      const box = this.frame.getBoundingClientRect();
      choose(personAt([event.clientX - box.left, event.clientY - box.top], this.projector()));
    });
  }

  begin(tryWebgl) {
    this.gl = tryWebgl ? openStage(this.overlay, true) : null;
    this.bones = document.createElement("canvas");  // bones are always drawn flat, on a canvas of their own
    this.overlay.after(this.bones);
    this.flat = this.bones.getContext("2d");
    if (!this.gl) return;
    this.bodies = new Bodies(this.gl);
    this.overlay.addEventListener("webglcontextlost", () => {
      this.gl = null;
      this.overlay.hidden = true;
      redraw();
    });
  }

  // World points to [x, y, depth, pixels a metre] of the footage as it stands on the page.
  projector() {
    const scale = this.frame.clientWidth / lens.width;
    return (point) => {
      const seen = throughLens(point);
      return seen && [seen[0] * scale, seen[1] * scale, seen[2], (lens.fx * scale) / seen[2]];
    };
  }

  draw() {
    if (!isOnScreen(this.view)) return;
    this.fitFrame();
    this.drawPicture();
    if (!fitCanvas(this.bones)) return;
    const bodies = state.overlay === "bodies" && this.gl;
    this.overlay.style.opacity = bodies ? state.opacity : 0;
    this.bones.style.opacity = state.opacity;
    if (bodies) this.drawBodies();
    this.drawBones(!bodies && state.overlay !== "none");
    this.labels.draw(this.projector(), this.frame.clientWidth, this.frame.clientHeight, state.layers.names && state.overlay !== "none");
  }

  // The footage keeps its shape inside the room there is.
  fitFrame() {
    const width = Math.floor(Math.min(this.view.clientWidth, (this.view.clientHeight * lens.width) / lens.height));
    this.frame.style.width = `${width}px`;
    this.frame.style.height = `${Math.round((width * lens.height) / lens.width)}px`;
  }

  drawPicture() {
    if (!this.pictures) return;
    const number = this.pictures.numberOf(state.frame);
    const picture = number === this.shown ? undefined : this.pictures.get(number);
    if (!picture) return;
    Object.assign(this.picture, { width: page.footage.width, height: page.footage.height });
    this.picture.getContext("2d").drawImage(picture, 0, 0);
    this.shown = number;
  }

  drawBodies() {
    const { gl, overlay } = this;
    if (!fitCanvas(overlay)) return;
    gl.viewport(0, 0, overlay.width, overlay.height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    const [right, down, forward] = lensAxes;
    const farthest = 1.1 * Math.max(1, ...people.map((person) => dot(forward, subtract(jointAt(person, state.frame, 0), lens.place)) + 2));
    const view = viewMatrix(right, down, forward, lens.place);
    this.bodies.draw({ view, projection: view, lens: true, farthest, light: unit([-0.35, -0.6, -0.72]) }, 0.3);
  }

  drawBones(shown) {
    const { flat, bones } = this, sharp = bones.width / bones.clientWidth;
    flat.setTransform(sharp, 0, 0, sharp, 0, 0);
    flat.clearRect(0, 0, bones.clientWidth, bones.clientHeight);
    if (shown) sketchSkeletons(flat, this.projector(), THICKNESS / 2);
  }
}
