// Lines between nodes and topics: wide where much goes, red where messages are lost.

import { setAttribute, setText, svg } from "./dom.js";
import { count, rate } from "./format.js";

// The heads of lines, of which there is one in each colour.
export function arrows() {
  const heads = ["", "losing", "lost", "grey"].map((kind) => svg("marker", {
    id: `head${kind}`, class: kind, viewBox: "0 0 8 8", refX: "7", refY: "4", markerWidth: "8", markerHeight: "8",
    markerUnits: "userSpaceOnUse", orient: "auto",
  }, svg("path", { d: "M0 0 8 4 0 8z" })));
  return svg("defs", {}, ...heads);
}

export function makeEdge() {
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

export function paintEdge(drawn, { from, ends, topic }, isNear) {
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
