// When messages were lost: bars, and sentences about the newest bursts.

import { element, setAttribute, setChildren, setText, svg } from "./dom.js";
import { count, plural, reasons } from "./format.js";

// A path of bars, the last of them at the right edge; `most` values fill the width. The highest bar has the full height.
export function bars(values, most, width, height, bottom) {
  const top = Math.max(0, ...values);
  if (!top) return "";
  const step = width / most, first = most - values.length;
  return values.map((value, at) => {
    if (!value) return "";
    const tall = Math.max(1, (value / top) * height);
    return `M${((first + at) * step).toFixed(1)},${bottom}v${(-tall).toFixed(1)}h${Math.max(1, step - 0.4).toFixed(1)}v${tall.toFixed(1)}z`;
  }).join("");
}

const WIDTH = 320, HEIGHT = 34;

// What is known of a topic's losses, for the chosen topic.
export class Losses {
  constructor() {
    this.path = svg("path");
    this.picture = svg("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: "img", class: "past", preserveAspectRatio: "none" }, this.path);
    this.from = element("span");
    this.to = element("span", {}, "now");
    this.axis = element("div", { class: "axis note" }, this.from, this.to);
    this.list = element("ul", { class: "bursts", "aria-label": "Bursts of losses, the newest first" });
    this.root = element("div", { hidden: true }, element("h3", {}, "Losses"), this.picture, this.axis, this.list);
  }

  show(topic) {
    const past = topic.past;
    this.root.hidden = !past;
    if (!past) return;
    const span = past.width_s * past.bars.length;
    const timed = past.bursts.length > 0;
    this.picture.toggleAttribute("hidden", !timed);
    this.axis.hidden = !timed;
    setAttribute(this.path, "d", bars(past.bars, past.bars.length, WIDTH, HEIGHT - 1, HEIGHT));
    setText(this.from, `${clock(span)} (${ago(span)})`);
    setAttribute(this.picture, "aria-label", `Messages lost over the last ${ago(span).replace(" ago", "")}, at most ${count(Math.round(Math.max(0, ...past.bars)))} in a bar`);
    const lines = past.bursts.map(([age, span, lost]) => `${clock(age)}${span > 1 ? `, ${span} s` : ""}: lost ${reasons(lost)}`).reverse();
    if (Object.keys(past.earlier).length) lines.push(`before that, time unknown: lost ${reasons(past.earlier)}`);
    while (this.list.children.length < lines.length) this.list.append(element("li"));
    setChildren(this.list, [...this.list.children].slice(0, lines.length));
    lines.forEach((line, at) => setText(this.list.children[at], line));
  }
}

const clock = (seconds) => new Date(Date.now() - seconds * 1000).toTimeString().slice(0, 8);

function ago(seconds) {
  if (seconds < 120) return `${plural(Math.round(seconds), "second")} ago`;
  if (seconds < 7200) return `${plural(Math.round(seconds / 60), "minute")} ago`;
  return `${plural(Math.round(seconds / 3600), "hour")} ago`;
}
