// The pose: two tapered tubes and the forces on the finger, in millimetres; z points up, so y = −z.

import { newtons, svg } from "./svg.js";

const BOX = [-22, -42, 144, 112];
const SCALES = [800, 400, 200, 100, 50, 25, 12.5];  // mm a newton
const LONGEST = 34;  // mm

/** The union of all spheres along an axis. */
function tube(points, radii) {
  let path = "";
  points.forEach(([x, z], i) => {
    const r = radii[i];
    path += `M${x - r} ${-z}a${r} ${r} 0 1 0 ${2 * r} 0a${r} ${r} 0 1 0 ${-2 * r} 0Z`;
    if (!i) return;
    const [x0, z0] = points[i - 1], r0 = radii[i - 1];
    const dx = x - x0, dy = z0 - z, length = Math.hypot(dx, dy) || 1, nx = -dy / length, ny = dx / length;
    path += `M${x0 + nx * r0} ${-z0 + ny * r0}L${x + nx * r} ${-z + ny * r}L${x - nx * r} ${-z - ny * r}`
      + `L${x0 - nx * r0} ${-z0 - ny * r0}Z`;
  });
  return path;
}

export function scene(host) {
  const parts = ["finger", "exosuit"].map((name) => ({
    edge: svg("path", { class: `tube-edge ${name}-edge` }), fill: svg("path", { class: name }),
  }));
  const axis = svg("path", { class: "axis" });
  const joints = svg("g", {}), arrows = svg("g", {}), ruler = svg("g", {});
  const drawing = svg("svg", { viewBox: BOX.join(" "), role: "img", "aria-label": "Pose, not there yet" },
    ...parts.flatMap((part) => [part.edge, part.fill]), axis, joints, arrows, ruler);
  host.append(drawing);

  function draw(values) {
    const { exosuit, exosuit_radius, finger, finger_radius, contacts } = values;
    [[finger, finger_radius], [exosuit, exosuit_radius]].forEach(([points, radii], i) => {
      const path = tube(points, radii);
      parts[i].edge.setAttribute("d", path);
      parts[i].fill.setAttribute("d", path);
    });
    axis.setAttribute("d", `M${exosuit.map(([x, z]) => `${x} ${-z}`).join("L")}`);
    joints.replaceChildren(...finger.slice(0, 3).map(([x, z]) => svg("circle", { class: "joint", cx: x, cy: -z, r: 0.9 })));
    const sizes = contacts.map(({ force }) => Math.hypot(...force));
    const largest = Math.max(...sizes, 0.01);
    const scale = SCALES.find((each) => each * largest <= LONGEST) ?? SCALES.at(-1);
    const drawn = [];
    contacts.forEach(({ name, at: [x, z], force: [fx, fz], radius }, i) => {
      if (sizes[i] * scale < 0.6) return;
      const ex = fx / sizes[i], ey = -fz / sizes[i], length = sizes[i] * scale;
      const x0 = x - ex * radius, y0 = -z - ey * radius, x1 = x0 + ex * length, y1 = y0 + ey * length;
      const head = Math.min(3, length), xb = x1 - ex * head, yb = y1 - ey * head, w = 0.38 * head;
      const line = `M${x0} ${y0}L${xb} ${yb}`;
      const beyond = Math.max(length, 2) + 3.2;
      drawn.push(svg("path", { class: "halo", d: line }), svg("path", { class: "arrow", d: line }),
        svg("path", { class: "tip", d: `M${x1} ${y1}L${xb - ey * w} ${yb + ex * w}L${xb + ey * w} ${yb - ex * w}Z` }),
        svg("text", { class: "label", x: x0 + ex * beyond, y: y0 + ey * beyond + 1.2, "text-anchor": "middle" }, name));
    });
    arrows.replaceChildren(...drawn);
    const newton = [1, 0.5, 0.2, 0.1, 0.05, 0.02, 0.01].find((each) => each * scale <= 24) ?? 0.01;
    const bar = (x, y, length, words) => [
      svg("path", { class: "ruler", d: `M${x} ${y - 1}v2m0 -1h${length}m0 -1v2` }),
      svg("text", { class: "soft", x, y: y - 2.2 }, words)];
    const left = BOX[0] + 5, low = BOX[1] + BOX[3] - 4;
    ruler.replaceChildren(...bar(left, low, 20, "20 mm"), ...bar(left + 32, low, newton * scale, `${newton} N`));
    const pressing = contacts.map(({ name }, i) => [name, sizes[i]]).filter(([, size]) => size > 0.0005);
    drawing.setAttribute("aria-label", pressing.length
      ? `Pose with contact forces ${pressing.map(([name, size]) => `${name} ${newtons(size)}`).join(", ")}`
      : "Pose without contact");
  }
  return { draw, drawing };
}
