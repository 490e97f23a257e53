"""A viscoelastic rod that only stretches, towards a stop: a standard linear solid."""

import numpy as np

RIGIDITY, LENGTH, GAP, STIFFNESS = 300e3 * np.pi * 0.005**2, 0.08, 0.002, 20e3
SHARE, TAU = 0.4, 2.0
RATIO = SHARE / (1 - SHARE)
"""Stiffness of the relaxing spring over that of the one that stays."""

BAR = """
format = 1
name = "bar"

[rods.soft]                     # it only stretches
length = "80 mm"
radius = "5 mm"
young = "300 kPa"
relaxation = [{ share = 0.4, time = "2 s" }]
strains = ["stretch_x"]
elements = 1
points_per_element = 3

[links.stop]                    # 2 mm ahead of it
length = "10 mm"
radius = ["5 mm", "5 mm"]
position = ["92 mm", "0 mm", "0 mm"]

[surfaces.bar]
type = "tube"
bodies = ["soft"]

[surfaces.points]
type = "spheres"
bodies = ["soft"]

[surfaces.pad]
type = "spheres"
bodies = ["stop"]
at = [0.0]

[contacts.press]
first = "points"
second = "pad"
stiffness = "20 kN/m"

[actuators.u]
type = "pressure_line"
body = "soft"
range = ["-1 N", "3 N"]

[sensors.force]
type = "contact_force"
surface = "pad"
body = "stop"
estimated = true

[cameras.side]
centre = ["40 mm", "0 mm"]
pixel = "1 mm"
"""
