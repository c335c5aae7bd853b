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

// A section with its heading.
export function panel(title, ...children) {
  return element("section", { className: "panel" }, element("h2", {}, title), ...children);
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
