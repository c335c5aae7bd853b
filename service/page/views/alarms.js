// The alarms of one machine, and its alarm rules.

import { get } from "../api.js";
import { isAvailable } from "../format.js";
import { alarmList } from "../parts/alarm_list.js";
import { alarmRules } from "../parts/alarm_rules.js";

export async function show(root, { machine, signal, onChange }) {
  const list = alarmList({ signal, load: (all) => get(`${machine.base}/alarms?state=${all ? "all" : "open"}`, { signal }) });
  const rules = alarmRules({ base: machine.base, signal, load: () => get(`${machine.base}/alarm-rules`, { signal }),
    depthKnown: () => isAvailable(machine.state.wear) });
  root.append(list.root, rules.root);
  await Promise.all([list.refresh(), rules.refresh()]);
  onChange((kinds) => Promise.all([kinds.has("alarm") || kinds.has("window") ? list.refresh() : null,
    kinds.has("window") ? rules.refresh() : null]));
}
