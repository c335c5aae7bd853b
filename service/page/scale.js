// Scales that one outlier does not rule: a point far from its neighbours on both sides is left outside.

const NEIGHBOURS = 3; // on either side
const FAR = 6; // spreads of the neighbours from which a point is an outlier
const LEAST_POINTS = 5;

const median = (values) => {
  const sorted = [...values].sort((a, b) => a - b);
  const middle = sorted.length >> 1;
  return sorted.length % 2 ? sorted[middle] : (sorted[middle - 1] + sorted[middle]) / 2;
};

// The indices of isolated points. The newest is never one of them: it may be the beginning of a change.
export function outliers(values) {
  const at = values.flatMap((v, i) => (Number.isFinite(v) ? [i] : []));
  if (at.length < LEAST_POINTS) return [];
  return at.filter((index, place) => {
    if (place === at.length - 1) return false;
    const near = [...at.slice(Math.max(place - NEIGHBOURS, 0), place), ...at.slice(place + 1, place + 1 + NEIGHBOURS)]
      .map((i) => values[i]);
    const middle = median(near);
    const spread = Math.max(median(near.map((v) => Math.abs(v - middle))), 0.1 * Math.abs(middle));
    return Math.abs(values[index] - middle) > FAR * spread;
  });
}

// The range to draw, and the points outside it: {min, max, outside: [{series, index, value}]}.
// series: [{values}], from..to: the part that is shown; extra: values that must be seen (limits, inspections)
export function rangeOf(series, { from = 0, to = Infinity, extra = [], zero = true, all = false } = {}) {
  let [low, high] = [Infinity, -Infinity];
  const candidates = [];
  for (const [number, { values }] of series.entries()) {
    const isolated = all ? new Set() : new Set(outliers(values));
    const last = Math.min(to, values.length - 1);
    for (let i = Math.max(from, 0); i <= last; i += 1) {
      const value = values[i];
      if (!Number.isFinite(value)) continue;
      if (isolated.has(i)) candidates.push({ series: number, index: i, value });
      else [low, high] = [Math.min(low, value), Math.max(high, value)];
    }
  }
  for (const value of extra) if (Number.isFinite(value)) [low, high] = [Math.min(low, value), Math.max(high, value)];
  if (low > high) [low, high] = candidates.length ? [0, Math.max(...candidates.map((c) => c.value))] : [0, 1];
  // an isolated point that hardly stretches the scale is shown
  const reach = 0.5 * (high - Math.min(low, zero ? 0 : low)) || Math.abs(high) || 1;
  const outside = candidates.filter((c) => c.value > high + reach || c.value < low - reach);
  for (const c of candidates) if (!outside.includes(c)) [low, high] = [Math.min(low, c.value), Math.max(high, c.value)];
  if (zero && low > 0) low = 0;
  const room = 0.06 * (high - low || Math.abs(high) || 1);
  return { min: zero && low === 0 ? 0 : low - room, max: high + room, outside };
}
