// The first tab: settings in, one view out. At most one view is on its way; what changes meanwhile goes next.

import { ask, file } from "./api.js";
import { forceTable, lineChart } from "./charts.js";
import { group, pick, slider } from "./controls.js";
import { scene } from "./scene.js";
import { by, download, newtons, round125, standalone } from "./svg.js";

const LONGEST_WAY = 48;  // turns; the server takes up to 64
const LONGEST_TRAIL = 400;  // points
const QUIET = 300;  // ms without a change until the whole path is asked for, and the numbers are spoken

export function explore(about, problem) {
  const view = { ...about.start };
  const pose = scene(by("pose"));
  const table = forceTable(by("forces"), true);
  const chart = lineChart(by("path"), "F_net over actuation", "actuation u [N]", "F_net [N]");
  const u = by("u");
  let busy = false, again = false, sent = 0, exosuit = 0, shown = null, path = null, trail = [], quiet = 0, stop = null, sweeping = 0;

  const here = () => view.drive.at(-1);

  async function update() {
    clearTimeout(quiet);
    if (busy) { again = true; return; }
    busy = true;
    do {
      again = false;
      sent = view.drive.length;
      const asked = exosuit;
      try {
        const found = await ask("/api/view", view);
        if (asked === exosuit) {
          // The server knows a shortest way to the same pose; what was driven meanwhile goes on from there.
          view.drive = [...found.drive, ...view.drive.slice(sent)];
          sent = found.drive.length;
          trail.push([found.drive.at(-1), found.F_net]);
          if (trail.length > LONGEST_TRAIL) trail.shift();
        }
        show(found);
        problem();
      } catch (error) {
        problem(error.message);
      }
    } while (again);
    busy = false;
    sent = 0;
    document.dispatchEvent(new CustomEvent("shown"));
  }

  function show(found) {
    shown = found;
    by("status").hidden = true;
    pose.draw(found.scene);
    by("image").src = `data:image/png;base64,${found.image}`;
    table(found.true, found.reading);
    by("net-true").textContent = newtons(found.F_net);
    by("net-estimated").textContent = newtons(found.reading.F_net);
    by("ood_score").textContent = `${found.reading.ood_score.toFixed(2)}${found.reading.ood_score > 1 ? ", do not trust" : ""}`;
    by("guard").textContent = found.guard.state;
    by("guard").className = `state ${found.guard.state}`;
    by("guard-cause").textContent = `Guard, shown this picture: ${found.guard.cause}.`;
    by("notes").hidden = !found.notes.length;
    by("notes").textContent = found.notes.length ? `Note: ${found.notes.join("; ")}.` : "";
    by("way").textContent = ["0", ...found.drive.filter((each, i) => i || each).map((each) => each.toFixed(2))].join(" → ") + " N";
    by("command").value = found.command;
    drawPath();
    clearTimeout(quiet);
    quiet = setTimeout(rest, QUIET);
  }

  function drawPath() {
    const most = Math.max(0.1, ...(path ? [...path.loading, ...path.unloading] : []), ...trail.map(([, y]) => y), shown?.reading.F_net ?? 0);
    const step = round125(most / 4);
    const series = path ? [
      { kind: "up", points: path.u.map((x, i) => [x, path.loading[i]]) },
      { kind: "down", points: path.u.map((x, i) => [x, path.unloading[i]]) },
    ] : [];
    const at = shown ? [{ kind: "here", x: shown.drive.at(-1), y: shown.F_net }, { kind: "there", x: shown.drive.at(-1), y: shown.reading.F_net }] : [];
    chart({
      x: [0, about.drive.largest], y: [0, Math.ceil((most * 1.02) / step) * step],
      series: [...series, { kind: "trail", points: trail }], marks: at,
      words: shown ? `${newtons(shown.F_net)} at u = ${here().toFixed(2)} N` : "",
    });
  }

  async function rest() {
    by("spoken").textContent = `u ${here().toFixed(2)} N: F net ${newtons(shown.F_net)}, estimated ${newtons(shown.reading.F_net)}, guard ${shown.guard.state}`;
    if (path || stop) return;
    stop = new AbortController();
    const { signal } = stop;
    by("path-note").textContent = "Solving the way up and down …";
    try {
      path = await ask("/api/path", view, signal);
      by("path-note").textContent = `${2 * path.u.length - 1} equilibria, 0 → 4 → 0 N in steps of ${path.u[1]} N; where the two differ the exosuit has snapped. Thin: where you have been. Open circle: estimate.`
        + (path.stable ? "" : " At some actuations no stable pose was found.");
      drawPath();
    } catch (error) {
      if (error.name !== "AbortError") problem(error.message);
    } finally {
      if (stop?.signal === signal) stop = null;
      document.dispatchEvent(new CustomEvent("path"));
    }
  }

  function driveTo(value) {
    const next = Math.round(value / about.drive.step) * about.drive.step;
    if (view.drive.length > LONGEST_WAY && !busy) view.drive = [];
    const [last, before] = [view.drive.at(-1), view.drive.at(-2)];
    // Not yet sent, and the same way: one drive.
    if (view.drive.length > Math.max(sent, 1) && (next - last) * (last - before) >= 0) view.drive[view.drive.length - 1] = next;
    else if (next !== last) view.drive.push(next);
    showU();
    update();
  }

  function showU() {
    u.value = here();
    u.setAttribute("aria-valuetext", newtons(here(), 2));
    by("u-value").textContent = newtons(here(), 2);
  }

  /** Another exosuit: its way begins at rest, and its path is not known. */
  function changed(name, value) {
    view[name] = value;
    view.drive = [here()];
    sent = 0;
    exosuit++;
    stop?.abort();
    stop = path = null;
    trail = [];
    update();
  }

  function build() {
    const family = about.families.find((each) => each.name === view.family);
    const parameters = family.parameters.map((spec, i) => slider({ ...spec, start: view.parameters[i] }, (value) => {
      const all = [...view.parameters];
      all[i] = value;
      changed("parameters", all);
    }).element);
    const choice = pick("Family", about.families, view.family, (name) => {
      view.parameters = about.families.find((each) => each.name === name).parameters.map((each) => each.start);
      changed("family", name);
      build();
      by("settings").querySelector("select").focus();
    });
    const sliders = (name, then) => about.groups[name].map((spec) => slider({ ...spec, start: view[spec.key] }, (value) => then(spec.key, value)).element);
    const looked = (key, value) => { view[key] = value; update(); };
    by("settings").replaceChildren(
      group("Exosuit", choice, ...parameters, ...sliders("Exosuit", changed)),
      group("Finger", ...sliders("Finger", changed)),
      group("Camera", ...sliders("Camera", looked), pick("Corruption", about.corruptions, view.corruption, (name) => looked("corruption", name))));
  }

  function sweep() {
    if (sweeping) { clearInterval(sweeping); sweeping = 0; by("sweep").textContent = "Drive up and down"; return; }
    let direction = here() >= about.drive.largest ? -1 : 1;
    by("sweep").textContent = "Stop";
    sweeping = setInterval(() => {
      if (busy) return;
      driveTo(Math.min(about.drive.largest, Math.max(0, here() + direction * about.drive.step)));
      if (here() >= about.drive.largest) direction = -1;
      else if (here() <= 0) sweep();
    }, 40);
  }

  async function save(name) {
    try { download(await file(`/api/save/${name}`, view), `exosight-${name}`); } catch (error) { problem(error.message); }
  }

  u.min = 0; u.max = about.drive.largest; u.step = about.drive.step;
  u.addEventListener("input", () => driveTo(Number(u.value)));
  by("settings").addEventListener("submit", (event) => event.preventDefault());
  by("sweep").addEventListener("click", sweep);
  by("save-figure").addEventListener("click", () => download(standalone(pose.drawing), "exosight-pose.svg"));
  by("save-picture").addEventListener("click", () => save("picture.png"));
  by("save-forces").addEventListener("click", () => save("forces.csv"));
  by("save-path").addEventListener("click", () => save("path.csv"));
  by("copy").addEventListener("click", async () => {
    by("command").select();
    try { await navigator.clipboard.writeText(by("command").value); by("spoken").textContent = "Copied"; } catch { /* it stays selected */ }
    by("copy").textContent = "Copied";
    setTimeout(() => { by("copy").textContent = "Copy"; }, 1200);
  });
  build();
  showU();
  update();
  return { view, seen: () => shown };
}
