// Faults of the page's layout of twenty graphs: boxes and labels that overlap, lines that cross one. For test_web_page.py.

const done = arguments[arguments.length - 1];
import("/layout.js").then(({ layOut }) => {
  let seed = 1;
  const random = (most) => (seed = (seed * 48271) % 2147483647) % most;
  const faults = [];
  for (let trial = 0; trial < 20; trial++) {
    const boxes = new Map(), edges = new Map(), nodes = 2 + random(9), topics = 2 + random(14);
    for (let one = 0; one < nodes; one++) boxes.set(`n${one}`, { width: 40 + random(120), height: 28, isRound: false });
    for (let one = 0; one < topics; one++) boxes.set(`t${one}`, { width: 142 + random(80), height: 44, isRound: true });
    for (let one = 0; one < 3 * topics; one++) {
      const ends = [`n${random(nodes)}`, `t${random(topics)}`], [from, to] = random(2) ? ends : ends.reverse();
      edges.set(`${from}>${to}`, { from, to, room: from[0] === "t" && random(3) ? 40 + random(60) : 0 });
    }
    const plan = layOut(boxes, edges);
    const areas = [...plan.boxes].map(([id, { x, y, width, height }]) => ({ id, x, y, width, height }));
    for (const [id, { middle }] of plan.edges)
      if (edges.get(id).room) areas.push({ id: `label ${id}`, ...middle, width: edges.get(id).room, height: 14 });
    const overlap = (one, other) => Math.abs(one.x - other.x) < (one.width + other.width) / 2
      && Math.abs(one.y - other.y) < (one.height + other.height) / 2;
    areas.forEach((one, at) => areas.slice(at + 1).forEach((other) => overlap(one, other) && faults.push([trial, one.id, other.id])));
    for (const [id, { path }] of plan.edges) {
      const line = document.createElementNS("http://www.w3.org/2000/svg", "path");
      line.setAttribute("d", path);
      const own = [edges.get(id).from, edges.get(id).to, `label ${id}`];
      const others = areas.filter((one) => !own.includes(one.id));
      for (let at = 0, length = line.getTotalLength(); at <= length; at += 3) {
        const { x, y } = line.getPointAtLength(at), hit = others.find((one) => overlap(one, { x, y, width: 0, height: 0 }));
        if (hit) faults.push([trial, id, hit.id]);
        if (x < plan.left - 1 || x > plan.right + 1 || y < plan.top - 1 || y > plan.bottom + 1) faults.push([trial, id, "outside"]);
      }
    }
  }
  done(faults);
});
