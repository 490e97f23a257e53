// A table of forces with bars in it, and line charts.

import { html, round125, svg } from "./svg.js";

/** Rows C1…C7 and F_net; `truth` has C0 first and may be missing. */
export function forceTable(host, withTruth) {
  const head = html("tr", {}, html("th", { scope: "col" }, html("span", { class: "unseen" }, "Contact")),
    html("th", { scope: "col" }, html("span", { class: "unseen" }, "Bars")),
    ...(withTruth ? [html("th", { scope: "col" }, "true")] : []),
    html("th", { scope: "col" }, "est."), html("th", { scope: "col" }, "90 % [N]"));
  const rows = Array.from({ length: 7 }, (_, i) => {
    const zero = svg("line", { class: "zero", x1: "0%", x2: "0%", y1: "0", y2: "100%" });
    const bar = svg("rect", { class: "true", x: "0%", y: "18%", height: "64%", rx: 1.5 });
    const whisker = svg("line", { class: "whisker", y1: "50%", y2: "50%" });
    const dot = svg("circle", { class: "dot", cy: "50%", r: 4.5 });
    const drawing = svg("svg", { "aria-hidden": "true" }, zero, bar, whisker, dot);
    const cells = Array.from({ length: withTruth ? 3 : 2 }, () => html("td"));
    const row = html("tr", {}, html("th", { scope: "row" }, `C${i + 1}`), html("td", { class: "bar" }, drawing), ...cells);
    return { row, bar, whisker, dot, cells };
  });
  const axis = svg("svg", { "aria-hidden": "true" });
  const foot = html("tr", {}, html("td"), html("td", { class: "bar" }, axis), html("td", { colspan: withTruth ? 3 : 2 }));
  host.append(html("table", {}, html("thead", {}, head), html("tbody", {}, ...rows.map((each) => each.row)), html("tfoot", {}, foot)));

  return (truth, reading) => {
    const most = round125(Math.max(0.05, ...(truth ?? []).slice(1), ...reading.high));
    const share = (value) => `${Math.min(100, (100 * value) / most)}%`;
    rows.forEach(({ bar, whisker, dot, cells }, i) => {
      const [low, high, estimated] = [reading.low[i], reading.high[i], reading.forces[i]];
      bar.setAttribute("width", share(truth ? truth[i + 1] : 0));
      whisker.setAttribute("x1", share(low));
      whisker.setAttribute("x2", share(high));
      dot.setAttribute("cx", share(estimated));
      const words = [estimated.toFixed(3), `${low.toFixed(3)}–${high.toFixed(3)}`];
      if (truth) words.unshift(truth[i + 1].toFixed(3));
      words.forEach((each, k) => { if (cells[k].textContent !== each) cells[k].textContent = each; });
    });
    axis.replaceChildren(svg("text", { x: "0%", y: 12 }, "0"),
      svg("text", { x: "100%", y: 12, "text-anchor": "end" }, `${most} N`));
  };
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

/** Words of a drawing, with what follows "F_" as its index. */
function lowered(words) {
  const [before, index, after] = words.split(/(?<=F)_(\w+)/);
  if (!index) return [words];
  return [before, svg("tspan", { dy: 3, "font-size": "75%" }, index), svg("tspan", { dy: -3 }, after)];
}

/** A line chart that fills its host; `draw` is given everything, so that it can be drawn anew in any size. */
export function lineChart(host, label, unitX, unitY) {
  const drawing = svg("svg", { role: "img", "aria-label": label });
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
    for (let at = from; at <= to + 1e-9; at += apart) {
      grid.push(svg("text", { x: X(at), y: y1 + 16, "text-anchor": "middle", class: "soft" }, String(Number(at.toPrecision(3)))));
    }
    grid.push(svg("line", { class: "frame", x1: x0, x2: x1, y1, y2: y1 }),
      svg("text", { x: (x0 + x1) / 2, y: height - 3, "text-anchor": "middle" }, unitX),
      svg("text", { x: 2, y: 11 }, ...lowered(unitY)));
    const bands = (what.bands ?? []).map(({ kind, from: a, to: b }) => svg("rect", {
      class: kind, x: X(a), width: Math.max(1, X(b) - X(a)), y: y0, height: y1 - y0,
    }));
    const series = what.series.map(({ kind, points, steps }) => svg("path", { class: kind, d: line(points, X, Y, steps) }));
    const marks = (what.marks ?? []).map(({ kind, x, y }) => svg("circle", { class: kind, cx: X(x), cy: Y(y), r: kind === "here" ? 5 : 6.5 }));
    const cursor = what.cursor == null ? [] : [svg("line", { class: "cursor", x1: X(what.cursor), x2: X(what.cursor), y1: y0, y2: y1 })];
    drawing.replaceChildren(...bands, ...grid, ...series, ...cursor, ...marks);
    if (what.words) drawing.setAttribute("aria-label", `${label}: ${what.words}`);
  }
  new ResizeObserver(() => draw()).observe(host);
  return draw;
}
