// A message as a tree: made once for each shape, then only the texts change. A number can be chosen for a plot.

import { element, setAttribute, setText } from "./dom.js";
import { count, size } from "./format.js";

export class Tree {
  // `plot(path)` when a number is chosen, `open(path)` when a long array is opened or folded.
  constructor(plot, open) {
    this.plot = plot;
    this.open = open;
    this.root = element("div", { class: "tree" });
    this.slot = newSlot(this.root);
    this.plotted = new Set();
    this.opened = new Set();
  }

  show(value) {
    this.fill(this.slot, value, "");
  }

  fill(slot, value, path) {
    const kind = kindOf(value);
    if (slot.kind !== kind) {
      slot.kind = kind;
      slot.place.replaceChildren();
      Object.assign(slot, this[`make_${kind}`](slot.place, path));
    }
    this[`fill_${kind}`](slot, value, path);
  }

  make_number(place, path) {
    const button = element("button", { type: "button", class: "value", title: "plot it", onclick: () => this.plot(path) });
    place.append(button);
    return { button };
  }

  fill_number({ button }, value, path) {
    setText(button, Number.isInteger(value) ? value : Number(value.toPrecision(9)));
    setAttribute(button, "aria-pressed", this.plotted.has(path));
    setAttribute(button, "aria-label", `${path} ${button.textContent}, plot it`);
  }

  make_text(place) {
    const text = element("span", { class: "text" });
    place.append(text);
    return { text };
  }

  fill_text({ text }, value) {
    setText(text, plain(value));
  }

  make_parts(place) {
    const list = element("ul");
    place.append(list);
    return { list, slots: new Map() };
  }

  fill_parts(slot, value, path) {
    this.fillList(slot, Object.entries(value), path);
  }

  fillList({ list, slots }, entries, path) {
    const names = new Set(entries.map(([name]) => name));
    for (const [name, slot] of slots)
      if (!names.has(name)) {
        slot.item.remove();
        slots.delete(name);
      }
    for (const [name, value] of entries) {
      let slot = slots.get(name);
      if (!slot) {
        const place = element("span");
        slot = newSlot(place);
        slot.item = element("li", {}, element("span", { class: "key" }, `${name}:`), " ", place);
        slots.set(name, slot);
        list.append(slot.item);
      }
      this.fill(slot, value, path ? `${path}.${name}` : name);
    }
  }

  make_array(place, path) {
    const button = element("button", { type: "button", class: "fold", onclick: () => this.open(path) });
    const list = element("ul", { class: "flow" });
    place.append(button, list);
    return { button, list, slots: new Map() };
  }

  fill_array(slot, value, path) {
    const isFolded = !Array.isArray(value);
    const parts = isFolded ? value.head : value, length = isFolded ? value.$array : value.length;
    slot.button.hidden = !isFolded;
    const isOpen = this.opened.has(path);
    slot.list.hidden = isFolded && !isOpen;
    setText(slot.button, isOpen ? `fold ${count(length)} elements` : `${count(length)} elements`);
    setAttribute(slot.button, "aria-expanded", isOpen);
    this.fillList(slot, parts.map((part, at) => [String(at), part]), path);
  }

  make_picture(place) {
    const canvas = element("canvas", { role: "img", "aria-label": "the image, small" });
    place.append(canvas);
    return { canvas };
  }

  fill_picture({ canvas }, { $image: image }) {
    if (image.of) setAttribute(canvas, "title", `${image.of.join(" × ")} pixels, shown small`);
    draw(canvas, image);
  }
}

const newSlot = (place) => ({ place, kind: "" });

function kindOf(value) {
  if (typeof value === "number") return "number";
  if (Array.isArray(value)) return "array";
  if (value === null || typeof value !== "object") return "text";
  if ("$array" in value) return "array";
  if ("$image" in value) return "picture";
  return Object.keys(value).some((key) => key[0] === "$") ? "text" : "parts";
}

function plain(value) {
  if (value === null || typeof value !== "object") return typeof value === "string" ? value : String(value);
  if ("$text" in value) return `${value.head}… (${count(value.$text)} characters)`;
  if ("$bytes" in value) return `${value.head}${value.$bytes * 2 > value.head.length ? "…" : ""} (${size(value.$bytes)})`;
  if ("$number" in value) return value.$number;
  if ("$map" in value) {
    const pairs = value.$map.map(([key, part]) => `${plain(key)}: ${JSON.stringify(part)}`);
    return [...pairs, ...(value.length > pairs.length ? [`… (${count(value.length)} in all)`] : [])].join(", ");
  }
  return String(value.$folded);
}

const bytesOf = (text) => Uint8Array.from(atob(text), (one) => one.charCodeAt(0));

async function draw(canvas, image) {
  const context = canvas.getContext("2d");
  if (image.rgb === undefined) {
    const picture = await createImageBitmap(new Blob([bytesOf(image.data)], { type: image.type })).catch(() => null);
    if (!picture) return;
    const scale = Math.min(1, 240 / Math.max(picture.width, picture.height));
    canvas.width = Math.round(picture.width * scale);
    canvas.height = Math.round(picture.height * scale);
    context.drawImage(picture, 0, 0, canvas.width, canvas.height);
    return;
  }
  const rgb = bytesOf(image.rgb), pixels = new ImageData(image.width, image.height);
  for (let at = 0, to = 0; at < rgb.length; at += 3, to += 4) {
    pixels.data[to] = rgb[at];
    pixels.data[to + 1] = rgb[at + 1];
    pixels.data[to + 2] = rgb[at + 2];
    pixels.data[to + 3] = 255;
  }
  if (canvas.width !== image.width) canvas.width = image.width;
  if (canvas.height !== image.height) canvas.height = image.height;
  context.putImageData(pixels, 0, 0);
}

// The number at `path` of a message; undefined where there is none.
export function numberAt(tree, path) {
  let value = tree;
  for (const name of path.split(".")) {
    if (value === null || typeof value !== "object") return undefined;
    value = Array.isArray(value) ? value[Number(name)] : "$array" in value ? value.head[Number(name)] : value[name];
  }
  return typeof value === "number" ? value : undefined;
}
