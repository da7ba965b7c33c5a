// Numbers as people read them.

export function rate(value) {
  if (value === null || value === undefined) return "–";
  if (value >= 1000) return `${(value / 1000).toPrecision(3)} k`;
  return value >= 100 ? value.toFixed(0) : value >= 10 ? value.toFixed(1) : value ? value.toPrecision(2) : "0";
}

export function size(value) {
  if (value === null || value === undefined) return "–";
  for (const [unit, least] of [["GB", 1e9], ["MB", 1e6], ["kB", 1e3]])
    if (value >= least) return `${(value / least).toPrecision(3)} ${unit}`;
  return `${Math.round(value)} B`;
}

export function age(ms) {
  if (ms === null || ms === undefined) return "";
  return ms >= 1000 ? `${(ms / 1000).toPrecision(3)} s` : `${ms >= 100 ? ms.toFixed(0) : ms.toPrecision(2)} ms`;
}

// Half of the messages, and 99 % of them, were at most so old: two numbers, with one unit where they share it.
export function ages(both) {
  if (!both) return "";
  const [half, most] = both.map(age);
  if (!most) return half;
  const [number, unit] = half.split(" ");
  return unit === most.split(" ")[1] ? `${number} / ${most}` : `${half} / ${most}`;
}

export const count = (value) => value.toLocaleString("en-US").replaceAll(",", "\u00a0");

export function reasons(dropped) {
  return Object.entries(dropped).filter(([, number]) => number)
    .map(([reason, number]) => `${count(number)} ${reason.replaceAll("_", " ")}`).join(", ");
}

export const shortType = (name) => name.replace("/msg/", "/");

export const plural = (number, word) => `${count(number)} ${word}${number === 1 ? "" : "s"}`;
