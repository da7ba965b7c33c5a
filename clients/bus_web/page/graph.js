// Nodes as boxes and topics as pills, laid out from left to right when the structure changes; else changed in place.

import { Kept, setAttribute, setChildren, setText, svg } from "./dom.js";
import { arrows, makeEdge, paintEdge } from "./edge.js";
import { rate, size } from "./format.js";
import { select } from "./selection.js";

const LINE = 16, PAD = 12, MARGIN = 16;

export class Graph {
  // `choose(topic)` when a topic is chosen, `chooseNode(name)` when a node is.
  constructor(place, note, choose, chooseNode) {
    this.place = place;
    this.note = note;
    this.choose = choose;
    this.chooseNode = chooseNode;
    this.key = "";
    this.focus = null; // the box whose neighbourhood was shown last
    this.boxes = new Kept((id) => this.makeBox(id));
    this.edges = new Kept(() => makeEdge());
    this.root = svg("svg", { role: "group", "aria-label": "Graph: nodes are boxes, topics are pills" });
    this.root.append(arrows());
    this.layer = svg("g");
    this.root.append(this.layer);
    this.measure = document.createElement("canvas").getContext("2d");
  }

  show(bus, view) {
    const { boxes, edges, focus, total } = select(bus, view, this.focus);
    this.focus = focus ?? this.focus;
    this.note.hidden = focus === null;
    if (focus !== null)
      setText(this.note, `${total} nodes and topics: shown are the ${boxes.size} around ${boxes.get(focus).name}. Choose another, or filter.`);
    const key = JSON.stringify([...boxes.keys(), "", ...edges.keys()]);
    if (key !== this.key) {
      this.key = key;
      this.layOut(boxes, edges);
    }
    for (const [id, box] of boxes) this.paintBox(this.boxes.all.get(id), box, view);
    for (const [id, edge] of edges)
      paintEdge(this.edges.all.get(id), edge, view.topic === edge.topic.name || view.node === edge.node.name);
  }

  layOut(boxes, edges) {
    const plan = new dagre.graphlib.Graph();
    plan.setGraph({ rankdir: "LR", nodesep: 14, ranksep: 64, edgesep: 8 });
    const font = getComputedStyle(this.place).fontFamily;
    this.measure.font = `600 13px ${font}`;
    for (const [id, box] of boxes) {
      const width = Math.max(this.measure.measureText(box.name).width, box.topic ? 118 : 40) + 2 * PAD;
      plan.setNode(id, { width: Math.ceil(width), height: box.topic ? 2 * LINE + PAD : LINE + PAD });
    }
    for (const [id, edge] of edges) plan.setEdge(edge.from, edge.to, { id });
    dagre.layout(plan);
    const drawn = this.boxes.only(boxes.keys());
    const lines = this.edges.only(edges.keys());
    setChildren(this.layer, [...drawn.map((one) => one.group), ...lines.map((one) => one.group)]); // what is lost, on top
    // dagre's own size leaves out the edges.
    let right = 0, bottom = 0, left = Infinity, top = Infinity;
    const reach = (x, y) => {
      left = Math.min(left, x); right = Math.max(right, x);
      top = Math.min(top, y); bottom = Math.max(bottom, y);
    };
    for (const id of boxes.keys()) {
      const at = plan.node(id);
      this.boxes.all.get(id).place(at);
      reach(at.x - at.width / 2, at.y - at.height / 2);
      reach(at.x + at.width / 2, at.y + at.height / 2);
    }
    for (const at of plan.edges()) {
      const { id, points } = plan.edge(at);
      this.edges.all.get(id).place(points);
      for (const { x, y } of points) reach(x, y);
    }
    if (left === Infinity) left = right = top = bottom = 0;
    const width = Math.ceil(right - left) + 2 * MARGIN, height = Math.ceil(bottom - top) + 2 * MARGIN;
    setAttribute(this.root, "viewBox", `${left - MARGIN} ${top - MARGIN} ${width} ${height}`);
    setAttribute(this.root, "width", width);
    setAttribute(this.root, "height", height);
    this.root.style.minWidth = `${Math.round(width * 0.62)}px`;
    if (!this.root.isConnected) this.place.append(this.root);
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
      const figures = topic.publishers.length ? `${rate(topic.hz)} Hz · ${size(topic.bytesPerS)}/s` : "no publisher";
      setText(drawn.name, topic.name);
      setText(drawn.figures, figures);
      setAttribute(drawn.group, "class", `topic${view.topic === topic.name ? " chosen" : ""}`);
      setAttribute(drawn.group, "aria-pressed", view.topic === topic.name);
      setAttribute(drawn.group, "aria-label", `topic ${topic.name} ${figures}${topic.lost ? `, lost ${topic.lost}` : ""}`);
      setAttribute(drawn.group, "data-topic", topic.name);
    } else {
      const isChosen = view.node === node.name;
      setText(drawn.name, node.name);
      setAttribute(drawn.group, "class", `node${isChosen ? " chosen" : ""}`);
      setAttribute(drawn.group, "aria-pressed", isChosen);
      setAttribute(drawn.group, "aria-label", `node ${node.name}, ${node.origin ? `on ${node.origin}` : `process ${node.pid}`}`);
      setAttribute(drawn.group, "data-node", node.name);
    }
  }
}
