// The bar of a bag that is played. The player decides: this sends requests, and shows the states that come back.

import { element, setAttribute, setText, svg } from "./dom.js";
import { bars } from "./losses.js";

export class Bag {
  // `ask` sends requests to the player.
  constructor(root, ask) {
    Object.assign(this, { root, ask });
    this.button = (text, onclick) => element("button", { type: "button", onclick }, text);
    this.play = this.button("", () => ask({ paused: !this.now.paused }));
    this.step = this.button("Next message", () => ask({ step: true }));
    this.speed = element("input", { type: "number", min: 0.1, step: 0.1, onchange: () => ask({ rate: Number(this.speed.value) }) });
    this.time = element("span");
    this.status = element("span", { role: "status" });
    this.path = svg("path");
    this.strip = svg("svg", { viewBox: "0 0 120 26", class: "past", role: "img", "aria-label": "Losses while recording", preserveAspectRatio: "none" }, this.path);
    this.slider = element("input", { type: "range", step: "any", "aria-label": "Position", oninput: () => this.seek(Number(this.slider.value)) });
    this.note = element("p", { class: "note" });
    this.bursts = element("p");
    root.append(element("p", {}, this.play, this.step, element("label", {}, "Speed ", this.speed), this.time, this.status), this.strip, this.slider, this.note, this.bursts);
  }

  open(told) {
    Object.assign(this, { recording: told, now: null, wanted: null, next: null });
    this.root.hidden = false;
    setText(this.note, told.note);
    setAttribute(this.slider, "max", told.span_s);
    setAttribute(this.path, "d", bars(told.bars, 120, 120, 25, 26));
    this.strip.toggleAttribute("hidden", !told.bars.length);
    this.bursts.replaceChildren(...told.bursts.map(([at, text]) => this.button(`${this.clock(at)}: ${text}`, () => this.seek(at))));
  }

  // Returns whether the time of the bag has jumped.
  state(told) {
    const before = this.now, jumped = before && told.seeks !== before.seeks;
    this.now = told;
    if (jumped) this.arrived();
    setText(this.play, told.paused ? "Play bag" : "Pause bag");
    this.step.disabled = told.status !== "paused";
    if (told.rate !== before?.rate) this.speed.value = told.rate;
    setText(this.status, told.status);
    this.show();
    return jumped;
  }

  refused(told) {
    setText(this.status, told.text);
    this.speed.value = this.now.rate;
    this.arrived();
  }

  // A drag has many positions: the next one is asked for when the player is at the one before.
  seek(at_s) {
    if (this.wanted === null) this.ask({ at_s: (this.wanted = at_s) });
    else this.next = at_s;
    this.show();
  }

  arrived() {
    const next = this.next;
    this.wanted = this.next = null;
    if (next !== null) this.seek(next);
  }

  show() {
    const at = this.next ?? this.wanted ?? this.now.at_s;
    this.slider.value = at;
    setText(this.time, `${duration(at)} / ${duration(this.recording.span_s)}, ${this.clock(at)}`);
  }

  clock(at_s) {
    const { start_ms } = this.recording;
    return start_ms === null ? duration(at_s) : new Date(Math.round(start_ms + at_s * 1000)).toTimeString().slice(0, 8);
  }
}

function duration(seconds) {
  const tenths = Math.floor(seconds * 10);
  return `${Math.floor(tenths / 600)}:${String(Math.floor(tenths / 10) % 60).padStart(2, "0")}.${tenths % 10}`;
}
