// Nodes as boxes and topics as pills, laid out from left to right when the structure changes; else changed in place.

import { Kept, setAttribute, setChildren, setText, svg } from "./dom.js";
import { count, rate, size } from "./format.js";

const MOST_BOXES = 80; // more are not for reading: then the neighbourhood of what is chosen
const EVERYWHERE = new Set(["/rosout", "/parameter_events"]); // of every node: shown with what is hidden
const LINE = 16, PAD = 12, MARGIN = 16;

export class Graph {
  // `choose(topic)` when a topic is chosen, `chooseNode(name)` when a node is.
  constructor(place, note, choose, chooseNode) {
    this.place = place;
    this.note = note;
    this.choose = choose;
    this.chooseNode = chooseNode;
    this.key = "";
    this.focus = null; // a box whose neighbourhood is shown where all are too many
    this.boxes = new Kept((id) => this.makeBox(id));
    this.edges = new Kept(() => makeEdge());
    this.root = svg("svg", { role: "group", "aria-label": "Graph: nodes are boxes, topics are pills" });
    this.root.append(arrows());
    this.layer = svg("g");
    this.root.append(this.layer);
    this.measure = document.createElement("canvas").getContext("2d");
  }

  show(bus, view) {
    const found = this.select(bus, view);
    const key = JSON.stringify([...found.boxes.keys(), "", ...found.edges.keys()]);
    if (key !== this.key) {
      this.key = key;
      this.layOut(found);
    }
    for (const [id, box] of found.boxes) this.paintBox(this.boxes.all.get(id), box, view);
    for (const [id, edge] of found.edges) {
      const node = (found.boxes.get(edge.from).node ?? found.boxes.get(edge.to).node).name;
      paintEdge(this.edges.all.get(id), edge, view.topic === edge.topic.name || view.node === node);
    }
  }

  // Boxes by id, and edges with the endpoints that they stand for.
  select(bus, view) {
    const isShown = (topic) => view.shows(topic) && (view.hidden || !EVERYWHERE.has(topic.name));
    const edges = new Map(), near = new Map(), all = new Map();
    const link = (one, other) => {
      for (const [from, to] of [[one, other], [other, one]]) {
        if (!near.has(from)) near.set(from, new Set());
        near.get(from).add(to);
      }
    };
    for (const topic of bus.topics.values()) {
      if (!isShown(topic)) continue;
      const pill = `t${topic.name}`;
      all.set(pill, { topic });
      for (const end of [...topic.publishers, ...topic.subscriptions]) {
        const node = bus.nodes.get(end.node);
        if (!node || (node.isHidden && !view.hidden)) continue;
        const box = `n${node.id}`;
        all.set(box, { node });
        const [from, to] = end.kind === "publisher" ? [box, pill] : [pill, box];
        const id = `${from}>${to}`;
        if (!edges.has(id)) edges.set(id, { from, to, ends: [], topic });
        edges.get(id).ends.push(end);
        link(box, pill);
      }
    }
    if (!view.filter)
      for (const node of bus.nodes.values())
        if ((!node.isHidden || view.hidden) && all.size < MOST_BOXES) all.set(`n${node.id}`, { node });
    const chosen = this.neighbourhood(all, near, view);
    const boxes = new Map([...all].filter(([id]) => chosen.has(id)).sort(([a], [b]) => (a < b ? -1 : 1)));
    return { boxes, edges: new Map([...edges].filter(([, edge]) => boxes.has(edge.from) && boxes.has(edge.to))) };
  }

  neighbourhood(all, near, view) {
    this.note.hidden = all.size <= MOST_BOXES;
    if (all.size <= MOST_BOXES) return new Set(all.keys());
    const chosen = [...all].find(([, { topic, node }]) => (topic ? topic.name === view.topic : node.name === view.node));
    let middle = chosen ? chosen[0] : this.focus;
    if (!middle || !all.has(middle)) {
      const topics = [...all.values()].filter((one) => one.topic).map((one) => one.topic);
      middle = `t${topics.reduce((best, one) => ((one.hz ?? 0) > (best.hz ?? 0) ? one : best), topics[0]).name}`;
    }
    this.focus = middle;
    const found = new Set([middle]);
    let border = [middle];
    while (border.length && found.size < MOST_BOXES) {
      const next = [];
      for (const one of border)
        for (const other of near.get(one) ?? [])
          if (!found.has(other) && found.size < MOST_BOXES) {
            found.add(other);
            next.push(other);
          }
      border = next;
    }
    const name = all.get(middle).topic?.name ?? all.get(middle).node.name;
    setText(this.note, `${all.size} nodes and topics: shown are the ${found.size} around ${name}. Choose another, or filter.`);
    return found;
  }

  layOut({ boxes, edges }) {
    const plan = new dagre.graphlib.Graph();
    plan.setGraph({ rankdir: "LR", nodesep: 14, ranksep: 64, edgesep: 8 });
    const font = getComputedStyle(this.place).fontFamily;
    this.measure.font = `600 13px ${font}`;
    for (const [id, box] of boxes) {
      const name = box.topic?.name ?? box.node.name;
      const width = Math.max(this.measure.measureText(name).width, box.topic ? 118 : 40) + 2 * PAD;
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

function arrows() {
  const heads = ["", "losing", "lost", "grey"].map((kind) => svg("marker", {
    id: `head${kind}`, class: kind, viewBox: "0 0 8 8", refX: "7", refY: "4", markerWidth: "8", markerHeight: "8",
    markerUnits: "userSpaceOnUse", orient: "auto",
  }, svg("path", { d: "M0 0 8 4 0 8z" })));
  return svg("defs", {}, ...heads);
}

function makeEdge() {
  const line = svg("path"), label = svg("text"), title = svg("title");
  const group = svg("g", {}, title, line, label);
  return {
    group, line, label, title,
    place(points) {
      const [first, ...others] = points;
      let path = `M${first.x} ${first.y}`;
      for (let at = 0; at < others.length - 1; at++) {
        const here = others[at], next = others[at + 1];
        const last = at === others.length - 2;
        path += `Q${here.x} ${here.y} ${last ? next.x : (here.x + next.x) / 2} ${last ? next.y : (here.y + next.y) / 2}`;
      }
      if (others.length === 1) path += `L${others[0].x} ${others[0].y}`;
      setAttribute(line, "d", path);
      const middle = points[Math.floor(points.length / 2)];
      setAttribute(label, "x", middle.x);
      setAttribute(label, "y", middle.y - 5);
    },
  };
}

function paintEdge(drawn, { from, ends, topic }, isNear) {
  const isSubscription = from[0] === "t";
  const hz = ends.reduce((sum, end) => sum + (end.hz ?? 0), 0);
  const lost = isSubscription ? ends.reduce((sum, end) => sum + end.lost, 0) : 0;
  const isLosing = isSubscription && ends.some((end) => end.lostPerS > 0);
  const isSocket = ends.some((end) => end.routes.has("socket"));
  const reasons = [...new Set(ends.flatMap((end) => end.reasons))];
  const isCut = reasons.length > 0 && ends.every((end) => !end.routes.size);
  const kind = isCut ? "grey" : isLosing ? "losing" : lost ? "lost" : "";
  setAttribute(drawn.group, "class", `edge ${kind}${isSocket ? " socket" : ""}${isNear ? " near" : ""}`);
  setAttribute(drawn.line, "stroke-width", (1 + 0.9 * Math.log10(1 + hz)).toFixed(1));
  setAttribute(drawn.line, "marker-end", `url(#head${kind})`);
  setText(drawn.label, isCut ? "no match" : lost ? `lost ${count(lost)}` : "");
  const routes = [...new Set(ends.flatMap((end) => [...end.routes]))];
  setText(drawn.title, [topic.name, `${rate(hz)} Hz`, routes.length ? `by ${routes.join(" and ")}` : "", ...reasons].filter(Boolean).join("\n"));
  setAttribute(drawn.group, "data-edge", `${isSubscription ? "subscription" : "publisher"} ${topic.name}`);
}
