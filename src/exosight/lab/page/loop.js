// The second tab: one run of the closed loop, played while it is worked out, then scrubbed.

import { lines } from "./api.js";
import { lineChart } from "./charts.js";
import { pick, slider } from "./controls.js";
import { scene } from "./scene.js";
import { by, download, html, newtons, round125 } from "./svg.js";

const PERIOD = 100;  // ms a step

export function loop(about, view, seen, problem) {
  const run = { target: about.run.target.start, law: "scheduled", gain: about.run.gain.start, sensor: "network", disturbance: "none" };
  const pose = scene(by("loop-pose"));
  const force = lineChart(by("loop-chart"), "Force over time", "time [s]", "force [N]");
  const drive = lineChart(by("loop-u-chart"), "Actuation over time", "time [s]", "u [N]");
  let steps = [], at = 0, playing = 0, stop = null;

  const gain = slider(about.run.gain, (value) => { run.gain = value; });
  const start = html("button", { type: "submit", class: "main" }, "Run");
  const offer = () => { gain.element.hidden = run.law !== "proportional"; };
  by("loop-settings").append(
    slider(about.run.target, (value) => { run.target = value; }).element,
    pick("Law", about.run.laws, run.law, (name) => { run.law = name; offer(); }), gain.element,
    pick("Sensor", about.run.sensors, run.sensor, (name) => { run.sensor = name; }),
    pick("Disturbance", about.run.disturbances, run.disturbance, (name) => { run.disturbance = name; }), start);
  offer();

  by("loop-settings").addEventListener("submit", async (event) => {
    event.preventDefault();
    stop?.abort();
    stop = new AbortController();
    const { signal } = stop;
    steps = []; at = 0;
    start.textContent = "Working …";
    by("loop-note").textContent = run.law === "scheduled" ? "The law learns the paths of this exosuit first, which takes seconds …" : "";
    let asked;
    try {
      asked = { view: { ...view, drive: [0] }, ...run };
      for await (const step of lines("/api/trial", asked, signal)) {
        if (step.error) throw new Error(step.error);
        steps.push(step);
        if (steps.length === 1) { by("loop-note").textContent = ""; play(); }
        by("time").max = steps.length - 1;
        by("play").disabled = by("time").disabled = by("save-run").disabled = false;
        charts();
      }
      problem();
    } catch (error) {
      if (error.name !== "AbortError") { problem(error.message); by("loop-note").textContent = `Not run: ${error.message}`; }
    } finally {
      if (stop?.signal === signal) { start.textContent = "Run"; stop = null; }
      document.dispatchEvent(new CustomEvent("run"));
    }
  });

  function play() {
    if (playing) return pause();
    if (at >= steps.length - 1 && !stop) at = 0;
    by("play").textContent = "Pause";
    playing = setInterval(() => {
      show(Math.min(at + 1, steps.length - 1));
      if (at === steps.length - 1 && !stop) pause();
    }, PERIOD);
    show(at);
  }

  function pause() {
    clearInterval(playing);
    playing = 0;
    by("play").textContent = "Play";
  }

  function picture(data, words) {
    by("loop-image").hidden = !data;
    by("loop-lost").hidden = !!data;
    by("loop-image").alt = words;
    if (data) by("loop-image").src = `data:image/png;base64,${data}`;
  }

  function show(index) {
    at = index;
    const step = steps[index];
    pose.draw(step.scene);
    picture(step.image, `Camera image at ${step.time.toFixed(1)} s`);
    by("loop-target").textContent = newtons(step.target);
    by("loop-true").textContent = newtons(step.F_net);
    by("loop-measured").textContent = step.reading ? newtons(step.reading.F_net) : "none";
    by("loop-u").textContent = newtons(step.u, 2);
    by("loop-guard").textContent = step.guard ? step.guard.state : "no guard";
    by("loop-guard").className = `state ${step.guard?.state ?? ""}`;
    by("loop-note").textContent = step.guard ? `Guard: ${step.guard.cause}.` : "The paper's law has no guard.";
    by("time").value = index;
    by("time").setAttribute("aria-valuetext", `${step.time.toFixed(1)} s`);
    by("time-value").textContent = `${step.time.toFixed(1)} s`;
    charts();
  }

  function charts() {
    const end = Math.max(6, steps.at(-1)?.time ?? 0);
    const values = steps.flatMap((step) => [step.F_net, step.target, step.reading?.F_net ?? 0]);
    const most = Math.max(0.1, ...values), tick = round125(most / 4);
    const cursor = steps[at]?.time;
    const wrong = ["none", "softer"].includes(run.disturbance) ? [] : [{ kind: "wrong", from: 2, to: 3 }];
    by("wrong-key").hidden = !wrong.length;
    force({
      x: [0, end], y: [0, Math.ceil((most * 1.02) / tick) * tick], cursor, bands: wrong,
      series: [
        { kind: "target", points: steps.map((step) => [step.time, step.target]), steps: true },
        { kind: "true", points: steps.map((step) => [step.time, step.F_net]) },
        { kind: "measured", points: steps.map((step) => [step.time, step.reading?.F_net ?? null]) },
      ],
      words: steps[at] ? `${newtons(steps[at].F_net)} for a target of ${newtons(steps[at].target)} at ${cursor} s` : "",
    });
    const all = steps.map((step) => step.u), high = Math.max(1, ...all), low = Math.min(0, ...all), by_ = round125((high - low) / 4);
    drive({
      x: [0, end], y: [Math.floor(low / by_) * by_, Math.ceil(high / by_) * by_], cursor,
      bands: [...wrong, ...bands()],
      series: [{ kind: "ink", points: steps.map((step) => [step.time, step.u]), steps: true }],
    });
  }

  /** Stretches of time in which the guard's state was not normal. */
  function bands() {
    const found = [];
    for (const step of steps) {
      const kind = step.guard?.state, last = found.at(-1);
      if (!kind || kind === "normal") continue;
      if (last?.kind === kind && step.time - last.to < 0.01) last.to = step.time + 0.1;
      else found.push({ kind, from: step.time, to: step.time + 0.1 });
    }
    return found;
  }

  /** Until something has run, what the first tab shows. */
  document.addEventListener("shown", () => {
    if (steps.length || !seen()) return;
    pose.draw(seen().scene);
    picture(seen().image, "Camera image");
  });
  by("play").addEventListener("click", play);
  by("time").addEventListener("input", () => { if (playing) pause(); show(Number(by("time").value)); });
  by("save-run").addEventListener("click", () => {
    const head = "time [s],target [N],F_net true [N],F_net measured [N],u [N],guard,cause\n";
    const rows = steps.map((step) => [step.time, step.target, step.F_net, step.reading?.F_net ?? "", step.u,
      step.guard?.state ?? "", `"${(step.guard?.cause ?? "").replaceAll('"', '""')}"`].join(","));
    download(new Blob([head + rows.join("\n") + "\n"], { type: "text/csv" }), "exosight-run.csv");
  });
  charts();
}
