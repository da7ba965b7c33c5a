// Elements made and changed in place. Texts are text nodes, whatever is in them.

const SVG = "http://www.w3.org/2000/svg";

export function element(name, attributes = {}, ...children) {
  return fill(document.createElement(name), attributes, children);
}

export function svg(name, attributes = {}, ...children) {
  return fill(document.createElementNS(SVG, name), attributes, children);
}

function fill(made, attributes, children) {
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith("on")) made.addEventListener(name.slice(2), value);
    else if (value !== null && value !== false) made.setAttribute(name, value === true ? "" : value);
  }
  made.append(...children);
  return made;
}

// Change a text or an attribute only where it is another: what stays, stays for the reader and for the browser.
export function setText(one, text) {
  const words = String(text);
  if (one.textContent !== words) one.textContent = words;
}

export function setAttribute(one, name, value) {
  if (value === null || value === false) {
    if (one.hasAttribute(name)) one.removeAttribute(name);
  } else if (one.getAttribute(name) !== String(value)) one.setAttribute(name, value);
}

// The children of `parent` in that order, each moved only where it is not there already. A moved element loses the focus:
// so the others leave first, and the child with the focus stays where it is.
export function setChildren(parent, wanted) {
  const stay = new Set(wanted);
  for (const child of [...parent.childNodes]) if (!stay.has(child)) child.remove();
  const hasFocus = (child) => child.parentNode === parent && child.contains(document.activeElement);
  let at = parent.firstChild;
  for (const child of wanted) {
    if (hasFocus(child)) moveToEnd(parent, at, child);
    if (child === at || hasFocus(child)) at = child.nextSibling;
    else parent.insertBefore(child, at);
  }
}

// The children from `first` on, up to `end` without it.
function moveToEnd(parent, first, end) {
  for (let child = first; child !== end;) {
    const next = child.nextSibling;
    parent.append(child);
    child = next;
  }
}

// One object for each key, made when it is first needed and gone when it is no longer.
export class Kept {
  constructor(make) {
    this.make = make;
    this.all = new Map();
  }

  only(keys) {
    const kept = new Map();
    for (const key of keys) kept.set(key, this.all.get(key) ?? this.make(key));
    this.all = kept;
    return [...kept.values()];
  }
}
