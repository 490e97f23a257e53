// The pose: tapered tubes and the forces on zones; z points up, so y = −z. Millimetres are scaled so that what the
// camera sees is always as wide.

import { html, quantity, round125, svg } from "./svg.js";

const WIDTH = 144, TALL = 0.78;  // of the drawing, and of a part of the camera's view that is higher than that
const LONGEST = 34;  // arrow
const COLOURS = 4;  // of the style sheet: tubes of one shade have one colour
const NEAR = 4;  // zones of one place
const NAMED = 24;  // zones up to which each is always named

/** The union of all spheres along an axis. */
export function tube(points, radii) {
  let path = "";
  points.forEach(([x, y], i) => {
    const r = radii[i];
    path += `M${x - r} ${y}a${r} ${r} 0 1 0 ${2 * r} 0a${r} ${r} 0 1 0 ${-2 * r} 0Z`;
    if (!i) return;
    const [x0, y0] = points[i - 1], r0 = radii[i - 1];
    const dx = x - x0, dy = y - y0, length = Math.hypot(dx, dy) || 1, nx = -dy / length, ny = dx / length;
    path += `M${x0 + nx * r0} ${y0 + ny * r0}L${x + nx * r} ${y + ny * r}L${x - nx * r} ${y - ny * r}`
      + `L${x0 - nx * r0} ${y0 - ny * r0}Z`;
  });
  return path;
}

/** The largest of 1, 2, 5 × 10ⁿ that is not above a value. */
const below125 = (value) => 1 / round125(1 / value);

/** Names of the tubes by their colours, for a legend. */
export function tubeLegend(about) {
  const shades = [...new Set(about.scene.tubes.map(({ shade }) => shade))];
  return shades.map((shade, i) => {
    const names = about.scene.tubes.filter((each) => each.shade === shade).map(({ name }) => name);
    return html("li", {}, html("i", { class: `swatch tube-${i % COLOURS}` }), names.slice(0, 3).join(", ") + (names.length > 3 ? " …" : ""));
  });
}

export function scene(host, about) {
  const { tubes, zones, centre, size } = about.scene;
  const shades = [...new Set(tubes.map(({ shade }) => shade))];
  const k = WIDTH / size[0];
  const parts = tubes.map(({ shade, jointed }) => {
    const kind = `tube-${shades.indexOf(shade) % COLOURS}`;
    return { jointed, kind, edge: svg("path", { class: `tube-edge ${kind}-edge` }), fill: svg("path", { class: kind }), extra: svg("g", {}) };
  });
  const names = svg("g", {}), arrows = svg("g", {}), ruler = svg("g", {});
  const drawing = svg("svg", { role: "img", "aria-label": "Pose, not there yet" },
    ...parts.flatMap((part) => [part.edge, part.fill]), ...parts.map((part) => part.extra), names, arrows, ruler);
  host.append(drawing);
  const height = Math.min(size[1] * k, WIDTH * TALL);
  const box = [(centre[0] - size[0] / 2) * k, -centre[1] * k - height / 2, WIDTH, height];
  drawing.setAttribute("viewBox", box.join(" "));
  const at = ([x, z]) => [x * k, -z * k];

  /** What is cut off of the camera's view is brought back where a pose needs it. */
  function fit(lines, radii) {
    const top = (-centre[1] - size[1] / 2) * k, bottom = (-centre[1] + size[1] / 2) * k;
    const edges = (sign) => lines.flatMap((points, i) => points.map(([, y], j) => y + sign * radii[i][j] * k));
    const [high, low] = [Math.max(top, Math.min(...edges(-1))) - 4, Math.min(bottom, Math.max(...edges(1))) + 4];
    if (low > box[1] + box[3]) box[1] = low - box[3];
    if (high < box[1]) box[1] = Math.max(top - 4, Math.min(high, box[1]));
    if (low > box[1] + box[3]) box[3] = low - box[1];
    drawing.setAttribute("viewBox", box.join(" "));
  }

  function draw(values) {
    const lines = values.tubes.map(({ axis }) => axis.map(at));
    values.tubes.forEach(({ radius }, i) => {
      const { edge, fill, extra, jointed, kind } = parts[i], points = lines[i];
      const path = tube(points, radius.map((each) => each * k));
      edge.setAttribute("d", path);
      fill.setAttribute("d", path);
      extra.replaceChildren(...(jointed
        ? points.slice(0, -1).map(([x, y]) => svg("circle", { class: `joint ${kind}-joint`, cx: x, cy: y, r: 0.9 }))
        : [svg("path", { class: `axis ${kind}-edge`, d: `M${points.map((point) => point.join(" ")).join("L")}` })]));
    });
    fit(lines, values.tubes.map(({ radius }) => radius));
    forces(values.zones);
  }

  /** Names at the middles of zones; those of one place stand side by side. */
  function zoneNames(quiet) {
    const placed = [];
    for (const [name, x, y] of quiet) {
      const same = placed.find((each) => Math.hypot(each.x - x, each.y - y) < NEAR);
      if (same) same.words += ` ${name}`;
      else placed.push({ words: name, x, y });
    }
    return placed.map(({ words, x, y }) => svg("text", { class: "zone", x, y: y + 3.6, "text-anchor": "middle" }, words));
  }

  function forces(found) {
    const sizes = found.map(({ force }) => Math.hypot(...force));
    const largest = Math.max(...sizes, 0.01);
    const scale = 800 / 2 ** Math.max(0, Math.ceil(Math.log2((800 * largest) / LONGEST)));  // a newton
    const pressed = [], quiet = [];
    found.forEach(({ at: place, force: [fx, fz], radius }, i) => {
      const [x, y] = at(place), length = sizes[i] * scale;
      if (length < 0.6) { quiet.push([zones[i], x, y]); return; }
      const ex = fx / sizes[i], ey = -fz / sizes[i];
      const x0 = x - ex * radius * k, y0 = y - ey * radius * k, x1 = x0 + ex * length, y1 = y0 + ey * length;
      const head = Math.min(3, length), xb = x1 - ex * head, yb = y1 - ey * head, w = 0.38 * head;
      const shaft = `M${x0} ${y0}L${xb} ${yb}`;
      const beyond = Math.max(length, 2) + 3.2;
      pressed.push(svg("path", { class: "halo", d: shaft }), svg("path", { class: "arrow", d: shaft }),
        svg("path", { class: "tip", d: `M${x1} ${y1}L${xb - ey * w} ${yb + ex * w}L${xb + ey * w} ${yb - ex * w}Z` }),
        svg("text", { class: "label", x: x0 + ex * beyond, y: y0 + ey * beyond + 1.2, "text-anchor": "middle" }, zones[i]));
    });
    names.replaceChildren(...(zones.length <= NAMED ? zoneNames(quiet) : []));
    arrows.replaceChildren(...pressed);
    const bar = (x, y, length, words) => [
      svg("path", { class: "ruler", d: `M${x} ${y - 1}v2m0 -1h${length}m0 -1v2` }),
      svg("text", { class: "soft", x, y: y - 2.2 }, words)];
    const left = box[0] + 5, bottom = box[1] + box[3] - 4, mm = below125(24 / k), newton = below125(24 / scale);
    ruler.replaceChildren(...bar(left, bottom, mm * k, `${mm} mm`),
      ...(zones.length ? bar(left + 32, bottom, newton * scale, `${Number(newton.toPrecision(2))} N`) : []));
    const told = zones.map((name, i) => [name, sizes[i]]).filter(([, each]) => each > 0.0005);
    drawing.setAttribute("aria-label", told.length
      ? `Pose with contact forces ${told.map(([name, each]) => `${name} ${quantity(each, "N")}`).join(", ")}`
      : "Pose without contact");
  }
  return { draw, drawing };
}
