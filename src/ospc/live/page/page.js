"use strict";

const at = (id) => document.getElementById(id);
const STAGES = { filming: "", estimating: "estimating …", writing: "writing …" };
let view = null;

const address = new URL("socket", location.href);
address.protocol = "ws:";
const socket = new WebSocket(address);
socket.binaryType = "blob";
socket.onmessage = (message) => {
  if (typeof message.data === "string") {
    view = JSON.parse(message.data);
    show();
  } else {
    createImageBitmap(message.data).then(showPicture, () => {});
  }
};
socket.onclose = () => {
  at("finish").disabled = true;
  if (!view || !["written", "failed"].includes(view.stage)) at("state").textContent = "the program has ended";
};
at("finish").onclick = () => {
  socket.send("finish");
  at("finish").disabled = true;
};
addEventListener("resize", () => view && show());
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => view && show());

function show() {
  const now = view.instruction;
  const ended = view.stage !== "filming";
  at("state").textContent = view.message || STAGES[view.stage] ||
    `${view.seconds.toFixed(0)} s, ${view.frames} frames` + (view.dropped ? `, ${view.dropped} dropped` : "");
  at("instruction").textContent = ended ? view.message || STAGES[view.stage] : now.text;
  at("instruction").dataset.kind = now.kind;
  at("instruction").className = now.kind === "done" || view.stage === "written" ? "done" : "";
  if (ended) at("finish").disabled = true;
  for (const [name, value] of Object.entries(view.bars)) {
    at(name).value = value;
    at(name).classList.toggle("full", value > 0.995);
    at(name).nextElementSibling.value = `${Math.floor(100 * value)} %`;
  }
  at("response-sigma").value = sigma(now.response_sigma);
  at("vignette-sigma").value = sigma(now.vignette_sigma);
  curve(at("response"), view.response, "--blue", now.greys);
  curve(at("vignette"), view.vignette, "--orange", now.radii);
  overlay();
}

const sigma = (value) => (value === null ? "" : `±${value.toPrecision(2)}, goal ±${view.goal}`);
const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

function showPicture(picture) {
  const canvas = at("picture");
  if (canvas.width !== picture.width || canvas.height !== picture.height) {
    [canvas.width, canvas.height] = [picture.width, picture.height];
    canvas.parentElement.style.aspectRatio = `${picture.width} / ${picture.height}`;
  }
  canvas.getContext("2d").drawImage(picture, 0, 0);
  canvas.dataset.shown = Number(canvas.dataset.shown || 0) + 1;
  picture.close();
}

/* Resize a canvas to its displayed size; return its context with width and height in CSS pixels. */
function cleared(canvas) {
  const scale = devicePixelRatio || 1;
  const [width, height] = [canvas.clientWidth, canvas.clientHeight];
  canvas.width = Math.round(width * scale);
  canvas.height = Math.round(height * scale);
  const pen = canvas.getContext("2d");
  pen.setTransform(scale, 0, 0, scale, 0, 0);
  return [pen, width, height];
}

function overlay() {
  const [pen, width, height] = cleared(at("overlay"));
  for (const [row, cells] of (view.places || []).entries()) {
    const [w, h] = [width / cells.length, height / view.places.length];
    for (const [column, filled] of cells.entries()) {
      pen.fillStyle = `rgb(40 200 150 / ${0.22 * filled})`;
      pen.fillRect(column * w, row * h, w, h);
    }
  }
  const corner = Math.hypot(width, height) / 2;
  for (const [ring, filled] of (view.radii || []).entries()) {
    pen.strokeStyle = `rgb(90 170 255 / ${0.75 * filled})`;
    pen.lineWidth = 1.5;
    pen.beginPath();
    pen.arc(width / 2, height / 2, ((ring + 0.5) / view.radii.length) * corner, 0, 2 * Math.PI);
    pen.stroke();
  }
  if (view.stage === "filming" && view.instruction.arrow) arrow(pen, view.instruction.arrow, width, height);
}

function arrow(pen, [[x0, y0], [x1, y1]], width, height) {
  const [from, to] = [[x0 * width, y0 * height], [x1 * width, y1 * height]];
  const angle = Math.atan2(to[1] - from[1], to[0] - from[0]);
  const head = Math.max(18, width / 22);
  const path = new Path2D();
  path.moveTo(...from);
  path.lineTo(to[0] - head * 0.7 * Math.cos(angle), to[1] - head * 0.7 * Math.sin(angle));
  const tip = new Path2D();
  tip.moveTo(...to);
  for (const side of [2.6, -2.6]) tip.lineTo(to[0] + head * Math.cos(angle + side), to[1] + head * Math.sin(angle + side));
  tip.closePath();
  for (const [ink, extra] of [["rgb(0 0 0 / 70%)", 4], [colour("--arrow"), 0]]) {
    pen.strokeStyle = pen.fillStyle = ink;
    pen.lineWidth = 6 + extra;
    pen.stroke(path);
    pen.lineWidth = extra;
    if (extra) pen.stroke(tip);
    pen.fill(tip);
    pen.beginPath();
    pen.arc(...from, 7 + extra / 2, 0, 2 * Math.PI);
    pen.fill();
  }
}

function curve(canvas, known, name, wanted) {
  const [pen, width, height] = cleared(canvas);
  const [left, top] = [6, 6];
  const x = (share) => left + share * (width - 2 * left);
  const y = (value) => height - top - Math.min(Math.max(value, 0), 1.05) / 1.05 * (height - 2 * top);
  if (wanted) {
    pen.fillStyle = colour("--line");
    pen.fillRect(x(wanted[0]), 0, x(wanted[1]) - x(wanted[0]), height);
  }
  pen.strokeStyle = colour("--line");
  pen.lineWidth = 1;
  for (const share of [0, 0.5, 1]) {
    pen.beginPath();
    pen.moveTo(x(0), y(share));
    pen.lineTo(x(1), y(share));
    pen.stroke();
  }
  if (!known) return;
  const last = known.value.length - 1;
  const line = (side) => known.value.map((value, i) => [x(i / last), y(value + side * 2 * known.sigma[i])]);
  pen.fillStyle = pen.strokeStyle = colour(name);
  pen.globalAlpha = 0.3;
  pen.beginPath();
  for (const point of [...line(1), ...line(-1).reverse()]) pen.lineTo(...point);
  pen.fill();
  pen.globalAlpha = 1;
  pen.lineWidth = 2;
  pen.beginPath();
  for (const point of line(0)) pen.lineTo(...point);
  pen.stroke();
}
