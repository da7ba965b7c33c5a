// Numbers as people read them.

export function rate(value) {
  if (value === null || value === undefined) return "–";
  if (value >= 999.5) return `${digits(value / 1000, 3)} k`;
  return value >= 99.95 ? value.toFixed(0) : value >= 9.95 ? value.toFixed(1) : value ? value.toPrecision(2) : "0";
}

export const hertz = (value) => rate(value).replace(/( k)?$/, (thousand) => `${thousand || " "}Hz`);

// That many digits, or all before the point: `toPrecision` alone would write 1.0e+2.
const digits = (value, number) => (value >= 10 ** number - 0.5 ? value.toFixed(0) : value.toPrecision(number));

export function size(value) {
  if (value === null || value === undefined) return "–";
  for (const [unit, least] of [["GB", 1e9], ["MB", 1e6], ["kB", 1e3]])
    if (value >= 0.9995 * least) return `${digits(value / least, 3)} ${unit}`;
  return `${Math.round(value)} B`;
}

export function age(ms) {
  if (ms === null || ms === undefined) return "";
  return ms >= 999.5 ? `${digits(ms / 1000, 3)} s` : `${digits(ms, 2)} ms`;
}

// Half of the messages, and 99 % of them, were at most so old: two numbers, with one unit where they share it.
export function ages(both) {
  if (!both) return "";
  const [half, most] = both.map(age);
  if (!most) return half;
  const [number, unit] = half.split(" ");
  return unit === most.split(" ")[1] ? `${number} / ${most}` : `${half} / ${most}`;
}

const grouped = (value, digits) => value.toLocaleString("en-US", { maximumFractionDigits: digits }).replaceAll(",", "\u00a0");

export const count = (value) => grouped(value, 3);

// A number at an axis, with all its digits.
export function tick(value) {
  const most = Math.abs(value);
  return most >= 1e15 || (most && most < 1e-6) ? value.toExponential() : grouped(value, 12);
}

export function reasons(dropped) {
  return Object.entries(dropped).filter(([, number]) => number)
    .map(([reason, number]) => `${count(number)} ${reason.replaceAll("_", " ")}`).join(", ");
}

export const shortType = (name) => name.replace("/msg/", "/");

export const plural = (number, word) => `${count(number)} ${word}${number === 1 ? "" : "s"}`;
