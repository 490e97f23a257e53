"""
Your own rig
============

From an empty folder to a closed loop on a device whose modulus, joint, camera and surface differ from the
model: pictures at known pressures, identification, a network for the identified system, and control through
a camera and a valve on a serial line. The rig is simulated, behind the interfaces of a real one: a source of
pictures and a pseudo-terminal.
"""

# %%
# The rig
# -------
#
# A short rod above one hinged link. What is known beforehand is a system file with rough numbers.

import os
import pty
import select
import tempfile
from pathlib import Path

import cv2
import numpy as np

folder = Path(tempfile.mkdtemp())
(folder / "rough.toml").write_text("""
format = 1
name = "lever"
rods.actuator = { length = "60 mm", radius = { formula = "6 - 2*X", unit = "mm" }, young = "300 kPa", \
elements = 2, points_per_element = 3, position = ["0 mm", "0 mm", "16 mm"] }
links.bone = { length = "50 mm", radius = ["10 mm", "8 mm"], \
joint = { type = "revolute", stiffness = "0.05 N m/rad" } }
surfaces.skin = { type = "tube", bodies = ["bone"], shade = 0.7 }
surfaces.rubber = { type = "tube", bodies = ["actuator"], shade = 0.25 }
contacts.press = { first = "rubber", second = "skin" }
actuators.p = { type = "pressure_line", body = "actuator", range = ["0 kPa", "60 kPa"], gain = "0.05 N/kPa" }
sensors.pad = { type = "contact_force", surface = "skin", at = "25 mm", estimated = true }
cameras.side = { centre = ["35 mm", "0 mm"], pixel = "1.5 mm", roll = "0 deg", width = 64, height = 64 }
""")

# %%
# The hardware. Nothing below reads its numbers; there is a picture of its camera, a load cell, and a valve
# that takes volts from a serial line and closes where no line has come for half a second. Its driver is
# :class:`exosight.control.line_receiver.LineReceiver`; a microcontroller needs the same few lines.

from exosight.control.line_receiver import LineReceiver
from exosight.control.simulated import SimulatedPlant
from exosight.system.build import build
from exosight.system.file import describe, read_system_file, replaced

VOLTS, KILOPASCALS = np.array([1.0, 4.0, 9.0]), np.array([0.0, 20.0, 60.0])
rough = read_system_file(folder / "rough.toml")


class Rig:
    """Quasi-static hardware with a clock that it keeps itself."""

    def __init__(self):
        true = {
            "rods.actuator.young": "380 kPa",
            "links.bone.joint.stiffness": "0.035 N m/rad",
            "cameras.side.centre.0": "32 mm",
            "cameras.side.centre.1": "2 mm",
            "cameras.side.pixel": "1.56 mm",
            "cameras.side.roll": "3 deg",
        }
        self._plant = SimulatedPlant(build(describe(replaced(rough, true))))
        self._random = np.random.default_rng(0)
        self._weave = 4 * np.sin(np.arange(64) / 1.7)[:, None] * np.sin(np.arange(64) / 2.3)
        self._serial, self._device = pty.openpty()
        self.time = 0.0
        self.valve = LineReceiver("voltage", "V", silence=0.5, released=1.0, now=lambda: self.time)
        self.port = os.ttyname(self._device)
        self._seen = self._plant.reset()

    def sleep(self, seconds):
        self.time += seconds

    def set_pressure(self, kilopascals):
        self._seen = self._plant.apply(np.array([kilopascals]))

    def look(self):
        """The valve follows its line, the rig comes to rest, the camera looks."""
        wait = 1.0  # a line may take a moment …
        while select.select([self._serial], [], [], wait)[0]:
            self.valve.take(os.read(self._serial, 4096))
            wait = 0.05  # … and another may follow
        self.set_pressure(float(np.interp(self.valve.value, VOLTS, KILOPASCALS)))
        return self.picture()

    def picture(self):
        """With a woven surface, uneven light and noise, none of which the model has."""
        light = np.linspace(1.0, 0.97, 64)
        noise = self._random.normal(scale=1.5, size=(64, 64))
        dark = self._seen.image < 200
        return np.clip(self._seen.image * light + self._weave * dark + noise, 0, 255).astype(np.uint8)

    def load_cell(self):
        return float(self._seen.outputs[0])


rig = Rig()

# %%
# Pictures at known pressures
# ---------------------------

pressures = np.linspace(5, 55, 6)
rows = ["picture,p [kPa],pad [N]"]
(folder / "pictures").mkdir()
for k, pressure in enumerate(pressures):
    rig.set_pressure(pressure)
    cv2.imwrite(str(folder / "pictures" / f"img_{k}.png"), rig.picture())
    reading = f"{rig.load_cell():.4f}" if k == 4 else ""  # the load cell was there once
    rows.append(f"img_{k}.png,{pressure:.2f},{reading}")
(folder / "loads.csv").write_text("\n".join(rows))

# %%
# Identification
# --------------
#
# The same as ``exosight identify pictures --loads loads.csv --system rough.toml --out my_rig.toml``.

import tomli_w

from exosight.rig.identification.files import open_pictures, read_measurements
from exosight.rig.identification.result import identify
from exosight.rig.table import read_table

nominal = build(describe(rough))
pictures, loads = open_pictures(folder / "pictures"), read_table(folder / "loads.csv")
measured = read_measurements(pictures, loads, nominal, masks=False)
found = identify(rough, measured, known_gains=False)
for each in found.estimates:
    print(f"{each.entry}: {each.value:.4g} ({each.low:.4g} to {each.high:.4g}) {each.unit}")
(folder / "my_rig.toml").write_text(tomli_w.dumps(found.named("my_rig")))

# %%
# A network of that rig
# ---------------------
#
# ``exosight generate --system my_rig.toml`` draws rigs within the intervals; ``exosight train`` learns to
# read them. A demonstration: an accurate network needs some hundred designs.

from exosight.app.data import divided, load
from exosight.app.pipeline import fit
from exosight.control import OnnxEstimator
from exosight.dataset.generation import GenerateConfig, generate
from exosight.learning import TrainConfig

DESIGNS, FRAMES, EPOCHS = 30, 16, 20

config = GenerateConfig(system=str(folder / "my_rig.toml"), designs=DESIGNS, frames=FRAMES)
generate(config, folder / "data")
data = load(folder / "data")
split = divided(data, "design", 0, None)
fit(data, split, TrainConfig(epochs=EPOCHS, threads=1), folder / "network", resume=False)
network = OnnxEstimator.load(folder / "network" / "model.onnx")

# %%
# The loop
# --------
#
# The valve takes volts: a calibration, volts against the pressure that the channel is in, turns one into the
# other, and keeps the controller within its range. The same as ``exosight live --source 0 --system
# my_rig.toml --model network/model.onnx --send /dev/ttyUSB0 --actuator valve.csv``, but that the rig brings
# its own clock.

from exosight.control import Guarded, Scheduled
from exosight.control.actuator_curve import read_actuator_curve, within_curve
from exosight.control.actuators import Lines
from exosight.control.realtime import Clock, run_live
from exosight.control.sources import Frame
from exosight.control.tuning import tune

(folder / "valve.csv").write_text("voltage [V],p [kPa]\n1,0\n4,20\n9,60\n")
system = build(describe(read_system_file(folder / "my_rig.toml")))
curve = read_actuator_curve(folder / "valve.csv", system.schema.channel())
controller = tune(within_curve(system, "p", curve))
target = 0.6 * float(controller.loading.controlled[-1])
steps, true = [], []


def frames():
    while True:
        image = rig.look()
        true.append(rig.load_cell())
        yield Frame(image, rig.time)


guarded = Guarded(Scheduled(controller))
lines = Lines.open(rig.port, curve.name, curve.unit, curve.at)
clock = Clock(now=lambda: rig.time, sleep=rig.sleep)
run_live(frames(), network.read, guarded, lines, [target] * 30, steps.append, clock)
error = abs(np.mean(true[-10:]) / target - 1)
print(f"target {target:.3f} N, load cell {np.mean(true[-10:]):.3f} N: off by {100 * error:.0f} %")
print(f"lines lost {rig.valve.missed}, refused {rig.valve.refused}")

# %%
# A program that stops sends nothing: the valve closes by itself.

lines.apply(30.0)
rig.look()
held = rig.valve.value
rig.sleep(0.6)
print(f"valve at {held:.2f} V; after 0.6 s without a line at {rig.valve.value:.2f} V")
lines.close()

# %%
from matplotlib.figure import Figure

figure = Figure(figsize=(6, 3), layout="constrained")
axes = figure.subplots()
times = [step.time for step in steps]
axes.plot(times, true[: len(times)], color="black", label="load cell")
axes.plot(times, [step.measurement.sum(controller.weights) for step in steps], "--", label="network")
axes.axhline(target, color="gray", linewidth=0.8, label="target")
axes.set(xlabel="time [s]", ylabel="force on the pad [N]")
axes.legend(frameon=False)
