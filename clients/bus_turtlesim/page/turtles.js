// The turtles and what their pens have drawn, as the server tells it: a picture first, then what is new.

const SIDE_PX = 500;
const METRE_PX = 45;
const AGAIN_MS = 1000;
const SHELLS = ["#3c8c3c", "#8c6a3c", "#8c3c6a", "#3c6a8c", "#c0a030", "#7a5cc0", "#2f8f8a", "#b5533c"];

const field = document.getElementById("field");
const state = document.getElementById("state");
const rows = document.getElementById("turtles");
const pens = document.createElement("canvas");
pens.width = pens.height = SIDE_PX;
const ink = pens.getContext("2d");

const scale = Math.max(1, Math.round(window.devicePixelRatio || 1));
field.width = field.height = SIDE_PX * scale;
const view = field.getContext("2d");

let frame = null;

function take(told) {
  if (told instanceof ArrayBuffer) {
    ink.clearRect(0, 0, SIDE_PX, SIDE_PX);
    if (told.byteLength) ink.putImageData(new ImageData(new Uint8ClampedArray(told), SIDE_PX, SIDE_PX), 0, 0);
    return;
  }
  frame = JSON.parse(told);
  if (frame.cleared) ink.clearRect(0, 0, SIDE_PX, SIDE_PX);
  for (const [left, top, right, bottom, colour] of frame.squares) {
    ink.fillStyle = colour;
    ink.fillRect(left, top, right - left, bottom - top);
  }
  draw();
  list();
}

function draw() {
  view.setTransform(scale, 0, 0, scale, 0, 0);
  view.fillStyle = frame.background;
  view.fillRect(0, 0, SIDE_PX, SIDE_PX);
  view.drawImage(pens, 0, 0);
  for (const turtle of frame.turtles) drawTurtle(turtle);
}

// A turtle that looks along the first axis, in pixels.
function drawTurtle({ x, y, theta, picture }) {
  const shell = SHELLS[picture % SHELLS.length];
  view.save();
  view.translate(x * METRE_PX, SIDE_PX - 1 - y * METRE_PX);
  view.rotate(-theta);
  view.lineWidth = 1.2;
  view.strokeStyle = "#202020";
  view.fillStyle = "#9ccf8a";
  for (const [along, across] of [[11, 13], [11, -13], [-11, 13], [-11, -13]]) ellipse(along, across, 6.5, 4, Math.sign(across) * 0.6);
  ellipse(-19, 0, 4.5, 2, 0);
  ellipse(20, 0, 7, 5.5, 0);
  view.fillStyle = shell;
  ellipse(0, 0, 17, 14, 0);
  view.beginPath();
  for (let corner = 0; corner < 6; corner += 1) {
    const angle = (corner * Math.PI) / 3;
    view.lineTo(8 * Math.cos(angle), 7 * Math.sin(angle));
  }
  view.closePath();
  for (let corner = 0; corner < 6; corner += 1) {
    const angle = (corner * Math.PI) / 3;
    view.moveTo(8 * Math.cos(angle), 7 * Math.sin(angle));
    view.lineTo(16 * Math.cos(angle), 13 * Math.sin(angle));
  }
  view.stroke();
  view.fillStyle = "#202020";
  for (const across of [2.4, -2.4]) dot(22.5, across, 1.1);
  view.restore();
}

function ellipse(x, y, long, wide, turn) {
  view.beginPath();
  view.ellipse(x, y, long, wide, turn, 0, 2 * Math.PI);
  view.fill();
  view.stroke();
}

function dot(x, y, radius) {
  view.beginPath();
  view.arc(x, y, radius, 0, 2 * Math.PI);
  view.fill();
}

// Rows are updated in place.
function list() {
  while (rows.rows.length > frame.turtles.length) rows.deleteRow(-1);
  frame.turtles.forEach((turtle, index) => {
    const row = rows.rows[index] ?? rows.insertRow();
    while (row.cells.length < 4) row.insertCell();
    const texts = [turtle.name, ...[turtle.x, turtle.y, turtle.theta].map((number) => number.toFixed(2))];
    texts.forEach((text, cell) => {
      if (row.cells[cell].textContent !== text) row.cells[cell].textContent = text;
    });
  });
  const names = frame.turtles.map((turtle) => turtle.name).join(", ");
  field.setAttribute("aria-label", names ? `Turtles: ${names}` : "No turtles");
}

function say(text, isAway) {
  state.textContent = text;
  state.className = isAway ? "away" : "";
}

function open() {
  const socket = new WebSocket(`ws://${location.host}/`, "busd.turtlesim.v1");
  socket.binaryType = "arraybuffer";
  socket.onopen = () => say("live", false);
  socket.onmessage = (event) => take(event.data);
  socket.onclose = () => {
    say("turtlesim_node has ended, or this page is of an earlier one", true);
    setTimeout(open, AGAIN_MS);
  };
}

open();
