// Sliders with a number beside them, and lists to choose from; all bounds come from the server.

import { html } from "./svg.js";

let count = 0;

/** A slider in shown units; `changed` is called with the value in the server's units. */
export function slider(spec, changed) {
  const id = `slider-${count++}`;
  const shown = (value) => Number((value * spec.scale).toPrecision(6));
  const step = shown(spec.step);
  const range = html("input", spec.log
    ? { type: "range", id, min: 0, max: 200, step: 1 }
    : { type: "range", id, min: shown(spec.low), max: shown(spec.high), step: "any" });
  const number = html("input", {
    type: "number", min: shown(spec.low), max: shown(spec.high), step: "any",
    "aria-label": `${spec.label}${spec.unit ? `, ${spec.unit}` : ""}, as a number`,
  });
  let now = spec.start;
  const show = (value, exact) => {
    now = value;
    range.value = spec.log ? (200 * Math.log(value / spec.low)) / Math.log(spec.high / spec.low) : shown(value);
    range.setAttribute("aria-valuetext", `${shown(value)} ${spec.unit}`);
    if (exact) return;
    number.value = shown(value);
    if (document.activeElement === number) number.select();  // what is typed next replaces it
  };
  const take = (value, exact) => {
    const inside = Math.min(spec.high, Math.max(spec.low, value));
    show(inside, exact && inside === value);
    changed(inside);
  };
  const snapped = (value) => {
    // Counted from the lowest value, but both ends can be reached.
    const near = spec.low + Math.round((value - spec.low) / spec.step) * spec.step;
    return value >= spec.high ? spec.high : Math.min(spec.high, Number(near.toPrecision(9)));
  };
  range.addEventListener("input", () => {
    const at = Number(range.value);
    take(spec.log ? Number((spec.low * (spec.high / spec.low) ** (at / 200)).toPrecision(3)) : snapped(at / spec.scale));
  });
  // With step "any" the keys would move by a hundredth of the range, off the grid.
  if (!spec.log) range.addEventListener("keydown", (event) => {
    const by = { ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1, PageUp: 10, PageDown: -10 }[event.key];
    if (!by) return;
    event.preventDefault();
    const steps = Math.max(1, Math.round((spec.high - spec.low) / spec.step / 100));
    take(snapped(now + by * steps * spec.step));
  });
  number.addEventListener("change", () => {
    const typed = Number(number.value);
    if (number.value === "" || !Number.isFinite(typed)) show(now);
    else take(Number((typed / spec.scale).toPrecision(9)));
  });
  /** Other limits, step and value; a number that is being typed stays. */
  const limit = (other) => {
    spec = { ...spec, ...other };
    for (const each of spec.log ? [number] : [number, range]) Object.assign(each, { min: shown(spec.low), max: shown(spec.high) });
    show(spec.start, document.activeElement === number && number.value !== String(shown(now)));
  };
  show(spec.start);
  const element = html("div", { class: "slider" },
    html("label", { for: id }, spec.label), html("span", { class: "number" }, number, spec.unit), range);
  return { element, set: show, limit, step };
}

/** A list to choose from. */
export function pick(label, options, start, changed) {
  const id = `pick-${count++}`;
  const select = html("select", { id }, ...options.map((each) => html("option", { value: each.name }, each.label)));
  select.value = start;
  select.addEventListener("change", () => changed(select.value));
  return html("div", { class: "pick" }, html("label", { for: id }, label), select);
}

/** Settings that are shown or hidden together; `opened` holds the names of the groups that are shown. */
export function group(name, opened, ...children) {
  const made = html("details", {}, html("summary", {}, name), ...children);
  made.open = opened.has(name);
  made.addEventListener("toggle", () => (made.open ? opened.add(name) : opened.delete(name)));
  return made;
}
