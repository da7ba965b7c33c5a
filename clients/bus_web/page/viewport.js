// The part of the graph in sight: its size, its place, and a small map of the whole.

import { element, setAttribute, svg } from "./dom.js";

const LEAST = 0.1, MOST = 2, STEP = 1.25;
const READABLE = 0.7; // by itself the graph gets no smaller

export class Viewport {
  // `place` scrolls `root`, the picture. Buttons and the map go into `bar`.
  constructor(place, root, bar) {
    this.place = place;
    this.root = root;
    this.box = { x: 0, y: 0, width: 0, height: 0 }; // what the picture covers, in its own units
    this.scale = 1;
    this.mode = "auto"; // or "fit": all of it; or "chosen": a size by the user
    const button = (text, label, press) => element("button", { type: "button", "aria-label": label, title: label, onclick: press }, text);
    this.fitButton = button("Fit", "Fit the graph (0)", () => this.fit());
    bar.append(this.makeMap(), element("div", { class: "zoom", role: "group", "aria-label": "Size of the graph" },
      this.fitButton, button("−", "Smaller (-)", () => this.zoom(1 / STEP)), button("+", "Larger (+)", () => this.zoom(STEP))));
    place.addEventListener("scroll", () => this.drawFrame(), { passive: true });
    place.addEventListener("keydown", (event) => this.press(event));
    place.addEventListener("wheel", (event) => this.turn(event), { passive: false });
    new ResizeObserver(() => this.resize()).observe(place);
  }

  makeMap() {
    this.shapes = svg("path", { class: "shapes" });
    this.lossy = svg("path", { class: "lossy" });
    this.here = svg("path", { class: "here" });
    this.frame = svg("rect", { class: "frame" });
    this.map = svg("svg", { class: "map", "aria-hidden": "true" }, this.shapes, this.lossy, this.here, this.frame);
    const go = (event) => {
      if (!event.buttons) return;
      const at = new DOMPoint(event.clientX, event.clientY).matrixTransform(this.map.getScreenCTM().inverse());
      this.centre(at.x, at.y);
    };
    this.map.addEventListener("pointerdown", (event) => { this.map.setPointerCapture(event.pointerId); go(event); });
    this.map.addEventListener("pointermove", go);
    return this.map;
  }

  // A new picture.
  cover(box) {
    this.box = box;
    for (const one of [this.root, this.map]) setAttribute(one, "viewBox", `${box.x} ${box.y} ${box.width} ${box.height}`);
    this.resize();
  }

  // Boxes on the map: all of them, those of topics that have lost messages, and the chosen one.
  drawMap(boxes) {
    const path = (some) => some.map(({ x, y, width, height }) => `M${x - width / 2} ${y - height / 2}h${width}v${height}h${-width}z`).join("");
    setAttribute(this.shapes, "d", path(boxes));
    setAttribute(this.lossy, "d", path(boxes.filter((one) => one.isLossy)));
    setAttribute(this.here, "d", path(boxes.filter((one) => one.isChosen)));
  }

  resize() {
    const { width, height } = this.box;
    if (!width || !this.place.clientWidth) return;
    const wide = this.place.clientWidth / width, high = (parseFloat(getComputedStyle(this.place).maxHeight) || Infinity) / height;
    if (this.mode === "auto") this.scale = Math.min(1, Math.max(READABLE, wide));
    if (this.mode === "fit") this.scale = Math.max(LEAST, Math.min(1, wide, high));
    setAttribute(this.root, "width", Math.floor(width * this.scale));
    setAttribute(this.root, "height", Math.floor(height * this.scale));
    setAttribute(this.fitButton, "aria-pressed", this.mode === "fit");
    this.drawFrame();
  }

  drawFrame() {
    const { x, y, width, height } = this.box, { scrollLeft, scrollTop, clientWidth, clientHeight, scrollWidth, scrollHeight } = this.place;
    const isWhole = scrollWidth <= clientWidth + 1 && scrollHeight <= clientHeight + 1;
    this.map.toggleAttribute("hidden", isWhole);
    if (isWhole) return;
    setAttribute(this.frame, "x", x + scrollLeft / this.scale);
    setAttribute(this.frame, "y", y + scrollTop / this.scale);
    setAttribute(this.frame, "width", Math.min(width, clientWidth / this.scale));
    setAttribute(this.frame, "height", Math.min(height, clientHeight / this.scale));
  }

  fit() {
    this.mode = this.mode === "fit" ? "auto" : "fit";
    this.resize();
  }

  // `at`: the point of the picture that stays in its place, in pixels of `place`; else the middle.
  zoom(by, at = { x: this.place.clientWidth / 2, y: this.place.clientHeight / 2 }) {
    const scale = Math.min(MOST, Math.max(LEAST, this.scale * by)), grown = scale / this.scale;
    const left = (this.place.scrollLeft + at.x) * grown - at.x, top = (this.place.scrollTop + at.y) * grown - at.y;
    this.mode = "chosen";
    this.scale = scale;
    this.resize();
    this.place.scrollTo(left, top);
  }

  press(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const act = { "+": () => this.zoom(STEP), "=": () => this.zoom(STEP), "-": () => this.zoom(1 / STEP), "0": () => this.fit() }[event.key];
    if (!act) return;
    event.preventDefault();
    act();
  }

  // The wheel with Ctrl, or two fingers on a touchpad; without, it scrolls.
  turn(event) {
    if (!event.ctrlKey) return;
    event.preventDefault();
    const { left, top } = this.place.getBoundingClientRect();
    this.zoom(Math.exp(-event.deltaY / 300), { x: event.clientX - left, y: event.clientY - top });
  }

  centre(x, y) {
    this.place.scrollTo((x - this.box.x) * this.scale - this.place.clientWidth / 2, (y - this.box.y) * this.scale - this.place.clientHeight / 2);
  }

  // Whether all of a box is in sight.
  has({ x, y, width, height }) {
    const left = (x - width / 2 - this.box.x) * this.scale - this.place.scrollLeft, top = (y - height / 2 - this.box.y) * this.scale - this.place.scrollTop;
    return left >= 0 && top >= 0 && left + width * this.scale <= this.place.clientWidth && top + height * this.scale <= this.place.clientHeight;
  }

  show(box) {
    if (!this.has(box)) this.centre(box.x, box.y);
  }
}
