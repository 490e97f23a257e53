// A map of the zones: the tubes that carry them, at rest, and the name of each at its place.

import { tube } from "./scene.js";
import { svg } from "./svg.js";

const WIDTH = 320, TALL = 90, EDGE = 14;  // of the drawing, of its tubes at most, and beside them
const ROW = 22;  // of names, above and below
const LETTER = 7.5, BETWEEN = 8;  // width, and least gap of names
const NAMED = 24;  // zones up to which each is named

/** Where names may stand in a row: each as near to its zone as those beside it allow. */
function spread(labels) {
  labels.forEach((each, i) => {
    each.half = (each.name.length * LETTER) / 2;
    const left = i ? labels[i - 1].x + labels[i - 1].half + BETWEEN : 2;
    each.x = Math.max(each.x, left + each.half);
  });
  labels.reduceRight((right, each) => {
    each.x = Math.min(each.x, right - each.half);
    return each.x - each.half - BETWEEN;
  }, WIDTH - 2);
}

/** Draws the map in `host` once `place` is given a pose; `colour` fills zones by the readings of their sensors. */
export function zoneMap(host, { tubes, zones }, kind) {
  let dots = [], shares = [];

  function place(pose) {
    const carriers = pose.tubes.filter((_, i) => tubes[i].zoned);
    const ends = carriers.flatMap(({ axis, radius }) => axis.flatMap(([x, z], i) => [[x - radius[i], z - radius[i]], [x + radius[i], z + radius[i]]]));
    if (!zones.length || !ends.length) return;
    const [left, low] = [0, 1].map((k) => Math.min(...ends.map((each) => each[k])));
    const [right, high] = [0, 1].map((k) => Math.max(...ends.map((each) => each[k])));
    const scale = Math.min((WIDTH - 2 * EDGE) / (right - left), TALL / (high - low));
    const height = scale * (high - low) + 2 * ROW;
    const at = ([x, z]) => [WIDTH / 2 + scale * (x - (left + right) / 2), ROW + scale * (high - z)];
    const bodies = carriers.map(({ axis, radius }) => svg("path", { class: "body", d: tube(axis.map(at), radius.map((each) => each * scale)) }));
    const places = zones.map((name, i) => ({ name, zone: at(pose.zones[i].at) }));
    const rows = [[], []];
    [...places].sort((a, b) => a.zone[0] - b.zone[0]).forEach((each, i) => rows[i % 2].push({ ...each, x: each.zone[0] }));
    const labels = zones.length > NAMED ? [] : rows.flatMap((row, below) => {
      spread(row);
      const y = below ? height : 0, sign = below ? -1 : 1;
      return row.flatMap(({ name, x, zone }) => [
        svg("path", { class: "leader", d: `M${x} ${y + sign * 15}L${zone.join(" ")}` }),
        svg("text", { x, y: below ? height - 3 : 11, "text-anchor": "middle" }, name)]);
    });
    dots = places.map(({ zone: [cx, cy] }) => svg("circle", { class: kind, cx, cy, r: 4.5 }));
    fill();
    host.replaceChildren(svg("svg", { role: "img", viewBox: `0 0 ${WIDTH} ${height}`, "aria-label": `Map of the zones ${zones.join(", ")}` },
      ...bodies, ...labels, ...dots));
  }

  const fill = () => dots.forEach((dot, i) => dot.setAttribute("fill-opacity", shares[i] ?? 0));

  function colour(values) {
    const sizes = zones.map((name) => Math.abs(values[name] ?? 0)), most = Math.max(0.05, ...sizes);
    shares = sizes.map((each) => each / most);
    fill();
  }

  return { place, colour };
}
