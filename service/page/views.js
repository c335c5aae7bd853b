// The views of one machine, in the order of their tabs. A view is one file in views/ and one line here.
//
// A view exports `async show(root, context)`: it fills `root` and keeps it up to date until it is left.
// context.machine   what is known of the asset (machine.js): name, base, state, trend, windows, rig, inspections, limit
// context.signal    AbortSignal of the time the view is shown: hand it to get(), send() and addEventListener()
// context.onChange  (handler) → called with the kinds of event after new data has come, until the view is left; may be async
// context.axis      "revolutions" or "time", of trends; context.setAxis(axis) changes it for all views
// `shown` says of which machines a view makes sense; without it, of all.

import { isAvailable } from "./format.js";

export const VIEWS = [
  { path: "", title: "Overview", load: () => import("./views/overview.js") },
  { path: "signals", title: "Signals", load: () => import("./views/signals.js") },
  { path: "alarms", title: "Alarms", load: () => import("./views/alarms.js") },
  { path: "what-if", title: "What if", load: () => import("./views/what-if.js"),
    shown: ({ wear, calibration }) => (isAvailable(wear) || isAvailable(calibration)) && !wear?.relation },
  { path: "life", title: "Life of the machine", load: () => import("./views/asset-life.js") },
  { path: "data", title: "Windows and data", load: () => import("./views/data.js") },
];
