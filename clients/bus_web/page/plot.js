// Numbers over time, one chart for each topic, with the age of its messages beside them.

import { element, setAttribute, setText } from "./dom.js";
import { tick } from "./format.js";
import { numberAt } from "./tree.js";

const SPAN_S = 60, MOST = 4000, HEIGHT = 170;
const COLOURS = ["--plot-1", "--plot-2", "--plot-3", "--plot-4", "--plot-5"];

export class Plots {
  // `changed()` when other numbers are plotted.
  constructor(place, changed) {
    this.place = place;
    this.changed = changed;
    this.charts = new Map();
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.redraw());
    new ResizeObserver(() => this.redraw()).observe(place);
  }

  get paths() {
    return Object.fromEntries([...this.charts].map(([topic, { paths }]) => [topic, paths]));
  }

  pathsOf(topic) {
    return new Set(this.charts.get(topic)?.paths);
  }

  toggle(topic, path) {
    let chart = this.charts.get(topic);
    if (!chart) {
      chart = new Chart(topic, (one) => this.toggle(topic, one));
      this.charts.set(topic, chart);
      this.place.append(chart.figure);
    }
    chart.toggle(path);
    if (!chart.paths.length) {
      chart.remove();
      this.charts.delete(topic);
    }
    this.place.hidden = !this.charts.size;
    this.changed();
  }

  add(told) {
    this.charts.get(told.topic)?.add(told);
  }

  // Forget all values: the time of a bag has jumped.
  clear() {
    for (const chart of this.charts.values()) chart.clear();
  }

  // The messages that each topic has lost in each of the last seconds.
  show(bus) {
    for (const chart of this.charts.values()) chart.lose(bus.topics.get(chart.topic)?.lostHistory ?? []);
  }

  redraw() {
    for (const chart of this.charts.values()) chart.make();
  }
}

class Chart {
  constructor(topic, drop) {
    this.topic = topic;
    this.drop = drop;
    this.paths = [];
    this.times = [];
    this.ages = [];
    this.values = new Map();
    this.width = 0;
    this.drawn = null;
    this.isDue = false;
    this.wasSeen = false;
    this.lost = [];
    this.lostAt = 0;
    this.title = element("figcaption");
    this.canvas = element("div", { role: "img" });
    this.buttons = element("p", { class: "series" });
    this.figure = element("figure", { class: "plot", "data-topic": topic }, this.title, this.canvas, this.buttons);
    setText(this.title, topic);
  }

  toggle(path) {
    if (this.paths.includes(path)) {
      this.paths = this.paths.filter((one) => one !== path);
      this.values.delete(path);
    } else if (this.paths.length < COLOURS.length) {
      this.paths.push(path);
      this.values.set(path, this.times.map(() => null));
    }
    this.buttons.replaceChildren(...this.paths.map((one, at) => element("button", {
      type: "button", class: `series-${at + 1}`, "aria-label": `take ${one} out of the plot`, onclick: () => this.drop(one),
    }, `${one} ×`)), element("span", { class: "age" }, "age in ms, on the right; red bars: losses"));
    this.make();
  }

  remove() {
    this.drawn?.destroy();
    this.figure.remove();
  }

  // The extremes since the last value, then the value.
  add({ at_ms: at, age_ms: age, tree, from_ms: from, ends }) {
    if (ends) [from, (from + at) / 2].forEach((time, end) => this.point(time, null, (path) => ends[path]?.[end]));
    this.point(at, age, (path) => numberAt(tree, path));
    if (this.isDue) return;
    this.isDue = true;
    requestAnimationFrame(() => this.draw());
  }

  point(at, age, value) {
    const time = at / 1000;
    if (time <= this.times.at(-1)) return;
    this.times.push(time);
    this.ages.push(age);
    for (const path of this.paths) this.values.get(path).push(value(path) ?? null);
    const drop = Math.max(this.times.findIndex((one) => one >= time - SPAN_S), this.times.length - MOST);
    if (drop > 0) for (const one of [this.times, this.ages, ...this.values.values()]) one.splice(0, drop);
  }

  clear() {
    for (const one of [this.times, this.ages, ...this.values.values()]) one.length = 0;
    this.draw();
  }

  lose(lost) {
    if (!lost.length && !this.lost.length) return;
    this.lost = lost;
    this.lostAt = Math.ceil(Date.now() / 1000);
    setAttribute(this.figure, "data-lost", Math.round(lost.reduce((sum, one) => sum + one, 0)));
    this.drawn?.redraw(false);
  }

  // Bars from the bottom, one for each second with losses, as high as a quarter of the plot.
  drawLosses(plot) {
    const top = Math.max(0, ...this.lost);
    if (!top) return;
    const { ctx, bbox } = plot;
    ctx.save();
    ctx.fillStyle = getComputedStyle(document.documentElement).getPropertyValue("--bad").trim();
    this.lost.forEach((number, at) => {
      const end = this.lostAt - (this.lost.length - 1 - at);
      const left = Math.max(bbox.left, plot.valToPos(end - 1, "x", true)), right = Math.min(bbox.left + bbox.width, plot.valToPos(end, "x", true));
      const tall = (number / top) * bbox.height * 0.25;
      if (number && right > left) ctx.fillRect(left, bbox.top + bbox.height - tall, Math.max(1, right - left - 1), tall);
    });
    ctx.restore();
  }

  draw() {
    this.isDue = false;
    if (!this.paths.length) return;
    this.drawn?.setData(this.data());
    setAttribute(this.figure, "data-points", this.times.length);
    const now = this.paths.map((path) => `${path} ${this.values.get(path).at(-1) ?? "–"}`).join(", ");
    setAttribute(this.canvas, "aria-label", `Plot of ${this.topic} over ${SPAN_S} seconds: ${now}, age ${this.ages.at(-1) ?? "–"} ms`
      + (this.lost.some(Boolean) ? `, ${this.figure.dataset.lost} messages lost` : ""));
  }

  data() {
    return [this.times, ...this.paths.map((path) => this.values.get(path)), this.ages];
  }

  make() {
    this.drawn?.destroy();
    this.drawn = null;
    const width = Math.floor(this.figure.clientWidth);
    if (!width || !this.paths.length) return;
    const style = getComputedStyle(document.documentElement);
    const colour = (name) => style.getPropertyValue(name).trim();
    const axis = { stroke: colour("--text"), grid: { stroke: colour("--line"), width: 1 }, ticks: { stroke: colour("--line"), width: 1 } };
    const series = this.paths.map((path, at) => ({ label: path, stroke: colour(COLOURS[at]), width: 1.5, spanGaps: true, points: { show: false } }));
    this.drawn = new uPlot({
      width,
      height: HEIGHT,
      hooks: { drawAxes: [(plot) => this.drawLosses(plot)] },
      legend: { show: false },
      cursor: { show: false },
      scales: { x: { time: true, range: (_, least, most) => [Math.max(least ?? 0, (most ?? 0) - SPAN_S), most ?? 1] }, age: { range: (_, least, most) => [0, 1.2 * (most || 1)] } },
      axes: [
        { ...axis, space: 70, incrs: [1, 2, 5, 10, 15, 30, 60], values: "{HH}:{mm}:{ss}" },
        { ...axis, ...numbers(62) },
        { ...axis, scale: "age", side: 1, ...numbers(50), grid: { show: false } },
      ],
      series: [{}, ...series, { label: "age", scale: "age", stroke: colour("--plot-age"), width: 1, dash: [4, 3], spanGaps: true, points: { show: false } }],
    }, this.data(), this.canvas);
    this.draw();
    if (this.wasSeen) return;
    this.wasSeen = true; // the user has just asked for it; uPlot has its size in the next picture
    requestAnimationFrame(() => this.figure.scrollIntoView({ block: "nearest" }));
  }
}

// Labels of an axis, and as much room as the longest of them needs, at least `least` pixels.
function numbers(least) {
  return {
    values: (_, splits) => splits.map((value) => (value === null ? "" : tick(value))),
    size(plot, labels, at, round) {
      const axis = plot.axes[at];
      if (round > 1) return axis._size; // else the labels and the room could change each other without an end
      plot.ctx.font = axis.font[0];
      const widths = (labels ?? []).map((label) => plot.ctx.measureText(label).width / devicePixelRatio);
      return Math.ceil(Math.max(least, axis.ticks.size + axis.gap + Math.max(0, ...widths)));
    },
  };
}
