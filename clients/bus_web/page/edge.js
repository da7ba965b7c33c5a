// Lines between nodes and topics: wide where much goes, red where messages are lost. Each has room for a label.

import { setAttribute, setText, svg } from "./dom.js";
import { count, hertz } from "./format.js";

// The heads of lines, of which there is one in each colour.
export function arrows() {
  const heads = ["", "losing", "lost", "grey"].map((kind) => svg("marker", {
    id: `head${kind}`, class: kind, viewBox: "0 0 8 8", refX: "7", refY: "4", markerWidth: "8", markerHeight: "8",
    markerUnits: "userSpaceOnUse", orient: "auto",
  }, svg("path", { d: "M0 0 8 4 0 8z" })));
  return svg("defs", {}, ...heads);
}

export const LABEL_HEIGHT = 18;

// `group` has the line. `sign` has the label, which is drawn above all lines.
export function makeEdge() {
  const line = svg("path"), title = svg("title");
  const shape = svg("rect", { height: LABEL_HEIGHT, rx: 3 }), label = svg("text");
  return {
    group: svg("g", {}, title, line), sign: svg("g", {}, shape, label), line, label, shape, title,
    room: 0, // the width that the layout keeps free for the label; it never shrinks, so the graph seldom moves
    place(path, middle) {
      setAttribute(line, "d", path);
      setAttribute(this.sign, "transform", `translate(${middle.x} ${middle.y})`);
      setAttribute(label, "y", 4);
      setAttribute(shape, "x", -this.room / 2);
      setAttribute(shape, "y", -LABEL_HEIGHT / 2);
      setAttribute(shape, "width", this.room);
    },
  };
}

const isSubscription = ({ from }) => from[0] === "t";
const lostOf = (edge) => (isSubscription(edge) ? edge.ends.reduce((sum, end) => sum + end.lost, 0) : 0);
const isCut = ({ ends }) => ends.some((end) => end.reasons.length) && ends.every((end) => !end.routes.size);

// What a line says: `lost 12`, `no match`, or nothing.
export function labelOf(edge) {
  const lost = lostOf(edge);
  return isCut(edge) ? "no match" : lost ? `lost ${count(lost)}` : "";
}

export function paintEdge(drawn, edge, isNear) {
  const { ends, topic } = edge;
  const hz = ends.reduce((sum, end) => sum + (end.hz ?? 0), 0);
  const isLosing = isSubscription(edge) && ends.some((end) => end.lostPerS > 0);
  const isSocket = ends.some((end) => end.routes.has("socket"));
  const reasons = [...new Set(ends.flatMap((end) => end.reasons))];
  const text = labelOf(edge);
  const kind = isCut(edge) ? "grey" : isLosing ? "losing" : text ? "lost" : "";
  const name = `${isSubscription(edge) ? "subscription" : "publisher"} ${topic.name}`;
  setAttribute(drawn.group, "class", `edge ${kind}${isSocket ? " socket" : ""}${isNear ? " near" : ""}`);
  setAttribute(drawn.group, "data-edge", name);
  setAttribute(drawn.sign, "class", `label ${kind}`);
  setAttribute(drawn.sign, "data-edge", name);
  setAttribute(drawn.shape, "visibility", text ? null : "hidden");
  setAttribute(drawn.line, "stroke-width", (1 + 0.9 * Math.log10(1 + hz)).toFixed(1));
  setAttribute(drawn.line, "marker-end", `url(#head${kind})`);
  setText(drawn.label, text);
  const routes = [...new Set(ends.flatMap((end) => [...end.routes]))];
  setText(drawn.title, [topic.name, hertz(hz), routes.length ? `by ${routes.join(" and ")}` : "", ...reasons].filter(Boolean).join("\n"));
}
