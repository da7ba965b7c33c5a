// The bar of a bag that is played: play, pause, step, speed, position; and when messages were lost in it.
// The player decides everything: this sends requests, and shows the states that come back.

import { element, setAttribute, setText, svg } from "./dom.js";
import { bars } from "./losses.js";
import { count, plural, reasons } from "./format.js";

const WIDTH = 1000, HEIGHT = 26, DAY_MS = 86400e3, MOST_SHOWN = 6;
const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 4, 10];
const WORDS = { playing: "playing", paused: "paused", reading: "reading", "at end": "at the end" };

export class Playback {
  // `ask` sends an object with requests to the player; `jumped()` is called after each seek.
  constructor(root, ask, jumped) {
    this.root = root;
    this.ask = ask;
    this.jumped = jumped;
    this.recording = null;
    this.state = null;
    this.wanted = null; // a position asked for, until the player is there
    this.next = null; // the position to ask for after that
    this.play = element("button", { type: "button", class: "play", onclick: () => this.toggle() }, "Play bag");
    this.step = element("button", { type: "button", onclick: () => this.ask({ step: true }) }, "Next message");
    this.speed = element("select", { onchange: () => this.ask({ rate: Number(this.speed.value) }) });
    this.name = element("b");
    this.status = element("span", { role: "status" });
    this.time = element("span", { class: "time" });
    this.slider = element("input", { type: "range", min: 0, value: 0, "aria-label": "Position in the bag, in seconds", oninput: () => this.seek(Number(this.slider.value)) });
    this.path = svg("path");
    this.strip = svg("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, class: "lost-strip", role: "img", preserveAspectRatio: "none" }, this.path);
    this.note = element("span");
    this.bursts = element("ol", { class: "lost-bursts", "aria-label": "Bursts of losses: go to one" });
    root.append(
      element("div", { class: "controls" }, this.play, this.step, element("label", {}, "Speed ", this.speed), this.time, this.name, this.status),
      element("div", { class: "line" }, this.strip, this.slider),
      element("div", { class: "note" }, this.note, this.bursts),
    );
  }

  setRecording(told) {
    this.recording = told;
    Object.assign(this, { state: null, wanted: null, next: null }); // the player of another start, perhaps
    this.root.hidden = false;
    setText(this.name, told.name);
    setAttribute(this.slider, "max", told.span_s);
    setAttribute(this.slider, "step", stepFor(told.span_s));
    this.showLosses();
  }

  setState(told) {
    const before = this.state;
    this.state = told;
    if (before && told.seeks !== before.seeks) {
      this.jumped();
      if (this.wanted !== null) this.arrived();
    }
    setText(this.play, told.status === "playing" || (told.status === "reading" && before?.status === "playing") ? "Pause bag" : "Play bag");
    this.step.disabled = told.status !== "paused";
    this.showSpeed(told.rate);
    if (this.wanted === null) this.slider.value = told.at_s;
    this.showTime();
    setText(this.status, WORDS[told.status] ?? told.status);
    setAttribute(this.status, "class", null);
  }

  refused(told) {
    setText(this.status, told.text);
    setAttribute(this.status, "class", "refused");
    if (this.wanted !== null) this.arrived();
  }

  toggle() {
    this.ask({ paused: this.play.textContent === "Pause bag" });
  }

  // A drag has many positions: the next one is asked for when the player is at the one before.
  seek(at_s) {
    if (this.wanted === null) {
      this.wanted = at_s;
      this.ask({ at_s });
    } else this.next = at_s;
    this.showTime();
  }

  arrived() {
    const next = this.next;
    Object.assign(this, { wanted: null, next: null });
    if (next !== null) this.seek(next);
  }

  showTime() {
    const at = this.next ?? this.wanted ?? this.state?.at_s ?? 0;
    const text = `${duration(at)} / ${duration(this.recording.span_s)}`;
    setText(this.time, this.clock(at) ? `${text}, ${this.clock(at)}` : text);
    setAttribute(this.slider, "aria-valuetext", `${at.toFixed(1)} s`);
  }

  showSpeed(rate) {
    const speeds = SPEEDS.includes(rate) ? SPEEDS : [...SPEEDS, rate].sort((one, other) => one - other);
    if (this.speed.options.length !== speeds.length || ![...this.speed.options].some((one) => Number(one.value) === rate))
      this.speed.replaceChildren(...speeds.map((one) => element("option", { value: one }, `${Number(one.toPrecision(3))}×`)));
    this.speed.value = String(rate);
  }

  showLosses() {
    const { losses, more } = this.recording;
    const topics = losses ?? [];
    this.strip.toggleAttribute("hidden", !topics.length);
    this.bursts.replaceChildren();
    if (losses === null) setText(this.note, "This bag has no record of losses: only bus bag record writes one.");
    else if (!topics.length) setText(this.note, "The recorder lost no messages.");
    else {
      const sums = topics[0].bars.map((_, at) => topics.reduce((all, one) => all + one.bars[at], 0));
      setAttribute(this.path, "d", bars(sums, sums.length, WIDTH, HEIGHT - 1, HEIGHT));
      // The bars begin with a whole second, and the bag does not.
      const { begin_s, width_s } = topics[0], span = Math.max(this.recording.span_s, 0.001);
      setAttribute(this.path, "transform", `translate(${(begin_s / span) * WIDTH} 0) scale(${(width_s * sums.length) / span} 1)`);
      const lines = topics.slice(0, 3).map((one) => `${one.topic} lost ${count(one.lost)} of ${count(one.expected)}`);
      const others = topics.length + more - lines.length;
      setText(this.note, `While recording: ${lines.join("; ")}${others ? `; and ${plural(others, "more topic")}` : ""}`);
      setAttribute(this.strip, "aria-label", `Messages that the recorder lost over the time of the bag, at most ${count(Math.round(Math.max(...sums)))} in ${plural(width_s, "second")}`);
      const bursts = topics.flatMap((one) => one.bursts.map(([at, span_s, lost]) => ({ at, span_s, lost, topic: one.topic }))).sort((one, other) => one.at - other.at);
      this.bursts.append(...bursts.slice(0, MOST_SHOWN).map((one) => this.burst(one)));
      if (bursts.length > MOST_SHOWN) {
        const all = element("button", { type: "button", onclick: () => this.bursts.replaceChildren(...bursts.map((one) => this.burst(one))) }, `${bursts.length - MOST_SHOWN} more`);
        this.bursts.append(element("li", {}, all));
      }
    }
  }

  burst({ at, span_s, lost, topic }) {
    const start = Math.max(0, Math.min(at, this.recording.span_s));
    const text = `${this.clock(start) || duration(start)}${span_s > 1 ? `, ${span_s} s` : ""}: ${topic} lost ${reasons(lost)}`;
    return element("li", {}, element("button", { type: "button", onclick: () => this.seek(start) }, text));
  }

  // The time of day; nothing in a bag of simulated time, which begins near 0.
  clock(at_s) {
    const ms = Math.round(this.recording.start_ms + at_s * 1000);
    return ms < DAY_MS ? "" : new Date(ms).toTimeString().slice(0, 8);
  }
}

function duration(seconds) {
  const whole = Math.floor(seconds), part = Math.floor((seconds - whole) * 10);
  const [h, m, s] = [Math.floor(whole / 3600), Math.floor(whole / 60) % 60, whole % 60];
  return `${h ? `${h}:${String(m).padStart(2, "0")}` : m}:${String(s).padStart(2, "0")}.${part}`;
}

// A key moves the position by about a two-hundredth of the bag.
function stepFor(span_s) {
  const least = span_s / 200;
  return [0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 30, 60, 300, 600].find((step) => step >= least) ?? 3600;
}
