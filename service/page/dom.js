// Elements, without a framework.

// An element with its properties, attributes ("aria-label", "role") and data; children are nodes or text.
export function element(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (value === null || value === undefined || value === false) continue;
    if (name === "dataset") Object.assign(made.dataset, value);
    else if (name.includes("-") || name === "role" || name === "for") made.setAttribute(name, value);
    else made[name] = value;
  }
  made.append(...children.flat().filter((child) => child !== null && child !== undefined && child !== ""));
  return made;
}

const SVG = "http://www.w3.org/2000/svg";

export function svg(tag, attributes = {}, ...children) {
  const made = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  made.append(...children);
  return made;
}

// A section with its heading: its title, or { title, kind, … } with further attributes.
export function panel(given, ...children) {
  const { title, kind, ...attributes } = typeof given === "string" ? { title: given } : given;
  return element("section", { className: kind ? `panel ${kind}` : "panel", ...attributes }, element("h2", {}, title), ...children);
}

// What is shown once its title is pressed, and stays so where it is drawn again.
export function folded(key, title, ...children) {
  return element("details", { dataset: { key } }, element("summary", {}, title), ...children);
}

// A check box, or one choice of several, with its text behind it; `act` gets whether it is checked.
export function choice(text, checked, act, { type = "checkbox", ...attributes } = {}) {
  return element("label", {}, element("input", { type, checked, onchange: (event) => act(event.target.checked), ...attributes }), ` ${text}`);
}

// Does something again and again while the page is seen, until the signal ends it.
export function repeat(act, milliseconds, signal) {
  const timer = setInterval(() => document.hidden || act(), milliseconds);
  signal.addEventListener("abort", () => clearInterval(timer));
}

// Lets the browser answer the keyboard and the mouse before more is drawn.
export const pause = () => new Promise((resolve) => { setTimeout(resolve, 0); });

// Runs a change of the page and gives the keyboard focus back to the same control, found by its data-key.
export function keepingFocus(change) {
  const key = document.activeElement?.dataset?.key;
  const group = document.activeElement?.dataset?.group;
  const open = [...document.querySelectorAll("details[open][data-key]")].map((d) => d.dataset.key);
  change();
  for (const one of open) {
    const again = document.querySelector(`details[data-key="${CSS.escape(one)}"]`);
    if (again) again.open = true;
  }
  if (!key || document.activeElement?.dataset?.key === key) return;
  const found = document.querySelector(`[data-key="${CSS.escape(key)}"]`)
    ?? (group && document.querySelector(`[data-group="${CSS.escape(group)}"]`));
  found?.focus({ preventScroll: true });
}
