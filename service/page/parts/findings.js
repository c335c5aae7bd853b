// What is found without a model of the machine: the gear pair from its encoders, how deep the shafts modulate the mesh
// vibration, and lines that belong to no known shaft.

import { element, panel } from "../dom.js";
import { fixed, isAvailable, number } from "../format.js";
import { facts, table } from "../table.js";

export function pairPanel(pair) {
  if (!isAvailable(pair)) return [];
  const { ratio, rest_urad: rest, stated, missed_counts: missed, sharp_steps: sharp, turns, base_radii: radii } = pair;
  const rows = [["ratio, pinion to gear", `${number(ratio.value, 5)} ± ${number(ratio.std, 2)}`],
    ["tooth counts that fit", pair.teeth_that_fit.slice(0, 6).join(", ") || "none from 10 to 60"],
    ["turns of pinion and gear", `${number(turns.pinion)}, ${number(turns.gear)}`],
    ["transmission error, RMS", `${number(rest.before, 4)} µrad; ${number(rest.after, 4)} µrad after removal of the run-out`],
    ["missed counts", missed.map((s) => `${number(s.counts)} at ${number(s.time_s)} s`).join(", ") || "none found"],
    ...sharp.map((s) => ["sharp step", `${number(s.counts)} counts ${s.shaft
      ? `at ${fixed(s.turn)} of each turn of the ${s.shaft}` : `at ${number(s.time_s)} s, passed only once`}`])];
  if (stated) {
    rows.push([`ratio from ${stated.source}`, `${number(stated.ratio, 5)}, ${stated.contradicted ? "contradicted" : "not contradicted"}`]);
  }
  const inUm = radii !== null && radii !== undefined;
  const terms = pair.run_out.map((t) => [`${t.multiple}× a turn of the ${t.shaft}`,
    `${number(t.amplitude_urad, 4)} ± ${number(t.std_urad, 2)}`,
    ...(inUm ? [`${number(t.amplitude_um)} ± ${number(t.std_um, 2)}`] : []), t.indistinguishable_from.join(", ")]);
  return [panel("Gear pair from its encoders", facts(rows),
    table(["run-out", "µrad of the pinion#", ...(inUm ? ["µm#"] : []), "indistinguishable from"], terms))];
}

const TIMES = { 1: "once", 2: "twice", 3: "three times" };
const MOST = 6; // modulations that are listed, the deepest
const WHOLE = 100; // [%] of the mesh lines: a modulation is not deeper

// One row for a multiple of a shaft's turn, with what every channel shows of it.
function modulationRow(group, compared) {
  const [deepest] = group;
  const channels = group.map((m) => `${m.channel.replace(/^accel\//, "")}: ${number(m.depth_percent)} ± ${number(m.depth_std_percent, 2)}`
    + (m.healthy_percent ? ` (healthy: ${number(m.healthy_percent[0], 2)} to ${number(m.healthy_percent[1], 2)})` : ""));
  const causes = deepest.depth_percent > WHOLE ? `deeper than a modulation can be: other lines at these places, or ${deepest.possible_causes}`
    : deepest.possible_causes;
  return [`${TIMES[deepest.per_turn] ?? `${deepest.per_turn} times`} per turn of the ${deepest.shaft}`, fixed(deepest.frequency_hz, 4),
    channels.join("; "), [...new Set(group.map((m) => m.kind))].join("; "),
    ...(compared ? [group.some((m) => m.new) ? "yes" : "no"] : []), causes];
}

// Sidebands of the mesh lines: a description, and a finding only where a healthy baseline shows that they are new.
export function modulationPanel(modulation) {
  if (!isAvailable(modulation) || !modulation.length) return [];
  const compared = modulation.some((m) => m.healthy_percent);
  const groups = new Map();
  for (const m of [...modulation].sort((a, b) => b.depth_percent - a.depth_percent)) {
    const key = `${m.shaft} ${m.per_turn}`;
    groups.set(key, [...(groups.get(key) ?? []), m]);
  }
  const fresh = (group) => Number(group.some((m) => m.new));
  const listed = [...groups.values()].sort((a, b) => fresh(b) - fresh(a)).slice(0, MOST);
  const meaning = compared ? "The depth is compared with the recordings of the healthy baseline."
    : "Healthy gears have sidebands, too: whether these are new, a healthy baseline shows.";
  return [panel("Modulation of the mesh vibration",
    element("p", {}, `${meaning} The accelerometers cannot distinguish the causes of one line.`),
    table(["modulated", "sidebands at ± [Hz]#", "depth by channel [% of the mesh lines]", "kind", ...(compared ? ["new"] : []), "possible causes"],
      listed.map((group) => modulationRow(group, compared))))];
}

export function unattributedPanels(lines) {
  return (lines ?? []).map((found) => {
    const sides = found.sidebands.slice(0, 8).map((s) => [s.channel,
      `${s.harmonic ? `mesh ${s.harmonic} ± ` : ""}${s.multiple}×`, number(s.amplitude),
      Number.isFinite(s.depth) ? fixed(100 * s.depth) : "–"]);
    const causes = [...found.causes].sort((a, b) => Number(b.possible) - Number(a.possible))
      .map((c) => [c.name, c.possible ? "possible" : "ruled out", c.detail]);
    const slower = found.part === 1 ? "" : `; weaker lines are at ${fixed(found.frequency_hz / found.part, 5)} Hz`;
    const what = found.geared === null ? "belong to no known shaft" : `belong to another shaft, geared ${found.geared} to the pinion`;
    return panel("Unattributed lines",
      element("p", {}, `Lines spaced by ${fixed(found.frequency_hz, 5)} ± ${number(found.frequency_std_hz, 2)} Hz (order ${
        fixed(found.order, 5)}) ${what}${slower}.`),
      table(["channel", "lines", "amplitude [m/s²]#", "of the mesh line [%]#"], sides),
      element("h3", {}, "Causes tested"),
      table(["cause", "result", "reason"], causes));
  });
}
