// The open alarms of all machines, the most urgent first.

import { alarmList } from "../parts/alarm_list.js";

const EVERY_MS = 3000; // what has not changed is not sent again

export async function show(root, { signal, get, connected }) {
  const list = alarmList({ signal, withAsset: true, load: (all) => get(`v1/alarms?state=${all ? "all" : "open"}`, { signal }) });
  root.append(list.root);
  await list.refresh();
  connected(true);
  const timer = setInterval(async () => {
    if (document.hidden) return;
    try {
      await list.refresh();
      connected(true);
    } catch (error) {
      if (error.name !== "AbortError") connected(false, error.message);
    }
  }, EVERY_MS);
  signal.addEventListener("abort", () => clearInterval(timer));
}
