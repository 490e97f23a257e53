"""
Closed loop
===========

The paper's law, and a gain-scheduled controller with a guard that releases when the camera fails.
"""

# %%
# The paper's law
# ---------------
#
# u_k = u_{k−1} + K_P e_k. With the true force as sensor no network is needed, and the response is that of the
# plant alone: before 0.30 N the exosuit snaps, and the force overshoots.

import numpy as np
from matplotlib.figure import Figure

from exosight.control import (
    CONTROL_SHAPE,
    Guarded,
    Measurement,
    OnnxEstimator,
    Proportional,
    Scheduled,
    hold,
    hold_and_release,
    measurement_from,
    run,
    run_guarded,
    true_reading,
)
from exosight.control.estimator import DEFAULT_MODEL
from exosight.control.simulated import SimulatedPlant
from exosight.exosuit.assembly import Exosuit
from exosight.exosuit.published import published

system = published(Exosuit(CONTROL_SHAPE))
plant = SimulatedPlant(system)
plain = run(plant, Proportional(5.0, plant.schema.channels[0]), true_reading(), hold(0.30, 20))
print(f"largest force on the way to 0.30 N: {plain.true.max():.3f} N")

# %%
# Tuning by simulation
# --------------------
#
# ``tune`` computes the loading and unloading branches: gains follow from the slopes, limits from the contact
# forces; targets inside a jump have no steady state, whatever the law.

from exosight.control.tuning import tune

config = tune(system, contact_limit=0.5, rate=10.0)
for before, after in config.loading.jumps:
    print(f"with u rising F_net jumps from {before:.3f} N to {after:.3f} N")
print(f"u stays within {config.unloading.u[-1]:.1f}…{config.loading.u[-1]:.2f} N")

# %%
# Guarded control from images
# ---------------------------
#
# The shipped network estimates the forces in each image, and the guard checks the estimate: OOD score,
# width of the intervals, frozen images.

network = OnnxEstimator.load(DEFAULT_MODEL)
guarded = Guarded(Scheduled(config))
record = run_guarded(plant, guarded, measurement_from(network), hold_and_release(0.25, 15))
print(f"F_net held: true {record.true[14]:.3f} N, after the release {record.true[-1]:.3f} N")
print(f"changes of state: {len(guarded.log)}")

# %%
# Camera failure
# --------------
#
# From step 10 on there are no frames. The guard holds, and then releases without feedback, within a second.

sense, steps = measurement_from(network), iter(range(1000))


def failing(observation):
    return sense(observation) if next(steps) < 10 else Measurement(commands=observation.commands)


failed = run_guarded(plant, guarded, failing, hold(0.25, 25))
for change in guarded.log:
    print(f"step {change.step}: {change.before.value} → {change.after.value}, {change.cause}")
print(f"F_net at the end: {failed.true[-1]:.3f} N")

# %%
figure = Figure(figsize=(7.0, 3.6), layout="constrained")
for ax, shown, title in zip(
    figure.subplots(1, 2, sharey=True),
    (record, failed),
    ("held and released", "no frame after 1 s"),
    strict=True,
):
    ax.plot(shown.time, shown.target, "--", color="#999999", label="target")
    ax.plot(shown.time, shown.true, "o-", color="#0072B2", markersize=3, label="true F_net")
    seen = np.isfinite(shown.estimated)
    ax.plot(shown.time[seen], shown.estimated[seen], "x", color="#D55E00", markersize=4, label="estimated")
    ax.set(xlabel="time [s]", ylabel="force [N]", title=title)
    ax.spines[["top", "right"]].set_visible(False)
ax.legend(frameon=False)

# %%
# Limitations, and the parameters of the guard: :doc:`/control`.
