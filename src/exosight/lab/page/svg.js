// Elements, numbers and files: what every part of the page needs.

export const by = (id) => document.getElementById(id);

export function svg(tag, attributes = {}, ...children) {
  const made = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  made.append(...children);
  return made;
}

export function html(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  made.append(...children);
  return made;
}

/** A number with so many digits behind the point, with a minus sign unless it is rounded to 0. */
export function fixed(value, digits) {
  const words = value.toFixed(digits);
  return Number(words) === 0 ? words.replace("-", "") : words.replace("-", "−");
}

/** A number with its unit. */
export const quantity = (value, unit, digits = 3) => `${fixed(value, digits)} ${unit}`;

/** An OOD score with two digits, rounded up above the limit of 1, as the guard has it: 1.001 is 1.01. */
export const scoreWords = (score) => fixed(score > 1 ? Math.ceil(100 * score) / 100 : score, 2);

/** As many digits as a step has. */
export const digitsOf = (step) => Math.max(0, -Math.floor(Math.log10(step) + 1e-9));

/** A name as it is printed: what follows a single letter and "_" is its index. */
export function named(name) {
  const [, letter, index] = name.match(/^([A-Za-z])_(\w+)$/) ?? [];
  return index ? [letter, html("sub", {}, index)] : [name];
}

/** The least of 1, 2, 5 × 10ⁿ that is not below a value. */
export function round125(value) {
  const power = 10 ** Math.floor(Math.log10(value));
  return power * [1, 2, 5, 10].find((each) => each * power >= value * (1 - 1e-9));
}

export function download(content, name) {
  const link = html("a", { href: URL.createObjectURL(content), download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}

const KEPT = ["fill", "stroke", "stroke-width", "stroke-dasharray", "stroke-linejoin", "stroke-linecap", "font-size",
  "font-family", "opacity", "paint-order", "text-anchor"];

/** A drawing as a file that looks the same without this page's style sheet. */
export function standalone(drawing) {
  const copy = drawing.cloneNode(true);
  const from = [drawing, ...drawing.querySelectorAll("*")];
  [copy, ...copy.querySelectorAll("*")].forEach((each, i) => {
    const style = getComputedStyle(from[i]);
    for (const name of KEPT) each.setAttribute(name, style.getPropertyValue(name));
    each.removeAttribute("class");
  });
  const [x, y, width, height] = drawing.getAttribute("viewBox").split(" ");
  copy.prepend(svg("rect", { x, y, width, height, fill: getComputedStyle(drawing).backgroundColor }));
  copy.setAttribute("xmlns", "http://www.w3.org/2000/svg");
  return new Blob([copy.outerHTML], { type: "image/svg+xml" });
}
