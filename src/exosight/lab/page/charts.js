// A table of sensors with bars in it, and line charts.

import { fixed, html, named, round125, svg } from "./svg.js";

/** Rows of sensors, those of one quantity on one scale; what is estimated stands beside what is true. */
export function sensorTable(host, sensors, { truth, estimates }) {
  const columns = [...(truth ? ["true"] : []), ...(estimates ? ["est.", "90 %"] : [])];
  const head = html("tr", {}, html("th", { scope: "col" }, html("span", { class: "unseen" }, "Sensor")),
    html("th", { scope: "col" }, html("span", { class: "unseen" }, "Bars")),
    ...columns.map((words) => html("th", { scope: "col" }, words)));
  const groups = Map.groupBy
    ? [...Map.groupBy(sensors, (each) => `${each.quantity} ${each.unit}`).values()]
    : [...new Set(sensors.map((each) => `${each.quantity} ${each.unit}`))].map((key) => sensors.filter((each) => `${each.quantity} ${each.unit}` === key));
  const drawn = groups.map((group) => {
    const rows = group.map(({ name, unit }) => {
      const zero = svg("line", { class: "zero", y1: "0", y2: "100%" });
      const bar = svg("rect", { class: "true", y: "18%", height: "64%", rx: 1.5 });
      const whisker = svg("line", { class: "whisker", y1: "50%", y2: "50%", display: "none" });
      const dot = svg("circle", { class: "dot", cy: "50%", r: 4.5, display: "none" });
      const cells = columns.map(() => html("td"));
      const drawing = svg("svg", { "aria-hidden": "true" }, zero, bar, whisker, dot);
      const row = html("tr", {}, html("th", { scope: "row" }, ...named(name), html("span", { class: "unseen" }, ` [${unit}]`)),
        html("td", { class: "bar" }, drawing), ...cells);
      return { name, row, zero, bar, whisker, dot, cells };
    });
    const axis = svg("svg", { "aria-hidden": "true" });
    const foot = html("tr", { class: "foot" }, html("td"), html("td", { class: "bar" }, axis), html("td", { class: "unit", colspan: Math.max(1, columns.length) }, group[0].unit));
    return { rows, axis, body: html("tbody", {}, ...rows.map((each) => each.row), foot) };
  });
  host.append(html("table", {}, html("thead", {}, head), ...drawn.map(({ body }) => body)));

  return (readings, found) => drawn.forEach(({ rows, axis }) => {
    const values = rows.flatMap(({ name }) => {
      const { value, low, high } = found?.[name] ?? {};
      return [readings?.[name], value, low, high].filter((each) => each !== undefined);
    });
    const most = round125(Math.max(0.05, ...values.map(Math.abs)));
    const from = Math.min(...values, 0) < 0 ? -most : 0;
    const share = (value) => Math.min(100, Math.max(0, (100 * (value - from)) / (most - from)));
    for (const { name, zero, bar, whisker, dot, cells } of rows) {
      const real = readings?.[name], { value, low, high } = found?.[name] ?? {};
      const place = (element, attribute, at) => element.setAttribute(attribute, `${share(at)}%`);
      place(zero, "x1", 0);
      place(zero, "x2", 0);
      place(bar, "x", Math.min(0, real ?? 0));
      bar.setAttribute("width", `${Math.abs(share(real ?? 0) - share(0))}%`);
      whisker.setAttribute("display", low === undefined ? "none" : "inline");
      dot.setAttribute("display", value === undefined ? "none" : "inline");
      if (low !== undefined) { place(whisker, "x1", low); place(whisker, "x2", high); }
      if (value !== undefined) place(dot, "cx", value);
      const words = [...(truth ? [real] : []), ...(estimates ? [value] : [])].map((each) => each == null ? "" : fixed(each, 3));
      if (estimates) words.push(low === undefined ? "" : `${fixed(low, 3)}–${fixed(high, 3)}`);
      words.forEach((each, k) => { if (cells[k].textContent !== each) cells[k].textContent = each; });
    }
    axis.replaceChildren(svg("text", { x: "0%", y: 12 }, String(from).replace("-", "−")),
      svg("text", { x: "100%", y: 12, "text-anchor": "end" }, String(most)));
  });
}

/** A line through points, interrupted where y is null. */
function line(points, X, Y, steps) {
  let path = "", open = false;
  for (const [x, y] of points) {
    if (y !== null) path += `${!open ? `M${X(x)} ` : steps ? `H${X(x)}V` : `L${X(x)} `}${Y(y)}`;
    open = y !== null;
  }
  return path;
}

/** Words of a drawing; what follows a single letter and "_" becomes its index. */
function lowered(words) {
  const [, before, letter, index, after] = words.match(/^(.*?)\b([A-Za-z])_(\w+)(.*)$/) ?? [];
  if (!index) return [words];
  return [before + letter, svg("tspan", { dy: 3, "font-size": "75%" }, index), svg("tspan", { dy: -3 }, after)];
}

/** A line chart that fills its host; `draw` is given everything, so that it can be drawn anew in any size. */
export function lineChart(host) {
  const drawing = svg("svg", { role: "img", "aria-label": "Chart, not there yet" });
  host.append(drawing);
  let last = null;

  function draw(what = last) {
    if (!what) return;
    last = what;
    const width = host.clientWidth, height = drawing.clientHeight;
    if (!width || !height) return;
    const [x0, y0, x1, y1] = [44, 26, width - 12, height - 36];
    const [low, high] = what.y, [from, to] = what.x;
    const X = (x) => x0 + ((x - from) / (to - from || 1)) * (x1 - x0);
    const Y = (y) => y1 - ((y - low) / (high - low || 1)) * (y1 - y0);
    const step = round125((high - low) / 5), first = Math.ceil(low / step - 1e-9);
    const grid = [];
    for (let k = first; k * step <= high + 1e-9; k++) {
      const words = Number((k * step).toPrecision(3)).toString().replace("-", "−");
      grid.push(svg("line", { class: "grid", x1: x0, x2: x1, y1: Y(k * step), y2: Y(k * step) }),
        svg("text", { x: x0 - 6, y: Y(k * step) + 4, "text-anchor": "end", class: "soft" }, words));
    }
    const apart = round125((to - from) / 6);
    for (let k = Math.ceil(from / apart - 1e-9); k * apart <= to + 1e-9; k++) {
      const words = String(Number((k * apart).toPrecision(3))).replace("-", "−");
      grid.push(svg("text", { x: X(k * apart), y: y1 + 16, "text-anchor": "middle", class: "soft" }, words));
    }
    grid.push(svg("line", { class: "frame", x1: x0, x2: x1, y1, y2: y1 }),
      svg("text", { x: (x0 + x1) / 2, y: height - 3, "text-anchor": "middle" }, ...lowered(what.labels[0])),
      svg("text", { x: 2, y: 11 }, ...lowered(what.labels[1])));
    const bands = (what.bands ?? []).map(({ kind, from: a, to: b }) => svg("rect", {
      class: kind, x: X(a), width: Math.max(1, X(b) - X(a)), y: y0, height: y1 - y0,
    }));
    const series = what.series.map(({ kind, points, steps }) => svg("path", { class: kind, d: line(points, X, Y, steps) }));
    const marks = (what.marks ?? []).map(({ kind, x, y }) => svg("circle", { class: kind, cx: X(x), cy: Y(y), r: kind === "here" ? 5 : 6.5 }));
    const cursor = what.cursor == null ? [] : [svg("line", { class: "cursor", x1: X(what.cursor), x2: X(what.cursor), y1: y0, y2: y1 })];
    drawing.replaceChildren(...bands, ...grid, ...series, ...cursor, ...marks);
    drawing.setAttribute("aria-label", [`${what.labels[1]} over ${what.labels[0]}`, what.words].filter(Boolean).join(": "));
  }
  new ResizeObserver(() => draw()).observe(host);
  return draw;
}
