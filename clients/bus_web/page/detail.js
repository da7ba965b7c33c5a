// The chosen topic: who publishes and subscribes, what is lost and why, what does not match, and its values.
// Or the chosen node, with what it publishes and subscribes to.

import { Kept, element, setChildren, setText } from "./dom.js";
import { makeEndpoint } from "./endpoint.js";
import { count, hertz, shortType, size } from "./format.js";
import { Ages } from "./ages.js";
import { Losses } from "./losses.js";
import { Tree } from "./tree.js";

export class Detail {
  constructor(place, { close, plot, look, choose }) {
    this.place = place;
    this.empty = [...place.children];
    this.close = close;
    this.plot = plot;
    this.look = look;
    this.chooseTopic = choose;
    this.topic = this.node = null;
    this.opened = new Set();
  }

  choose(topic, node) {
    if (topic === this.topic && node === this.node) return;
    this.topic = topic;
    this.node = node;
    this.opened = new Set();
    if (topic === null && node === null) {
      this.place.replaceChildren(...this.empty);
      return;
    }
    this.about = element("p", { class: "note" });
    this.rows = new Kept(() => makeEndpoint(node === null ? null : this.chooseTopic));
    this.list = element("ul", { class: "ends", "aria-label": "Endpoints" });
    const title = element("div", { class: "title" }, element("h2", { id: "detail-title", tabindex: "-1" }, topic ?? node),
      element("button", { type: "button", onclick: () => this.close() }, "Close"));
    if (node !== null) {
      this.place.replaceChildren(title, this.about, this.list);
      return;
    }
    this.mismatches = element("ul", { class: "mismatches", "aria-label": "What does not match" });
    this.losses = new Losses();
    this.ages = new Ages();
    this.tree = new Tree((path) => this.plot(topic, path), (path) => this.toggle(path));
    this.valueNote = element("p", { class: "note", id: "value-note" }, "no message yet");
    this.place.replaceChildren(
      title, this.about, this.list, this.mismatches, this.losses.root, this.ages.root, element("h3", {}, "Values"), this.valueNote,
      element("div", { class: "values", tabindex: "0", role: "group", "aria-label": `Values of ${topic}` }, this.tree.root),
    );
  }

  toggle(path) {
    this.opened.has(path) ? this.opened.delete(path) : this.opened.add(path);
    this.tree.opened = this.opened;
    this.look();
  }

  show(bus) {
    if (this.node !== null) this.showNode(bus);
    if (this.topic === null) return;
    const topic = bus.topics.get(this.topic);
    if (!topic) {
      setText(this.about, "It is not on the bus now.");
      setChildren(this.list, []);
      setChildren(this.mismatches, []);
      return;
    }
    const figures = [topic.types.map(shortType).join(" and "), hertz(topic.hz), `${size(topic.bytesPerS)}/s`];
    setText(this.about, figures.join(" · "));
    const ends = [...topic.publishers, ...topic.subscriptions].filter((end) => bus.nodes.has(end.node));
    this.showEnds(bus, ends);
    this.losses.show(topic);
    this.ages.show(topic);
    const cut = bus.pairs.filter((pair) => pair.reason && pair.publisher.topic === this.topic);
    setChildren(this.mismatches, cut.slice(0, 20).map(({ publisher, subscription, reason }) => element("li", {},
      `${bus.nodes.get(publisher.node)?.name} and ${bus.nodes.get(subscription.node)?.name} don't match: ${reason}`)));
  }

  showNode(bus) {
    const nodes = [...bus.nodes.values()].filter((one) => one.name === this.node);
    setText(this.about, nodes.length ? nodes.map((one) => (one.origin ? `on ${one.origin}` : `process ${one.pid}`)).join(", ") : "It is not on the bus now.");
    const ends = [...bus.ends.values()].filter((end) => bus.nodes.get(end.node)?.name === this.node && !bus.topics.get(end.topic)?.isHidden);
    this.showEnds(bus, ends.sort((one, other) => (one.kind + one.topic < other.kind + other.topic ? -1 : 1)));
  }

  showEnds(bus, ends) {
    const rows = this.rows.only(ends.map((end) => end.id));
    setChildren(this.list, rows.map((row) => row.item));
    rows.forEach((row, at) => row.paint(ends[at], bus.nodes.get(ends[at].node)));
  }

  value(told) {
    if (told.topic !== this.topic) return;
    setText(this.valueNote, `message ${count(told.number)} · ${size(told.bytes)} · ${told.age_ms.toFixed(told.age_ms < 10 ? 2 : 0)} ms old on arrival`);
    this.tree.show(told.tree);
  }

  fault(told) {
    if (told.topic === this.topic) setText(this.valueNote, told.text);
  }

  plotted(paths) {
    if (this.topic !== null) this.tree.plotted = paths;
  }
}
