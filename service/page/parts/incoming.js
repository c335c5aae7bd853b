// What waits for a person: machines that send frames and that nobody has adopted, and rig files that came on the stream.

import { addressOf, newestOf, pathOf, send } from "../api.js";
import { element, keepingFocus, panel } from "../dom.js";
import { instant, revolutions as count } from "../format.js";
import { busy, form, signature, signed } from "../forms.js";
import { table } from "../table.js";
import { since } from "./health.js";

const NONE = { assets: [] };

const time = (text) => since(instant(text));

function button(text, key, act, className = "") {
  return element("button", { type: "button", className, dataset: { key }, onclick: act }, text);
}

// Panels over the list of machines; `changed` is called after a decision. Hidden while nothing waits.
export function incoming({ get, signal, changed }) {
  const said = element("p", { className: "said", role: "status" });
  const signing = form({ label: null, className: "", fields: signature({ hint: "why; kept with the decision" }) });
  const unknown = element("div", { id: "unknown-assets" });
  const rigs = element("div", { id: "rig-proposals" });
  const explained = element("p", {}, "These names send frames and are not machines of this service. Their frames are left out until somebody adopts them.");
  const root = panel({ title: "Waiting for a decision", id: "incoming", hidden: true }, explained, unknown, rigs, signing, said);
  let drawn = "";

  const decide = (path, body, done) => (event) => busy(event.currentTarget, said, async () => {
    await send("POST", path, { ...signed(signing), ...body }, { signal });
    await changed();
    return done;
  });

  function row(asset) {
    const name = asset.asset;
    const path = `v1/unknown-assets/${encodeURIComponent(name)}`;
    const done = `${name} is adopted: its frames are used from now on.`;
    const withRig = asset.rig ? [button("Adopt with its rig file", `adopt-rig ${name}`, decide(`${path}/adopt`, { rig: asset.rig_digest }, done), "primary"), " "] : [];
    return { dataset: { asset: name }, cells: [name, time(asset.first_seen), time(asset.last_seen), count(asset.frames),
      asset.channels.join(", ") || "–", asset.rig ? asset.rig_name || "offered" : "–",
      [...withRig, button("Adopt", `adopt ${name}`, decide(`${path}/adopt`, {}, done), asset.rig ? "" : "primary"), " ",
        button("Dismiss", `dismiss ${name}`, decide(`${path}/dismiss`, {}, `${name} is dismissed: its frames stay unused.`))]] };
  }

  function proposal({ asset, digest, received, name, differences }) {
    const path = `${pathOf(asset)}/rig-proposal`;
    const lines = differences.map((d) => [d.key, d.present ?? "–", d.proposed ?? "–"]);
    return element("section", { dataset: { proposal: asset } },
      element("h3", {}, "Rig file offered for ", element("a", { href: addressOf(asset) }, asset)),
      element("p", {}, `${name ? `"${name}", ` : ""}received `, time(received), `, digest ${digest}. The rig file in use is kept until somebody decides.`),
      element("details", { open: lines.length <= 8, dataset: { key: `rig ${digest}` } },
        element("summary", {}, `${lines.length} ${lines.length === 1 ? "value differs" : "values differ"} from the rig file in use`),
        table(["value", "in use", "proposed"], lines, { named: true })),
      element("p", {}, button("Accept", `accept ${digest}`, decide(path, { decision: "accept", digest }, `The rig file of ${asset} is accepted.`), "primary"), " ",
        button("Reject", `reject ${digest}`, decide(path, { decision: "reject", digest }, `The rig file for ${asset} is rejected.`))));
  }

  const newest = newestOf(() => Promise.all([get("v1/unknown-assets", { signal }), get("v1/rig-proposals", { signal })])
    .catch((error) => {
      if (error.status === 404) return [NONE, []]; // a service that has neither
      throw error;
    }));

  async function refresh() {
    const waiting = await newest();
    if (waiting === null) return;
    const [found, proposed] = waiting;
    const now = JSON.stringify([found.assets, proposed, Math.floor(Date.now() / 30_000)]); // "last seen" grows by itself
    if (now === drawn) return;
    drawn = now;
    keepingFocus(() => {
      root.hidden = found.assets.length + proposed.length === 0 && !said.textContent;
      unknown.hidden = explained.hidden = found.assets.length === 0;
      unknown.replaceChildren(table(["Machine", "First seen", "Last seen", "Frames", "Channels", "Rig file", "Decision"],
        found.assets.map(row), { caption: "Machines that are not known", named: true }));
      rigs.replaceChildren(...proposed.map(proposal));
    });
  }

  return { root, refresh };
}
