// Nodes as boxes and topics as pills, laid out from left to right when the structure changes; else changed in place.

import { Kept, setAttribute, setChildren, setText, svg } from "./dom.js";
import { arrows, labelOf, makeEdge, paintEdge } from "./edge.js";
import { count, hertz, size } from "./format.js";
import { layOut } from "./layout.js";
import { select } from "./selection.js";
import { Viewport } from "./viewport.js";

const LINE = 16, PAD = 12, MARGIN = 16;
const LONG = 44; // letters of a longer name are left out in the middle
const LABEL = "lost 999"; // the least room for a label: a count may grow for a while

const shortened = (name) => (name.length > LONG ? `${name.slice(0, LONG / 2 - 1)}…${name.slice(1 - LONG / 2)}` : name);

export class Graph {
  // `choose(topic)` when a topic is chosen, `chooseNode(name)` when a node is.
  constructor(place, note, bar, choose, chooseNode) {
    this.place = place;
    this.note = note;
    this.choose = choose;
    this.chooseNode = chooseNode;
    this.key = "";
    this.focus = null; // the box whose neighbourhood was shown last
    this.target = null; // the id of the box to which it scrolls
    this.seen = null; // the box to which it has scrolled last, and the boxes that were there then
    this.plan = { boxes: new Map(), edges: new Map() };
    this.boxes = new Kept((id) => this.makeBox(id));
    this.edges = new Kept(() => makeEdge());
    this.root = svg("svg", { role: "group", "aria-label": "Graph: nodes are boxes, topics are pills" }, arrows());
    this.layers = [svg("g"), svg("g"), svg("g")]; // lines, boxes, labels
    this.root.append(...this.layers);
    place.append(this.root);
    this.viewport = new Viewport(place, this.root, bar);
    this.measure = document.createElement("canvas").getContext("2d");
  }

  show(bus, view) {
    const { boxes, edges, focus, total } = select(bus, view, this.focus);
    this.focus = focus ?? this.focus;
    setText(this.note, focus !== null
      ? `${count(total)} nodes and topics: shown are the ${boxes.size} around ${boxes.get(focus).name}. Choose another, or filter.`
      : boxes.size ? "" : view.filter ? `No name or type has “${view.filter}”.` : "No nodes are on the bus.");
    this.note.hidden = !this.note.textContent;
    this.boxes.only(boxes.keys());
    this.edges.only(edges.keys());
    const rooms = [...edges].map(([id, edge]) => this.makeRoom(this.edges.all.get(id), labelOf(edge)));
    const key = JSON.stringify([...boxes.keys(), "", ...edges.keys(), ...rooms]);
    if (key !== this.key) {
      this.key = key;
      this.layOut(boxes, edges);
    }
    for (const [id, box] of boxes) this.paintBox(this.boxes.all.get(id), box, view);
    for (const [id, edge] of edges)
      paintEdge(this.edges.all.get(id), edge, view.topic === edge.topic.name || view.node === edge.node.name);
    this.showPlace(boxes, view, focus);
  }

  makeRoom(edge, label) {
    if (!label) return edge.room;
    this.measure.font = `600 12px ${this.font}`;
    const width = Math.ceil(Math.max(...[label, LABEL].map((text) => this.measure.measureText(text).width))) + 8;
    edge.room = Math.max(edge.room, width);
    return edge.room;
  }

  get font() {
    return getComputedStyle(this.place).fontFamily;
  }

  layOut(boxes, edges) {
    this.measure.font = `600 13px ${this.font}`;
    const sizes = new Map([...boxes].map(([id, box]) => {
      const width = Math.max(this.measure.measureText(shortened(box.name)).width, box.topic ? 118 : 40) + 2 * PAD;
      return [id, { width: Math.ceil(width), height: box.topic ? 2 * LINE + PAD : LINE + PAD, isRound: Boolean(box.topic) }];
    }));
    const lines = new Map([...edges].map(([id, { from, to }]) => [id, { from, to, room: this.edges.all.get(id).room }]));
    const before = this.plan.boxes.get(this.target);
    const wasSeen = before && this.viewport.has(before);
    this.plan = layOut(sizes, lines);
    const drawn = [...this.edges.all.values()];
    setChildren(this.layers[0], drawn.map((one) => one.group));
    setChildren(this.layers[1], [...this.boxes.all.values()].map((one) => one.group));
    setChildren(this.layers[2], drawn.map((one) => one.sign));
    for (const [id, at] of this.plan.boxes) this.boxes.all.get(id).place(at);
    for (const [id, { path, middle }] of this.plan.edges) this.edges.all.get(id).place(path, middle);
    const { left, top, right, bottom } = this.plan;
    this.viewport.cover({
      x: left - MARGIN, y: top - MARGIN, width: Math.ceil(right - left) + 2 * MARGIN, height: Math.ceil(bottom - top) + 2 * MARGIN,
    });
    if (wasSeen && this.plan.boxes.has(this.target)) this.viewport.show(this.plan.boxes.get(this.target));
  }

  // The map, and in sight what is chosen, else the middle of the shown part, else the first column: once for each
  // choice, and when other boxes come or leave, so that the user may scroll away.
  showPlace(boxes, view, focus) {
    let chosen = null;
    this.viewport.drawMap([...boxes].map(([id, { topic, node }]) => {
      const isChosen = topic ? view.topic === topic.name : view.node === node.name;
      if (isChosen) chosen = id;
      return { ...this.plan.boxes.get(id), isChosen, isLossy: Boolean(topic?.lost) };
    }));
    this.target = chosen ?? focus;
    const seen = this.target === null ? "" : JSON.stringify([this.target, ...boxes.keys()]);
    if (seen === this.seen || !boxes.size) return;
    if (this.target !== null) this.viewport.show(this.plan.boxes.get(this.target));
    else if (this.seen === null) this.viewport.show([...this.plan.boxes.values()].reduce((best, one) => (one.x < best.x ? one : best)));
    this.seen = seen;
  }

  makeBox(id) {
    const shape = svg("rect");
    const name = svg("text", { class: "name" }), figures = svg("text", { class: "figures" });
    const group = svg("g", { tabindex: "0", role: "button" }, shape, name, " ", figures);
    const made = { group, shape, name, figures };
    made.place = ({ x, y, width, height }) => {
      const isTopic = id[0] === "t";
      group.setAttribute("transform", `translate(${x - width / 2} ${y - height / 2})`);
      for (const [key, value] of Object.entries({ width, height, rx: isTopic ? height / 2 : 4 })) setAttribute(shape, key, value);
      for (const [text, line] of [[name, 1], [figures, 2]]) {
        setAttribute(text, "x", width / 2);
        setAttribute(text, "y", line * LINE + 2);
      }
    };
    const press = () => (id[0] === "t" ? this.choose(id.slice(1)) : this.chooseNode(group.dataset.node));
    group.addEventListener("click", press);
    group.addEventListener("keydown", (event) => {
      if (event.key !== "Enter" && event.key !== " ") return;
      event.preventDefault();
      press();
    });
    return made;
  }

  paintBox(drawn, { node, topic }, view) {
    if (topic) {
      const figures = topic.publishers.length ? `${hertz(topic.hz)} · ${size(topic.bytesPerS)}/s` : "no publisher";
      setText(drawn.name, shortened(topic.name));
      setText(drawn.figures, figures);
      setAttribute(drawn.group, "class", `topic${view.topic === topic.name ? " chosen" : ""}`);
      setAttribute(drawn.group, "aria-pressed", view.topic === topic.name);
      setAttribute(drawn.group, "aria-label", `topic ${topic.name} ${figures}${topic.lost ? `, lost ${count(topic.lost)}` : ""}`);
      setAttribute(drawn.group, "data-topic", topic.name);
    } else {
      const isChosen = view.node === node.name;
      setText(drawn.name, shortened(node.name));
      setAttribute(drawn.group, "class", `node${isChosen ? " chosen" : ""}`);
      setAttribute(drawn.group, "aria-pressed", isChosen);
      setAttribute(drawn.group, "aria-label", `node ${node.name}, ${node.origin ? `on ${node.origin}` : `process ${node.pid}`}`);
      setAttribute(drawn.group, "data-node", node.name);
    }
  }
}
