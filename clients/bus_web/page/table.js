// A row for each topic, changed in place; sorted when a heading is chosen, so that no row moves under a finger.

import { SECONDS } from "./bus.js";
import { Kept, element, setAttribute, setChildren, setText, svg } from "./dom.js";
import { ages, count, plural, rate, shortType, size } from "./format.js";
import { bars } from "./losses.js";

const PAGE = 100;
const WIDTH = 72, HEIGHT = 14, STRIP = 6; // of the line, and of the bars below it, whose room is always there: no row moves

const routesOf = (topic) => [...new Set(topic.subscriptions.flatMap((end) => [...end.routes]))].sort();
const queue = ({ queued, depth }) => (depth === null ? count(queued) : `${count(queued)}/${count(depth)}`);
// By need: a narrow window shows the first ones.
const COLUMNS = [
  ["Topic", (topic) => topic.name, null],
  ["Hz", (topic) => topic.hz ?? -1, (topic) => rate(topic.hz)],
  ["Lost", (topic) => topic.lost, (topic) => (topic.lost ? count(topic.lost) : "0")],
  ["Why", why, why],
  ["Lost/s", (topic) => topic.lostPerS, (topic) => (topic.lostPerS ? rate(topic.lostPerS) : "")],
  ["60 s", null, null],
  ["Age", (topic) => topic.age?.[0] ?? -1, (topic) => ages(topic.age)],
  ["Queue", (topic) => topic.queued, (topic) => (topic.subscriptions.length ? queue(topic) : "")],
  ["B/s", (topic) => topic.bytesPerS ?? -1, (topic) => size(topic.bytesPerS)],
  ["Pub", (topic) => topic.publishers.length, (topic) => topic.publishers.length],
  ["Sub", (topic) => topic.subscriptions.length, (topic) => topic.subscriptions.length],
  ["Route", (topic) => routesOf(topic).join(), (topic) => routesOf(topic).join(", ")],
  ["Type", (topic) => topic.types[0] ?? "", (topic) => topic.types.map(shortType).join(" and ")],
];
const HINTS = { Age: "half of the messages / 99 % of them were at most so old when a program took them" };
const placeOf = (wanted) => COLUMNS.findIndex(([title]) => title === wanted);
const SPARK = placeOf("60 s"), TYPE = placeOf("Type");
const NUMBERS = new Set(["Hz", "B/s", "Pub", "Sub", "Queue", "Age", "Lost/s", "Lost"]);

export class Table {
  constructor(table, pages, choose) {
    this.head = table.tHead.rows[0];
    this.body = table.tBodies[0];
    this.pages = pages;
    this.choose = choose;
    this.sort = 0;
    this.isReverse = false;
    this.page = 0;
    this.order = [];
    this.isSorted = false;
    this.rows = new Kept((name) => this.makeRow(name));
    COLUMNS.forEach(([title, value], at) => {
      const label = value ? element("button", { type: "button", onclick: () => this.sortBy(at), title: HINTS[title] ?? null }, title) : title;
      this.head.append(element("th", { scope: "col", "data-column": title, class: NUMBERS.has(title) ? "number" : null }, label));
    });
    const step = (text, by) => element("button", { type: "button", onclick: () => this.turn(by) }, text);
    this.back = step("Previous", -1);
    this.where = element("span");
    this.next = step("Next", 1);
    pages.append(this.back, this.where, this.next);
  }

  sortBy(at) {
    this.isReverse = this.sort === at ? !this.isReverse : at !== 0;
    this.sort = at;
    this.isSorted = false;
    this.page = 0;
    this.again();
  }

  turn(by) {
    this.page += by;
    this.again();
  }

  again() {
    if (this.bus) this.show(this.bus, this.view);
  }

  show(bus, view) {
    Object.assign(this, { bus, view });
    const key = `${bus.structure} ${view.filter} ${view.hidden}`;
    if (key !== this.key || !this.isSorted) this.arrange(bus, view, key);
    const last = Math.max(0, Math.ceil(this.order.length / PAGE) - 1);
    this.page = Math.min(Math.max(this.page, 0), last);
    const names = this.order.slice(this.page * PAGE, (this.page + 1) * PAGE).filter((name) => bus.topics.has(name));
    const rows = this.rows.only(names);
    setChildren(this.body, rows.map((one) => one.row));
    rows.forEach((row, at) => row.paint(bus.topics.get(names[at]), view));
    this.pages.hidden = last === 0;
    setText(this.where, ` page ${this.page + 1} of ${last + 1} `);
    this.back.disabled = this.page === 0;
    this.next.disabled = this.page === last;
    [...this.head.cells].forEach((cell, at) =>
      setAttribute(cell, "aria-sort", at === this.sort ? (this.isReverse ? "descending" : "ascending") : null));
  }

  arrange(bus, view, key) {
    const value = COLUMNS[this.sort][1];
    const shown = [...bus.topics.values()].filter((topic) => view.shows(topic));
    const known = new Map(this.isSorted ? this.order.map((name, at) => [name, at]) : []);
    const compare = (one, other) => {
      const before = value(one), after = value(other);
      const order = before < after ? -1 : before > after ? 1 : 0;
      return (this.isReverse ? -order : order) || (one.name < other.name ? -1 : 1);
    };
    // Those that were there keep their places, but for the order by name, in which none ever moves.
    shown.sort((one, other) => {
      const [first, second] = [known.get(one.name), known.get(other.name)];
      if (this.sort === 0 || (first === undefined && second === undefined)) return compare(one, other);
      return (first ?? Infinity) - (second ?? Infinity);
    });
    this.order = shown.map((topic) => topic.name);
    this.key = key;
    this.isSorted = true;
  }

  makeRow(name) {
    const button = element("button", { type: "button", class: "name", onclick: () => this.choose(name) }, name);
    const line = svg("polyline", { fill: "none" });
    const strip = svg("path", { class: "strip" });
    const spark = svg("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT + STRIP}`, width: WIDTH, height: HEIGHT + STRIP, role: "img", class: "spark" }, line, strip);
    const cells = COLUMNS.map(([title], at) =>
      element(at ? "td" : "th", { scope: at ? null : "row", "data-column": title, class: NUMBERS.has(title) ? "number" : null }));
    cells[0].append(button);
    cells[SPARK].append(spark);
    const row = element("tr", { "data-topic": name }, ...cells);
    row.addEventListener("click", (event) => event.target.closest("button") || this.choose(name));
    return {
      row,
      paint: (topic, view) => {
        COLUMNS.forEach(([, , text], at) => text && setText(cells[at], text(topic)));
        setAttribute(cells[TYPE], "title", topic.types.join(" and "));
        drawSpark(line, topic.history);
        const lost = topic.lostHistory.reduce((sum, one) => sum + one, 0);
        setAttribute(strip, "d", bars(topic.lostHistory, SECONDS, WIDTH, STRIP - 1, HEIGHT + STRIP));
        setAttribute(spark, "aria-label", `Hz of the last minute, ${rate(Math.max(0, ...topic.history))} at most`
          + (lost ? `; ${plural(Math.round(lost), "message")} lost` : ""));
        const isChosen = view.topic === name;
        setAttribute(button, "aria-pressed", isChosen);
        setAttribute(row, "class", [isChosen && "chosen", topic.lostPerS ? "losing" : topic.lost ? "lost" : ""].filter(Boolean).join(" ") || null);
      },
    };
  }
}

// The reason of most losses, and whether pairs do not match; Lost and Lost/s say the rest.
function why({ lost, lostPerS, why: reason, cut }) {
  const loss = lost ? `${lostPerS ? "now: " : ""}${reason.replaceAll("_", " ")}` : "";
  return [loss, cut ? (cut === 1 ? "no match" : `${count(cut)} no match`) : ""].filter(Boolean).join("; ");
}

// From zero to a quarter above the most, so that a steady rate is a line and no block.
function drawSpark(line, values) {
  const most = 1.25 * Math.max(...values, 0) || 1;
  const first = SECONDS - values.length;
  const points = values.map((value, at) =>
    `${(((first + at) * WIDTH) / (SECONDS - 1)).toFixed(1)},${(HEIGHT - 1 - (value / most) * (HEIGHT - 2)).toFixed(1)}`);
  setAttribute(line, "points", points.join(" "));
}
