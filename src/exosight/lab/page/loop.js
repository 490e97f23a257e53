// The second tab: one run of the closed loop, played while it is worked out, then scrubbed.

import { ask, lines } from "./api.js";
import { lineChart } from "./charts.js";
import { pick, slider } from "./controls.js";
import { scene } from "./scene.js";
import { by, digitsOf, download, html, named, quantity, round125 } from "./svg.js";

const PERIOD = 100;  // ms a step

export function loop(about, view, seen, problem) {
  const { channels } = about;
  const run = {
    sensor: about.controlled, channel: channels[0].name, target: about.run.target.start, law: about.run.laws[0].name,
    gain: about.run.gain.start, measured: about.run.measured[0].name, disturbance: about.run.disturbances[0].name,
  };
  const pose = scene(by("loop-pose"), about);
  const value = lineChart(by("loop-chart")), drive = lineChart(by("loop-u-chart"));
  let steps = [], ran = run, at = 0, playing = 0, stop = null, aiming = null, aimed = "";

  const unitOf = (name) => about.sensors.find((each) => each.name === name).unit;
  const channelOf = (name) => channels.find((each) => each.name === name);
  const measured = (step) => step.reading?.estimates[ran.sensor]?.value;
  const target = html("div", {});
  const gain = slider(about.run.gain, (to) => { run.gain = to; });
  const start = html("button", { type: "submit", class: "main" }, "Run");
  const offer = () => { gain.element.hidden = run.law !== "proportional"; };
  const list = (label, names, key) => pick(label, names.map((name) => ({ name, label: name })), run[key], (name) => { run[key] = name; aim(); });

  function aimAt(spec) {
    run.target = spec.start;
    target.replaceChildren(slider({ ...spec, label: `Target ${run.sensor}`, unit: unitOf(run.sensor) }, (to) => { run.target = to; }).element);
  }

  /** Between which limits the target may lie: the path of the sensor over the channel tells. */
  async function aim() {
    aiming?.abort();
    aiming = new AbortController();
    const key = `${run.sensor} ${run.channel}`;
    if (key === aimed) return;
    try {
      const settings = { view: { ...view, drive: [] }, channel: run.channel, sensor: run.sensor };
      aimAt({ ...about.run.target, ...(await ask("/api/path", settings, aiming.signal)).target });
      aimed = key;
    } catch (error) {
      if (error.name !== "AbortError") problem(error.message);
    }
  }

  aimAt(about.run.target);
  by("loop-settings").append(
    list("Sensor", about.controllable, "sensor"), ...(channels.length > 1 ? [list("Channel", channels.map(({ name }) => name), "channel")] : []),
    target,
    pick("Law", about.run.laws, run.law, (name) => { run.law = name; offer(); }), gain.element,
    pick("Measured by", about.run.measured, run.measured, (name) => { run.measured = name; }),
    pick("Disturbance", about.run.disturbances, run.disturbance, (name) => { run.disturbance = name; }), start);
  offer();
  document.addEventListener("tab", (event) => { if (event.detail === "loop") aim(); });

  by("loop-settings").addEventListener("submit", async (event) => {
    event.preventDefault();
    stop?.abort();
    stop = new AbortController();
    const { signal } = stop;
    steps = []; at = 0; ran = { ...run };
    titles();
    start.textContent = "Working …";
    by("loop-note").textContent = run.law === "scheduled" ? "The law learns the paths of this system first, which takes seconds …" : "";
    try {
      for await (const step of lines("/api/trial", { view: { ...view, drive: [] }, ...run }, signal)) {
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

  function titles() {
    for (const each of document.querySelectorAll(".loop-sensor")) each.replaceChildren(...named(ran.sensor));
    for (const each of document.querySelectorAll(".loop-channel")) each.replaceChildren(...named(ran.channel));
  }

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
    const step = steps[index], unit = unitOf(ran.sensor), channel = channelOf(ran.channel);
    pose.draw(step.scene);
    picture(step.image, `Camera image at ${step.time.toFixed(1)} s`);
    by("loop-target").textContent = quantity(step.target, unit);
    by("loop-true").textContent = quantity(step.readings[ran.sensor], unit);
    by("loop-measured").textContent = measured(step) === undefined ? "none" : quantity(measured(step), unit);
    by("loop-u").textContent = quantity(step.command, channel.unit, digitsOf(channel.step));
    by("loop-guard").textContent = step.guard ? step.guard.state : "no guard";
    by("loop-guard").className = `state ${step.guard?.state ?? ""}`;
    by("loop-note").textContent = step.guard ? `Guard: ${step.guard.cause}.` : "The paper's law has no guard.";
    by("time").value = index;
    by("time").setAttribute("aria-valuetext", `${step.time.toFixed(1)} s`);
    by("time-value").textContent = `${step.time.toFixed(1)} s`;
    charts();
  }

  function charts() {
    const end = Math.max(6, steps.at(-1)?.time ?? 0), unit = unitOf(ran.sensor), channel = channelOf(ran.channel);
    const values = steps.flatMap((step) => [step.readings[ran.sensor], step.target, measured(step) ?? 0]);
    const cursor = steps[at]?.time;
    const wrong = ["none", "softer"].includes(ran.disturbance) ? [] : [{ kind: "wrong", from: 2, to: 3 }];
    by("wrong-key").hidden = !wrong.length;
    value({
      labels: ["time [s]", `${ran.sensor} [${unit}]`],
      x: [0, end], y: scaled(Math.min(0, ...values), Math.max(0.1, ...values) * 1.02), cursor, bands: wrong,
      series: [
        { kind: "target", points: steps.map((step) => [step.time, step.target]), steps: true },
        { kind: "true", points: steps.map((step) => [step.time, step.readings[ran.sensor]]) },
        { kind: "measured", points: steps.map((step) => [step.time, measured(step) ?? null]) },
      ],
      words: steps[at] ? `${quantity(steps[at].readings[ran.sensor], unit)} for a target of ${quantity(steps[at].target, unit)} at ${cursor} s` : "",
    });
    const all = steps.map((step) => step.command);
    drive({
      labels: ["time [s]", `${ran.channel} [${channel.unit}]`],
      x: [0, end], y: scaled(Math.min(0, ...all), Math.max(Math.abs(channel.peak) / 4, ...all)), cursor,
      bands: [...wrong, ...bands()],
      series: [{ kind: "ink", points: steps.map((step) => [step.time, step.command]), steps: true }],
    });
  }

  /** Limits of an axis that end on its ticks. */
  function scaled(low, high) {
    const tick = round125((high - low) / 4);
    return [Math.floor(low / tick + 1e-9) * tick, Math.ceil(high / tick - 1e-9) * tick];
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

  function table() {
    const unit = unitOf(ran.sensor), channel = channelOf(ran.channel);
    const head = `time [s],target [${unit}],${ran.sensor} true [${unit}],${ran.sensor} measured [${unit}],${ran.channel} [${channel.unit}],guard,cause\n`;
    return head + steps.map((step) => [step.time, step.target, step.readings[ran.sensor], measured(step) ?? "", step.command,
      step.guard?.state ?? "", `"${(step.guard?.cause ?? "").replaceAll('"', '""')}"`].join(",")).join("\n") + "\n";
  }

  /** Until something has run, what the first tab shows. */
  document.addEventListener("shown", () => {
    if (steps.length || !seen()) return;
    pose.draw(seen().scene);
    picture(seen().image, "Camera image");
  });
  by("play").addEventListener("click", play);
  by("time").addEventListener("input", () => { if (playing) pause(); show(Number(by("time").value)); });
  by("save-run").addEventListener("click", () => download(new Blob([table()], { type: "text/csv" }), "exosight-run.csv"));
  titles();
  charts();
}
