// How old messages were when programs took them: a histogram of the last ten seconds.

import { element, setAttribute, setText, svg } from "./dom.js";
import { age, ages, plural } from "./format.js";
import { bars } from "./losses.js";

const WIDTH = 320, HEIGHT = 34;

export class Ages {
  constructor() {
    this.path = svg("path");
    this.picture = svg("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: "img", class: "past ages", preserveAspectRatio: "none" }, this.path);
    this.from = element("span");
    this.middle = element("span");
    this.to = element("span");
    this.root = element("div", { hidden: true }, element("h3", {}, "Age"), this.picture,
      element("div", { class: "axis note" }, this.from, this.middle, this.to));
  }

  show(topic) {
    const parts = topic.ages;
    this.root.hidden = !parts;
    if (!parts) return;
    const numbers = parts.map(([, , number]) => number);
    setAttribute(this.path, "d", bars(numbers, numbers.length, WIDTH, HEIGHT - 1, HEIGHT));
    setText(this.from, parts[0][0] ? age(parts[0][0]) : "0");
    setText(this.to, age(parts.at(-1)[1]));
    const both = topic.age?.[1] ? `half / 99 %: ${ages(topic.age)}` : "";
    setText(this.middle, both);
    const sum = numbers.reduce((all, one) => all + one, 0);
    setAttribute(this.picture, "aria-label", `Ages of ${plural(sum, "message")} from ${this.from.textContent} to ${this.to.textContent}; ${both}`);
  }
}
