// The second tab: one run of the closed loop, played while it is worked out, then scrubbed.

import { ask, lines } from "./api.js";
import { lineChart } from "./charts.js";
import { pick, slider } from "./controls.js";
import { scene } from "./scene.js";
import { by, digitsOf, download, html, named, quantity, round125 } from "./svg.js";

const PERIOD = 100;  // ms a step

export function loop(about, view, seen, problem) {
  const { channels } = about;
  const chosen = {};  // what the next run is asked for; a target of null is the default of its path
  const pose = scene(by("loop-pose"), about);
  const value = lineChart(by("loop-chart")), drive = lineChart(by("loop-u-chart"));
  let targets = about.run.target, aiming = null, aimed = "";
  // What is shown: the settings and the steps of one run, which of them, its request until it has ended, the
  // timer while it plays. Null: what the first tab shows.
  let run = null;

  const unitOf = (name) => about.sensors.find((each) => each.name === name).unit;
  const channelOf = (name) => channels.find((each) => each.name === name);
  const settings = () => run?.settings ?? chosen;
  const steps = () => run?.steps ?? [];
  const measured = (step) => step.reading?.estimates[settings().sensor]?.value;
  const changed = () => document.dispatchEvent(new CustomEvent("changed"));
  const target = html("div", {});
  let targetSlider = null;
  const start = html("button", { type: "submit", class: "main" }, "Run");

  function list(label, options, key, then = () => {}) {
    return pick(label, options, chosen[key], (name) => { chosen[key] = name; then(); changed(); });
  }

  function build() {
    const names = (each) => each.map((name) => ({ name, label: name }));
    const another = () => { chosen.target = null; untilRun(); offerTarget(); aim(); };
    const gain = slider({ ...about.run.gain, start: chosen.gain }, (to) => { chosen.gain = to; changed(); });
    const offer = () => { gain.element.hidden = chosen.law !== "proportional"; };
    by("loop-settings").replaceChildren(
      list("Sensor", names(about.controllable), "sensor", another),
      ...(channels.length > 1 ? [list("Channel", names(channels.map(({ name }) => name)), "channel", another)] : []),
      target, list("Law", about.run.laws, "law", offer), gain.element,
      list("Measured by", about.run.measured, "measured"), list("Disturbance", about.run.disturbances, "disturbance"), start);
    offer();
    offerTarget();
  }

  const targetLimits = () => ({ ...targets, start: chosen.target ?? targets.start });

  function offerTarget() {
    const spec = { ...targetLimits(), label: `Target ${chosen.sensor}`, unit: unitOf(chosen.sensor) };
    targetSlider = slider(spec, (to) => { chosen.target = to; changed(); });
    target.replaceChildren(targetSlider.element);
  }

  /** Between which limits the target may lie: the path of the sensor over the channel tells. */
  async function aim() {
    aiming?.abort();
    aiming = new AbortController();
    const asked = { view: { ...view, drive: [] }, channel: chosen.channel, sensor: chosen.sensor };
    const key = JSON.stringify([view.design, asked.channel, asked.sensor]);
    if (key === aimed) return;
    try {
      targets = { ...about.run.target, ...(await ask("/api/path", asked, aiming.signal)).target };
      aimed = key;
      if (chosen.target < targets.low || chosen.target > targets.high) chosen.target = null;
      targetSlider.limit(targetLimits());
    } catch (error) {
      if (error.name !== "AbortError") problem(error.message);
    }
  }

  /** Settings from the page's address. */
  function apply(wanted) {
    Object.assign(chosen, wanted);
    aimed = "";
    build();
    untilRun();
  }

  /** Until something has run, titles and axes are those of the next run. */
  function untilRun() {
    if (run) return;
    titles();
    controls();
  }

  async function begin() {
    end();
    const own = run = { settings: { ...chosen, target: chosen.target ?? targets.start }, steps: [], at: 0, timer: 0, request: new AbortController() };
    titles();
    show(0);
    by("loop-note").textContent = chosen.law === "scheduled" ? "The scheduled law solves the paths of this system first, which takes seconds …" : "";
    try {
      for await (const step of lines("/api/trial", { view: { ...view, drive: [] }, ...own.settings }, own.request.signal)) {
        if (step.error) throw new Error(step.error);
        if (own !== run) return;
        own.steps.push(step);
        if (own.steps.length === 1) play();
        else controls();
      }
      problem();
    } catch (error) {
      if (own === run) { problem(error.message); by("loop-note").textContent = `Not run: ${error.message}`; }
    } finally {
      own.request = null;
      if (own === run) controls();
      document.dispatchEvent(new CustomEvent("run"));
    }
  }

  /** What was shown until now neither plays nor arrives any more. */
  function end() {
    pause();
    run?.request?.abort();
    run = null;
  }

  function titles() {
    for (const each of document.querySelectorAll(".loop-sensor")) each.replaceChildren(...named(settings().sensor));
    for (const each of document.querySelectorAll(".loop-channel")) each.replaceChildren(...named(settings().channel));
  }

  function play() {
    const own = run, last = () => own.steps.length - 1;
    if (own.at === last() && !own.request) own.at = 0;
    own.timer = setInterval(() => {
      if (own.at === last() && !own.request) pause();
      else show(Math.min(own.at + 1, last()));
    }, PERIOD);
    show(own.at);
  }

  function pause() {
    if (!run) return;
    clearInterval(run.timer);
    run.timer = 0;
    controls();
  }

  function picture(data, words) {
    by("loop-image").hidden = !data;
    by("loop-lost").hidden = !!data;
    by("loop-image").alt = words;
    if (data) by("loop-image").src = `data:image/png;base64,${data}`;
  }

  /** One step of the run; before the first, what the first tab shows. */
  function show(at) {
    run.at = at;
    const step = run.steps[at], { sensor, channel } = run.settings, unit = unitOf(sensor);
    const words = step ? {
      target: quantity(step.target, unit), true: quantity(step.readings[sensor], unit),
      measured: measured(step) === undefined ? "none" : quantity(measured(step), unit),
      u: quantity(step.command, channelOf(channel).unit, digitsOf(channelOf(channel).step)),
      guard: step.guard ? step.guard.state : "no guard",
      note: step.guard ? `Guard: ${step.guard.cause}.` : "The paper's law has no guard.",
    } : { target: "–", true: "–", measured: "–", u: "–", guard: "–", note: "" };
    for (const [name, each] of Object.entries(words)) by(`loop-${name}`).textContent = each;
    by("loop-guard").className = `state ${step?.guard?.state ?? ""}`;
    if (step) {
      pose.draw(step.scene);
      picture(step.image, `Camera image at ${step.time.toFixed(1)} s`);
    } else showFirst();
    controls();
  }

  function showFirst() {
    if (!seen()) return;
    pose.draw(seen().scene);
    picture(seen().image, "Camera image");
  }

  /** Buttons, time and charts: they change with every step that arrives. */
  function controls() {
    const step = steps()[run?.at], words = step ? `${step.time.toFixed(1)} s` : "–";
    start.textContent = run?.request ? "Working …" : "Run";
    by("play").textContent = run?.timer ? "Pause" : "Play";
    by("play").disabled = by("time").disabled = by("save-run").disabled = !step;
    by("time").max = Math.max(0, steps().length - 1);
    by("time").value = run?.at ?? 0;
    by("time").setAttribute("aria-valuetext", words);
    by("time-value").textContent = words;
    charts();
  }

  function charts() {
    const shown = steps(), { sensor, disturbance } = settings(), unit = unitOf(sensor), channel = channelOf(settings().channel);
    const end = Math.max(6, shown.at(-1)?.time ?? 0), step = shown[run?.at], cursor = step?.time;
    const values = shown.flatMap((each) => [each.readings[sensor], each.target, measured(each) ?? 0]);
    const wrong = ["none", "softer"].includes(disturbance) ? [] : [{ kind: "wrong", from: 2, to: 3 }];
    by("wrong-key").hidden = !wrong.length;
    value({
      labels: ["time [s]", `${sensor} [${unit}]`],
      x: [0, end], y: scaled(Math.min(0, ...values), Math.max(0.1, ...values) * 1.02), cursor, bands: wrong,
      series: [
        { kind: "target", points: shown.map((each) => [each.time, each.target]), steps: true },
        { kind: "true", points: shown.map((each) => [each.time, each.readings[sensor]]) },
        { kind: "measured", points: shown.map((each) => [each.time, measured(each) ?? null]) },
      ],
      words: step ? `${quantity(step.readings[sensor], unit)} for a target of ${quantity(step.target, unit)} at ${cursor} s` : "",
    });
    const all = shown.map((each) => each.command);
    drive({
      labels: ["time [s]", `${channel.name} [${channel.unit}]`],
      x: [0, end], y: scaled(Math.min(0, ...all), Math.max(Math.abs(channel.peak) / 4, ...all)), cursor,
      bands: [...wrong, ...bands()],
      series: [{ kind: "ink", points: shown.map((each) => [each.time, each.command]), steps: true }],
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
    for (const step of steps()) {
      const kind = step.guard?.state, last = found.at(-1);
      if (!kind || kind === "normal") continue;
      if (last?.kind === kind && step.time - last.to < 0.01) last.to = step.time + 0.1;
      else found.push({ kind, from: step.time, to: step.time + 0.1 });
    }
    return found;
  }

  function table() {
    const { sensor, channel } = run.settings, unit = unitOf(sensor);
    const head = `time [s],target [${unit}],${sensor} true [${unit}],${sensor} measured [${unit}],${channel} [${channelOf(channel).unit}],guard,cause\n`;
    return head + run.steps.map((step) => [step.time, step.target, step.readings[sensor], measured(step) ?? "", step.command,
      step.guard?.state ?? "", `"${(step.guard?.cause ?? "").replaceAll('"', '""')}"`].join(",")).join("\n") + "\n";
  }

  document.addEventListener("tab", (event) => { if (event.detail === "loop") aim(); });
  document.addEventListener("shown", () => { if (!steps().length) showFirst(); });
  by("loop-settings").addEventListener("submit", (event) => { event.preventDefault(); begin(); });
  by("play").addEventListener("click", () => (run.timer ? pause() : play()));
  by("time").addEventListener("input", () => { const at = Number(by("time").value); pause(); show(at); });
  by("save-run").addEventListener("click", () => download(new Blob([table()], { type: "text/csv" }), "exosight-run.csv"));
  return { apply, chosen };
}
