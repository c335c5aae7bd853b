// Signing in and out: the key goes to the service once, which keeps it in a cookie that no script can read.

import { get, send } from "./api.js";
import { element, panel } from "./dom.js";
import { field, form } from "./forms.js";

// Shows who is signed in, with a button to sign out; calls `changed` afterwards.
export async function showSession(place, changed) {
  let session;
  try {
    session = await get("v1/session");
  } catch (error) {
    console.warn(error.message);
    return;
  }
  if (session.name) document.body.dataset.signer = session.name;
  else delete document.body.dataset.signer;
  if (!session.signed_in) {
    const other = session.credentials && session.role
      ? [element("button", { type: "button", onclick: () => changed(true) }, "Sign in")] : [];
    place.replaceChildren(...other);
    return;
  }
  const out = element("button", { type: "button" }, "Sign out");
  out.addEventListener("click", async () => {
    await send("DELETE", "v1/session");
    place.replaceChildren();
    await changed(false);
  });
  place.replaceChildren(element("span", { title: `role: ${session.role ?? "none"}` }, session.name ?? ""), " ", out);
}

// A form that asks for a key; calls `done` once it is accepted.
export function signInForm(done, reason = "") {
  return panel("Sign in", element("p", {}, reason || "Sign in to do more than read."), form({
    title: "Key", submit: "Sign in",
    fields: [field({ name: "key", label: "API key or token", type: "password", autocomplete: "current-password",
      required: true, maxLength: 8192 })],
    send: async ({ key }) => {
      await send("POST", "v1/session", { key: key.trim() });
      await done();
      return "Signed in.";
    },
  }));
}
