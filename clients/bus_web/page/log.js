// The last lines of /rosout, from a severity on.

import { element, setText } from "./dom.js";
import { count, plural } from "./format.js";

const MOST = 300;
const NAMES = [[50, "Fatal"], [40, "Error"], [30, "Warn"], [20, "Info"], [0, "Debug"]];
const nameOf = (level) => NAMES.find(([least]) => level >= least)[1];

export class Log {
  constructor(list, note, empty, severity) {
    this.list = list;
    this.empty = empty;
    this.note = note;
    this.severity = severity;
    this.leftOut = 0;
    this.held = null; // while it stands still: what has come meanwhile
    severity.addEventListener("change", () => this.choose());
    this.sayEmpty();
  }

  pause(isPaused) {
    const held = this.held ?? [];
    this.held = isPaused ? [] : null;
    if (!isPaused) this.add({ lines: held, left_out: 0 });
  }

  clear() {
    if (this.held) this.held = [];
    this.list.replaceChildren();
    this.sayEmpty();
  }

  add({ lines, left_out: leftOut }) {
    this.leftOut += leftOut;
    if (this.held) {
      this.held = [...this.held, ...lines].slice(-MOST);
      return;
    }
    const isAtEnd = this.list.scrollTop + this.list.clientHeight >= this.list.scrollHeight - 4;
    for (const [ms, level, name, text] of lines.sort(([one], [other]) => one - other)) {
      const time = new Date(ms).toTimeString().slice(0, 8);
      const kind = nameOf(level);
      const line = element("li", { class: kind.toLowerCase(), "data-level": level },
        element("time", {}, time), " ", element("b", {}, kind), " ", element("i", {}, name), " ", element("span", {}, text));
      line.hidden = level < Number(this.severity.value);
      this.list.append(line);
    }
    while (this.list.children.length > MOST) this.list.firstChild.remove();
    if (isAtEnd) this.list.scrollTop = this.list.scrollHeight;
    this.sayEmpty();
    setText(this.note, this.leftOut ? `${count(this.leftOut)} lines arrived too fast and are not shown` : "");
  }

  choose() {
    for (const line of this.list.children) line.hidden = Number(line.dataset.level) < Number(this.severity.value);
    this.sayEmpty();
  }

  // An empty list says in words whether there are no lines, or only lines below the chosen severity.
  sayEmpty() {
    const lines = [...this.list.children], shown = lines.some((line) => !line.hidden);
    this.list.hidden = !shown;
    this.empty.hidden = shown;
    const name = nameOf(Number(this.severity.value));
    setText(this.empty, lines.length ? `No line is ${name} or worse; ${plural(lines.length, "line")} below that.` : "No lines yet: nodes' log lines (/rosout) appear here.");
  }
}
