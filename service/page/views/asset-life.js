// The life of one machine: the open question with its answers, changes that people enter, its gears, its healthy
// baseline, its name, and whether it is in use.

import { addressOf, get, send, warned } from "../api.js";
import { element, keepingFocus, panel } from "../dom.js";
import { dateTime, instant, number, revolutions, sentence, signedText } from "../format.js";
import { ASSET_NAME, field, form, signature } from "../forms.js";
import { facts, table } from "../table.js";

const ANSWERS = {
  gears_replaced: ["The gears were replaced", "The windows that wait begin a new epoch of this machine, with unworn gears."],
  counter_reset: ["The counter was reset", "The windows that wait continue this machine's history; revolutions go on from the sum."],
  other_machine: ["It is another machine", "The windows that wait, and the stream from now on, belong to a new asset."],
  ignore: ["Ignore", "A fallen count: the windows are listed as refused. A differing rig file: the earlier one is kept. "
    + "Frames of passed times: they stay unused."],
};
const CHANGES = {
  gears_replaced: ["Gears replaced", "Wear, life and effects on the gears begin again; what was learned of the structure is kept."],
  sensor_moved: ["Sensor moved or replaced", "The transfer path and the level of this sensor are learned again; wear is kept."],
  oil_changed: ["Oil changed", "The wear coefficient may change from now on; everything is kept."],
  counter_reset: ["Revolution counter reset", "Revolutions go on from the sum; wear is kept."],
  reassembled: ["Taken apart and reassembled", "Damping, alignment, transfer path and phases are learned again; wear is kept."],
};
const OTHERS = { renamed: "renamed", retired: "retired", reinstated: "reinstated", other_machine: "other machine",
  ignore: "question ignored", baseline_given: "baseline learned", baseline_removed: "baseline removed", created: "created",
  rig_accepted: "rig file accepted", rig_rejected: "rig file rejected" };
const ENDING = ["gears_replaced", "reassembled", "sensor_moved"]; // earlier windows show another machine
const DONE = "Done.";

const labelOf = (kind) => CHANGES[kind]?.[0] ?? OTHERS[kind] ?? kind;

// Sends one change; the text that is shown then.
async function enter(machine, signal, body) {
  const { status, body: answer } = await send("POST", `${machine.base}/changes`, body, { signal });
  return status === 202 || !answer.done ? "Queued: it is applied after the current window." : DONE;
}

// Says below the fields of a form what the kind means that is chosen there; `chosen(kind)` shows the fields of it.
function explaining(own, meanings, chosen) {
  const explained = element("p", { className: "meta", role: "status" });
  const select = own.querySelector("[name=kind]");
  const show = () => {
    explained.textContent = meanings[select.value]?.[1] ?? "";
    chosen(select.value);
  };
  select.addEventListener("change", show);
  show();
  own.querySelector(".fields").after(explained);
}

function questionPanel(machine, signal) {
  const asked = machine.state.question;
  if (!asked) return "";
  const choices = [["", "choose an answer"], ...asked.answers.map((kind) => [kind, ANSWERS[kind]?.[0] ?? kind])];
  const name = field({ name: "name", label: "Name of the other machine", ...ASSET_NAME });
  const own = form({
    submit: "Answer",
    fields: [field({ name: "kind", label: "Answer", type: "select", options: choices, value: "", required: true }), name, ...signature()],
    send: (values) => enter(machine, signal, values.kind === "other_machine" ? values : { ...values, name: undefined }),
  });
  explaining(own, ANSWERS, (kind) => {
    name.hidden = kind !== "other_machine";
    name.querySelector("input").required = !name.hidden;
  });
  return panel({ title: asked.text, id: "question" }, element("p", { className: "question" }, asked.detail),
    element("p", { className: "meta", id: "waiting" }), own);
}

function waitingText(asked) {
  return [`Since ${dateTime(instant(asked.since))}.`,
    `${revolutions(asked.waiting)} ${asked.waiting === 1 ? "window waits" : "windows wait"} for the answer.`,
    ...(asked.left_out ? [`${asked.left_out} more were left out: there was no room.`] : [])].join(" ");
}

function changeForm(machine, signal) {
  const channels = Object.keys(machine.state.data_quality?.channels ?? {}).filter((c) => c.startsWith("accel/")).map((c) => c.slice(6));
  const only = {
    sensor: field({ name: "sensor", label: "Accelerometer", type: "select", options: channels.map((c) => [c, c]), value: channels[0] }),
    revolutions: field({ name: "revolutions", label: "Count at the change", type: "number", min: 0, hint: "where it is not that of the latest window" }),
    count: field({ name: "count", label: "Set to", unit: "turns", type: "number", min: 0, value: 0 }),
  };
  const shown = { sensor_moved: ["sensor"], gears_replaced: ["revolutions"], counter_reset: ["revolutions", "count"] };
  const own = form({
    submit: "Enter the change",
    fields: [field({ name: "kind", label: "What was done", type: "select", value: "oil_changed",
      options: Object.entries(CHANGES).map(([kind, [text]]) => [kind, text]) }), ...Object.values(only),
    field({ name: "at", label: "When", type: "datetime-local", hint: "kept for the record; it is applied after the current window" }), ...signature()],
    send: ({ kind, by, note, at, ...rest }) => {
      const given = Object.fromEntries((shown[kind] ?? []).map((key) => [key, rest[key]]));
      return enter(machine, signal, { kind, by, note, at, ...given });
    },
  });
  explaining(own, CHANGES, (kind) => {
    for (const [key, one] of Object.entries(only)) one.hidden = !(shown[kind] ?? []).includes(key);
  });
  return panel("Enter a change", own);
}

function changesPanel(changes) {
  const rows = [...changes].reverse().map((c) => [dateTime(instant(c.received)), labelOf(c.kind), c.by ?? "", c.note ?? "",
    [c.sensor, c.name, Number.isFinite(c.revolutions) ? `${revolutions(c.revolutions)} turns` : "", c.at ? `made ${c.at}` : "",
      c.done ? "" : "queued"].filter(Boolean).join(", ")]);
  return panel({ title: "Changes", id: "changes" }, rows.length ? table(["entered", "change", "by", "note", "details"], rows)
    : element("p", { className: "none" }, "No changes have been entered."));
}

function epochsPanel(machine, epochs) {
  if (epochs.length < 2) return "";
  const rows = [...epochs].reverse().map((e) => [e.epoch === machine.state.epoch ? `${e.epoch} (present)` : String(e.epoch),
    dateTime(instant(e.since)), revolutions(e.windows),
    element("a", { href: `${machine.base}/trend?epoch=${e.epoch}` }, "trend (JSON)")]);
  return panel("Gears so far", table(["epoch", "first window", "windows#", "data"], rows));
}

function baselinePanel(machine, signal, { baseline, kept }, renewed) {
  const made = panel({ title: "Healthy baseline", id: "baseline" });
  const found = baseline.baseline;
  if (baseline.own && found) {
    const suffices = found.sufficiency;
    made.append(facts([
      ["Recordings", suffices ? `${suffices.recordings} (at least ${suffices.recordings_needed} to judge teeth)` : String(found.recordings.length)],
      ["Load learned", suffices?.load_percent ? `${suffices.load_percent.map((p) => number(p, 2)).join(" to ")} %` : "not known"],
      ["Sensors", found.channels.join(", ")],
      ["In use since", baseline.at ? dateTime(instant(baseline.at)) : "–"], ["By", baseline.by ?? "–"], ["Note", baseline.note ?? "–"],
    ]), ...(suffices?.not_judged ?? []).map(({ what, reason }) => element("p", {}, sentence(`Not judged yet: ${what}: ${reason}`))));
  } else {
    made.append(element("p", {}, "This machine has no baseline of its own."));
  }
  made.append(element("p", { className: "meta" }, "A baseline is learned from windows of the healthy machine, at several loads, and shows what has changed "
    + "since on machines without a full model."));
  if (kept.length) {
    const latest = kept.at(-1).index;
    made.append(form({
      title: baseline.own ? "Renew it" : "Learn it", submit: baseline.own ? "Learn again" : "Learn",
      fields: [field({ name: "first", label: "First window", type: "number", min: 0, step: 1, required: true, value: kept[0].index }),
        field({ name: "last", label: "Last window", type: "number", min: 0, step: 1, required: true, value: latest,
          hint: `signals of ${kept.length} windows are kept, ${kept[0].index} to ${latest}` }),
        ...(baseline.own ? [field({ name: "add", label: "Add to the recordings so far", type: "checkbox" })] : []), ...signature()],
      send: async ({ first, last, add, by, note }) => {
        const windows = kept.map((w) => w.index).filter((i) => i >= first && i <= last);
        await send("POST", `${machine.base}/baseline/learn`, { windows, add: Boolean(add), by, note }, { signal });
        await renewed();
        return `Learned from ${windows.length} windows.`;
      },
    }));
  } else {
    made.append(element("p", { className: "none" }, "No window's signals are kept: learn it with gear-twin remote assets baseline."));
  }
  if (baseline.own) {
    made.append(form({ title: "Remove it", submit: "Remove the baseline", danger: true, fields: [], send: async () => {
      await send("DELETE", `${machine.base}/baseline`, undefined, { signal });
      await renewed();
      return "Removed.";
    } }));
  }
  return made;
}

function namePanel(machine, signal) {
  const { retired } = machine.state;
  const rename = form({
    title: "Rename", submit: "Rename",
    fields: [field({ name: "name", label: "New name", required: true, ...ASSET_NAME }), ...signature()],
    send: async (values) => {
      machine.leaving = true;
      let said = "";
      try {
        said = await enter(machine, signal, { ...values, kind: "renamed" });
      } finally {
        machine.leaving = said === DONE;
      }
      if (said === DONE) location.hash = addressOf(values.name, "life");
      return said;
    },
  });
  const use = form({
    title: retired ? "Take back into use" : "Retire", submit: retired ? "Reinstate" : "Retire this machine", danger: !retired,
    fields: signature(), send: (values) => enter(machine, signal, { ...values, kind: retired ? "reinstated" : "retired" }),
  });
  const state = retired
    ? [element("p", { className: "question" }, `${signedText(`Retired since ${dateTime(instant(retired.since))}`, retired)}. Frames that come are left out.`)] : [];
  return panel("Name and use", ...state, rename, use);
}

export async function show(root, { machine, signal, onChange }) {
  const load = async () => {
    const [changes, epochs, baseline, signals] = await Promise.all(
      ["changes", "epochs", "baseline", "signals"].map((part) => get(`${machine.base}/${part}`, { signal })));
    const first = Math.max(epochs.find((e) => e.epoch === machine.state.epoch)?.first ?? 0,
      ...changes.filter((c) => ENDING.includes(c.kind)).map((c) => c.effect?.from_window ?? 0));
    return { changes, epochs, baseline, kept: signals.windows.filter((w) => w.index >= first && !w.refused) };
  };
  let found = await load();
  const [top, rest, base, name] = ["div", "div", "div", "div"].map((tag) => element(tag));
  root.append(top, changeForm(machine, signal), rest, base, name);
  const shown = new Map();
  // A part with a form is drawn again only where what it shows has changed: what is being typed is kept otherwise.
  const drawWhere = (place, what, make) => {
    const now = JSON.stringify(what);
    if (shown.get(place) !== now) place.replaceChildren(make());
    shown.set(place, now);
  };
  const draw = () => keepingFocus(() => {
    const { question = null, retired = null } = machine.state;
    drawWhere(top, question && [question.kind, question.detail], () => questionPanel(machine, signal));
    if (question) top.querySelector("#waiting").textContent = waitingText(question);
    rest.replaceChildren(changesPanel(found.changes), epochsPanel(machine, found.epochs));
    drawWhere(base, [found.baseline, found.kept.length > 0], () => baselinePanel(machine, signal, found, renewed));
    drawWhere(name, retired, () => namePanel(machine, signal));
  });
  const renewed = async () => {
    found = await load();
    draw();
  };
  draw();
  onChange((kinds) => (["change", "question", "window"].some((kind) => kinds.has(kind)) ? renewed().catch(warned) : null));
}
