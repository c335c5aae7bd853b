// What waits for a person: machines that send frames and that nobody has adopted, and rig files that came on the stream.

import { newestOf, pathOf, send } from "../api.js";
import { element, keepingFocus, panel } from "../dom.js";
import { ago, dateTime, instant, revolutions as count } from "../format.js";
import { busy, field } from "../forms.js";
import { keepName, storedName } from "./alarm_list.js";

const NONE = { assets: [] };

const time = (text) => element("time", { dateTime: text, title: dateTime(instant(text)) }, ago(instant(text)) || dateTime(instant(text)));
const cell = (head, ...content) => element("td", { dataset: { head } }, ...content);

function button(text, key, act, className = "") {
  return element("button", { type: "button", className, dataset: { key }, onclick: act }, text);
}

// Panels over the list of machines; `changed` is called after a decision. Hidden while nothing waits.
export function incoming({ get, signal, changed }) {
  const said = element("p", { className: "said", role: "status" });
  const signature = element("form", { className: "fields", onsubmit: (e) => e.preventDefault() },
    field({ name: "by", label: "Your name", value: storedName(), maxLength: 200, autocomplete: "name" }),
    field({ name: "note", label: "Note", maxLength: 2000, hint: "why; kept with the decision" }));
  const unknown = element("tbody");
  const rigs = element("div", { id: "rig-proposals" });
  const lists = element("table", { className: "blocks", id: "unknown-assets" },
    element("caption", { className: "visually-hidden" }, "Machines that are not known"),
    element("thead", {}, element("tr", {}, ...["Machine", "First seen", "Last seen", "Frames", "Channels", "Rig file", "Decision"]
      .map((h) => element("th", { scope: "col" }, h)))), unknown);
  const explained = element("p", {}, "These names send frames and are not machines of this service. Their frames are left out until somebody adopts them.");
  const root = panel("Waiting for a decision", explained, lists, rigs, signature, said);
  root.id = "incoming";
  root.hidden = true;
  let drawn = "";

  const signed = () => {
    const values = Object.fromEntries([...signature.elements].filter((c) => c.name && c.value).map((c) => [c.name, c.value]));
    if (values.by) keepName(values.by);
    return values;
  };
  const decide = (path, body, done) => (event) => busy(event.currentTarget, said, async () => {
    await send("POST", path, { ...signed(), ...body }, { signal });
    await changed();
    return done;
  });

  function row(asset) {
    const name = asset.asset;
    const path = `v1/unknown-assets/${encodeURIComponent(name)}`;
    const done = `${name} is adopted: its frames are used from now on.`;
    const withRig = asset.rig ? [button("Adopt with its rig file", `adopt-rig ${name}`, decide(`${path}/adopt`, { rig: asset.rig_digest }, done), "primary"), " "] : [];
    return element("tr", { dataset: { asset: name } }, element("th", { scope: "row", dataset: { head: "machine" } }, name),
      cell("first seen", time(asset.first_seen)), cell("last seen", time(asset.last_seen)), cell("frames", count(asset.frames)),
      cell("channels", asset.channels.join(", ") || "–"), cell("rig file", asset.rig ? asset.rig_name || "offered" : "–"),
      cell("decision", ...withRig, button("Adopt", `adopt ${name}`, decide(`${path}/adopt`, {}, done), asset.rig ? "" : "primary"), " ",
        button("Dismiss", `dismiss ${name}`, decide(`${path}/dismiss`, {}, `${name} is dismissed: its frames stay unused.`))));
  }

  function proposal({ asset, digest, received, name, differences }) {
    const path = `${pathOf(asset)}/rig-proposal`;
    const lines = differences.map((d) => element("tr", {}, element("th", { scope: "row" }, d.key),
      element("td", {}, d.present ?? "–"), element("td", {}, d.proposed ?? "–")));
    const values = element("table", {}, element("thead", {}, element("tr", {},
      ...["value", "in use", "proposed"].map((h) => element("th", { scope: "col" }, h)))), element("tbody", {}, ...lines));
    return element("section", { dataset: { proposal: asset } },
      element("h3", {}, "Rig file offered for ", element("a", { href: `#/asset/${encodeURIComponent(asset)}` }, asset)),
      element("p", {}, `${name ? `"${name}", ` : ""}received `, time(received), `, digest ${digest}. The rig file in use is kept until somebody decides.`),
      element("details", { open: lines.length <= 8, dataset: { key: `rig ${digest}` } },
        element("summary", {}, `${lines.length} ${lines.length === 1 ? "value differs" : "values differ"} from the rig file in use`), values),
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
      lists.hidden = explained.hidden = found.assets.length === 0;
      unknown.replaceChildren(...found.assets.map(row));
      rigs.replaceChildren(...proposed.map(proposal));
    });
  }

  return { root, refresh };
}
