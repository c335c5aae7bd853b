// Spectra of many windows over one another, as a map of colours with a cursor.

import { get } from "../api.js";
import { colour } from "../chart.js";
import { choice, element, panel } from "../dom.js";
import { dateTime, instant, number, revolutions, sentence } from "../format.js";
import { unitOf } from "./signal_chart.js";

const HEIGHT = 420;
const [LEFT, BOTTOM, TOP, RIGHT] = [92, 44, 10, 14];
const BAR = 96; // width of the colour scale
// viridis (S. van der Walt, N. Smith, CC0): even in brightness, and read without colour vision
const MAP = [[68, 1, 84], [71, 44, 122], [59, 81, 139], [44, 113, 142], [33, 144, 141], [39, 173, 129], [92, 200, 99], [170, 220, 50], [253, 231, 37]];

function shade(share) {
  const at = Math.min(Math.max(share, 0), 1) * (MAP.length - 1);
  const i = Math.min(Math.floor(at), MAP.length - 2);
  return MAP[i].map((c, k) => Math.round(c + (at - i) * (MAP[i + 1][k] - c)));
}

// Fills `root`; `choose(index)` is called with the window of a row that is clicked, or on which Enter is pressed.
export function waterfallView(root, { machine, signal, kept, channel, choose }) {
  const options = { view: "order-spectrum", range: 80, x_to: "", markers: true };
  const canvas = element("canvas", { className: "waterfall", tabIndex: 0 });
  canvas.setAttribute("role", "img");
  canvas.setAttribute("aria-label", "Waterfall: not computed yet");
  const reading = element("p", { className: "reading", "aria-live": "polite" });
  const said = element("p", { className: "caption", role: "status" });
  const links = element("p", { className: "downloads" });
  let answer = null;
  let cursor = null; // { row, column }
  let high = 1;

  const path = (more) => `${machine.base}/waterfall?${new URLSearchParams({ view: options.view, channel: channel() || kept.channels[0],
    ...(options.x_to ? { x_to: options.x_to } : {}), ...more })}`;

  async function load() {
    if (!kept.windows.length) {
      said.textContent = sentence(kept.reason ?? "no window's signals are kept yet");
      canvas.hidden = true;
      return;
    }
    canvas.hidden = false;
    said.textContent = "Computing the spectra …";
    try {
      answer = await get(path({ bins: 600, windows: 80 }), { signal });
    } catch (error) {
      if (error.name === "AbortError") return;
      answer = null;
      if (options.view === "order-spectrum" && error.status === 409 && !path({}).includes("encoder")) { // no angle: frequency needs none
        options.view = "spectrum";
        select.value = "spectrum";
        load();
        return;
      }
      said.textContent = sentence(error.message);
      draw();
      return;
    }
    cursor = null;
    const left = answer.left_out.length ? ` ${answer.left_out.length} windows without this spectrum are left out (window ${
      answer.left_out[0].index}: ${answer.left_out[0].reason}).` : "";
    said.textContent = `${answer.channel}. ${answer.notes.join(". ")}.${left}`;
    links.replaceChildren("Download: ", element("a", { href: path({ format: "csv" }) }, "CSV"), " · ",
      element("a", { href: path({ format: "png" }), target: "_blank" }, "PNG"));
    draw();
  }

  const area = () => ({ width: canvas.clientWidth - LEFT - RIGHT - BAR, height: HEIGHT - TOP - BOTTOM });
  const rowLabel = (w) => (w.revolutions === null ? `window ${w.index}` : `${revolutions(w.revolutions)} rev`);

  function draw() {
    const px = devicePixelRatio || 1;
    canvas.width = Math.max(canvas.clientWidth, 200) * px;
    canvas.height = HEIGHT * px;
    const ctx = canvas.getContext("2d");
    ctx.scale(px, px);
    ctx.clearRect(0, 0, canvas.clientWidth, HEIGHT);
    if (!answer) return;
    const { width, height } = area();
    const rows = answer.values.length;
    const columns = answer.x.values.length;
    const flat = answer.values.flat().filter((v) => v > 0).sort((a, b) => a - b);
    high = flat[Math.floor(0.999 * (flat.length - 1))] ?? 1;
    const picture = new ImageData(columns, rows);
    answer.values.forEach((row, r) => row.forEach((v, c) => {
      const at = 4 * ((rows - 1 - r) * columns + c);
      if (v === null) return;
      const db = v > 0 ? 20 * Math.log10(v / high) : -Infinity;
      picture.data.set([...shade(1 + db / options.range), 255], at);
    }));
    const small = element("canvas", { width: columns, height: rows });
    small.getContext("2d").putImageData(picture, 0, 0);
    ctx.imageSmoothingEnabled = false;
    ctx.drawImage(small, LEFT, TOP, width, height);
    axes(ctx, width, height);
    scale(ctx, width, height);
    if (options.markers) markers(ctx, width, height);
    if (cursor) cross(ctx, width, height);
    describe();
  }

  function axes(ctx, width, height) {
    ctx.fillStyle = ctx.strokeStyle = colour("muted");
    ctx.font = "12px system-ui, sans-serif";
    ctx.textAlign = "center";
    const top = highest();
    const step = niceStep(top, Math.max(width / 90, 2));
    for (let x = 0; x <= top * 1.0001; x += step) {
      const at = LEFT + (x / top) * width;
      ctx.fillRect(at, TOP + height, 1, 5);
      ctx.fillText(number(x), at, TOP + height + 18);
    }
    ctx.fillText(unitOf(answer.x.label, answer.x.unit), LEFT + width / 2, HEIGHT - 6);
    ctx.textAlign = "right";
    const each = Math.ceil((answer.windows.length * 16) / height);
    answer.windows.forEach((w, r) => {
      if (r % each) return;
      ctx.fillText(rowLabel(w), LEFT - 6, TOP + height - ((r + 0.5) / answer.windows.length) * height + 4);
    });
    ctx.textAlign = "left";
  }

  function scale(ctx, width, height) {
    const left = LEFT + width + 16;
    for (let y = 0; y < height; y += 1) {
      ctx.fillStyle = `rgb(${shade(1 - y / height).join(",")})`;
      ctx.fillRect(left, TOP + y, 14, 1);
    }
    ctx.fillStyle = colour("muted");
    for (let share = 0; share <= 1; share += 0.25) {
      ctx.fillText(`${number(high * 10 ** ((-options.range * (1 - share)) / 20), 2)}`, left + 19, TOP + height * (1 - share) + (share === 1 ? 10 : 4));
    }
    ctx.fillText(answer.unit, left, TOP + height + 18);
  }

  function markers(ctx, width, height) {
    ctx.font = "11px system-ui, sans-serif";
    let free = -Infinity;
    for (const m of answer.markers.filter((one) => one.kind === "mesh")) {
      const at = LEFT + (m.x / highest()) * width;
      if (at < free || at + ctx.measureText(m.label).width + 3 > LEFT + width) continue;
      ctx.fillStyle = "rgb(255 255 255 / .85)";
      ctx.fillText(m.label, at + 3, TOP + 12);
      ctx.fillRect(at, TOP, 1, 14);
      free = at + ctx.measureText(m.label).width + 8;
    }
  }

  function cross(ctx, width, height) {
    const x = LEFT + ((cursor.column + 0.5) / answer.x.values.length) * width;
    const y = TOP + height - ((cursor.row + 0.5) / answer.windows.length) * height;
    ctx.fillStyle = "rgb(255 255 255 / .8)";
    ctx.fillRect(x, TOP, 1, height);
    ctx.fillRect(LEFT, y, width, 1);
  }

  const highest = () => {
    const { values } = answer.x;
    return values.at(-1) + (values[1] - values[0]) / 2;
  };

  function describe() {
    canvas.setAttribute("aria-label", `Waterfall of ${answer.channel}: ${answer.windows.length} windows from ${
      rowLabel(answer.windows[0])} to ${rowLabel(answer.windows.at(-1))}, ${answer.x.label} up to ${number(highest())} ${
      answer.x.unit}. Arrow keys move the cursor, Enter shows the window.`);
  }

  function moveTo(row, column) {
    cursor = { row: clamp(row, answer.windows.length), column: clamp(column, answer.x.values.length) };
    const w = answer.windows[cursor.row];
    const value = answer.values[cursor.row][cursor.column];
    reading.textContent = `window ${w.index} · ${dateTime(instant(w.start_time))} · ${rowLabel(w)} · ${
      number(answer.x.values[cursor.column], 5)} ${answer.x.unit} · ${value === null ? "no value" : `${number(value)} ${answer.unit}`}`;
    draw();
  }

  function placeOf(event) {
    const { width, height } = area();
    const box = canvas.getBoundingClientRect();
    return [Math.floor((1 - (event.clientY - box.top - TOP) / height) * answer.windows.length),
      Math.floor(((event.clientX - box.left - LEFT) / width) * answer.x.values.length)];
  }

  let waiting = false;
  canvas.addEventListener("pointermove", (event) => {
    if (!answer || waiting) return;
    waiting = true;
    requestAnimationFrame(() => {
      waiting = false;
      moveTo(...placeOf(event));
    });
  });
  canvas.addEventListener("click", (event) => {
    if (!answer) return;
    moveTo(...placeOf(event));
    choose(answer.windows[cursor.row].index);
  });
  canvas.addEventListener("keydown", (event) => {
    if (!answer) return;
    const { row, column } = cursor ?? { row: answer.windows.length - 1, column: 0 };
    const leap = event.shiftKey ? 10 : 1;
    const moves = { ArrowUp: [row + 1, column], ArrowDown: [row - 1, column], ArrowLeft: [row, column - leap],
      ArrowRight: [row, column + leap], Home: [row, 0], End: [row, answer.x.values.length - 1] };
    if (event.key === "Enter" && cursor) choose(answer.windows[cursor.row].index);
    else if (moves[event.key]) moveTo(...moves[event.key]);
    else return;
    event.preventDefault();
  });
  const size = new ResizeObserver(() => draw());
  size.observe(canvas);
  const dark = matchMedia("(prefers-color-scheme: dark)");
  dark.addEventListener("change", draw, { signal });
  signal.addEventListener("abort", () => size.disconnect());

  const select = element("select", { ariaLabel: "Axis", onchange: () => { options.view = select.value; options.x_to = limit.value = ""; load(); } },
    new Option("orders of pinion rotation", "order-spectrum"), new Option("frequency", "spectrum"));
  const range = element("select", { ariaLabel: "Range of the colours", onchange: () => { options.range = Number(range.value); draw(); } },
    ...[40, 60, 80].map((db) => new Option(`${db} dB`, String(db), false, db === options.range)));
  const limit = element("input", { type: "number", min: "0", step: "any", className: "short", ariaLabel: "Up to",
    onchange: () => { options.x_to = limit.value; load(); } });
  root.append(panel("Waterfall of all windows that are kept",
    element("div", { className: "controls" }, labelled("over", select), labelled("up to", limit), labelled("colours", range),
      choice("mesh harmonics", true, (checked) => { options.markers = checked; draw(); })),
    said, reading, canvas, links));
  load();
  return { load };
}

export const labelled = (text, control) => element("label", { className: "control" }, `${text} `, control);

const clamp = (value, count) => Math.min(Math.max(value, 0), count - 1);

function niceStep(span, count) {
  const raw = span / count;
  const power = 10 ** Math.floor(Math.log10(raw));
  return [1, 2, 5, 10].map((f) => f * power).find((step) => step >= raw);
}
