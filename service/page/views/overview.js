// The overview of a machine: its state first, then what this kind of machine can tell, and once what it cannot.

import { addressOf } from "../api.js";
import { element, keepingFocus } from "../dom.js";
import { KIND_WORDS, isAvailable, number, revolutions } from "../format.js";
import { cards, missing } from "../parts/cards.js";
import { effectsPanel } from "../parts/effects.js";
import { modulationPanel, pairPanel, unattributedPanels } from "../parts/findings.js";
import { health } from "../parts/health.js";
import { trends } from "../parts/trends.js";

// As the service does for the list of assets (service/contract/overview.py).
export function kindOf({ wear, calibration, baseline, pair }) {
  const byLevel = isAvailable(wear) && Boolean(wear.relation);
  if (!byLevel && (isAvailable(wear) || isAvailable(calibration))) return "model";
  if (isAvailable(baseline)) return "baseline";
  return isAvailable(pair) ? "encoders" : "level";
}

// What the figures rest on, and counts, in small print.
function smallPrint(machine, kind) {
  const { wear, windows_total: total } = machine.state;
  const updates = machine.trend.filter((p) => p.updated).length;
  const k = isAvailable(wear) && Number.isFinite(wear.k_wear_per_n)
    ? `Archard coefficient K = ${number(wear.k_wear_per_n)} 1/N. ` : "";
  const last = machine.windows.findLast((w) => Number.isFinite(w.revolutions));
  return element("p", { className: "small-print" }, `Answers from: ${KIND_WORDS[kind]}. ${k}${revolutions(total)} window${total === 1 ? "" : "s"}${
    updates ? `, ${revolutions(updates)} of those drawn updated the model` : ""}${
    last ? `; the latest at ${revolutions(last.revolutions)} revolutions` : ""}. `,
    element("a", { href: addressOf(machine.name, "data") }, "Windows, data quality, calibration"), ". Report: ",
    element("a", { href: `${machine.base}/report`, target: "_blank", rel: "noopener" }, "page"), ", ",
    element("a", { href: `${machine.base}/report?format=pdf` }, "PDF"));
}

export async function show(root, context) {
  const { machine } = context;
  const effects = effectsPanel(machine, context.signal);
  const drawn = trends(context);
  const [top, found, lower, turning] = [element("div"), element("div", { className: "findings" }), element("div"), element("div")];
  root.append(top, effects.root, turning, found, drawn.root, lower);

  const drawAll = () => {
    const { state } = machine;
    const kind = kindOf(state);
    const empty = state.windows_total === 0;
    top.replaceChildren(health(state), ...(empty ? [] : [cards(machine, kind)]));
    effects.draw();
    turning.replaceChildren(...modulationPanel(state.modulation));
    found.replaceChildren(...pairPanel(state.pair), ...unattributedPanels(state.unattributed_lines));
    drawn.root.hidden = empty;
    lower.replaceChildren(...(empty ? [] : [missing(state), smallPrint(machine, kind)]));
    root.dataset.kind = kind;
  };
  const draw = async () => {
    keepingFocus(drawAll);
    if (machine.state.windows_total > 0) await drawn.draw();
  };
  await draw();
  context.onChange(draw);
}
