// The third tab: an uploaded image.

import { upload } from "./api.js";
import { sensorTable } from "./charts.js";
import { by, fixed, quantity } from "./svg.js";

export function estimate({ system, sensors, controlled, pixels }) {
  const table = sensorTable(by("file-sensors"), sensors, { truth: false, estimates: true });
  const { unit } = sensors.find(({ name }) => name === controlled);
  by("network-system").textContent = system;
  by("network-size").textContent = pixels.join(":");
  const drop = by("drop");

  async function take(picture) {
    if (!picture) return;
    by("file-problem").hidden = true;
    try {
      const found = await upload(picture);
      by("file-image").src = `data:image/png;base64,${found.image}`;
      by("file-image").alt = `${picture.name}, gray, ${pixels.join(" by ")} pixels`;
      const { estimates, ood_score: score } = found.reading;
      table(null, estimates);
      const strange = score > 1;
      by("verdict").className = `verdict ${strange ? "bad" : ""}`;
      by("verdict").textContent = strange
        ? `Do not trust these estimates: the image is out of distribution (OOD score ${fixed(score, 2)}, trusted up to 1).`
        : `${controlled} ${quantity(estimates[controlled].value, unit)}; the image is within the training distribution (OOD score ${fixed(score, 2)}).`;
      by("file-cause").textContent = `Guard, given this image: ${found.guard.state}; ${found.guard.cause}.`;
      by("result").hidden = by("file-result").hidden = false;
    } catch (error) {
      by("file-problem").textContent = `Not estimated: ${error.message}.`;
      by("file-problem").hidden = false;
      by("result").hidden = by("file-result").hidden = true;
    }
    document.dispatchEvent(new CustomEvent("estimated"));
  }

  by("file").addEventListener("change", () => { take(by("file").files[0]); by("file").value = ""; });
  drop.addEventListener("dragover", (event) => { event.preventDefault(); drop.classList.add("over"); });
  drop.addEventListener("dragleave", () => drop.classList.remove("over"));
  drop.addEventListener("drop", (event) => { event.preventDefault(); drop.classList.remove("over"); take(event.dataTransfer.files[0]); });
  // A file that misses the field must not replace the page.
  for (const name of ["dragover", "drop"]) document.addEventListener(name, (event) => event.preventDefault());
}
