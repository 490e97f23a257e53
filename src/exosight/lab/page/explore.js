// The first tab: settings in, one view out. At most one view is on its way; what changes meanwhile goes next.

import { ask, file } from "./api.js";
import { lineChart, sensorTable } from "./charts.js";
import { group, pick, slider } from "./controls.js";
import { zoneMap } from "./map.js";
import { scene, tubeLegend } from "./scene.js";
import { by, digitsOf, download, fixed, html, named, quantity, round125, scoreWords, standalone } from "./svg.js";

const LONGEST_WAY = 48;  // stops; the server takes up to 64
const LONGEST_TRAIL = 400;  // points
const QUIET = 300;  // ms without a change until the whole path is asked for, and the numbers are spoken

export function explore(about, problem) {
  const { channels, sensors } = about;
  const view = {};  // what is asked for: design, drive and camera; `apply` fills it
  const chosen = {};  // what is charted: a sensor, and the place of a channel
  const pose = scene(by("pose"), about);
  const estimates = !about.network.refusal;
  const table = sensorTable(by("sensors"), sensors, { truth: true, estimates });
  const map = zoneMap(by("map"), about.scene, "true");
  const chart = lineChart(by("path"));
  const rows = channels.map(channelRow);
  // Where the pose stays above the settings, there is room for one group of them.
  const opened = matchMedia("(max-width: 46rem)").matches ? new Set([(about.design[0] ?? { name: "Camera" }).name]) : new Set([...about.design.map(({ name }) => name), "Camera"]);
  let busy = false, again = false, sent = 0, changes = 0, shown = null, path = null, trail = [], quiet = 0, stop = null, sweeping = 0, mapped = false;

  const now = () => view.drive.at(-1) ?? channels.map(() => 0);
  const here = () => now()[chosen.channel];
  const told = (i, value) => quantity(value, channels[i].unit, digitsOf(channels[i].step));
  const read = (name) => shown?.readings[name] ?? 0;
  const guessed = () => shown?.reading?.estimates[chosen.sensor.name]?.value;
  const others = (commands) => commands.filter((_, i) => i !== chosen.channel).join();
  /** What a path belongs to. */
  const pathKey = () => JSON.stringify([view.design, chosen.channel, chosen.sensor.name, others(now())]);
  const asked = () => ({ view, channel: channels[chosen.channel].name, sensor: chosen.sensor.name });

  async function update() {
    clearTimeout(quiet);
    document.dispatchEvent(new CustomEvent("changed"));
    if (busy) { again = true; return; }
    busy = true;
    do {
      again = false;
      sent = view.drive.length;
      const before = changes;
      try {
        const found = await ask("/api/view", view);
        if (before === changes) {
          // The server knows a shortest drive to the same pose; what was driven meanwhile goes on from there.
          view.drive = [...found.drive, ...view.drive.slice(sent)];
          sent = found.drive.length;
          trail.push({ commands: found.drive.at(-1) ?? channels.map(() => 0), readings: found.readings });
          if (trail.length > LONGEST_TRAIL) trail.shift();
        }
        show(found);
        problem();
      } catch (error) {
        problem(error.message);
        if (!shown && error.refused) document.dispatchEvent(new CustomEvent("refused", { detail: error.message }));
      }
    } while (again);
    busy = false;
    sent = 0;
    document.dispatchEvent(new CustomEvent("shown"));
    document.dispatchEvent(new CustomEvent("changed"));
  }

  function show(found) {
    shown = found;
    by("status").hidden = true;
    pose.draw(found.scene);
    by("image").src = `data:image/png;base64,${found.image}`;
    by("image").alt = `Camera image, ${about.scene.pixels.join(" by ")} pixels`;
    table(found.readings, found.reading?.estimates);
    map.colour(found.readings);
    facts();
    by("notes").hidden = !found.notes.length;
    by("notes").textContent = found.notes.length ? `Note: ${found.notes.join("; ")}.` : "";
    by("way").replaceChildren(...way(found.drive));
    by("command").value = found.command;
    drawPath();
    clearTimeout(quiet);
    quiet = setTimeout(rest, QUIET);
  }

  function facts() {
    const { name, unit } = chosen.sensor, value = guessed();
    by("value-true").textContent = quantity(read(name), unit);
    by("value-estimated").textContent = value === undefined ? "none" : quantity(value, unit);
    if (!shown.reading) return;
    const { ood_score: score } = shown.reading, { state, cause } = shown.guard;
    by("ood_score").textContent = `${scoreWords(score)}${score > 1 ? ", do not trust" : ""}`;
    by("guard").textContent = state;
    by("guard").className = `state ${state}`;
    by("guard-cause").textContent = `Guard, given this image: ${cause}.`;
  }

  /** The stops of a drive; a system of several channels names the one that moved. */
  function way(drive) {
    const one = channels.length === 1, words = [];
    let before = channels.map(() => 0);
    for (const stop of drive) {
      stop.forEach((value, i) => {
        if (value !== before[i]) words.push(one ? fixed(value, digitsOf(channels[i].step)) : `${channels[i].name} ${told(i, value)}`);
      });
      before = stop;
    }
    return [one ? `${["0", ...words].join(" → ")} ${channels[0].unit}` : ["rest", ...words].join(" → ")];
  }

  function drawPath() {
    const { name, unit } = chosen.sensor, channel = channels[chosen.channel], known = path?.key === pathKey() ? path : null;
    const visited = trail.filter(({ commands }) => others(commands) === others(now())).map(({ commands, readings }) => [commands[chosen.channel], readings[name]]);
    const value = guessed();
    const all = [...(known ? [...known.loading, ...known.unloading] : []), ...visited].map(([, y]) => y).concat(value ?? 0, 0);
    const most = Math.max(0.1, ...all), least = Math.min(0, ...all), step = round125((most - least) / 4);
    const series = known ? [{ kind: "up", points: known.loading }, { kind: "down", points: known.unloading }] : [];
    const marks = shown ? [{ kind: "here", x: here(), y: read(name) }] : [];
    if (shown && value !== undefined) marks.push({ kind: "there", x: here(), y: value });
    chart({
      labels: [`${channel.name} [${channel.unit}]`, `${name} [${unit}]`],
      x: [channel.low, channel.high], y: [Math.floor((least * 1.02) / step) * step, Math.ceil((most * 1.02) / step) * step],
      series: [...series, { kind: "trail", points: visited }], marks,
      words: shown ? `${quantity(read(name), unit)} at ${channel.name} = ${told(chosen.channel, here())}` : "",
    });
  }

  /** The zones' places are those of the system at rest, which it is asked for once. */
  async function drawMap() {
    mapped = true;
    try {
      const { scene: atRest } = await ask("/api/view", { ...view, drive: [] });
      map.place(atRest);
      document.dispatchEvent(new CustomEvent("at-rest", { detail: atRest }));
    } catch { mapped = false; }  // with the next view
  }

  async function rest() {
    const { name, unit } = chosen.sensor, value = guessed();
    by("spoken").textContent = [`${channels[chosen.channel].name} ${told(chosen.channel, here())}: ${name} ${quantity(read(name), unit)}`,
      ...(value === undefined ? [] : [`estimated ${quantity(value, unit)}`]), ...(shown.guard ? [`guard ${shown.guard.state}`] : [])].join(", ");
    if (!mapped) drawMap();
    const key = pathKey();
    if (path?.key === key || stop?.key === key) return;
    stop?.abort();
    stop = Object.assign(new AbortController(), { key });
    const own = stop, channel = channels[chosen.channel];
    by("path-note").textContent = "Solving the path up and down …";
    try {
      path = { ...await ask("/api/path", asked(), own.signal), key };
      const ends = [0, channel.peak, path.unloading.at(-1)[0]].map((each) => String(each).replace("-", "−")).join(" → ");
      by("path-note").textContent = `${path.loading.length + path.unloading.length - 1} equilibria, ${ends} ${channel.unit} in steps of ${path.step} ${channel.unit}; where the two differ the system has snapped. Thin: commands visited.`
        + (estimates ? " Open circle: estimate." : "") + (path.stable ? "" : " At some commands no stable pose was found.");
      drawPath();
    } catch (error) {
      if (error.name !== "AbortError") problem(error.message);
    } finally {
      if (stop === own) stop = null;
      document.dispatchEvent(new CustomEvent("path"));
    }
  }

  function driveTo(i, value) {
    const { step } = channels[i], next = Number((Math.round(value / step) * step).toPrecision(9));
    if (view.drive.length > LONGEST_WAY && !busy) view.drive = [];
    const last = now(), before = view.drive.at(-2) ?? channels.map(() => 0);
    const stopThere = last.map((each, k) => (k === i ? next : each));
    // Not yet sent, and further along the same move: one stop.
    const onward = last.every((each, k) => k === i || each === before[k]) && (next - last[i]) * (last[i] - before[i]) >= 0;
    if (view.drive.length > sent && onward) view.drive[view.drive.length - 1] = stopThere;
    else if (next !== last[i]) view.drive.push(stopThere);
    showCommands();
    update();
  }

  function channelRow(channel, i) {
    const id = `channel-${channel.name}`;
    const range = html("input", { type: "range", id, min: channel.low, max: channel.high, step: channel.step, "aria-describedby": "way-note" });
    const output = html("output", { id: `${id}-value`, for: id });
    range.addEventListener("input", () => driveTo(i, Number(range.value)));
    by("drive").append(html("div", { class: "channel" }, html("label", { for: id }, "Command ", ...named(channel.name)), range, output));
    return { range, output };
  }

  function showCommands() {
    now().forEach((value, i) => {
      rows[i].range.value = value;
      rows[i].range.setAttribute("aria-valuetext", told(i, value));
      rows[i].output.textContent = told(i, value);
    });
    const { peak } = channels[chosen.channel];
    by("sweep").textContent = sweeping ? "Stop" : "Drive up and down";
    by("falling").textContent = `falling from ${told(chosen.channel, peak)}`;
  }

  /** Another system: it is driven anew from rest, and its path is not known. */
  function redesigned(key, value) {
    view.design[key] = value;
    view.drive = [now()];
    anew();
  }

  function anew() {
    sent = 0;
    changes++;
    stop?.abort();
    trail = [];
    showCommands();
    update();
  }

  const designSliders = (specs) => specs.map((spec) =>
    slider({ ...spec, start: view.design[spec.key] }, (value) => redesigned(spec.key, value)).element);

  function kinds({ key, label, options }) {
    const chosenNow = options.find(({ name }) => name === view.design[key]);
    const choice = pick(label, options, view.design[key], (name) => {
      for (const { key: old } of chosenNow.sliders) delete view.design[old];
      for (const { key: other, start } of options.find((each) => each.name === name).sliders) view.design[other] = start;
      redesigned(key, name);
      build();
      by("settings").querySelector("select").focus();
    });
    return [choice, ...designSliders(chosenNow.sliders)];
  }

  function build() {
    const setCamera = (key, value) => { view.camera[key] = value; update(); };
    const cameraSliders = about.camera.map((spec) => slider({ ...spec, start: view.camera[spec.key] }, (value) => setCamera(spec.key, value)).element);
    by("settings").replaceChildren(
      ...about.design.map(({ name, choice, sliders }) => group(name, opened, ...(choice ? kinds(choice) : []), ...designSliders(sliders))),
      group("Camera", opened, ...cameraSliders, pick("Corruption", about.corruptions, view.camera.corruption, (name) => setCamera("corruption", name))));
  }

  /** Which sensor is charted over which channel. */
  function choices() {
    const sensor = pick("Sensor", sensors.map(({ name }) => ({ name, label: name })), chosen.sensor.name, (name) => {
      chosen.sensor = sensors.find((each) => each.name === name);
      rechosen();
    });
    const channel = pick("Channel", channels.map(({ name }) => ({ name, label: name })), channels[chosen.channel].name, (name) => {
      if (sweeping) sweep();
      chosen.channel = channels.findIndex((each) => each.name === name);
      rechosen();
    });
    by("choices").replaceChildren(sensor, ...(channels.length > 1 ? [channel] : []));
  }

  function rechosen() {
    title();
    showCommands();
    document.dispatchEvent(new CustomEvent("changed"));
    if (!shown) return;
    facts();
    drawPath();
    rest();
  }

  function title() {
    for (const each of document.querySelectorAll(".chosen-sensor")) each.replaceChildren(...named(chosen.sensor.name));
    by("path-title").replaceChildren(...named(chosen.sensor.name), " over ", ...named(channels[chosen.channel].name));
  }

  function sweep() {
    if (sweeping) { clearInterval(sweeping); sweeping = 0; showCommands(); return; }
    const { step, peak } = channels[chosen.channel], up = Math.sign(peak);
    let direction = here() === peak ? -up : up;
    sweeping = setInterval(() => {
      if (busy) return;
      const next = here() + direction * step;
      driveTo(chosen.channel, up > 0 ? Math.min(peak, Math.max(0, next)) : Math.max(peak, Math.min(0, next)));
      if (Math.abs(here() - peak) < step / 2) direction = -up;
      else if (Math.abs(here()) < step / 2 && direction === -up) sweep();
    }, 40);
    showCommands();
  }

  async function save(name, settings) {
    try { download(await file(`/api/save/${name}`, settings), `exosight-${name}`); } catch (error) { problem(error.message); }
  }

  by("settings").addEventListener("submit", (event) => event.preventDefault());
  by("sweep").addEventListener("click", sweep);
  by("save-figure").addEventListener("click", () => download(standalone(pose.drawing), "exosight-pose.svg"));
  by("save-picture").addEventListener("click", () => save("picture.png", view));
  by("save-readings").addEventListener("click", () => save("readings.csv", view));
  by("save-pose").addEventListener("click", () => save("pose.csv", view));
  by("save-path").addEventListener("click", () => save("path.csv", asked()));
  by("copy").addEventListener("click", async () => {
    by("command").select();
    try { await navigator.clipboard.writeText(by("command").value); by("spoken").textContent = "Copied"; } catch { /* it stays selected */ }
    by("copy").textContent = "Copied";
    setTimeout(() => { by("copy").textContent = "Copy"; }, 1200);
  });
  by("system").textContent = about.system;
  by("pose-legend").prepend(...tubeLegend(about));
  for (const each of document.querySelectorAll(".estimates")) each.hidden = !estimates;
  by("no-estimates").hidden = estimates;
  by("no-estimates").textContent = estimates ? "" : `${about.network.refusal[0].toUpperCase()}${about.network.refusal.slice(1)}.`;

  /** Settings from the page's address: a view, and what is charted of it. */
  function apply(wanted) {
    if (sweeping) sweep();
    Object.assign(view, wanted.view);
    chosen.sensor = sensors.find(({ name }) => name === wanted.sensor);
    chosen.channel = channels.findIndex(({ name }) => name === wanted.channel);
    build();
    choices();
    title();
    anew();
  }

  const state = () => ({ view, sensor: chosen.sensor.name, channel: channels[chosen.channel].name });
  return { view, seen: () => shown, apply, state };
}
