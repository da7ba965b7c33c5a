// What the page is put together of, and what goes from one part to another.

import { Bag } from "./bag.js";
import { Bus } from "./bus.js";
import { Connection } from "./connection.js";
import { Detail } from "./detail.js";
import { setAttribute, setText } from "./dom.js";
import { count, hertz, plural, rate, size } from "./format.js";
import { Graph } from "./graph.js";
import { Log } from "./log.js";
import { Plots } from "./plot.js";
import { Sheet } from "./sheet.js";
import { Table } from "./table.js";

const the = (id) => document.getElementById(id);

const bus = new Bus();
const view = {
  filter: "", hidden: false, topic: null, node: null, isPaused: false,
  shows(topic) {
    return (this.hidden || !topic.isHidden) && (!this.filter || topic.name.toLowerCase().includes(this.filter)
      || topic.types.some((type) => type.toLowerCase().includes(this.filter)));
  },
};
const graph = new Graph(the("graph"), the("graph-note"), the("graph-bar"), choose, chooseNode);
const table = new Table(the("table"), the("pages"), choose);
const log = new Log(the("lines"), the("log-note"), the("log-empty"), the("severity"));
const plots = new Plots(the("plots"), look);
const detail = new Detail(the("detail"), { close: () => choose(null), plot: (topic, path) => plots.toggle(topic, path), look, choose });
const sheet = new Sheet(the("sheet"), () => choose(null));
const missed = new Map();
let name = "bus", isDue = false, isWanted = false, wasDrawn = false;
const bag = new Bag(the("bag"), (request) => connection.say("play", request));

const hear = {
  hello(told) {
    name = told.bus;
    document.title = `bus ${told.bus}`;
  },
  graph: (told) => bus.setGraph(told),
  history: (told) => bus.setHistory(told),
  rates(told) {
    state("", `on ${name}`);
    bus.setRates(told);
    show();
  },
  detail(told) {
    bus.setDetail(told);
    show();
  },
  value(told) {
    if (view.isPaused) return;
    plots.add(told);
    detail.value(told);
  },
  fault: (told) => detail.fault(told),
  log: (told) => log.add(told),
  recording: (told) => bag.open(told),
  playback: (told) => bag.state(told) && plots.clear(),
  refused: (told) => bag.refused(told),
  bus: (told) => state("away", `busd is away: ${told.text}`),
  status(told) {
    for (const [topic, number] of Object.entries(told.dropped)) missed.set(topic, (missed.get(topic) ?? 0) + number);
    const all = [...missed.values()].reduce((sum, one) => sum + one, 0);
    the("missed").hidden = false;
    setText(the("missed"), `${plural(all, "message")} left out here: this page is slower than the bus`);
    setAttribute(the("missed"), "title", [...missed].map(([topic, number]) => `${topic}: ${count(number)}`).join("\n"));
  },
};

const connection = new Connection((told) => hear[told.op]?.(told), (how, reason) => {
  if (how === "open") {
    log.clear();
    the("log").open && connection.say("log", { on: true });
    look();
  } else state("away", {
    shut: "bus web has restarted: open the new address that it has printed",
    refused: `bus web refuses this page: ${reason}. Trying again`,
    closed: "bus web is away: trying again",
  }[how]);
});

function state(kind, text) {
  setText(the("state"), text);
  setAttribute(the("state"), "class", kind || null);
}

// What of messages is wanted: the chosen topic with its open arrays, and plotted numbers.
function look() {
  const topics = view.topic === null ? {} : { [view.topic]: [...detail.opened] };
  connection.say("look", { topics, plots: plots.paths });
  detail.plotted(plots.pathsOf(view.topic));
}

function choose(topic) {
  Object.assign(view, { topic: topic === view.topic ? null : topic, node: null });
  chosen();
}

const rowOf = (topic) => topic === null ? null : document.querySelector(`tr[data-topic="${CSS.escape(topic)}"] button`);

function chooseNode(name) {
  Object.assign(view, { topic: null, node: name === view.node ? null : name });
  chosen();
}

function chosen() {
  const hadFocus = sheet.hasFocus;
  detail.choose(view.topic, view.node);
  if (view.topic === null && view.node === null) sheet.shut(hadFocus);
  else sheet.open(hadFocus, rowOf(view.topic));
  look();
  showAnyway();
}

// What the user does is seen though all stands still.
function showAnyway() {
  isWanted = true;
  show();
}

// However much is told, once for each picture that the browser draws.
function show() {
  if (isDue) return;
  isDue = true;
  requestAnimationFrame(() => {
    isDue = false;
    if (view.isPaused && !isWanted) return;
    isWanted = false;
    graph.show(bus, view);
    if (!wasDrawn) performance.mark("first graph");
    wasDrawn = true;
    table.show(bus, view);
    detail.show(bus);
    plots.show(bus);
    sheet.settle();
    const shown = [...bus.topics.values()].filter((topic) => view.shows(topic));
    const sum = (key) => shown.reduce((all, topic) => all + (topic[key] ?? 0), 0);
    const nodes = [...bus.nodes.values()].filter((node) => view.hidden || !node.isHidden).length;
    const losing = sum("lostPerS");
    setText(the("sums"), `${plural(nodes, "node")}, ${plural(shown.length, "topic")}, ${hertz(sum("hz"))}, ${size(sum("bytesPerS"))}/s, `
      + (losing ? `${rate(losing)} lost each second` : `${count(sum("lost"))} lost`));
  });
}

the("filter").addEventListener("input", (event) => {
  view.filter = event.target.value.trim().toLowerCase();
  showAnyway();
});
the("hidden").addEventListener("change", (event) => {
  view.hidden = event.target.checked;
  showAnyway();
});
the("pause").addEventListener("click", () => {
  view.isPaused = !view.isPaused;
  setAttribute(the("pause"), "aria-pressed", view.isPaused);
  log.pause(view.isPaused);
  show();
});
the("log").addEventListener("toggle", () => {
  log.clear();
  connection.say("log", { on: the("log").open });
});
