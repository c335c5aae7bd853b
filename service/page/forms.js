// Forms: labelled fields, checked by the browser, with what the service answers shown where it was asked.

import { element } from "./dom.js";
import { Problem } from "./api.js";

let made = 0;

// One field with its label: { name, label, type, unit, value, required, min, max, step, options, hint, rows, key }.
// type: a type of <input>, "select" (options: [value, text]) or "textarea".
export function field(given) {
  const signer = given.name === "by" ? document.body.dataset.signer : undefined; // whoever is signed in signs
  const { name, label, type = "text", unit = "", hint = "", options = [], rows = 2, value, key, ...rest } =
    signer ? { ...given, value: signer, readOnly: true } : given;
  const id = `field-${name}-${made += 1}`;
  const shared = { id, name, "aria-describedby": hint ? `${id}-hint` : null, dataset: { key: key ?? name } };
  let control;
  if (type === "select") {
    control = element("select", { ...shared, ...rest }, ...options.map(([v, text]) => new Option(text, v, false, v === value)));
  } else if (type === "textarea") {
    control = element("textarea", { ...shared, ...rest, rows, value: value ?? "" });
  } else {
    control = element("input", { ...shared, ...rest, type, value: value ?? "", checked: type === "checkbox" && Boolean(value) });
    if (type === "number") control.step = rest.step ?? "any";
  }
  const text = element("label", { htmlFor: id }, unit ? `${label} [${unit}]` : label);
  return element("div", { className: type === "checkbox" ? "field check" : "field" }, ...(type === "checkbox" ? [control, text] : [text, control]),
    ...(hint ? [element("small", { id: `${id}-hint` }, hint)] : []));
}

// A form of fields. `send(values)` does what is asked and returns the text to show; a Problem is shown as it is.
// Values: numbers of number fields, true or false of check boxes, text of others; an empty field is left out.
export function form({ title = "", fields, submit, send, danger = false }) {
  const said = element("p", { className: "said", role: "status" });
  const button = element("button", { type: "submit", className: danger ? "danger" : "primary" }, submit);
  const own = element("form", { className: "form", "aria-label": title || submit }, ...(title ? [element("h3", {}, title)] : []),
    element("div", { className: "fields" }, ...fields), element("div", { className: "submit" }, button, said));
  own.addEventListener("submit", async (event) => {
    event.preventDefault();
    await busy(button, said, () => send(valuesOf(own), own));
  });
  return own;
}

// Runs an action of a button: disabled while it runs, its result or error in `said`.
export async function busy(button, said, act) {
  if (button.getAttribute("aria-disabled") === "true") return;
  button.setAttribute("aria-disabled", "true");
  said.classList.remove("error");
  said.textContent = "In progress …";
  try {
    said.textContent = (await act()) ?? "Done.";
  } catch (error) {
    if (error.name === "AbortError") return;
    if (!(error instanceof Problem)) console.warn(error);
    said.classList.add("error");
    said.textContent = error.message;
  } finally {
    button.removeAttribute("aria-disabled");
  }
}

export function valuesOf(own) {
  const values = {};
  for (const control of own.elements) {
    if (!control.name) continue;
    if (control.type === "checkbox") values[control.name] = control.checked;
    else if (control.type === "number") {
      if (control.value !== "") values[control.name] = control.valueAsNumber;
    } else if (control.value !== "") values[control.name] = control.value;
  }
  return values;
}
