// Numbers and parts of a report as text.

export const isAvailable = (part) =>
  part !== null && part !== undefined && !(typeof part === "object" && part.status === "not available");

export const reasonOf = (part) =>
  (part && typeof part === "object" && part.reason) || "not reported";

// Reasons that several parts of the state share: the notice on top gives each once, and no part repeats it.
export const sharedReasons = new Set();

export const isShared = (part) => !isAvailable(part) && sharedReasons.has(reasonOf(part));

export function number(value, digits = 3) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  const size = Math.abs(value);
  if (size !== 0 && (size < 1e-3 || size >= 1e7)) {
    const [mantissa, power] = value.toExponential(digits - 1).split("e");
    return `${mantissa}·10${superscript(Number(power))}`;
  }
  return new Intl.NumberFormat("en", { maximumSignificantDigits: Math.max(digits, Math.ceil(Math.log10(size + 1))) })
    .format(value);
}

// With all its digits, for columns of figures.
export function fixed(value, digits = 3) {
  if (!Number.isFinite(value)) return "–";
  if (value === 0 || Math.abs(value) < 1e-3 || Math.abs(value) >= 1e7) return number(value, digits);
  const decimals = Math.max(0, digits - 1 - Math.floor(Math.log10(Math.abs(value))));
  return new Intl.NumberFormat("en", { minimumFractionDigits: decimals, maximumFractionDigits: decimals }).format(value);
}

export function range(band, digits = 3) {
  if (!band || !Number.isFinite(band.p05) || !Number.isFinite(band.p95)) return "no band";
  return `${number(band.p05, digits)} – ${number(band.p95, digits)}`;
}

export function revolutions(value) {
  return value === null || value === undefined ? "–" : new Intl.NumberFormat("en").format(Math.round(value));
}

// A value of a report that no panel knows by name: text, number, {value, std, unit} or a list.
export function anything(value) {
  if (value === null || value === undefined) return "–";
  if (typeof value === "number") return number(value, 4);
  if (typeof value === "boolean") return value ? "yes" : "no";
  if (Array.isArray(value)) {
    if (value.length > 8) return `${value.length} values`;
    return value.length ? value.map(anything).join(", ") : "none";
  }
  if (typeof value === "object") {
    if ("value" in value) {
      const std = Number.isFinite(value.std) ? ` ± ${number(value.std, 2)}` : "";
      return `${anything(value.value)}${std}${value.unit ? ` ${value.unit}` : ""}`;
    }
    if ("median" in value) return `${number(value.median)} (${range(value)})`;
    if (!isAvailable(value)) return `not available: ${reasonOf(value)}`;
    return Object.entries(value).map(([k, v]) => `${words(k)} ${anything(v)}`).join("; ");
  }
  return String(value);
}

// A JSON name as words, with its unit where the name carries one.
const UNITS = [
  ["_m2_per_n", " [m²/N]"], ["_per_n", " [1/N]"], ["_n_per_m", " [N/m]"], ["_percent", " [%]"], ["_hours", " [h]"],
  ["_um", " [µm]"], ["_hz", " [Hz]"], ["_nm", " [N·m]"], ["_deg", " [°]"], ["_ns", " [ns]"],
];

export function words(name) {
  for (const [suffix, unit] of UNITS) {
    if (name.endsWith(suffix)) return spaced(name.slice(0, -suffix.length)) + unit;
  }
  return spaced(name);
}

function spaced(name) {
  return name.replaceAll("_", " ").replace(/\b(rms|rul|gmf)\b/g, (short) => short.toUpperCase());
}

function superscript(power) {
  return String(power).replace("-", "⁻").replace(/\d/g, (d) => "⁰¹²³⁴⁵⁶⁷⁸⁹"[d]);
}
