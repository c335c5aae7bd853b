// When a machine was last seen, and what waits: the line that every view of it has.

import { element } from "../dom.js";
import { ago, dateTime, instant } from "../format.js";
import { dataBadge } from "./health.js";

export function seen(state) {
  const at = instant(state.last_seen) ?? instant(state.windows?.at(-1)?.start_time);
  const waiting = state.data?.waiting;
  const since = waiting && instant(waiting.since);
  const behind = waiting?.behind?.length ? `, behind ${waiting.behind.join(", ")}` : "";
  return element("p", { className: "seen" }, "Last seen ",
    element("time", { title: dateTime(at), dateTime: Number.isFinite(at) ? new Date(at).toISOString() : "" }, ago(at) || dateTime(at)),
    " · ", dataBadge(state),
    waiting ? ` · ${waiting.windows} window${waiting.windows === 1 ? " waits" : "s wait"} to be assessed, the first came ${ago(since)}${behind}` : "");
}
