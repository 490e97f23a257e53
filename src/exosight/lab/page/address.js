// The settings of the page in its address, behind "#": browsers send nothing of that to the server, and a
// token never stands there. What is read is held against what the system has.

const LONGEST = 8000;  // characters
const MOST_STOPS = 64;  // of a drive; the server takes no more
const TABS = ["explore", "loop", "estimate"];

const names = (list) => list.map(({ name }) => name);

/** What can stand in an address: its name, the field of `state` that it sets, what is allowed, and what is usual. */
function* entries(about, state) {
  const { view, run } = state;
  const one = (key, at, field, allowed, usual = allowed[0]) => ({ key, at, field, allowed, usual });
  const number = (key, at, { key: field, low, high, start }) => ({ key, at, field, low, high, usual: start });
  yield one("tab", state, "tab", TABS);
  yield one("sensor", state, "sensor", names(about.sensors), about.controlled);
  yield one("channel", state, "channel", names(about.channels));
  for (const { choice, sliders } of about.design) {
    if (choice) yield one(`design.${choice.key}`, view.design, choice.key, names(choice.options));
    const own = choice?.options.find(({ name }) => name === view.design[choice.key]).sliders ?? [];
    for (const spec of [...own, ...sliders]) yield number(`design.${spec.key}`, view.design, spec);
  }
  for (const spec of about.camera) yield number(`camera.${spec.key}`, view.camera, spec);
  yield one("camera.corruption", view.camera, "corruption", names(about.corruptions));
  yield one("loop.sensor", run, "sensor", about.controllable, about.controlled);
  yield one("loop.channel", run, "channel", names(about.channels));
  yield number("loop.target", run, { key: "target", low: 1e-9, high: 1e6, start: null });
  yield one("loop.law", run, "law", names(about.run.laws));
  yield number("loop.gain", run, about.run.gain);
  yield one("loop.measured", run, "measured", names(about.run.measured));
  yield one("loop.disturbance", run, "disturbance", names(about.run.disturbances));
}

function read(text, { key, allowed, low, high }) {
  const value = allowed ? text : text.trim() === "" ? NaN : Number(text);
  if (allowed ? allowed.includes(value) : value >= low && value <= high) return value;
  throw new Error(`${key}: expected ${allowed ? `one of ${allowed.join(", ")}` : `${low} to ${high}`}, got "${text.slice(0, 40)}"`);
}

/** The commands of one stop, such as "2.4", or "2.4_0.02" of two channels. */
function readStop(text, channels) {
  const parts = text.split("_");
  if (parts.length !== channels.length) throw new Error(`drive: expected ${channels.length} commands joined by "_", got "${text.slice(0, 40)}"`);
  return channels.map(({ name, low, high, step }, i) => {
    const value = read(parts[i], { key: `drive, ${name}`, low, high }), near = Math.round(value / step) * step;
    if (Math.abs(value - near) > 1e-6 * step) throw new Error(`drive, ${name}: expected multiples of ${step}, got "${parts[i].slice(0, 40)}"`);
    return value;
  });
}

/** All settings of the page: what it opens with if `text` is empty, what `text` says otherwise; an Error if it does not fit. */
export function readAddress(text, about) {
  const { design, drive, camera } = structuredClone(about.start);
  const state = { view: { design, drive, camera }, run: {} };
  if (text.length > LONGEST) throw new Error(`expected at most ${LONGEST} characters, got ${text.length}`);
  const given = new URLSearchParams(text.replace(/^#/, "")), empty = !text.replace(/^#/, "");
  const stops = given.getAll("drive");
  if (stops.length > MOST_STOPS) throw new Error(`drive: expected at most ${MOST_STOPS} stops, got ${stops.length}`);
  if (stops.length) state.view.drive = stops.map((stop) => readStop(stop, about.channels));
  given.delete("drive");
  if (!empty) state.view.design = {};  // what an address does not name is nominal, whatever the page opens with
  for (const entry of entries(about, state)) {
    const { key, at, field, usual } = entry;
    if (given.has(key)) at[field] = read(given.get(key), entry);
    else if (!empty || at[field] === undefined) at[field] = usual;
    given.delete(key);
  }
  for (const key of given.keys()) throw new Error(`${key.slice(0, 40)}: there is no such setting of ${about.system}`);
  return state;
}

/** The same as text: all that is not usual, and the drive. */
export function writeAddress(state, about) {
  const to = new URLSearchParams();
  for (const { key, at, field, usual } of entries(about, state)) if (at[field] !== usual) to.append(key, at[field]);
  const { drive } = state.view;
  for (const stop of drive.length ? drive : [about.channels.map(() => 0)]) to.append("drive", stop.join("_"));
  return `#${to}`;
}
