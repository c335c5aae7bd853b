// The open alarms of all machines, the most urgent first.

import { unlessLeft } from "../api.js";
import { repeat } from "../dom.js";
import { alarmList } from "../parts/alarm_list.js";

const EVERY_MS = 3000; // what has not changed is not sent again

export async function show(root, { signal, get, connected }) {
  const list = alarmList({ signal, withAsset: true, load: (all) => get(`v1/alarms?state=${all ? "all" : "open"}`, { signal }) });
  root.append(list.root);
  const refresh = () => list.refresh().then(() => connected(true));
  await refresh();
  repeat(() => refresh().catch(unlessLeft((reason) => connected(false, reason))), EVERY_MS, signal);
}
