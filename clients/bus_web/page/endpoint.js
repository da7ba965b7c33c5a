// An endpoint as an item of a list: what it counts, its queue, its losses, its QoS.

import { SECONDS } from "./bus.js";
import { element, setAttribute, setText, svg } from "./dom.js";
import { ages, count, hertz, plural, reasons, shortType } from "./format.js";
import { bars } from "./losses.js";

const WIDTH = 72, HEIGHT = 10;

// `choose`: where the list is of a node, each endpoint has its topic, which may be chosen.
export function makeEndpoint(choose) {
  const kind = element("span", { class: "kind" });
  const node = choose ? element("button", { type: "button", class: "name", onclick: () => choose(node.textContent) }) : element("b");
  const process = element("span", { class: "note" });
  const qos = element("span", { class: "note" }), figures = element("span"), lost = element("span", { class: "loss" }), advice = element("div", { class: "advice", hidden: true });
  const strip = svg("path", { class: "strip" });
  const past = svg("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, width: WIDTH, height: HEIGHT, role: "img", class: "spark" }, strip);
  const item = element("li", {}, element("div", {}, kind, " ", node, " ", process), element("div", {}, figures, " ", lost, " ", past), advice, element("div", {}, qos));
  return {
    item,
    paint(end, about) {
      const isSubscription = end.kind === "subscription";
      setText(kind, isSubscription ? "sub" : "pub");
      setAttribute(kind, "title", end.kind);
      setText(node, choose ? end.topic : about.name);
      setText(process, choose ? shortType(end.type) : about.origin ? `on ${about.origin}` : `pid ${about.pid}`);
      const messages = end.messages === null ? "" : `${count(end.messages)} messages, `;
      const queue = isSubscription ? `, queue ${count(end.queued)}${end.depth === null ? "" : ` of ${count(end.depth)}`}` : "";
      const routes = [...end.routes].sort().join(" and ");
      setText(figures, `${messages}${hertz(end.hz)}${queue}${isSubscription && end.age !== null ? `, ${ages(end.age)} old` : ""}${routes ? `, by ${routes}` : end.reasons.length ? "" : ", alone"}`);
      setText(lost, end.lost ? `lost ${count(end.lost)}${reasons(end.dropped) ? `: ${reasons(end.dropped)}` : ""}` : "");
      setAttribute(lost, "class", end.lostPerS ? "loss losing" : "loss");
      const recent = Math.round(end.lostHistory.reduce((sum, one) => sum + one, 0));
      past.toggleAttribute("hidden", !recent);
      setAttribute(strip, "d", bars(end.lostHistory, SECONDS, WIDTH, HEIGHT - 1, HEIGHT));
      setAttribute(past, "aria-label", `${plural(recent, "message")} lost in the last minute`);
      setText(advice, end.advice);
      advice.hidden = !end.advice;
      setText(qos, end.qos);
    },
  };
}
