// The third tab: an uploaded image, or what a frame leaves of it.

import { asPng, upload } from "./api.js";
import { sensorTable } from "./charts.js";
import { cropFrame, fits } from "./crop.js";
import { zoneMap } from "./map.js";
import { by, quantity } from "./svg.js";

export function estimate({ network, scene }) {
  const { system, sensors, controlled, pixels } = network;
  const table = sensorTable(by("file-sensors"), sensors, { truth: false, estimates: true });
  const map = zoneMap(by("file-map"), scene, "estimated");
  const { unit } = sensors.find(({ name }) => name === controlled);
  by("network-system").textContent = system;
  by("network-size").textContent = pixels[0] === pixels[1] ? "square" : pixels.join(":");
  const drop = by("drop");

  const whole = by("whole"), frame = cropFrame(whole, pixels);
  let name = "", count = 0;

  /** What was chosen is estimated at once if the network can read it as it is; otherwise a part of it is chosen first. */
  async function take(file) {
    if (!file) return;
    const own = ++count;
    name = file.name;
    by("crop").hidden = by("result").hidden = by("file-result").hidden = by("file-problem").hidden = true;
    try {
      if (!await shown(file)) {  // TIFF: no browser shows it
        const png = await asPng(file);
        if (own === count) await shown(png);
      }
    } catch (error) {
      if (own === count) refuse(error);
      return;
    }
    if (own !== count) return;
    if (fits(whole, pixels)) return read(file);
    by("crop").hidden = false;
    frame.reset();
    by("frame").focus();
  }

  /** Puts an image under the frame; false if the browser cannot read it. */
  async function shown(picture) {
    URL.revokeObjectURL(whole.src);
    whole.src = URL.createObjectURL(picture);
    return whole.decode().then(() => true, () => false);
  }

  function refuse(error) {
    by("file-problem").textContent = `Not estimated: ${error.message}.`;
    by("file-problem").hidden = false;
    by("result").hidden = by("file-result").hidden = true;
    document.dispatchEvent(new CustomEvent("estimated"));
  }

  async function read(picture) {
    const own = ++count;
    by("file-problem").hidden = true;
    try {
      const found = await upload(picture);
      if (own !== count) return;
      by("file-image").src = `data:image/png;base64,${found.image}`;
      by("file-image").alt = `${name}, gray, ${pixels.join(" by ")} pixels`;
      const { estimates } = found.reading, { flagged, words } = found.trust;
      table(null, estimates);
      map.colour(Object.fromEntries(Object.entries(estimates).map(([sensor, { value }]) => [sensor, value])));
      by("verdict").className = `verdict ${flagged ? "bad" : ""}`;
      by("verdict").textContent = flagged
        ? `${words[0].toUpperCase()}${words.slice(1)}.`
        : `${controlled} ${quantity(estimates[controlled].value, unit)}; ${words}.`;
      by("file-cause").textContent = `Guard, given this image: ${found.guard.state}; ${found.guard.cause}.`;
      by("result").hidden = by("file-result").hidden = false;
    } catch (error) {
      if (own === count) refuse(error);
      return;
    }
    document.dispatchEvent(new CustomEvent("estimated"));
  }

  // The zones of a system that the network was not trained for have other names.
  if (!network.refusal) document.addEventListener("at-rest", (event) => map.place(event.detail));
  by("estimate-crop").addEventListener("click", async () => read(await frame.picture()));
  by("file").addEventListener("change", () => { take(by("file").files[0]); by("file").value = ""; });
  drop.addEventListener("dragover", (event) => { event.preventDefault(); drop.classList.add("over"); });
  drop.addEventListener("dragleave", () => drop.classList.remove("over"));
  drop.addEventListener("drop", (event) => { event.preventDefault(); drop.classList.remove("over"); take(event.dataTransfer.files[0]); });
  // A file that misses the field must not replace the page.
  for (const name of ["dragover", "drop"]) document.addEventListener(name, (event) => event.preventDefault());
}
