// What of the bus the graph shows: boxes by id, and edges with the endpoints that they stand for.

const MOST_BOXES = 80; // more are not for reading: then the neighbourhood of what is chosen
const EVERYWHERE = new Set(["/rosout", "/parameter_events"]); // of every node: shown with what is hidden

// `focus` is the id of the box whose neighbourhood was shown last. It comes back in what is returned; null where
// all are shown, of which there are `total`.
export function select(bus, view, focus) {
  const all = new Map(), edges = new Map();
  for (const topic of bus.topics.values()) {
    if (!view.shows(topic) || (EVERYWHERE.has(topic.name) && !view.hidden)) continue;
    const pill = `t${topic.name}`;
    all.set(pill, { topic, name: topic.name });
    for (const end of [...topic.publishers, ...topic.subscriptions]) {
      const node = bus.nodes.get(end.node);
      if (!node || (node.isHidden && !view.hidden)) continue;
      const box = `n${node.id}`;
      all.set(box, { node, name: node.name });
      const [from, to] = end.kind === "publisher" ? [box, pill] : [pill, box];
      const id = `${from}>${to}`;
      if (!edges.has(id)) edges.set(id, { from, to, ends: [], topic, node });
      edges.get(id).ends.push(end);
    }
  }
  if (!view.filter)
    for (const node of bus.nodes.values())
      if ((!node.isHidden || view.hidden) && all.size < MOST_BOXES) all.set(`n${node.id}`, { node, name: node.name });
  const middle = all.size > MOST_BOXES ? middleOf(all, view, focus) : null;
  const chosen = middle === null ? all : neighbourhood(middle, edges.values());
  return {
    boxes: new Map([...all].filter(([id]) => chosen.has(id)).sort(([a], [b]) => (a < b ? -1 : 1))),
    edges: new Map([...edges].filter(([, edge]) => chosen.has(edge.from) && chosen.has(edge.to))),
    focus: middle,
    total: all.size,
  };
}

// What is chosen; else what was before; else the topic with most messages.
function middleOf(all, view, focus) {
  const chosen = [...all].find(([, { topic, name }]) => name === (topic ? view.topic : view.node));
  if (chosen) return chosen[0];
  if (all.has(focus)) return focus;
  const topics = [...all].filter(([, one]) => one.topic);
  return topics.reduce((best, one) => ((one[1].topic.hz ?? 0) > (best[1].topic.hz ?? 0) ? one : best))[0];
}

function neighbourhood(middle, edges) {
  const near = new Map();
  for (const { from, to } of edges)
    for (const [one, other] of [[from, to], [to, from]]) {
      if (!near.has(one)) near.set(one, new Set());
      near.get(one).add(other);
    }
  const found = new Set([middle]);
  for (const one of found) // which grows meanwhile: the nearest come first
    for (const other of near.get(one) ?? []) if (found.size < MOST_BOXES) found.add(other);
  return found;
}
