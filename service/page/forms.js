// Forms: labelled fields, checked by the browser, with what the service answers shown where it was asked.

import { element } from "./dom.js";
import { Problem } from "./api.js";

const NAME = "gear-twin name"; // key of the browser's store: who signed last
export const ASSET_NAME = { pattern: "[A-Za-z0-9_.\\-]{1,64}", hint: "letters, digits, . _ -" };

let made = 0;

// One field with its label: { name, label, type, unit, value, required, min, max, step, options, hint, rows, key }.
// type: a type of <input>, or "select" (options: [value, text]).
export function field(given) {
  const signer = given.name === "by" ? document.body.dataset.signer : undefined; // whoever is signed in signs
  const { name, label, type = "text", unit = "", hint = "", options = [], value, key, ...rest } =
    signer ? { ...given, value: signer, readOnly: true } : given;
  const id = `field-${name}-${made += 1}`;
  const shared = { id, name, "aria-describedby": hint ? `${id}-hint` : null, dataset: { key: key ?? name } };
  let control;
  if (type === "select") {
    control = element("select", { ...shared, ...rest }, ...options.map(([v, text]) => new Option(text, v, false, v === value)));
  } else {
    control = element("input", { ...shared, ...rest, type, value: value ?? "", checked: type === "checkbox" && Boolean(value) });
    if (type === "number") control.step = rest.step ?? "any";
  }
  const text = element("label", { htmlFor: id }, unit ? `${label} [${unit}]` : label);
  return element("div", { className: type === "checkbox" ? "field check" : "field" }, ...(type === "checkbox" ? [control, text] : [text, control]),
    ...(hint ? [element("small", { id: `${id}-hint` }, hint)] : []));
}

// Who does something, and why: the name is kept for the next form. `prefix` and `suffix` are of the keys of both fields.
export function signature({ hint = "what was done, and why", note = "Note", required = false, maxLength = 200, prefix = "", suffix = "" } = {}) {
  return [
    field({ name: "by", label: "Your name", value: localStorage.getItem(NAME) ?? "", required, maxLength, autocomplete: "name", key: `${prefix}by${suffix}` }),
    field({ name: "note", label: note, maxLength: 2000, hint, key: `${prefix}note${suffix}` }),
  ];
}

// A form of fields. `send(values)` does what is asked and returns the text to show; a Problem is shown as it is.
// Values: numbers of number fields, true or false of check boxes, text of others; an empty field is left out.
// `more`: further buttons; those that need the values use `run`.
export function form({ title = "", submit = "", label = title || submit, className = "form", fields, send, danger = false, more = [] }) {
  const buttons = [...(submit ? [element("button", { type: "submit", className: danger ? "danger" : "primary" }, submit)] : []), ...more];
  const own = element("form", { className, "aria-label": label }, ...(title ? [element("h3", {}, title)] : []),
    element("div", { className: "fields" }, ...fields),
    ...(buttons.length ? [element("div", { className: "submit" }, ...buttons, element("p", { className: "said", role: "status" }))] : []));
  own.addEventListener("submit", (event) => {
    event.preventDefault();
    if (send) run(buttons[0], send);
  });
  return own;
}

// Runs what a button of a form is for, with the form's values where they are valid.
export async function run(button, act) {
  const own = button.form;
  if (own.reportValidity()) await busy(button, own.querySelector(".said"), () => act(signed(own), own));
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

// The values of a form; the name is kept.
export function signed(own) {
  const values = valuesOf(own);
  if (values.by) localStorage.setItem(NAME, values.by);
  return values;
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
