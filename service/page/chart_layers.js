// What is drawn on a chart below and above its lines: bands, vertical marks, limits, inspections, points outside the scale.

const ratio = () => devicePixelRatio || 1;

function within(u, draw) {
  const { ctx, bbox } = u;
  ctx.save();
  ctx.beginPath();
  ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
  ctx.clip();
  draw(ctx, bbox, ratio());
  ctx.restore();
}

function line(ctx, fromX, fromY, toX, toY) {
  ctx.beginPath();
  ctx.moveTo(fromX, fromY);
  ctx.lineTo(toX, toY);
  ctx.stroke();
}

function area(ctx, corners) {
  ctx.beginPath();
  for (const [x, y] of corners) ctx.lineTo(x, y);
  ctx.fill();
}

export function drawBands(u, { bands, values }, colour) {
  within(u, (ctx) => {
    for (const { low, high, colour: name = "predicted" } of bands) {
      ctx.fillStyle = colour(name);
      ctx.globalAlpha = 0.18;
      for (const [from, to] of runs(low, high)) {
        const edge = (bound) => values.slice(from, to + 1).map((x, i) => [u.valToPos(x, "x", true), u.valToPos(bound[from + i], "y", true)]);
        area(ctx, [...edge(high), ...edge(low).reverse()]);
      }
    }
  });
}

// The stretches in which both edges are known.
function* runs(low, high) {
  let from = -1;
  for (let i = 0; i <= low.length; i += 1) {
    const known = i < low.length && Number.isFinite(low[i]) && Number.isFinite(high[i]);
    if (known && from < 0) from = i;
    if (!known && from >= 0) {
      yield [from, i - 1];
      from = -1;
    }
  }
}

export function drawMarks(u, { marks }, colour) {
  within(u, (ctx, box, px) => {
    ctx.font = `${11 * px}px system-ui, sans-serif`;
    [ctx.textAlign, ctx.textBaseline] = ["left", "alphabetic"];
    let free = -Infinity; // where the last label ends
    for (const { x, label, colour: name = "update", dash = [2, 3] } of [...marks].sort((a, b) => a.x - b.x)) {
      const at = Math.round(u.valToPos(x, "x", true));
      if (at < box.left - 1 || at > box.left + box.width + 1) continue;
      ctx.strokeStyle = ctx.fillStyle = colour(name);
      ctx.lineWidth = px;
      ctx.setLineDash(dash.map((d) => d * px));
      line(ctx, at, box.top, at, box.top + box.height);
      if (!label) continue;
      const width = ctx.measureText(label).width;
      const fits = (x) => x >= box.left && x + width <= box.left + box.width;
      const left = [at + 4 * px, at - 4 * px - width].find(fits) ?? box.left + 2 * px; // in a narrow chart at its edge
      if (left < free) continue;
      ctx.fillText(label, left, box.top + 11 * px);
      free = left + width + 6 * px;
    }
  });
}

export function drawLimits(u, { limits }, colour) {
  within(u, (ctx, box, px) => {
    for (const { y, label, colour: name = "bad" } of limits) {
      const at = Math.round(u.valToPos(y, "y", true));
      if (at < box.top) continue;
      ctx.strokeStyle = ctx.fillStyle = colour(name);
      ctx.lineWidth = 1.5 * px;
      ctx.setLineDash([6 * px, 4 * px]);
      line(ctx, box.left, at, box.left + box.width, at);
      ctx.font = `${11.5 * px}px system-ui, sans-serif`;
      [ctx.textAlign, ctx.textBaseline] = ["left", "alphabetic"];
      ctx.fillText(label, box.left + 6 * px, at > box.top + 16 * px ? at - 5 * px : at + 14 * px);
    }
  });
}

export function drawSpots(u, { spots }, colour) {
  within(u, (ctx, _, px) => {
    for (const { x, y, error, colour: name = "inspection", shape = "diamond", size = 5.5 } of spots) {
      const [at, middle] = [u.valToPos(x, "x", true), u.valToPos(y, "y", true)];
      ctx.strokeStyle = ctx.fillStyle = colour(name);
      ctx.lineWidth = 1.5 * px;
      if (Number.isFinite(error)) line(ctx, at, u.valToPos(y - error, "y", true), at, u.valToPos(y + error, "y", true));
      const r = size * px;
      const corners = { diamond: [[0, -r], [r, 0], [0, r], [-r, 0]], up: [[0, -r], [r, r], [-r, r]],
        down: [[0, r], [r, -r], [-r, -r]] }[shape];
      area(ctx, corners.map(([dx, dy]) => [at + dx, middle + dy]));
    }
  });
}

// An arrow at the upper or lower edge where a point lies outside the scale.
export function drawOutside(u, { values, series }, outside, colour) {
  within(u, (ctx, box, px) => {
    for (const { series: number, index, value } of outside) {
      const at = u.valToPos(values[index], "x", true);
      const above = value > u.scales.y.max;
      const tip = above ? box.top + 2 * px : box.top + box.height - 2 * px;
      const base = tip + (above ? 9 : -9) * px;
      ctx.fillStyle = colour(series[number]?.colour ?? "predicted");
      area(ctx, [[at, tip], [at - 5 * px, base], [at + 5 * px, base]]);
    }
  });
}
