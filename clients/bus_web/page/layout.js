// Where boxes, lines and labels of the graph are: columns from left to right, made by dagre. Pure, but for dagre.
//
// dagre gives each line a place of its own in every column that it passes, and each label one, too. A line is level as
// far as its column is wide and bends between columns only. So it crosses no box and no label.

import { LABEL_HEIGHT } from "./edge.js";

const SPACES = { rankdir: "LR", nodesep: 14, edgesep: 10 };
const GAP = 40, MORE = 4, MOST = 160; // between columns; the more lines meet at a box, the wider
const STEP = 9; // between the ends of lines at one side of a box

// `boxes`: by id, { width, height, isRound }. `edges`: by id, { from, to, room }: the width of its label, 0 for none.
// Returns the same ids: `boxes` with their middles, `edges` with { path, middle }, and what all of them cover.
export function layOut(boxes, edges) {
  const plan = new dagre.graphlib.Graph();
  plan.setGraph({ ...SPACES, ranksep: Math.min(MOST, GAP + MORE * busiest(edges)) });
  for (const [id, { width, height }] of boxes) plan.setNode(id, { width, height });
  for (const [id, { from, to, room }] of edges)
    plan.setEdge(from, to, { id, width: room, height: room ? LABEL_HEIGHT : 0, labelpos: "c" });
  dagre.layout(plan);
  const placed = new Map([...boxes].map(([id, box]) => [id, { ...box, ...plan.node(id) }]));
  const lines = plan.edges().map(({ v, w }) => ({ ...plan.edge(v, w), from: placed.get(v), to: placed.get(w) }));
  const widths = columns(placed.values(), lines);
  for (const line of lines) line.inner = line.points.slice(1, -1);
  spreadEnds(placed, lines);
  const found = new Map(lines.map((line) => [line.id, { path: pathOf(line, widths), middle: middleOf(line) }]));
  return { boxes: placed, edges: found, ...extent(placed.values(), lines) };
}

// The most lines that begin, or end, at one box.
function busiest(edges) {
  const counts = new Map();
  for (const { from, to } of edges.values())
    for (const key of [`from ${from}`, `to ${to}`]) counts.set(key, (counts.get(key) ?? 0) + 1);
  return Math.max(0, ...counts.values());
}

const keyOf = (x) => Math.round(x);

// Half the width of each column, by its middle.
function columns(boxes, lines) {
  const widths = new Map();
  const widen = (x, width) => widths.set(keyOf(x), Math.max(widths.get(keyOf(x)) ?? 0, width / 2));
  for (const { x, width } of boxes) widen(x, width);
  for (const { x, width } of lines) if (width) widen(x, width);
  return widths;
}

const middleOf = ({ x, y, width, inner, from, to }) =>
  width ? { x, y } : inner[Math.floor(inner.length / 2)] ?? { x: (from.x + to.x) / 2, y: (from.y + to.y) / 2 };

// Lines begin and end side by side, in the order of the places to which they go.
function spreadEnds(boxes, lines) {
  const sides = new Map();
  const join = (box, line, end, next) => {
    const side = next.x < box.x ? "left" : "right";
    const key = `${side} ${box.x} ${box.y}`;
    if (!sides.has(key)) sides.set(key, { box, side, ends: [] });
    sides.get(key).ends.push({ line, end, next });
  };
  for (const line of lines) {
    join(line.from, line, "begin", line.inner[0] ?? line.to);
    join(line.to, line, "end", line.inner.at(-1) ?? line.from);
  }
  for (const { box, side, ends } of sides.values()) {
    ends.sort((one, other) => one.next.y - other.next.y);
    const step = Math.min(STEP, (box.height - 12) / Math.max(1, ends.length - 1));
    ends.forEach(({ line, end }, at) => {
      const off = (at - (ends.length - 1) / 2) * step;
      const radius = box.isRound ? box.height / 2 : 0;
      const reach = box.width / 2 - (radius ? radius - Math.sqrt(radius * radius - off * off) : 0);
      line[end] = { x: box.x + (side === "left" ? -reach : reach), y: box.y + off };
    });
  }
}

function pathOf(line, widths) {
  const { begin, end, from, to, inner } = line;
  // Each stop is a level piece: from the edge of a box to that of its column, or across a column.
  const stops = [];
  const across = ({ x, y }, sign) => {
    const half = widths.get(keyOf(x)) ?? 0;
    stops.push([x - sign * half, y], [x + sign * half, y]);
  };
  const outer = (box, point, other) => {
    const half = widths.get(keyOf(box.x)) ?? box.width / 2;
    return [box.x + Math.sign(other.x - box.x || 1) * half, point.y];
  };
  const sign = Math.sign((inner[0] ?? to).x - from.x) || 1;
  stops.push([begin.x, begin.y], outer(from, begin, inner[0] ?? to));
  for (const point of inner) across(point, sign);
  stops.push(outer(to, end, inner.at(-1) ?? from), [end.x, end.y]);
  let path = `M${round(stops[0])}L${round(stops[1])}`;
  for (let at = 2; at < stops.length; at += 2) {
    const [here, next] = [stops[at - 1], stops[at]];
    const middle = (here[0] + next[0]) / 2;
    path += `C${round([middle, here[1]])} ${round([middle, next[1]])} ${round(next)}L${round(stops[at + 1])}`;
  }
  return path;
}

const round = ([x, y]) => `${x.toFixed(1)} ${y.toFixed(1)}`;

function extent(boxes, lines) {
  let right = -Infinity, bottom = -Infinity, left = Infinity, top = Infinity;
  const reach = ({ x, y, width = 0, height = 0 }) => {
    left = Math.min(left, x - width / 2); right = Math.max(right, x + width / 2);
    top = Math.min(top, y - height / 2); bottom = Math.max(bottom, y + height / 2);
  };
  for (const box of boxes) reach(box);
  for (const line of lines) {
    for (const point of line.inner) reach(point);
    if (line.width) reach(line);
  }
  return left === Infinity ? { left: 0, top: 0, right: 0, bottom: 0 } : { left, top, right, bottom };
}
